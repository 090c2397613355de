"""Set-up values into the numbers of the builder's cycle: all old or all new, whatever fails on the way.

The same care as for tables, without switches, programs and restarts, because one request writes all numbers:

    preflight   every reason against it at once; a refusal changes nothing
    lease       number, journal, audit: on the disk before anything is sent
    snapshot    the numbers once more; another hand in between ends it here
    place       announced, written by one request, read back
    commit      one line; or the old numbers again, read back; or held, where nobody can say

A write is never repeated; after a time-out the numbers are read, and the old ones are written back. The way back of a
committed hand-over is a transaction of its own, over exactly the numbers that were written. A journal that did not end
keeps the next hand-over from beginning until `restore_setup` has led back to its old numbers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import TrueflankError, UnsupportedDevice
from drivers.local.ownfiles import make_own_folder
from drivers.message import Message
from drivers.ports.controller import Controller, HoldsValues
from drivers.types.identity import MachineIdentity
from drivers.units import arcsec_to_deg, um_to_mm
from drivers.workpiece import MOST_C_DEG, MOST_DRESSING_MM, MOST_X_MM
from gateway.domain.grinding_process import HeldUnit, HeldValue, SetupHandover, SetupName, SetupProof
from gateway.errors import StoreError, VerifyError, WriteRefused
from gateway.interlocks import Refusal, refuse, setup_refusals
from gateway.push import journal
from gateway.push.journal import Journal, JournalRead, machine_lock
from gateway.push.phases import PushEvent, PushPhase, step_message
from gateway.push.state import wrap_unexpected
from gateway.say import Say, silence

FOLDER = "setup-values"
LIMITS: dict[SetupName, float] = {
    "x": 1000.0 * MOST_X_MM,
    "dressing": 1000.0 * MOST_DRESSING_MM,
    "swivel": 3600.0 * MOST_C_DEG,
}
"""Largest value that may be added at once, um or arcsec."""


@dataclass(frozen=True, slots=True)
class SetupContext:
    """Everything a hand-over may use; the names are those of `gateway.push.PushContext`.

    ``announce`` keeps, durable, that a transaction begins, before anything is sent; it raises where that fails.
    ``approvals_needed`` is how many people the site asks for (None: one).
    """

    controller: Controller
    clock: Clock
    journals: Path
    machine: MachineIdentity
    typed_name: str
    site_name: str
    actor: str = ""
    audit_broken: str = ""
    harmless_alarms: tuple[int, ...] = ()
    risk_taken: bool = False
    approvals_needed: int | None = None
    announce: Callable[[int, Sequence[HeldValue]], None] = lambda _number, _values: None
    say: Say = silence

    @property
    def folder(self) -> Path:
        """The machine's folder of journals: its lock and its numbers are those of every push."""
        return journal.machine_folder(self.journals, self.machine.serial)

    @property
    def holder(self) -> HoldsValues:
        """The controller as a holder of numbers. Raises UnsupportedDevice (E-HELD-NONE)."""
        if not isinstance(self.controller, HoldsValues):
            raise UnsupportedDevice("E-HELD-NONE", self.site_name)
        return self.controller


def number_for(name: SetupName, added: float, unit: HeldUnit) -> float:
    """What ``added`` (um; arcsec of the swivel) is in the unit of the control's number."""
    if unit in ("um", "arcsec"):
        return added
    return arcsec_to_deg(added) if name == "swivel" else um_to_mm(added)


def planned_values(
    values: Sequence[HeldValue], proofs: Sequence[SetupProof], held: Sequence[float], *, step: str = ""
) -> tuple[HeldValue, ...]:
    """The values with old and new numbers, by the proved sense; the step that is to prove one counts as +1."""
    found = []
    for one, old in zip(values, held, strict=True):
        sense = 1 if one.name == step else next((p.sense for p in proofs if fits(p, one)), 1)
        found.append(replace(one, old=old, new=old + sense * number_for(one.name, one.added, one.unit)))
    return tuple(found)


