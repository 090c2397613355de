"""The commands `reindex`, and what the index says of all machines: `compare` and `tables`."""

from __future__ import annotations

from typing import Annotated

import typer

from gateway.cli.onward import next_step
from gateway.cli.options import JsonOption, SiteArgument, load_site
from gateway.cli.show import counted, echo, show_json


def reindex_command(site: SiteArgument, as_json: JsonOption = False) -> None:
    """Make the index of a site's runs anew; the run folders are the truth and are only read."""
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    store = store_of(tree, site)
    count = SiteIndex(tree, site, store).rebuilt()
    if as_json:
        show_json({"runs": count})
        return
    echo(f"{store.root}: {counted(count, 'run', 'runs')}")


def compare_command(
    site: SiteArgument,
    parameter: Annotated[str, typer.Argument(help="E, R, B, A or M of an axis, rms of the flank.")],
    subject: Annotated[str, typer.Option("--axis", help="The axis; flank for the tooth.")],
    before: Annotated[bool, typer.Option("--before", help="As found instead of as left.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare one error across the machines that the site's index knows: the newest figure of each, largest first."""
    from drivers.terms import shown
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    index = SiteIndex(tree, site, store_of(tree, site))
    found = index.compared(parameter, subject=subject, phase="before" if before else "after")
    if as_json:
        show_json({"machines": found})
        return
    for one in found:
        sure = "" if one["expanded"] is None else f" +- {one['expanded']:.3g}"
        figure = f"{one['value']:.3g}{sure} {shown(one['unit'])}"
        echo(f"{one['serial']:<20} {one['site']:<20} {figure:<22} {one['phase']:<7} {one['created_utc'][:10]}")
    if not found:
        echo(f"no machine has {parameter} of {subject}")


def tables_command(
    site: SiteArgument,
    serial: Annotated[str, typer.Option("--machine", help="One machine only, by its serial number.")] = "",
    as_json: JsonOption = False,
) -> None:
    """List the tables that should act in every machine of the index, by what was pushed: id and date of each."""
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    found = SiteIndex(tree, site, store_of(tree, site)).tables(serial=serial)
    if as_json:
        show_json({"tables": found})
        return
    for one in found:
        told = f"{one['serial']:<20} {one['site']:<20} "
        if one["problem"]:
            echo(told + one["problem"])
            continue
        switch = "on" if one["enabled"] else "off"
        echo(told + f"{one['name']:<12} {one['table_id']:<13} {one['utc'][:16].replace('T', ' ')} UTC  {switch}")
    if not found:
        echo("no table was pushed to " + (f"machine {serial}" if serial else "any machine"))
    else:
        next_step(f"verify-table {site}")
