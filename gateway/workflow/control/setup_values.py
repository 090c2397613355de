"""Set-up values of an inspected part into the builder's own cycle: written to the control, or typed by a person.

A part that the builder's cycle has ground tells what its set-up values lack. Each value goes to the place that the site
file names, in the sense that a known step has proved; where there is none a person types it. The next part of the same
run verifies it. The transaction itself is `gateway.push.setup_values`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, fixed, joined
from gateway import audit
from gateway.approve import is_risk_taken
from gateway.config import SiteFile, WorkSection
from gateway.domain.grinding_process import SETUP_KEYS, HeldValue, Separation, SetupHandover, SetupName, SetupProof
from gateway.errors import IllegalTransition, RollbackFailed, VerifyError, WriteRefused
from gateway.interlocks import Refusal, proves
from gateway.push import (
    JOURNALS,
    SetupContext,
    hand_over_setup,
    last_setup,
    preflight_setup,
    restore_setup,
    sense_refusals,
    setup_history,
    unfinished_setup,
)
from gateway.say import Say
from gateway.store import RunFolder
from gateway.store.machine_books import SetupProofBook
from gateway.tooth import GroundPart, SetupValues
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import audit_problem, error_words, outcome_word, report_log_problem
from gateway.workflow.run.context import RunContext, check_name, open_context, run_or_look
from gateway.workflow.run.folder import site_of, store_of
from gateway.workflow.tooth.part_plan import work_section

SURE = 2.0  # standard uncertainties from which a value is worth handing over
STEPS: Mapping[SetupName, float] = {"x": 5.0, "dressing": 5.0, "swivel": 60.0}
"""The known step of each value, um or arcsec."""


@dataclass(frozen=True, slots=True)
class HandoverOutcome:
    """What is to be handed over, or what became of it."""

    values: tuple[HeldValue, ...]
    lines: tuple[Message, ...]
    applied: bool
    record: SetupHandover | None = None
    refused_by: tuple[str, ...] = ()
    exit_code: int = 0

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        ended = None if self.record is None else self.record.outcome
        rows = [asdict(one) for one in self.values]
        return {"applied": self.applied, "outcome": ended, "values": rows, "refused_by": list(self.refused_by)}


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What a known step of a held number did to the next part."""

    name: SetupName
    gain: float
    u: float
    proof: SetupProof | None

    @property
    def exit_code(self) -> int:
        """0 proved, 1 anything else."""
        return 0 if self.proof is not None else 1

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        told = {"name": self.name, "gain": fixed(self.gain), "u": fixed(self.u)}
        if self.proof is None:
            return (Message.of("W-HAND-UNPROVED", **told),)
        return (Message.of("W-HAND-PROVED" if self.proof.sense == 1 else "W-HAND-REVERSED", **told),)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        sense = None if self.proof is None else self.proof.sense
        return {"name": self.name, "gain": self.gain, "u": self.u, "sense": sense}


async def hand_over_run(
    folder: RunFolder, *, part: str, apply: bool, machine_name: str, clock: Clock, say: Say, step: str = ""
) -> HandoverOutcome:
    """Hand over what a part of a run lacks, or with ``step`` a known step of one value; without `apply` only look.

    Raises WriteRefused (E-RUN-NAME, E-HAND-REFUSED), IllegalTransition (E-HAND-SEPARATE, E-HAND-TWICE, E-HAND-OWN,
    E-HAND-SMALL), ConfigError (E-HAND-STEP, E-HELD-...), VerifyError (E-HAND-ROLLED-BACK), RollbackFailed
    (E-HAND-HELD), and what the control raises.
    """
    site, site_path = site_of(folder)
    check_name(site, apply, machine_name)
    _demand_fresh(folder, part, site, site_path)
    values = _step_value(site, step) if step else values_of_part(work_section(site), _separated(folder, part))
    if not values:
        raise IllegalTransition("E-HAND-SMALL", folder.run_id, part=part)
    held = tuple(one for one in values if one.place)
    typed = tuple(one for one in values if not one.place)
    lines = _typing_lines(work_section(site), typed)
    if not held:
        record = SetupHandover(part, typed, "typed", utc=clock.utc().isoformat(timespec="seconds"))
        if apply:
            folder.put(stages.handed(part), record, (folder.digest(stages.separated(part)),))
        return HandoverOutcome(typed, lines, applied=apply, record=record if apply else None)
    before = folder.state
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            done = await _hand_over(at, held, part, step, machine_name if apply else "")
    finally:
        folder.set_state(before)
    if done.record is None:
        return replace(done, values=(*done.values, *typed), lines=(*lines, *done.lines))
    record = replace(done.record, values=(*done.record.values, *typed))
    folder.put(stages.handed(part), record, (folder.digest(stages.separated(part)),))
    _raise_unless_done(record, site)
    return replace(done, values=record.values, record=record, lines=(*lines, *done.lines))


