"""The commands `approve`, `push`, `rollback`, `recover`, `tables verify` and `disable`: tables in the control."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.errors import DeviceError
from drivers.message import Message
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.terms import spoken
from gateway.cli.next_steps import (
    after_preview,
    after_push_preview,
    after_recovery,
    after_site_run,
    next_command,
    push_options,
    show_next,
    show_outcome,
)
from gateway.cli.options import (
    ApplyOption,
    JsonOption,
    MachineOption,
    PointsOption,
    RiskOption,
    RunArgument,
    SiteArgument,
    StoreOption,
    TablesOption,
    TakeOption,
    load_site,
    open_run,
)
from gateway.cli.output import echo, render_text, show_json, text_of
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end
from gateway.errors import StillOn
from gateway.say import Say

TableOption = Annotated[
    str, typer.Option("--axis", help=f"Machine axis, or a cross table: {spoken().name('cross', 'C1', 3)}.")
]


def approve_command(
    run_folder: RunArgument, axis: TableOption = "", store: StoreOption = Path("runs"), as_json: JsonOption = False
) -> None:
    """Show a stored proposal as `push` does, ask for the machine's name, and approve it for ten minutes."""
    from gateway.cli.next_steps import show_outcome
    from gateway.cli.output import echo, show_json
    from gateway.cli.progress import progress
    from gateway.store import Store
    from gateway.workflow.control.push import approve_plan, show_plan, signer_at_keyboard
    from gateway.workflow.run.folder import site_of

    folder = open_run(Store(store), run_folder, "proposal")
    with progress(quiet=as_json, folder=folder) as say:
        outcome = run_to_end(_with_clock(lambda clock: show_plan(folder, table=axis, clock=clock, say=say)))
    if not as_json:
        show_outcome(outcome, as_json=False)
    typed = typer.prompt(text_of("P-APPROVE-NAME"), err=True, default="", show_default=False).strip()
    signer, kept_by = signer_at_keyboard(folder, datetime.now(UTC), _prompt_secret)
    asked: dict[str, Any] = {"table": axis, "typed_name": typed, "signer": signer, "kept_by": kept_by}
    made = run_to_end(_with_clock(lambda clock: approve_plan(folder, clock=clock, **asked)))
    if as_json:
        plans = [{"plan_hash": one.plan_hash, "actor": one.actor, "expires_utc": one.expires_utc} for one in made]
        show_json({"approved": plans, **outcome.as_data()})
        return
    for one in made:
        echo(Message.of("S-APPROVED-BY", actor=one.actor, expires_utc=one.expires_utc, plan_hash=one.plan_hash[:12]))
    options = push_options(site_of(folder)[0].controller.driver, typed)
    show_next(f"push {run_folder} --store {store} {options}")


def rollback_command(
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
    setup_values: Annotated[
        bool, typer.Option("--setup-values", help="The set-up values handed over last in place of tables.")
    ] = False,
    store: StoreOption = Path("runs"),
    points: PointsOption = False,
    risk: RiskOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what the last push replaced, table by table; with --apply put all of it back. Exit 9: a table stays on."""
    from gateway.cli.next_steps import show_outcome
    from gateway.cli.progress import progress
    from gateway.workflow.control.rollback import roll_back_site

    site, path = _site_of(place, store)
    if setup_values:
        _roll_back_setup(site, path, machine, risk, apply=apply, as_json=as_json)
        return
    with progress(quiet=as_json, at=(site, path)) as say:
        asked: dict[str, Any] = {"table": axis, "apply": apply, "machine_name": machine, "say": say}
        outcome = run_to_end(_with_clock(lambda clock: roll_back_site(site, path, clock=clock, **asked)), at=path)
    against = {"refused_by": outcome.data.get("refused_by", ()), "site": path}
    dry = after_preview("rollback", place, axis, site.site.name, **against)
    onward = next_command("recovered", site=path) if apply else dry
    show_outcome(outcome, as_json=as_json, points=points, onward=onward)


def verify_table_command(
    site: SiteArgument,
    axis: TableOption = "",
    run: Annotated[str, typer.Option(help="Compare with this run's proposal instead; with --axis.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Compare the live tables (all that pushes left, or one) with the last committed push; exit code 9: one differs."""
    from gateway.cli.next_steps import show_outcome
    from gateway.cli.progress import progress
    from gateway.config import load_site
    from gateway.workflow.control.verify import verify_table
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "proposal") if run else None
    with progress(quiet=as_json, at=(tree, site)) as say:
        asked: dict[str, Any] = {"table": axis, "run": folder, "say": say}
        with exchange_files_for(PieceOfWork(f"verify-table {axis} {run}", "go-on", ends=True)):
            outcome = run_to_end(_with_clock(lambda clock: verify_table(tree, site, clock=clock, **asked)), at=site)
    rows = outcome.data.get("tables", [outcome.data])
    wrong = next((one["axis"] for one in rows if one.get("kind") != "as-approved"), axis)
    back = "unfinished" if outcome.data.get("unfinished") else "worse-axis"
    onward = (
        next_command(back, site=site, axis=spoken().axis_of(wrong)) if outcome.exit_code else f"audit verify {site}"
    )
    show_outcome(outcome, as_json=as_json, onward=onward)


