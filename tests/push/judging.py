"""What must hold when a push has ended, whatever happened, and when its remains have been looked at and recovered."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import TrueflankError
from gateway.domain import PushRecord
from gateway.errors import RollbackFailed, VerifyError, WriteRefused
from gateway.push import PushContext, journal, look, outcome_error, recover, unfinished
from tests.push.oracle import Oracle


@dataclass
class Played:
    """One push with its faults: how it ended, what was wrong with that, and what became of it afterwards."""

    seed: int
    faults: list[str] = field(default_factory=list)
    outcome: str = ""
    recovered: str = ""
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        told = "; ".join(self.wrong)
        return f"seed {self.seed} ({', '.join(self.faults)}): {self.outcome}, then {self.recovered}: {told}"


async def ended(work: Awaitable[PushRecord]) -> str:
    """How a push ended, in a word; its error is of the kind that the outcome promises."""
    try:
        record = await work
    except asyncio.CancelledError:
        return "cancelled"
    except TrueflankError as error:
        return f"raised {error.code}"
    kinds: dict[str, Any] = {"refused": WriteRefused, "rolled-back": VerifyError, "held": RollbackFailed}
    assert isinstance(outcome_error(record), kinds.get(record.outcome, type(None)))
    return str(record.outcome)


def judge(oracle: Oracle, found: Played, said: list[str], context: PushContext) -> None:
    """What must hold the moment the push has ended; ``said`` are the codes it told people."""
    oracle.look("at the end")
    found.wrong += oracle.broken
    serial, outcome = context.machine.serial, found.outcome
    left = unfinished(context.journals, serial)
    if outcome == "committed" and not oracle.as_wanted:
        found.wrong.append("committed, but the new table is not on")
    if outcome == "rolled-back" and not (oracle.as_before or oracle.foreign):
        found.wrong.append("rolled back, but the old table is not as it was")
    if outcome in ("refused", "already-applied") and oracle.writes and not oracle.foreign:
        found.wrong.append(f"{outcome}, but {oracle.writes} values were written")
    if outcome == "held" and ("P-PUSH-HELD" not in said or [one.kinds[-1] for one in left] != ["HELD"]):
        found.wrong.append("held, but not said or not kept")
    over = outcome in ("committed", "rolled-back", "refused", "already-applied")
    if over and left:
        found.wrong.append(f"{outcome}, but the journal says {left[0].kinds[-1:]}")
    if (
        not over
        and outcome != "held"
        and not left
        and not (oracle.foreign or as_kept(oracle, context.journals, serial))
    ):
        found.wrong.append(f"{outcome}, nothing left open in the journal, but the machine is not as it says")


def as_kept(oracle: Oracle, journals: Path, serial: str) -> bool:
    """Whether the machine is as the last journal that ended says: a disk may fail after the last word is on it."""
    folder = journal.machine_folder(journals, serial)
    kept = [one.kinds[-1] for one in (*journal.all_of(folder / "done"), *journal.all_of(folder)) if one.kinds]
    return oracle.as_wanted if kept[-1:] == ["COMMITTED"] else oracle.as_before


async def settle(oracle: Oracle, context: PushContext, found: Played, *, willing: bool) -> None:
    """A fresh gateway on a sound machine: its finding is true, and what it offers leads home.

    ``willing``: control and people do what is asked of them, so nothing may be held.
    """
    serial = context.machine.serial
    journal.tidy(journal.machine_folder(context.journals, serial))
    left = unfinished(context.journals, serial)
    found.recovered = "" if left else "nothing open"
    for one in left:
        found.recovered += await _settled(oracle, one, context, found, willing=willing)
    oracle.look("after recovery")
    found.wrong += [words for words in oracle.broken if words not in found.wrong]


async def _settled(
    oracle: Oracle, one: journal.JournalRead, context: PushContext, found: Played, *, willing: bool
) -> str:
    writes, expected = oracle.writes, truth(oracle)
    finding = await look(one, context)
    if oracle.writes != writes:
        found.wrong.append("looking wrote")
    if finding.code != expected and not oracle.foreign:
        found.wrong.append(f"found {finding.words}, but it is {expected}")
    if finding.action == "none":
        return f"{finding.code} "
    try:
        record = await recover(one, context)
    except TrueflankError as error:
        found.wrong.append(f"the recovery failed: {error}")
        return f"{finding.code} failed "
    if record.outcome == "rolled-back" and not (oracle.as_before or oracle.foreign):
        found.wrong.append("recovered, but the old table is not as it was")
    if record.outcome == "held" and willing and not oracle.foreign:
        found.wrong.append(f"the recovery was held: {record.steps[-2:]}")
    return f"{finding.code} {record.outcome} "


def truth(oracle: Oracle) -> str:
    """What the machine's memory says a finding must be."""
    if oracle.as_before:
        return "R-PUSH-UNTOUCHED"
    if oracle.is_old():
        return "R-PUSH-DISABLED"
    if oracle.is_new():
        return "R-PUSH-ENABLED" if oracle.switched_on else "R-PUSH-WRITTEN"
    return "R-PUSH-HALF"
