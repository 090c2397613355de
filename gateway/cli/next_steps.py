"""What to type next: the last line of every result, from one table of states; and the result of a workflow itself."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from drivers.checks import CheckLine
from drivers.message import Message
from gateway.cli import output
from gateway.cli.output import NEXT, echo, show_json, show_table

NEVER_TESTED = frozenset({"W-DOC-UNTESTED", "W-OFF-UNSEEN"})
NEXT_COMMANDS: Mapping[str, str] = {
    "proposed": "push {run}",  # the look comes first
    "free": "push {run} {options}",
    "untested": "doctor self-test {site}",
    "unapproved": "approve {run}",
    "unfinished": "recover {site}",
    "outdated": "run {site}",
    "refused": "doctor {site}",
    "left": "recover {site} --apply --machine {machine}",
    "choose": "recover {site} (--finish | --undo) --apply --machine {machine}",
    "unread": "recover {site}",
    "recovered": "tables verify {site}",
    "in-part": "rollback {site}",
    "better": "tables verify {site}",
    "unchanged": "tables verify {site}",
    "committed": "tables verify {site}",
    "pushed": "tables verify {site}",
    "rolled-back": "tables verify {site}",
    "worse": "rollback {site}",
    "worse-axis": "rollback {site} --axis {axis}",
    "measured": "correct {site} --run {run}",
    "partly-measured": "measure {site} --resume {run}",
    "failed": "runs logs --run {id} --store {store}",
    "stopped": "runs logs --run {id} --store {store}",
    "to-measure": "measure {site} --plan",
    "to-connect": "day {folder} --site {site} --connect",
    "else": "runs show {id} --store {store}",
}
"""What a result leaves, and the command to go on with: a look never names itself, and nothing that was just done is
named again."""
STATE_BY_REFUSAL: Mapping[str, frozenset[str]] = {
    "unfinished": frozenset({"E-INT-UNFINISHED", "E-INT-MARKER", "E-INT-JOURNAL-MISSING"}),
    "untested": frozenset({"E-INT-NO-SELF-TEST", "E-INT-OTHER-SELF-TEST", "E-INT-SELF-TEST"}),
    "outdated": frozenset(
        {
            *("E-INT-AGE", "E-INT-DATE", "E-INT-LOST-UPDATE", "E-INT-NO-BASE", "E-INT-WARMTH", "E-INT-COVERAGE"),
            *("E-INT-INCOMPLETE", "E-INT-MEASURED", "E-INT-TEMPERATURE-MOVED", "E-INT-NOT-PROPOSED", "E-INT-REPEAT"),
        }
    ),
    "unapproved": frozenset({"E-INT-APPROVAL-MISSING", "E-INT-APPROVAL-EXPIRED", "E-INT-APPROVAL-USED"}),
}
"""Which refusals of a push lead where; the first that was met counts, any other is looked for by the doctor."""


def next_command(state: str, **known: object) -> str:
    """The command after a state; where what it names is not known, the run's own line."""
    told = {name: str(value) for name, value in known.items() if value not in ("", None)}
    if "run" in told:
        told |= {"id": Path(told["run"]).name, "store": str(Path(told["run"]).parent)}
    for text in (NEXT_COMMANDS.get(state, NEXT_COMMANDS["else"]), NEXT_COMMANDS["else"]):
        try:
            return text.format(**told)
        except KeyError:
            continue
    return ""


def show_next(command: str) -> None:
    """Say the next command."""
    echo(f"{NEXT}trueflank {command}")


def push_options(driver: str, machine: str) -> str:
    """The options of a push that writes, over the road that this driver has."""
    road = "--offline " if driver.endswith("-offline") else ""
    return f"{road}--apply --machine {machine}"


def after_run(state: str, folder: str, site: str, *, worse: Sequence[str] = ()) -> str:
    """After a run or a push: look at what was proposed, take back what got worse, look after what is live."""
    alone = state == "worse" and len(worse) == 1
    return next_command("worse-axis" if alone else state, run=folder, site=site, axis=next(iter(worse), ""))


def after_push_preview(refused_by: Collection[str], folder: str, site: str, options: str) -> str:
    """After a look at a proposal: the push itself, or what removes the reason against it."""
    return next_command(_refusal_state(refused_by) if refused_by else "free", run=folder, site=site, options=options)


def _refusal_state(refused_by: Collection[str]) -> str:
    """What a refusal of a look leaves."""
    return next((state for state, codes in STATE_BY_REFUSAL.items() if codes.intersection(refused_by)), "refused")


def after_recovery(findings: Collection[Any], site: str, machine: str, *, apply: bool) -> str:
    """After a recovery: what is offered is carried out, what could not be read is looked at again."""
    if any(finding.stands for finding in findings):
        state = "left"
    elif apply or not findings:
        state = "in-part" if any(getattr(finding, "rest", ()) for finding in findings) else "recovered"
    elif any(getattr(finding, "choices", ()) for finding in findings):
        state = "choose"
    else:
        state = "left" if any(finding.action != "none" for finding in findings) else "unread"
    return next_command(state, site=site, machine=machine)


def after_preview(
    command: str,
    place: str,
    axis: str,
    machine: str,
    *,
    table: str = "",
    refused_by: Collection[str] = (),
    site: object = "",
) -> str:
    """After saying what a command would do: the same with consent, of the very same table.

    Where something speaks against it, what removes the reason at this ``site``.
    """
    if refused_by:
        return next_command(_refusal_state(refused_by), site=site or place)
    only = (f" --axis {axis}" if axis else "") + (f" --table {table}" if table else "")
    return f"{command} {place}{only} --apply --machine {machine}"


def repeat_after_faults(command: str) -> None:
    """Say that faults were told above, and the command that looks again."""
    echo(Message.of("S-NEXT-CORRECT", command=command))


def after_doctor(lines: Collection[CheckLine], site: str) -> None:
    """Say what to type after the doctor: itself again after a fault, the self-test that nobody has made, or a run.

    What a road can never tell keeps nobody from a run.
    """
    outcomes = {line.outcome for line in lines}
    if "wrong" in outcomes:
        repeat_after_faults(f"doctor {site}")
    elif NEVER_TESTED.intersection(line.code for line in lines):
        show_next(f"doctor self-test {site}")
    elif "unknown" in outcomes:
        echo(Message.of("S-NEXT-CHECK", site=site))
    else:
        show_next(f"run {site}")


def _detail_count(details: tuple[Message, ...]) -> tuple[Message, ...]:
    """How many lines more there are: the report has them all."""
    return (Message.of("S-RUN-DETAILS", count=len(details)),) if details else ()


def show_outcome(outcome: Any, *, as_json: bool, points: bool = False, onward: str = "") -> None:
    """Print what a workflow handed back, and the command to go on with; end with its exit code."""
    if as_json:
        show_json(outcome.as_data())
    else:
        if outcome.rows:
            show_table(outcome.title, outcome.headings, outcome.rows)
        for point in outcome.points if points else ():
            echo(point)
        told = outcome.details if output.chosen_voice() is output.Voice.VERBOSE else _detail_count(outcome.details)
        for line in (*told, *outcome.lines[:-1], *outcome.places, *outcome.lines[-1:]):
            echo(line)
        if outcome.points and not points:
            echo(Message.of("S-RUN-POINTS"))
        if onward:
            show_next(onward)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def after_site_run(outcome: Any, site: Path) -> str:
    """The command to go on with after a run at this site."""
    return after_run(outcome.state, outcome.run_folder, str(site), worse=outcome.data.get("worse", ()))