def _prompt_secret(question: Any) -> str:
    from drivers.message import render

    return str(typer.prompt(render(question), err=True, default="", show_default=False, hide_input=True)).strip()


async def _with_clock(work: Any) -> Any:
    from drivers.clock import LoopClock

    return await work(LoopClock())


def _sentences(said: tuple[Message, ...]) -> str:
    """What was found, in the reader's language, each thought as a sentence."""
    return ". ".join(map(render_text, said))


def _site_of(place: str, store: Path) -> tuple[Any, Path]:
    """The site named by its file or by a run made at it."""
    from gateway.config import load_site
    from gateway.store import Store
    from gateway.workflow.run.folder import site_of

    if place.endswith(".toml"):
        return load_site(Path(place)), Path(place)
    return site_of(open_run(Store(store), place))


def push_command(
    run_folder: RunArgument,
    axis: TablesOption = None,
    points: PointsOption = False,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    risk: RiskOption = "",
    offline: Annotated[
        bool, typer.Option("--offline", help="Write programs for a person to carry to the control, then exit.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="With --offline: continue with the files that were brought back.")
    ] = False,
    setup_values: Annotated[
        str,
        typer.Option(
            metavar="PART",
            help="Hand over what this part's set-up values lack to the builder's cycle, in place of tables.",
            show_default=False,
        ),
    ] = "",
    step: Annotated[
        str,
        typer.Option(
            help="With --setup-values: a known step of x, dressing or swivel, to prove its sense.", show_default=False
        ),
    ] = "",
    before: Annotated[
        str,
        typer.Option(
            metavar="PART",
            help="With --setup-values: judge the step that was handed over after this part.",
            show_default=False,
        ),
    ] = "",
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Show a stored proposal's difference and every refusal; with --apply write it and measure again."""
    from gateway.approve import take_risk
    from gateway.store import Store
    from gateway.workflow.control.push import push_run
    from gateway.workflow.run.folder import site_of
    from gateway.workflow.run.push_context import push_by_files

    if setup_values:
        _hand_over(run_folder, store, setup_values, step, before, machine, risk, apply=apply, as_json=as_json)
        return
    folder = open_run(Store(store), run_folder, "proposal")
    asked: dict[str, Any] = {"apply": apply, "machine_name": machine, "tables": tuple(axis or ())}

    async def main(say: Say) -> Any:
        return await push_run(folder, clock=LoopClock(), say=say, **asked)

    with take_risk(risk), push_by_files(offline=offline, resume=resume):
        with progress(quiet=as_json, folder=folder) as say:
            outcome = run_to_end(main(say))
        tree, site = site_of(folder)
        options = push_options(tree.controller.driver, tree.site.name)
        looked = after_push_preview(outcome.data.get("refused_by", ()), outcome.run_folder, str(site), options)
        onward = after_site_run(outcome, site) if apply else looked
        show_outcome(outcome, as_json=as_json, points=points, onward=onward)


def recover_command(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    finish: Annotated[
        bool, typer.Option("--finish", help="Finish an interrupted rollback: the earlier tables become active.")
    ] = False,
    undo: Annotated[
        bool, typer.Option("--undo", help="Undo an interrupted rollback: the pushed tables stay active.")
    ] = False,
    take: TakeOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what an interrupted push or rollback left behind; with --apply put it right."""
    from gateway.broker import take_from_hung_gateway
    from gateway.workflow.control.rollback import recover_site

    if finish and undo:
        raise typer.BadParameter("choose one of --finish and --undo", param_hint="--finish, --undo")
    choice = "finish" if finish else "undo" if undo else "offered"
    tree = load_site(site)

    async def main(say: Say) -> Any:
        with take_from_hung_gateway(take), exchange_files_for(PieceOfWork("recover", "instead")):
            asked: dict[str, Any] = {"apply": apply, "machine_name": machine, "choice": choice}
            return await recover_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        findings = run_to_end(main(say), at=site)
    if as_json:
        show_json([finding.as_data() for finding in findings])
    for finding in findings if apply and not as_json else ():  # what was found was said before it was carried out
        echo(_sentences(finding.said_at_last))
    for finding in () if as_json or apply else findings:
        echo(_sentences(finding.said), colour="red" if finding.still_on else None, bold=finding.still_on)
    if not apply and any(finding.still_on for finding in findings):
        raise typer.Exit(StillOn.exit_code)
    if not findings and not as_json:
        echo(Message.of("S-PUSH-NONE-LEFT", name=tree.site.name))
    if not as_json:
        show_next(after_recovery(findings, str(site), tree.site.name, apply=apply))
    if any(finding.stands for finding in findings):
        raise typer.Exit(DeviceError.exit_code)


# ---- set-up values of the builder's cycle


def _hand_over(
    run: str, store: Path, part: str, step: str, before: str, machine: str, risk: str, *, apply: bool, as_json: bool
) -> None:
    """What a part lacks, a known step, or the judgement of one."""
    from gateway.approve import take_risk
    from gateway.cli.machine.tooth import show_lines
    from gateway.store import Store
    from gateway.workflow.control.setup_values import hand_over_run, prove_step

    if step and before:
        raise typer.BadParameter("give either --step or --before", param_hint="--step, --before")
    folder = open_run(Store(store), run, "part")
    if before:

        async def judge(clock: Any) -> Any:
            return prove_step(folder, before=before, after=part, clock=clock)

        show_lines(run_to_end(_with_clock(judge)), as_json=as_json)
        return

    async def main(say: Say) -> Any:
        asked: dict[str, Any] = {"part": part, "apply": apply, "machine_name": machine, "step": step}
        return await hand_over_run(folder, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, folder=folder) as say, take_risk(risk):
        outcome = run_to_end(main(say))
    show_lines(outcome, as_json=as_json)


def _roll_back_setup(site: Any, path: Path, machine: str, risk: str, *, apply: bool, as_json: bool) -> None:
    from gateway.approve import take_risk
    from gateway.cli.machine.tooth import show_lines
    from gateway.workflow.control.setup_values import roll_back_setup_site

    with progress(quiet=as_json, at=(site, path)) as say, take_risk(risk):
        asked: dict[str, Any] = {"apply": apply, "machine_name": machine, "say": say}
        outcome = run_to_end(_with_clock(lambda clock: roll_back_setup_site(site, path, clock=clock, **asked)), at=path)
    show_lines(outcome, as_json=as_json)


# ---- disable: one table off at any position of its axis


def disable_command(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="Machine axis that the table compensates.")],
    table: Annotated[
        str, typer.Option("--table", help=f"A cross table, {spoken().cross_key}3; else the axis' {spoken().own}.")
    ] = "",
    apply: ApplyOption = False,
    machine: MachineOption = "",
    take: TakeOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what a table does to its axis now; with --apply switch it off and read that back. Writes no value."""
    from drivers.clock import LoopClock
    from gateway.broker import take_from_hung_gateway
    from gateway.cli.next_steps import show_outcome
    from gateway.cli.progress import progress
    from gateway.cli.signals import run_to_end
    from gateway.config import load_site
    from gateway.workflow.control.disable import disable_site

    tree = load_site(site)
    asked: dict[str, Any] = {"axis": axis, "table": table, "apply": apply, "machine_name": machine}
    with progress(quiet=as_json, at=(tree, site)) as say:

        async def main() -> Any:
            with take_from_hung_gateway(take), exchange_files_for(PieceOfWork("disable", "instead")):
                return await disable_site(tree, site, clock=LoopClock(), say=say, **asked)

        outcome = run_to_end(main(), at=site)
    off = outcome.data["off"] if not apply else True
    dry = next_command("pushed", site=site)
    if not off:
        against = outcome.data["refused_by"]
        dry = after_preview("disable", str(site), axis, tree.site.name, table=table, refused_by=against)
    show_outcome(outcome, as_json=as_json, onward=f"recover {site}" if apply else dry)
