"""What to type next: the last line of every result."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from drivers.checks import CheckLine
from gateway.cli.show import NEXT, echo

NEVER_TESTED = frozenset({"W-DOC-UNTESTED", "W-OFF-UNSEEN"})
UNTESTED = frozenset({"E-INT-NO-SELF-TEST", "E-INT-OTHER-SELF-TEST", "E-INT-SELF-TEST"})
PUSHED = ("better", "unchanged", "committed", "pushed")


def next_step(command: str) -> None:
    """Say the next command."""
    echo(f"{NEXT}trueflank {command}")


def consent(driver: str, machine: str) -> str:
    """The options of a push that writes, over the road that this driver has."""
    road = "--offline " if driver.endswith("-offline") else ""
    return f"{road}--apply --machine {machine}"


def after_run(state: str, folder: str, site: str, options: str, *, worse: Sequence[str] = ()) -> str:
    """After a run or a push: consent to what was proposed, take back what got worse, look after what is live."""
    if state == "proposed":
        return f"push {folder} {options}"
    if state == "worse":
        return f"rollback {site} --axis {next(iter(worse), 'AXIS')}"
    return f"verify-table {site}" if state in PUSHED else f"runs show {Path(folder).name} --store {Path(folder).parent}"


def after_look(refused_by: Collection[str], folder: str, site: str, options: str) -> str:
    """After a look at a proposal: the push itself, the self-test it lacks, or the same look once no reason is left."""
    if UNTESTED.intersection(refused_by):
        return f"self-test {site}"
    return f"push {folder}" if refused_by else f"push {folder} {options}"


def after_recovery(findings: Collection[Any], site: str, machine: str, *, apply: bool) -> str:
    """After a recovery: what is offered is carried out, what could not be read is looked at again."""
    if any(finding.stands for finding in findings):
        return f"recover {site} --apply --machine {machine}"
    if apply or not findings:
        return f"verify-table {site}"
    offered = any(finding.action != "none" for finding in findings)
    return f"recover {site} --apply --machine {machine}" if offered else f"recover {site}"


def after_dry(command: str, place: str, axis: str, machine: str) -> str:
    """After saying what a command would do: the same with consent."""
    only = f" --axis {axis}" if axis else ""
    return f"{command} {place}{only} --apply --machine {machine}"


def repeat(command: str) -> None:
    """Say that faults were told above, and the command that looks again."""
    echo(f"next: correct what is wrong above, then trueflank {command}")


def after_doctor(lines: Collection[CheckLine], site: str) -> None:
    """Say what to type after the doctor: itself again after a fault, the self-test that nobody has made, or a run.

    What a road can never tell keeps nobody from a run.
    """
    outcomes = {line.outcome for line in lines}
    if "wrong" in outcomes:
        repeat(f"doctor {site}")
    elif NEVER_TESTED.intersection(line.code for line in lines):
        next_step(f"self-test {site}")
    elif "unknown" in outcomes:
        echo(f"next: check what it could not tell, then trueflank run {site}")
    else:
        next_step(f"run {site}")
