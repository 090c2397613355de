"""Rules on the machine as it stands, and on the consent to write to it."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.types import ChannelStatus
from gateway.interlocks.facts import MAX_JUMP, ROUNDING, PushFacts, Refusal, Rule, no, value_at


def _machine(facts: PushFacts) -> Iterator[Refusal]:
    different = facts.expected.differences(facts.found)
    if different:
        wanted = ", ".join(str(getattr(facts.expected, name)) for name in different)
        found = ", ".join(str(getattr(facts.found, name)) for name in different)
        yield from no("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=found)


def _units(facts: PushFacts) -> Iterator[Refusal]:
    if facts.found.unit_system != "metric":
        yield from no("E-INT-INCH", found=facts.found.unit_system)


def _channel(facts: PushFacts) -> Iterator[Refusal]:
    """Between the halves a program waits, or has ended where the control needs two: both are right."""
    if facts.moment == "start" and facts.state.channel is not ChannelStatus.RESET:
        yield from no("E-INT-CHANNEL", found=facts.state.channel.name.lower())


def _mode(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.mode.upper() not in facts.modes:
        yield from no("E-INT-MODE", found=facts.state.mode, wanted=" or ".join(facts.modes))


def _alarms(facts: PushFacts) -> Iterator[Refusal]:
    active = [number for number in facts.state.alarms if number not in facts.harmless_alarms]
    if active:
        yield from no("E-INT-ALARM", alarms=", ".join(map(str, active)))


def _axis(facts: PushFacts) -> Iterator[Refusal]:
    axis = facts.axis_state
    if axis is None:
        known = ", ".join(sorted(facts.state.axes))
        yield from no("E-INT-AXIS", axis=facts.change.axis, known=known)
        return
    if not axis.referenced:
        yield from no("E-INT-REFERENCE", axis=axis.name)
    if not axis.in_position:
        yield from no("E-INT-MOVING", axis=axis.name)


def _access(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.access_level > facts.access_level_needed:
        level, needed = facts.state.access_level, facts.access_level_needed
        yield from no("E-INT-ACCESS", level=level, needed=needed)


def _jump(facts: PushFacts) -> Iterator[Refusal]:
    axis = facts.axis_state
    if axis is None:
        return
    jump = value_at(facts.table, axis.position)
    if facts.purpose == "restore" and not facts.change.old_enabled:
        return
    if abs(jump) > MAX_JUMP + ROUNDING:
        fields = {"axis": axis.name, "position": axis.position, "limit": MAX_JUMP}
        yield from no("E-INT-JUMP", jump=round(jump, 3), unit=facts.table.deviation_unit, **fields)


def _name(facts: PushFacts) -> Iterator[Refusal]:
    if facts.typed_name != facts.site_name:
        typed = facts.typed_name or "nothing"
        yield from no("E-INT-NAME", typed=typed, wanted=facts.site_name)


def _unfinished(facts: PushFacts) -> Iterator[Refusal]:
    if facts.unfinished:
        yield from no("E-INT-UNFINISHED", journals=", ".join(facts.unfinished))


def _skipped(facts: PushFacts) -> Iterator[Refusal]:
    if facts.change.skipped:
        yield from no("E-INT-SKIPPED", why=facts.change.skipped)


def _nothing(facts: PushFacts) -> Iterator[Refusal]:
    change = facts.change
    if change.old_enabled and change.new == change.old:
        yield from no("E-INT-NOTHING", table=change.new.name)


def _base(facts: PushFacts) -> Iterator[Refusal]:
    if facts.unchanged is False:
        yield from no("E-INT-LOST-UPDATE", axis=facts.change.axis, base=facts.change.base_digest[:12])


def _proof(facts: PushFacts) -> Iterator[Refusal]:
    if facts.purpose != "table":
        return
    proof, table = facts.proof, facts.table
    if proof is None or (proof.function, proof.output_axis) != (table.function, table.output_axis):
        yield from no("E-INT-NO-PROOF", function=table.function, axis=table.output_axis)
    elif proof.machine.differences(facts.found):
        differ = ", ".join(proof.machine.differences(facts.found))
        yield from no("E-INT-OTHER-PROOF", axis=table.output_axis, differ=differ)
    elif table.function == "EEC" and proof.sign != 1:
        yield from no("E-INT-SIGN", axis=table.output_axis, slope=proof.slope)


MACHINE: tuple[Rule, ...] = (_machine, _units, _channel, _mode, _alarms, _axis, _access)
CONSENT: tuple[Rule, ...] = (_name, _unfinished, _skipped, _nothing, _base, _proof)
RELEASE: tuple[Rule, ...] = (*MACHINE, _jump)
NAMED: tuple[Rule, ...] = (_name,)
