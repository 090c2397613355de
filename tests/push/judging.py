"""What must hold when a push has ended, whatever happened, and when its remains have been looked at and recovered."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import TrueflankError
from gateway.domain.outcomes import PushRecord
from gateway.errors import RollbackFailed, StillOn, VerifyError, WriteRefused
from gateway.push import journal, outcome_error
from gateway.push.context import PushContext
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.table_status import held_pushes
from tests.push.oracle import Oracle


@dataclass
class Played:
    """One push with its faults: how it ended, what was wrong with that, and what became of it afterwards."""

    seed: int
    faults: list[str] = field(default_factory=list)
    outcome: str = ""
    recovered: str = ""
    wrong: list[str] = field(default_factory=list)
    whims: list[str] = field(default_factory=list)
    unseen: bool = False

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
    kinds: dict[str, Any] = {"refused": WriteRefused, "rolled-back": VerifyError}
    kinds |= {"untouched": VerifyError, "held": RollbackFailed, "held-on": StillOn}
    assert isinstance(outcome_error(record), kinds.get(record.outcome, type(None)))
    return str(record.outcome)


def judge(oracle: Oracle, found: Played, said: list[str], context: PushContext) -> None:
    """What must hold the moment the push has ended; ``said`` are the codes it told people."""
    oracle.look("at the end")
    found.wrong += oracle.broken
    serial, outcome = context.machine.serial, found.outcome
    left = unfinished_tables(context.journals, serial)
    found.unseen = oracle.unseen
    if outcome == "committed" and not oracle.as_wanted and not oracle.unseen:
        found.wrong.append("committed, but the new table is not on")
    if outcome == "rolled-back" and not (oracle.as_before or oracle.foreign or oracle.unseen):
        found.wrong.append("rolled back, but the old table is not as it was")
    if outcome == "held" and not (oracle.off or oracle.unseen or lies(oracle)):
        found.wrong.append("held, but it is on: nobody was told")
    if outcome in ("refused", "already-applied", "untouched") and oracle.writes and not oracle.foreign:
        found.wrong.append(f"{outcome}, but {oracle.writes} values were written")
    word = {"held": "P-PUSH-HELD", "held-on": "P-PUSH-HELD-ON"}.get(outcome, "")
    loudest = [code for code in said if "HELD" in code][-1:]
    if word and (loudest != [word] or [one.kinds[-1] for one in left] != ["HELD"]):
        found.wrong.append(f"{outcome}, but not said or not kept")
    if word and [one.needs_attention for one in held_pushes(context.journals)] != [outcome == "held-on"]:
        found.wrong.append(f"{outcome}, but the journal says another thing")
    over = outcome in ("committed", "rolled-back", "untouched", "refused", "already-applied")
    if over and left:
        found.wrong.append(f"{outcome}, but the journal says {left[0].kinds[-1:]}")
    if (
        not over
        and not word
        and not left
        and not (oracle.foreign or oracle.unseen or as_kept(oracle, context.journals, serial))
    ):
        found.wrong.append(f"{outcome}, nothing left open in the journal, but the machine is not as it says")


def lies(oracle: Oracle) -> bool:
    """A control or PLC whose switch reads off while the table acts, where nothing of it is to be seen."""
    return oracle.nck.spec.lies_about_disable or oracle.plc_lied


def as_kept(oracle: Oracle, journals: Path, serial: str) -> bool:
    """Whether the machine is as the last journal that ended says: a disk may fail after the last word is on it."""
    folder = journal.machine_folder(journals, serial)
    kept = [
        one.kinds[-1] for one in (*journal.read_journals(folder / "done"), *journal.read_journals(folder)) if one.kinds
    ]
    return oracle.as_wanted if kept[-1:] == ["COMMITTED"] else oracle.as_before


async def settle(oracle: Oracle, context: PushContext, found: Played, *, willing: bool) -> None:
    """A fresh gateway on a sound machine: its finding is true, and what it offers leads home.

    ``willing``: control and people do what is asked of them, so nothing may be held.
    """
    serial = context.machine.serial
    journal.set_ended_aside(journal.machine_folder(context.journals, serial))
    left = unfinished_tables(context.journals, serial)
    found.recovered = "" if left else "nothing open"
    for one in left:
        found.recovered += await _settled(oracle, one, context, found, willing=willing)
    oracle.look("after recovery")
    found.wrong += [words for words in oracle.broken if words not in found.wrong]


async def _settled(
    oracle: Oracle, one: journal.JournalRead, context: PushContext, found: Played, *, willing: bool
) -> str:
    writes, expected = oracle.writes, truth(oracle, one.kinds)
    finding = await inspect_unfinished(one, context)
    if oracle.writes != writes:
        found.wrong.append("looking wrote")
    if finding.code != expected and not oracle.foreign:
        found.wrong.append(f"found {finding.words}, but it is {expected}")
    if finding.action == "none":
        return f"{finding.code} "
    if finding.action == "disable":
        return f"{finding.code} " + await _switched_off(oracle, one, context, found, willing=willing)
    try:
        record = await recover_table(one, context)
    except TrueflankError as error:
        found.wrong.append(f"the recovery failed: {error}")
        return f"{finding.code} failed "
    if record.outcome == "rolled-back" and not (oracle.as_before or oracle.foreign):
        found.wrong.append("recovered, but the old table is not as it was")
    if record.outcome == "held" and willing and not oracle.foreign:
        found.wrong.append(f"the recovery was held: {record.steps[-2:]}")
    return f"{finding.code} {record.outcome} "


async def _switched_off(
    oracle: Oracle, one: journal.JournalRead, context: PushContext, found: Played, *, willing: bool
) -> str:
    """What was found on goes off by the first recovery, with no value written; the next is a restore."""
    before = oracle.content
    record = await recover_table(one, context)
    if record.outcome != "held" and willing:
        found.wrong.append(f"it could not be switched off: {record.outcome} {record.steps[-2:]}")
    if record.outcome == "held" and not (oracle.off or lies(oracle)):
        found.wrong.append("switched off, says the recovery, but it is on")
    if oracle.content != before:
        found.wrong.append("switching off wrote values")
    if record.outcome != "held":
        return f"{record.outcome} "
    again = next(
        left for left in unfinished_tables(context.journals, context.machine.serial) if left.number == one.number
    )
    return "off " + await _settled(oracle, again, context, found, willing=willing)


def truth(oracle: Oracle, kinds: tuple[str, ...] = ("DISABLE", "ENABLE")) -> str:
    """What the machine's memory, and what the journal had announced, say a finding must be."""
    if oracle.as_before:
        return "R-PUSH-UNTOUCHED"
    if oracle.switched_on and (not oracle.is_new() or "ENABLE" not in kinds):
        return "R-PUSH-STILL-ON" if "DISABLE" in kinds else "R-PUSH-FOREIGN"
    if oracle.is_old():
        return "R-PUSH-DISABLED"
    if oracle.is_new():
        return "R-PUSH-ENABLED" if oracle.switched_on else "R-PUSH-WRITTEN"
    return "R-PUSH-HALF"


def watching(device: Any, oracle: Oracle) -> Any:
    """The gateway's looks at the control: what the control does by itself before one begins can be seen by it.

    With programs the tables are saved at a program's start; what is fetched later is of that moment.
    """
    looks = ["prepare_stops", "switch_reading", "wait_disabled"]
    looks += [] if device.capabilities.stops else ["saved_tables"]

    def watched(name: str) -> Any:
        real = getattr(device, name)

        async def look_at(*args: Any) -> Any:
            oracle.unseen = False
            return await real(*args)

        return look_at

    for name in looks:
        setattr(device, name, watched(name))
    return device