def _demand_fresh(folder: RunFolder, part: str, site: SiteFile, site_path: Path) -> None:
    """Once after each part, and only after one that the builder's cycle ground with its own values."""
    _separated(folder, part)
    ground = stages.ground(part)
    if folder.has(ground) and folder.get(ground, GroundPart).setup != SetupValues():
        raise IllegalTransition("E-HAND-OWN", folder.run_id, part=part)
    if not folder.has(stages.handed(part)):
        return
    done = folder.get(stages.handed(part), SetupHandover)
    acting = done.outcome == "typed"
    if done.machine is not None and done.outcome == "committed":
        history = setup_history(store_of(site, site_path).root / JOURNALS, done.machine.serial)
        acting = done.transaction not in {one.undoes for one in history}
    if acting:
        raise IllegalTransition("E-HAND-TWICE", folder.run_id, part=part)


def _separated(folder: RunFolder, part: str) -> Separation:
    if not folder.has(stages.separated(part)):
        raise IllegalTransition("E-HAND-SEPARATE", folder.run_id, part=part)
    return folder.get(stages.separated(part), Separation)


def held_value(work: WorkSection, name: SetupName, added: float) -> HeldValue:
    """A set-up value with the place that the site file names for it ("": a person types it)."""
    unit = work.place_angle_unit if name == "swivel" else work.place_length_unit
    return HeldValue(name, str(getattr(work, f"{name}_place")), unit, added)


def values_of_part(work: WorkSection, found: Separation) -> tuple[HeldValue, ...]:
    """What a part's set-up values lack, as far as it is known to be something."""
    known = {name: found.setup.get(key) for name, key in SETUP_KEYS.items()}
    sure = {name: one.value for name, one in known.items() if one is not None and abs(one.value) > SURE * one.u}
    return tuple(held_value(work, name, round(value, 3)) for name, value in sure.items())


def _step_value(site: SiteFile, step: str) -> tuple[HeldValue, ...]:
    """The known step. Raises ConfigError (E-HAND-STEP) for no value, or one that no control holds."""
    work = work_section(site)
    name = next((one for one in STEPS if one == step), None)
    if name is None or not getattr(work, f"{name}_place"):
        known = ", ".join(one for one in STEPS if getattr(work, f"{one}_place")) or "-"
        raise ConfigError("E-HAND-STEP", site.site.name, step=step, known=known)
    return (held_value(work, name, STEPS[name]),)


def _typing_lines(work: WorkSection, typed: Sequence[HeldValue]) -> tuple[Message, ...]:
    return tuple(
        Message.of(
            "W-HAND-TYPE",
            name=one.name,
            value=fixed(one.added, 1, signed=True),
            unit="arcsec" if one.name == "swivel" else "um",
            place=str(getattr(work, f"{one.name}_entry")) or "-",
        )
        for one in typed
    )


def setup_context(at: RunContext, typed_name: str) -> SetupContext:
    """What a hand-over at this site works with."""
    folder = at.folder.run_id

    def announce(number: int, values: Sequence[HeldValue]) -> None:
        told = {"run": folder, "values": [asdict(one) for one in values]}
        serial = at.machine.serial
        audit.record(at.store.root, "setup-start", clock=at.clock, serial=serial, transaction=number, details=told)

    return SetupContext(
        controller=at.supervisor.controller,
        clock=at.clock,
        journals=at.store.root / JOURNALS,
        machine=at.machine,
        typed_name=typed_name,
        site_name=at.site.site.name,
        actor=audit.acting_person(),
        audit_broken=audit_problem(at),
        risk_taken=is_risk_taken(),
        approvals_needed=at.site.site.approvals,
        announce=announce,
        say=at.say,
    )


