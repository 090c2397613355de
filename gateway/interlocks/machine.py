"""Rules on the machine as it is found, on the consent to write to it, and on switching a table off."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.terms import spoken
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus
from drivers.types.orders import SignProof
from drivers.units import deviation_scale
from gateway.interlocks.facts import (
    PROOF_COVERAGE,
    PROOF_SIZES,
    PROOF_TIMES_U,
    PROOF_WITHIN,
    ROUNDING,
    TEMPERATURE_MOVED,
    PushFacts,
    Refusal,
    Rule,
    other_tables_now,
    refuse,
    value_at,
)


def _machine(facts: PushFacts) -> Iterator[Refusal]:
    different = facts.request.machine.differences(facts.found)
    if different:
        wanted = ", ".join(str(getattr(facts.request.machine, name)) for name in different)
        found = ", ".join(str(getattr(facts.found, name)) for name in different)
        yield from refuse("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=found)


def _units(facts: PushFacts) -> Iterator[Refusal]:
    if facts.found.unit_system != "metric":
        yield from refuse("E-INT-INCH", found=facts.found.unit_system)


def _channel(facts: PushFacts) -> Iterator[Refusal]:
    """Between the halves a program waits, or has ended where the control needs two: both are right."""
    if facts.moment == "start" and facts.state.channel is not ChannelStatus.RESET:
        yield from refuse("E-INT-CHANNEL", found=facts.state.channel.name.lower())


def _mode(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.mode.upper() not in facts.modes:
        yield from refuse("E-INT-MODE", found=facts.state.mode, wanted=" or ".join(facts.modes))


def _alarms(facts: PushFacts) -> Iterator[Refusal]:
    active = [number for number in facts.state.alarms if number not in facts.request.harmless_alarms]
    if active:
        yield from refuse("E-INT-ALARM", alarms=", ".join(map(str, active)))


def _axis(facts: PushFacts) -> Iterator[Refusal]:
    """Output and input axis alike: no compensation acts unless both are referenced."""
    known = ", ".join(sorted(facts.state.axes))
    for name in facts.axes:
        axis = facts.state.axes.get(name)
        if axis is None:
            yield from refuse("E-INT-AXIS" if name == facts.change.axis else "E-INT-INPUT", axis=name, known=known)
            continue
        if not axis.referenced:
            yield from refuse("E-INT-REFERENCE", axis=axis.name)
        if not axis.in_position:
            yield from refuse("E-INT-MOVING", axis=axis.name)


def _axis_units(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    for axis, unit in ((facts.axis_state, table.output_unit), (facts.input_state, table.input_unit)):
        if axis is not None and axis.unit != unit:
            yield from refuse("E-INT-UNIT", table=table.called, axis=axis.name, wanted=unit, found=axis.unit)
            return


def _access(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.access_level > facts.request.access_level_needed:
        level, needed = facts.state.access_level, facts.request.access_level_needed
        yield from refuse("E-INT-ACCESS", level=level, needed=needed)


def _jump(facts: PushFacts) -> Iterator[Refusal]:
    """What switching on will do, this table and those that come on with it; after a restart the motors are off."""
    axis = facts.input_state
    if axis is None or not facts.can.switches_now or (facts.purpose == "restore" and not facts.change.old_enabled):
        return
    alone = value_at(facts.table, axis.position)
    jump = max(alone, alone + other_tables_now(facts), key=abs)
    if abs(jump) > facts.bounds.jump + ROUNDING and abs(other_tables_now(facts)) <= facts.bounds.jump + ROUNDING:
        fields = {"axis": facts.change.axis, "position": axis.position, "limit": facts.bounds.jump}
        yield from refuse("E-INT-JUMP", jump=round(jump, 3), unit=facts.table.deviation_unit, **fields)


def _safe_places(facts: PushFacts) -> Iterator[Refusal]:
    """Nobody moves an axis of a machine of which nobody said where its axes may stand meanwhile."""
    for name in sorted(set(facts.state.axes) - set(facts.places.ranges)):
        yield from refuse("E-INT-NO-PLACE", axis=name)


def _inside_safe_places(facts: PushFacts) -> Iterator[Refusal]:
    """Every axis stands in its safe place now, and the one that moves finds its place to go to in there."""
    for name, axis in sorted(facts.state.axes.items()):
        if name in facts.places.ranges and not facts.places.holds(name, axis.position):
            yield from _outside(facts, name, axis.position)
    moved, place = facts.table.input_axis, facts.agreeing_position
    if place is not None and moved in facts.places.ranges and not facts.places.holds(moved, place):
        yield from _outside(facts, moved, place)


def _outside(facts: PushFacts, axis: str, position: float) -> Iterator[Refusal]:
    low, high = facts.places.ranges[axis]
    yield from refuse("E-INT-OUTSIDE", axis=axis, position=round(position, 3), low=low, high=high)


def _name(facts: PushFacts) -> Iterator[Refusal]:
    if facts.request.typed_name != facts.request.site_name:
        typed = facts.request.typed_name or "nothing"
        yield from refuse("E-INT-NAME", typed=typed, wanted=facts.request.site_name)


def _open_journals(facts: PushFacts) -> Iterator[Refusal]:
    if facts.unfinished:
        yield from refuse("E-INT-UNFINISHED", journals=", ".join(facts.unfinished))


def _skipped_change(facts: PushFacts) -> Iterator[Refusal]:
    if facts.change.skipped:
        yield from refuse("E-INT-SKIPPED", why=facts.change.skipped)


def _no_change(facts: PushFacts) -> Iterator[Refusal]:
    change = facts.change
    if change.old_enabled and change.new == change.old:
        yield from refuse("E-INT-NOTHING", table=change.new.called)


def _marker(facts: PushFacts) -> Iterator[Refusal]:
    """Somebody else's push that did not end: on another PC, or in a store that is gone."""
    marker = facts.marker
    if marker is not None and marker.state in ("in-progress", "held") and not facts.mark.ours:
        yield from refuse("E-INT-MARKER", number=marker.transaction, state=marker.state)


