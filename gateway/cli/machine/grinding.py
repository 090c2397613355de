"""The command `grind`: one test part through the control, or what would be sent."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.onward import next_step
from gateway.cli.options import JsonOption, PartOption, SiteArgument, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end


def grind_command(
    site: SiteArgument,
    part: PartOption = "part",
    run: Annotated[str, typer.Option(help="Store it in this run: folder or id.", show_default=False)] = "",
    x_um: Annotated[
        float | None,
        typer.Option(help="Zero of the infeed, um; + cuts deeper. Default: the present value.", show_default=False),
    ] = None,
    c_arcsec: Annotated[
        float | None,
        typer.Option(help="Zero of the index axis, arcsec. Default: the present value.", show_default=False),
    ] = None,
    dressing_um: Annotated[
        float | None,
        typer.Option(
            help="Offset of the dressed profile along the wheel's axis, um. Default: the present value.",
            show_default=False,
        ),
    ] = None,
    machine: Annotated[
        str, typer.Option(help="The machine's name, typed to consent; without it nothing is sent.")
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Grind a test part with these set-up values; without --machine show its places and values only."""
    from gateway.config import load_site
    from gateway.store.machine_books import SetupBook
    from gateway.tooth import SetupValues
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.part_plan import gear_of_site

    tree = load_site(site)
    store = store_of(tree, site)
    now = SetupBook(store.root).current(tree.controller.serial, gear_of_site(tree, site).name)
    given = {"x_um": x_um, "c_arcsec": c_arcsec, "dressing_um": dressing_um}
    setup = SetupValues(**{**asdict(now), **{key: value for key, value in given.items() if value is not None}})
    folder = open_run(store, run) if run else None
    if machine:
        _grind(tree, site, part, setup, machine, folder, as_json=as_json)
    else:
        _show(tree, site, part, setup, f" --run {run}" if run else "", as_json=as_json)


def _grind(tree: Any, site: Path, part: str, setup: Any, machine: str, folder: Any, *, as_json: bool) -> None:
    from drivers.clock import LoopClock
    from gateway.workflow.tooth.grinding import grind_site

    async def main(say: Any) -> Any:
        asked = {"part": part, "setup": setup, "machine_name": machine, "run": folder}
        return await grind_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        made, used = run_to_end(main(say), at=site)
    if as_json:
        show_json({**asdict(made), "run_folder": str(used.path)})
        return
    echo(f"{made.part}: {made.spaces} spaces ground, {made.started_utc} to {made.ended_utc}")
    echo(f"run folder: {used.path}")
    next_step(f"inspect {site} --part {part} --run {used.path}")


def _show(tree: Any, site: Path, part: str, setup: Any, into: str, *, as_json: bool) -> None:
    """Where each axis goes, and what is set; the program itself with --json. Nothing is opened.

    ``into`` is the option of the run that the part goes into.
    """
    from drivers import registry
    from gateway.workflow.tooth.part_plan import entry_instructions, gear_of_site, grind_plan

    plan = grind_plan(tree, gear_of_site(tree, site), setup, part)
    name = f"{tree.controller.driver}-program"
    able = name in registry.known("program")
    text = registry.load(name, "program")(plan, tree.controller.settings, str(site)) if able else ""
    rows = [(axis.name, f"{place:.4f}") for axis, place in plan.places()]
    if as_json:
        places = [{"axis": axis, "place": float(place)} for axis, place in rows]
        values = asdict(setup)
        show_json({"setup": values, "places": places, "seconds": round(plan.seconds), "program": text, "able": able})
        return
    show_table("outermost places (mm, deg; machine coordinates)", ("axis", "place"), rows)
    echo(f"set-up values: x {setup.x_um:+.1f} um, C {setup.c_arcsec:+.1f} arcsec, dressing {setup.dressing_um:+.1f} um")
    echo(entry_instructions(tree.work, setup))
    if able:
        echo("the NC program: trueflank program --what grind, or --json here")
    echo(f"{plan.spaces} spaces, about {plan.seconds / 60.0:.0f} min; nothing was sent (--machine NAME grinds)")
    if able:
        next_step(f"grind {site} --part {part}{into} --machine {tree.site.name}")
    else:
        echo(f"driver {tree.controller.driver} runs no programs: this part cannot be ground over it")
        next_step(f"inspect {site} --part {part}{into}")