async def _hand_over(
    at: RunContext, values: Sequence[HeldValue], part: str, step: str, typed_name: str
) -> HandoverOutcome:
    context = setup_context(at, typed_name or at.site.site.name)
    proofs = SetupProofBook(at.store.root).of(at.machine)
    if not typed_name:
        planned, reasons = await preflight_setup(values, proofs, context, step=step)
        return _look(planned, reasons)
    record = await _audited(at, hand_over_setup(values, proofs, context, part=part, step=step))
    return HandoverOutcome(record.values, _value_lines(record.values), applied=True, record=record)


def _look(planned: tuple[HeldValue, ...], reasons: tuple[Refusal, ...]) -> HandoverOutcome:
    lines = (*_value_lines(planned), *(one.message for one in reasons), Message.of("W-HAND-DRY"))
    return HandoverOutcome(planned, lines, applied=False, refused_by=tuple(one.code for one in reasons))


def _value_lines(values: Sequence[HeldValue]) -> tuple[Message, ...]:
    return tuple(
        Message.of(
            "W-HAND-VALUE",
            name=one.name,
            place=one.place,
            old=fixed(one.old, 6),
            new=fixed(one.new, 6),
            unit=one.unit,
            added=fixed(one.added, 2, signed=True),
            measure="arcsec" if one.name == "swivel" else "um",
        )
        for one in values
    )


async def _audited(at: RunContext, work: Any) -> SetupHandover:
    """Keep in the audit log how it ended, without a record too."""
    serial = at.machine.serial
    try:
        record: SetupHandover = await work
    except (TrueflankError, asyncio.CancelledError) as error:
        told = {"run": at.folder.run_id, "why": error_words(error)}
        action = f"setup-{outcome_word(error)}"
        report_log_problem(at, audit.note(at.store.root, action, clock=at.clock, serial=serial, details=told))
        raise
    told = {"run": at.folder.run_id, "part": record.part, "why": joined(record.reasons)}
    action, number = f"setup-{record.outcome}", record.transaction
    report_log_problem(
        at, audit.note(at.store.root, action, clock=at.clock, serial=serial, transaction=number, details=told)
    )
    return record


def _raise_unless_done(record: SetupHandover, site: SiteFile) -> None:
    """Raise VerifyError (E-HAND-ROLLED-BACK) or RollbackFailed (E-HAND-HELD) where it did not end as asked."""
    told: dict[str, Any] = {"transaction": record.transaction, "why": record.reasons}
    if record.outcome == "rolled-back":
        raise VerifyError("E-HAND-ROLLED-BACK", site.site.name, **told)
    if record.outcome == "held":
        raise RollbackFailed("E-HAND-HELD", site.site.name, **told)


async def roll_back_setup_site(
    site: SiteFile, site_path: Path, *, apply: bool, machine_name: str, clock: Clock, say: Say
) -> HandoverOutcome:
    """The old numbers of the last hand-over again, or of one that did not end; without `apply` say which they are.

    Raises WriteRefused (E-RUN-NAME, E-HAND-NOTHING, E-HAND-FOREIGN, E-HAND-REFUSED), VerifyError (E-HAND-ROLLED-BACK:
    the newer numbers stayed), RollbackFailed (E-HAND-HELD), BusyError, StoreError.
    """
    check_name(site, apply, machine_name)
    with run_or_look(site, site_path, "rolling back", look=not apply) as folder:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            # The journals are the store's of the site, whichever folder this look has.
            store = store_of(site, site_path).root
            context = replace(setup_context(at, site.site.name), journals=store / JOURNALS)
            if not apply:
                return await _look_back(context)
            record = await _audited(at, restore_setup(context))
            folder.set_state(f"setup-{record.outcome}")
    if record.undoes or record.outcome == "held":
        _raise_unless_done(record, site)
    return HandoverOutcome(record.values, _value_lines(record.values), applied=True, record=record)


async def _look_back(context: SetupContext) -> HandoverOutcome:
    serial = context.machine.serial
    lines: tuple[Message, ...] = ()
    left = unfinished_setup(context.journals, serial)
    found = last_setup(context.journals, serial)
    if left is not None:
        back = tuple(HeldValue(**one) for one in left.latest("values") or ())
        lines = (Message.of("W-HAND-UNFINISHED", transaction=left.number),)
    elif found is not None:
        back = found.values
    else:
        return HandoverOutcome((), (Message.of("W-HAND-NOTHING"),), applied=False)
    values = tuple(replace(one, added=-one.added, old=one.new, new=one.old) for one in back)
    return HandoverOutcome(values, (*lines, *_value_lines(values), Message.of("W-HAND-DRY")), applied=False)