def _audit_behind(facts: PushFacts) -> Iterator[Refusal]:
    """The control remembers more of this store than its audit log does."""
    if facts.mark.behind:
        yield from refuse("E-INT-AUDIT-BEHIND", why=facts.mark.behind)


def _missing_journals(facts: PushFacts) -> Iterator[Refusal]:
    if facts.missing:
        yield from refuse("E-INT-JOURNAL-MISSING", numbers=", ".join(map(str, facts.missing)))


def _key(facts: PushFacts) -> Iterator[Refusal]:
    if facts.key_taken:
        yield from refuse("E-INT-KEY", key=facts.key_taken)


def _base(facts: PushFacts) -> Iterator[Refusal]:
    if facts.purpose == "table" and not facts.change.base_digest:
        yield from refuse("E-INT-NO-BASE", table=facts.table.called)
    if facts.unchanged is False:
        yield from refuse("E-INT-LOST-UPDATE", axis=facts.change.axis, base=facts.change.base_digest[:12])


def _temperature(facts: PushFacts) -> Iterator[Refusal]:
    """A table made while temperature compensation was worth something else holds part of the difference."""
    base = facts.change.base or (facts.request.capture.live if facts.request.capture is not None else None)
    if facts.live is None or base is None or base.axis != facts.live.axis:
        return
    then, now = base.temperature, facts.live.temperature
    if then is None or now is None:
        return
    scale = deviation_scale(facts.unit)
    moved = max((abs(now.at(place) - then.at(place)) * scale for place in _temperature_places(facts)), default=0.0)
    if moved > TEMPERATURE_MOVED + ROUNDING:
        fields = {"axis": facts.live.axis, "moved": round(moved, 3), "limit": TEMPERATURE_MOVED}
        yield from refuse("E-INT-TEMPERATURE-MOVED", unit=facts.table.deviation_unit, **fields)


def _temperature_places(facts: PushFacts) -> tuple[float, ...]:
    """Ends of what was measured of the output axis; without any a metre or a turn around its zero."""
    if facts.request.capture is not None and facts.request.capture.targets.size:
        return float(facts.request.capture.targets[0]), float(facts.request.capture.targets[-1])
    around = 1000.0 if facts.unit == "mm" else 360.0
    return -around, 0.0, around


