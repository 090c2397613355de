"""The commands `approve`, `rollback` and `verify-table`: who agrees, what is taken back, what is live."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.terms import spoken
from gateway.cli.onward import after_dry, consent, next_step, step_of
from gateway.cli.options import (
    ApplyOption,
    JsonOption,
    MachineOption,
    PointsOption,
    RunArgument,
    SiteArgument,
    StoreOption,
    open_run,
)
from gateway.cli.stopping import run_to_end

TableOption = Annotated[
    str, typer.Option("--axis", help=f"Machine axis, or a cross table: {spoken().name('cross', 'C1', 3)}.")
]


def approve(
    run_folder: RunArgument, axis: TableOption = "", store: StoreOption = Path("runs"), as_json: JsonOption = False
) -> None:
    """Show a stored proposal as `push` does, ask for the machine's name, and approve it for ten minutes."""
    from gateway.cli.machine.running import show_outcome
    from gateway.cli.screen.telling import progress
    from gateway.cli.show import echo, show_json
    from gateway.store import Store
    from gateway.workflow.control.push import approve_plan, show_plan, signer_at_keyboard
    from gateway.workflow.run.folder import site_of

    folder = open_run(Store(store), run_folder, "proposal")
    with progress(quiet=as_json, folder=folder) as say:
        outcome = run_to_end(_main(lambda clock: show_plan(folder, table=axis, clock=clock, say=say)))
    if not as_json:
        show_outcome(outcome, as_json=False)
    typed = typer.prompt("type the machine's name to approve", err=True, default="", show_default=False).strip()
    signer, kept_by = signer_at_keyboard(folder, datetime.now(UTC), _secret)
    asked: dict[str, Any] = {"table": axis, "typed_name": typed, "signer": signer, "kept_by": kept_by}
    made = run_to_end(_main(lambda clock: approve_plan(folder, clock=clock, **asked)))
    if as_json:
        plans = [{"plan_hash": one.plan_hash, "actor": one.actor, "expires_utc": one.expires_utc} for one in made]
        show_json({"approved": plans, **outcome.as_data()})
        return
    for one in made:
        echo(f"approved by {one.actor} until {one.expires_utc}: plan {one.plan_hash[:12]}")
    options = consent(site_of(folder)[0].controller.driver, typed)
    next_step(f"push {run_folder} --store {store} {options}")


def rollback(
    place: Annotated[str, typer.Argument(metavar="SITE|RUN", help="Site file, or run.", show_default=False)],
    axis: Annotated[
        str,
        typer.Option(
            "--axis",
            help=f"Only what moves this machine axis, or one table: {spoken().name('cross', 'C1', 3)}; else all.",
        ),
    ] = "",
    apply: ApplyOption = False,
    machine: MachineOption = "",
    store: StoreOption = Path("runs"),
    points: PointsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say what the last push replaced, table by table; with --apply put all of it back. Exit 9: a table stays on."""
    from gateway.cli.machine.running import show_outcome
    from gateway.cli.screen.telling import progress
    from gateway.workflow.control.rollback import roll_back_site

    site, path = _site(place, store)
    with progress(quiet=as_json, at=(site, path)) as say:
        asked: dict[str, Any] = {"table": axis, "apply": apply, "machine_name": machine, "say": say}
        outcome = run_to_end(_main(lambda clock: roll_back_site(site, path, clock=clock, **asked)), at=path)
    against = {"refused_by": outcome.data.get("refused_by", ()), "site": path}
    dry = after_dry("rollback", place, axis, site.site.name, **against)
    onward = step_of("recovered", site=path) if apply else dry
    show_outcome(outcome, as_json=as_json, points=points, onward=onward)


def verify_table_command(
    site: SiteArgument,
    axis: TableOption = "",
    run: Annotated[str, typer.Option(help="Compare with this run's proposal instead; with --axis.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Compare the live tables (all that pushes left, or one) with the last committed push; exit code 9: one differs."""
    from gateway.cli.machine.running import show_outcome
    from gateway.cli.screen.telling import progress
    from gateway.config import load_site
    from gateway.workflow.control.verify import verify_table
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "proposal") if run else None
    with progress(quiet=as_json, at=(tree, site)) as say:
        asked: dict[str, Any] = {"table": axis, "run": folder, "say": say}
        with exchange_files_for(PieceOfWork(f"verify-table {axis} {run}", "go-on", ends=True)):
            outcome = run_to_end(_main(lambda clock: verify_table(tree, site, clock=clock, **asked)), at=site)
    rows = outcome.data.get("tables", [outcome.data])
    wrong = next((one["axis"] for one in rows if one.get("kind") != "as-approved"), axis)
    back = "unfinished" if outcome.data.get("unfinished") else "worse-axis"
    onward = step_of(back, site=site, axis=spoken().axis_of(wrong)) if outcome.exit_code else f"audit verify {site}"
    show_outcome(outcome, as_json=as_json, onward=onward)


def _secret(question: Any) -> str:
    from drivers.message import render

    return str(typer.prompt(render(question), err=True, default="", show_default=False, hide_input=True)).strip()


async def _main(work: Any) -> Any:
    from drivers.clock import LoopClock

    return await work(LoopClock())


def _site(place: str, store: Path) -> tuple[Any, Path]:
    """The site named by its file or by a run made at it."""
    from gateway.config import load_site
    from gateway.store import Store
    from gateway.workflow.run.folder import site_of

    if place.endswith(".toml"):
        return load_site(Path(place)), Path(place)
    return site_of(open_run(Store(store), place))