def prove_step(folder: RunFolder, *, before: str, after: str, clock: Clock) -> StepOutcome:
    """What the known step handed over after part ``before`` did to part ``after``; a proved sense is kept.

    Raises IllegalTransition (E-HAND-SEPARATE, E-HAND-NO-STEP: nothing of the kind was handed over).
    """
    parts = [_separated(folder, one) for one in (before, after)]
    has = folder.has(stages.handed(before))
    done = folder.get(stages.handed(before), SetupHandover) if has else None
    if done is None or not done.step or done.outcome != "committed" or done.machine is None:
        raise IllegalTransition("E-HAND-NO-STEP", folder.run_id, part=before)
    (step,) = done.values
    first, second = (one.asks(step.name) for one in parts)
    gain = (first.value - second.value) / step.added
    u = (first.u**2 + second.u**2) ** 0.5 / abs(step.added)
    if not proves(gain, u):
        return StepOutcome(step.name, gain, u, None)
    proof = SetupProof(
        machine=done.machine,
        name=step.name,
        place=step.place,
        unit=step.unit,
        sense=1 if gain > 0.0 else -1,
        gain=gain,
        u=u,
        date_utc=clock.utc().isoformat(timespec="seconds"),
    )
    site, site_path = site_of(folder)
    SetupProofBook(store_of(site, site_path).root).save(proof)
    return StepOutcome(step.name, gain, u, proof)


# The closing run with the builder's cycle: what changes from part to part.

LEAST = 0.05  # um: less is nobody's business


def require_senses(at: RunContext) -> None:
    """Refuse a run that hands over in a sense that nobody has proved. Raises WriteRefused (E-HAND-REFUSED)."""
    work, proofs = work_section(at.site), SetupProofBook(at.store.root).of(at.machine)
    named = [held_value(work, name, 0.0) for name in ("x", "dressing") if getattr(work, f"{name}_place")]
    reasons = [one for value in named for one in sense_refusals(value, proofs)]
    if reasons:
        told = tuple(one.message for one in reasons)
        raise WriteRefused("E-HAND-REFUSED", at.site.site.name, count=len(told), reasons=told)


async def hand_over_change(at: RunContext, part: str, change: SetupValues) -> SetupHandover | None:
    """Hand over by how much the set-up values of part ``part`` differ from those of the part before; once in a run.

    What has no place is said, for a person to type; None where nothing changes. Raises as `hand_over_run`.
    """
    work, label = work_section(at.site), f"{at.folder.run_id}/{part}"
    amounts: dict[SetupName, float] = {"x": change.x_um, "dressing": change.dressing_um}
    values = tuple(held_value(work, name, round(one, 3)) for name, one in amounts.items() if abs(one) >= LEAST)
    if not values or at.folder.has(stages.handed(part)):
        return None
    held = tuple(one for one in values if one.place)
    typed = tuple(one for one in values if not one.place)
    for line in _typing_lines(work, typed):
        at.say("P-HAND-TYPE", line=line)
    utc = at.clock.utc().isoformat(timespec="seconds")
    record = SetupHandover(part, typed, "typed", utc=utc)
    if held:
        done = _known_handover(at, label)
        if done is None:
            proofs = SetupProofBook(at.store.root).of(at.machine)
            context = setup_context(at, at.site.site.name)
            done = await _audited(at, hand_over_setup(held, proofs, context, part=label))
        record = replace(done, part=part, values=(*done.values, *typed))
        for line in _value_lines(done.values):
            at.say("P-HAND-VALUE", line=line)
        _raise_unless_done(record, at.site)
    at.folder.put(stages.handed(part), record)
    return record


def _known_handover(at: RunContext, label: str) -> SetupHandover | None:
    """One that this run has committed before it was stopped, and nobody has taken back."""
    history = setup_history(at.store.root / JOURNALS, at.machine.serial)
    undone = {one.undoes for one in history}
    return next(
        (one for one in history if one.part == label and one.transaction not in undone and not one.undoes), None
    )