def fits(proof: SetupProof, value: HeldValue) -> bool:
    """Whether a proof is of this value, place and unit; the machine is the caller's affair."""
    return (proof.name, proof.place, proof.unit) == (value.name, value.place, value.unit)


async def preflight_setup(
    values: Sequence[HeldValue], proofs: Sequence[SetupProof], context: SetupContext, *, step: str = ""
) -> tuple[tuple[HeldValue, ...], tuple[Refusal, ...]]:
    """The values with their numbers, and every reason not to write them now; reads only.

    Raises ConfigError (E-HELD-...), UnsupportedDevice (E-HELD-NONE), and what the port raises.
    """
    held = await context.holder.held_values([one.place for one in values])
    own = [one for one in proofs if not one.machine.differences(context.machine)]
    found = planned_values(values, own, held, step=step)
    reasons = [*await _reasons(context), *_unended(context), *_shared_places(values)]
    for one in values:
        reasons += () if one.name == step else sense_refusals(one, own)
        if abs(one.added) > LIMITS[one.name]:
            reasons += refuse("E-HAND-LIMIT", name=one.name, value=round(one.added, 2), limit=LIMITS[one.name])
    return found, tuple(reasons)


def _shared_places(values: Sequence[HeldValue]) -> Iterator[Refusal]:
    """Two values in one number: the second would be written over the first."""
    for place in dict.fromkeys(one.place for one in values):
        names = [one.name for one in values if one.place == place]
        if len(names) > 1:
            yield from refuse("E-HAND-SHARED", place=place, names=", ".join(names))


def sense_refusals(value: HeldValue, proofs: Sequence[SetupProof]) -> tuple[Refusal, ...]:
    """A value whose sense no proof of this machine tells (E-HAND-SENSE)."""
    known = any(fits(proof, value) for proof in proofs)
    return () if known else tuple(refuse("E-HAND-SENSE", name=value.name, place=value.place))


async def _reasons(context: SetupContext) -> list[Refusal]:
    """What speaks against any write of numbers, the way back among them."""
    found, state = await context.controller.identify(), await context.controller.state()
    return list(setup_refusals(context, found, state, context.controller.capabilities))


def _unended(context: SetupContext) -> Iterator[Refusal]:
    left = unfinished_setup(context.journals, context.machine.serial)
    if left is not None:
        yield from refuse("E-HAND-UNFINISHED", transaction=left.number)


def unfinished_setup(journals: Path, serial: str) -> JournalRead | None:
    """The hand-over of a machine that did not end, the newest one; None where all ended. Raises StoreError."""
    left = journal.unfinished_journals(journal.machine_folder(journals, serial) / FOLDER)
    return left[-1] if left else None


async def hand_over_setup(
    values: Sequence[HeldValue],
    proofs: Sequence[SetupProof],
    context: SetupContext,
    *,
    part: str = "",
    step: str = "",
) -> SetupHandover:
    """Add to the numbers that the builder's cycle reads; the record's outcome says how it ended.

    Raises WriteRefused (E-HAND-REFUSED) with nothing written and every reason, BusyError (E-PUSH-BUSY), StoreError,
    and as long as nothing was announced the port's errors.
    """
    with wrap_unexpected(context.site_name), machine_lock(context.folder):
        planned, reasons = await preflight_setup(values, proofs, context, step=step)
        _demand_none(context, reasons)
        return await _exchange(planned, context, part=part, step=step)


def _demand_none(context: SetupContext, reasons: Sequence[Refusal]) -> None:
    if reasons:
        told = tuple(one.message for one in reasons)
        raise WriteRefused("E-HAND-REFUSED", context.site_name, count=len(told), reasons=told)