def _self_test(facts: PushFacts) -> Iterator[Refusal]:
    """Programs that this very control has not tried are not let loose on its tables; no setting waives it."""
    if not facts.can.self_test:
        return
    axis, test = facts.change.axis, facts.request.self_test
    if test is None:
        yield from refuse("E-INT-NO-SELF-TEST", axis=axis)
    elif test.machine.differences(facts.found):
        differ = ", ".join(test.machine.differences(facts.found))
        yield from refuse("E-INT-OTHER-SELF-TEST", axis=axis, differ=differ, date=test.utc, tested=test.machine.version)
    elif not test.ok:
        yield from refuse("E-INT-SELF-TEST", axis=axis, date=test.utc, missed=test.missed)


def _proof(facts: PushFacts) -> Iterator[Refusal]:
    if facts.purpose != "table":
        return
    proof, table = facts.request.proof, facts.table
    if proof is None or (proof.kind, proof.output_axis) != (table.kind, table.output_axis):
        yield from refuse("E-INT-NO-PROOF", function=spoken().kind(table.kind), axis=table.output_axis)
    elif proof.machine.differences(facts.found):
        differ = ", ".join(proof.machine.differences(facts.found))
        yield from refuse("E-INT-OTHER-PROOF", axis=table.output_axis, differ=differ)
    elif proof.reversed:
        yield from refuse("E-INT-SIGN", axis=table.output_axis, slope=proof.slope)
    elif not _is_sound(proof):
        yield from refuse("E-INT-BAD-PROOF", axis=table.output_axis, slope=proof.slope, u=proof.slope_u)


def _is_sound(proof: SignProof) -> bool:
    return proves(proof.slope, proof.slope_u) and proof.agrees


def proves(slope: float, u: float) -> bool:
    """Whether a measured step, ``slope`` of what was commanded with standard uncertainty ``u``, proves a sign.

    Its size is one within 20 % or within its expanded uncertainty (k = 2), whichever is wider, so that an axis that
    scatters can be proved. It is more than four times u, and nearer to one than to half or twice: an error of unit or
    factor is not taken for scatter. Where either is not a number, nothing is proved.
    """
    size = abs(slope)
    right = abs(size - 1.0) <= max(PROOF_WITHIN + ROUNDING, PROOF_COVERAGE * u)
    least, most = PROOF_SIZES
    return right and least <= size <= most and size > PROOF_TIMES_U * u


MACHINE: tuple[Rule, ...] = (_machine, _units, _channel, _mode, _alarms, _axis, _axis_units, _access, _safe_places)
CONSENT: tuple[Rule, ...] = (
    *(_name, _open_journals, _marker, _audit_behind, _missing_journals, _key, _skipped_change, _no_change, _base),
    *(_temperature, _self_test, _proof, _inside_safe_places),
)
RELEASE: tuple[Rule, ...] = (*MACHINE, _jump, _inside_safe_places)
NAMED: tuple[Rule, ...] = (_name,)


# Switching off asks only for the right machine, the right axis and no running program: off is where every doubt leads,
# and alarms, modes or a missing reference must not keep a table on. The control itself demands release and standstill.


def switching_refusals(
    expected: MachineIdentity, found: MachineIdentity, axis: str, axes: tuple[str, ...], *, in_reset: bool
) -> tuple[Refusal, ...]:
    """Every reason not to switch off now, by catalogue code (E-INT-MACHINE, E-INT-AXIS, E-INT-CHANNEL)."""
    reasons: list[Refusal] = []
    different = expected.differences(found)
    if different:
        wanted = ", ".join(str(getattr(expected, name)) for name in different)
        told = ", ".join(str(getattr(found, name)) for name in different)
        reasons += refuse("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=told)
    if axis not in axes:
        reasons += refuse("E-INT-AXIS", axis=axis, known=", ".join(sorted(axes)))
    if not in_reset:
        reasons += refuse("E-INT-CHANNEL", found="active")
    return tuple(reasons)