async def restore_setup(context: SetupContext) -> SetupHandover:
    """The old numbers again: of a hand-over that did not end, else of the last one that nobody has taken back.

    Raises WriteRefused (E-HAND-REFUSED, E-HAND-FOREIGN: neither old nor new is held there, E-HAND-NOTHING), BusyError,
    StoreError, and the port's errors as long as nothing was announced.
    """
    with wrap_unexpected(context.site_name), machine_lock(context.folder):
        left = unfinished_setup(context.journals, context.machine.serial)
        if left is not None:
            return await _finish(left, context)
        done = last_setup(context.journals, context.machine.serial)
        if done is None:
            raise WriteRefused("E-HAND-NOTHING", context.site_name)
        _demand_none(context, await _reasons(context))
        held = await context.holder.held_values([one.place for one in done.values])
        back = tuple(replace(one, added=-one.added, old=one.new, new=one.old) for one in done.values)
        _demand_known(context, back, held, both=False)
        return await _exchange(back, context, part=done.part, undoes=done.transaction)


def last_setup(journals: Path, serial: str) -> SetupHandover | None:
    """The newest committed hand-over that nobody has taken back. Raises StoreError (E-PUSH-JOURNAL)."""
    stack: list[SetupHandover] = []
    for one in setup_history(journals, serial):
        if one.undoes:
            stack = [other for other in stack if other.transaction != one.undoes]
        else:
            stack.append(one)
    return stack[-1] if stack else None


def setup_history(journals: Path, serial: str) -> tuple[SetupHandover, ...]:
    """Every committed hand-over of a machine, ways back among them, oldest first.

    Raises StoreError (E-PUSH-JOURNAL).
    """
    folder = journal.machine_folder(journals, serial) / FOLDER
    found = []
    for one in sorted((*journal.read_journals(folder / "done"), *journal.read_journals(folder)), key=_age):
        if one.broken:
            raise StoreError("E-PUSH-JOURNAL", str(one.path), why=one.broken)
        if one.state.phase is PushPhase.COMMITTED:
            found.append(_record(one, "committed"))
    return tuple(found)


def _age(found: JournalRead) -> str:
    return str(found.entries[0].facts.get("utc", "")) if found.entries else ""


def _record(found: JournalRead, outcome: Any) -> SetupHandover:
    return SetupHandover(
        part=str(found.latest("part") or ""),
        values=tuple(HeldValue(**one) for one in found.latest("values") or ()),
        outcome=outcome,
        transaction=found.number,
        step=str(found.latest("step") or ""),
        undoes=int(found.latest("undoes") or 0),
        utc=_age(found),
        reasons=found.reasons,
    )


def _demand_known(context: SetupContext, values: Sequence[HeldValue], held: Sequence[float], *, both: bool) -> None:
    """Nobody else's number is written over. Raises WriteRefused (E-HAND-FOREIGN)."""
    for one, now in zip(values, held, strict=True):
        if now != one.old and not (both and now == one.new):
            raise WriteRefused("E-HAND-FOREIGN", context.site_name, place=one.place, held=now, old=one.old, new=one.new)


class _Exchange:
    """One transaction at work: its journal, its values, what is told."""

    def __init__(self, kept: Journal, number: int, values: Sequence[HeldValue], context: SetupContext) -> None:
        self.kept, self.number, self.values, self.context = kept, number, tuple(values), context

    def note(self, event: PushEvent, **facts: object) -> None:
        """On the disk first, then told. Raises StoreError."""
        utc = self.context.clock.utc().isoformat(timespec="seconds")
        self.kept.append(event, utc=utc, **facts)
        self.context.say("P-HAND-STEP", transaction=self.number, event=step_message(event))

    async def held(self) -> tuple[float, ...]:
        """What is there now."""
        return await self.context.holder.held_values([one.place for one in self.values])

    async def place(self, wanted: Sequence[float]) -> None:
        """Write, whatever is told of it, and compare. Raises VerifyError (E-HAND-DIFFERS), what reading raises."""
        told: TrueflankError | None = None
        try:
            numbers = {one.place: value for one, value in zip(self.values, wanted, strict=True)}
            await self.context.holder.hold_values(numbers)
        except TrueflankError as error:
            told = error
        for one, value, now in zip(self.values, wanted, await self.held(), strict=True):
            if now != value:
                if told is not None:
                    raise told
                raise VerifyError("E-HAND-DIFFERS", one.place, place=one.place, value=value, held=now)

    async def lead_back(self, why: Message) -> tuple[bool, Message | None]:
        """The old numbers again: whether a read-back says so, else why not. Raises StoreError."""
        self.note(PushEvent.ROLLING_BACK, why=why)
        try:
            with wrap_unexpected(self.context.site_name):
                await self.place([one.old for one in self.values])
        except StoreError:
            raise
        except TrueflankError as error:
            self.note(PushEvent.HELD, why=error.message)
            return False, error.message
        self.note(PushEvent.ROLLED_BACK)
        return True, None


async def _exchange(
    values: Sequence[HeldValue], context: SetupContext, *, part: str, step: str = "", undoes: int = 0
) -> SetupHandover:
    seed = int(context.clock.utc().timestamp())
    number = journal.allocate_number(context.folder, seed)
    folder = context.folder / FOLDER
    make_own_folder(folder)
    kept = Journal.create(folder, number)
    work = _Exchange(kept, number, values, context)
    try:
        return await _run(work, part=part, step=step, undoes=undoes)
    except asyncio.CancelledError:
        work.note(PushEvent.STOPPED, why=Message.of("W-PUSH-STOP-BY", by="a cancel"))
        raise
    finally:
        kept.close()
        if journal.read(kept.path).is_ended:
            journal.set_aside(kept.path)


async def _run(work: _Exchange, *, part: str, step: str, undoes: int) -> SetupHandover:
    context = work.context
    told: dict[str, object] = {"part": part, "step": step, "undoes": undoes, "actor": context.actor}
    purpose = "restore" if undoes else "setup"
    facts = [asdict(one) for one in work.values]
    work.note(PushEvent.LEASED, purpose=purpose, serial=context.machine.serial, values=facts, **told)
    try:
        context.announce(work.number, work.values)
        work.note(PushEvent.AUDITED)
        _demand_known(context, work.values, await work.held(), both=False)
        work.note(PushEvent.SNAPSHOT)
    except TrueflankError as error:
        work.note(PushEvent.ABORTED, why=error.message)
        raise
    reasons: tuple[Message, ...] = ()
    outcome: Any = "committed"
    try:
        with wrap_unexpected(context.site_name):
            work.note(PushEvent.PLACE)
            await work.place([one.new for one in work.values])
        work.note(PushEvent.PLACED)
        work.note(PushEvent.COMMITTED)
    except StoreError:
        raise
    except TrueflankError as error:
        back, why = await work.lead_back(error.message)
        outcome = "rolled-back" if back else "held"
        reasons = (error.message, *(() if why is None else (why,)))
    utc = context.clock.utc().isoformat(timespec="seconds")
    return SetupHandover(
        part=part,
        values=work.values,
        outcome=outcome,
        transaction=work.number,
        step=step,
        undoes=undoes,
        utc=utc,
        reasons=reasons,
        machine=context.machine,
    )


async def _finish(left: JournalRead, context: SetupContext) -> SetupHandover:
    """A hand-over that did not end: nothing was announced, or its old numbers again."""
    if left.broken:
        raise StoreError("E-PUSH-JOURNAL", str(left.path), why=left.broken)
    found = _record(left, "rolled-back")
    kept = Journal.reopen(left)
    work = _Exchange(kept, left.number, found.values, context)
    try:
        if left.state.phase in (PushPhase.NOTHING, PushPhase.PREPARED, PushPhase.READ):
            work.note(PushEvent.CLOSED)
            return replace(found, machine=context.machine)
        _demand_none(context, await _reasons(context))
        _demand_known(context, found.values, await work.held(), both=True)
        back, why = await work.lead_back(Message.of("W-PUSH-UNFINISHED"))
        return found if back else replace(found, outcome="held", reasons=(why,) if why else ())
    finally:
        kept.close()
        if journal.read(kept.path).is_ended:
            journal.set_aside(kept.path)
