"""May we write? Every reason against it at once, from facts read before; pure.

Limits: |value| 0.200 mm / 0.050 deg; slope 1.0 um/mm / 10 arcsec per deg; change against the live table
0.120 mm / 0.015 deg; zero at the reference position within 0.1 um / arcsec; old and new agree within
1 um / 1 arcsec where the axis stands. A measurement older than 24 h or taken more than 2 K away is stale.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Literal

import numpy as np

from drivers.errors import words
from drivers.types import (
    Ambient,
    AxisState,
    ChannelStatus,
    CompensationTable,
    FloatArray,
    MachineIdentity,
    MachineState,
    SignProof,
    TableLimits,
)
from drivers.units import AxisUnit
from gateway.domain import Capture, TableChange

MAX_VALUE = {"mm": 200.0, "deg": 180.0}
MAX_SLOPE = {"mm": 1.0, "deg": 10.0}
MAX_CHANGE = {"mm": 120.0, "deg": 54.0}
MAX_JUMP = 1.0
MAX_AT_REFERENCE = 0.1
MAX_AGE = timedelta(hours=24)
MAX_AHEAD = timedelta(minutes=2)
MAX_DRIFT_K = 2.0
MIN_REPETITIONS = 3
MAX_SUSPECT_SHARE = 0.1
# Values are judged with this much room, so that a table exactly at its limit passes.
ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Refusal:
    """One reason not to write: a catalogue code with its fields."""

    code: str
    fields: Mapping[str, object]

    @property
    def words(self) -> str:
        """The reason as people read it."""
        return f"{self.code}: {words(self.code, **self.fields)}"


@dataclass(frozen=True, slots=True)
class PushFacts:
    """All that is known when the question is asked.

    ``moment`` "start" is before anything is sent, "release" while the program waits between its halves.
    ``agreeing_position`` is where old and new table agree (None: nowhere). ``unchanged`` says whether the live
    tables are those of the capture (None: not read yet). ``unfinished`` names journals left open.
    """

    change: TableChange
    purpose: Literal["table", "sign-proof", "restore"]
    moment: Literal["start", "release"]
    typed_name: str
    site_name: str
    expected: MachineIdentity
    found: MachineIdentity
    state: MachineState
    limits: TableLimits
    reference: float
    agreeing_position: float | None
    now_utc: datetime
    unchanged: bool | None = None
    proof: SignProof | None = None
    capture: Capture | None = None
    ambient_now: Ambient | None = None
    unfinished: tuple[str, ...] = ()
    modes: tuple[str, ...] = ("AUTO",)
    harmless_alarms: tuple[int, ...] = ()
    access_level_needed: int = 7
    known: Mapping[str, object] = field(default_factory=dict)

    @property
    def table(self) -> CompensationTable:
        """The table to be written."""
        return self.change.new

    @property
    def unit(self) -> AxisUnit:
        """Unit of the table's output axis."""
        return self.change.new.output_unit

    @property
    def axis_state(self) -> AxisState | None:
        """The axis as the controller reports it."""
        return self.state.axes.get(self.change.axis)


def refusals(facts: PushFacts) -> tuple[Refusal, ...]:
    """Every reason not to write now, none left out; empty means yes."""
    return tuple(refusal for rule in _rules(facts) for refusal in rule(facts))


Rule = Callable[[PushFacts], Iterator[Refusal]]


def _rules(facts: PushFacts) -> tuple[Rule, ...]:
    if facts.moment == "release":
        return (*_MACHINE, _jump)
    if facts.purpose == "restore":
        return (*_MACHINE, _name, _points)
    if facts.purpose == "sign-proof":
        return (*_MACHINE, *_CONSENT, *_TABLE)
    return (*_MACHINE, *_CONSENT, *_TABLE, *_MEASURED)


def _no(code: str, **fields: object) -> Iterator[Refusal]:
    yield Refusal(code, fields)


def _machine(facts: PushFacts) -> Iterator[Refusal]:
    different = facts.expected.differences(facts.found)
    if different:
        wanted = ", ".join(str(getattr(facts.expected, name)) for name in different)
        found = ", ".join(str(getattr(facts.found, name)) for name in different)
        yield from _no("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=found)


def _units(facts: PushFacts) -> Iterator[Refusal]:
    if facts.found.unit_system != "metric":
        yield from _no("E-INT-INCH", found=facts.found.unit_system)


def _channel(facts: PushFacts) -> Iterator[Refusal]:
    in_reset = facts.state.channel is ChannelStatus.RESET
    if in_reset != (facts.moment == "start"):
        wanted = "reset" if facts.moment == "start" else "waiting in the program"
        yield from _no("E-INT-CHANNEL", found=facts.state.channel.name.lower(), wanted=wanted)


def _mode(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.mode.upper() not in facts.modes:
        yield from _no("E-INT-MODE", found=facts.state.mode, wanted=" or ".join(facts.modes))


def _alarms(facts: PushFacts) -> Iterator[Refusal]:
    active = [number for number in facts.state.alarms if number not in facts.harmless_alarms]
    if active:
        yield from _no("E-INT-ALARM", alarms=", ".join(map(str, active)))


def _axis(facts: PushFacts) -> Iterator[Refusal]:
    axis = facts.axis_state
    if axis is None:
        known = ", ".join(sorted(facts.state.axes))
        yield from _no("E-INT-AXIS", axis=facts.change.axis, known=known)
        return
    if not axis.referenced:
        yield from _no("E-INT-REFERENCE", axis=axis.name)
    if not axis.in_position:
        yield from _no("E-INT-MOVING", axis=axis.name)


def _access(facts: PushFacts) -> Iterator[Refusal]:
    if facts.state.access_level > facts.access_level_needed:
        level, needed = facts.state.access_level, facts.access_level_needed
        yield from _no("E-INT-ACCESS", level=level, needed=needed)


def _jump(facts: PushFacts) -> Iterator[Refusal]:
    axis = facts.axis_state
    if axis is None:
        return
    jump = value_at(facts.table, axis.position)
    if facts.purpose == "restore" and not facts.change.old_enabled:
        return
    if abs(jump) > MAX_JUMP + ROUNDING:
        fields = {"axis": axis.name, "position": axis.position, "limit": MAX_JUMP}
        yield from _no("E-INT-JUMP", jump=round(jump, 3), unit=facts.table.deviation_unit, **fields)


def _name(facts: PushFacts) -> Iterator[Refusal]:
    if facts.typed_name != facts.site_name:
        typed = facts.typed_name or "nothing"
        yield from _no("E-INT-NAME", typed=typed, wanted=facts.site_name)


def _unfinished(facts: PushFacts) -> Iterator[Refusal]:
    if facts.unfinished:
        yield from _no("E-INT-UNFINISHED", journals=", ".join(facts.unfinished))


def _skipped(facts: PushFacts) -> Iterator[Refusal]:
    if facts.change.skipped:
        yield from _no("E-INT-SKIPPED", why=facts.change.skipped)


def _nothing(facts: PushFacts) -> Iterator[Refusal]:
    change = facts.change
    if change.old_enabled and change.new == change.old:
        yield from _no("E-INT-NOTHING", table=change.new.name)


def _base(facts: PushFacts) -> Iterator[Refusal]:
    if facts.unchanged is False:
        yield from _no("E-INT-LOST-UPDATE", axis=facts.change.axis, base=facts.change.base_digest[:12])


def _proof(facts: PushFacts) -> Iterator[Refusal]:
    if facts.purpose != "table":
        return
    proof, table = facts.proof, facts.table
    if proof is None or (proof.function, proof.output_axis) != (table.function, table.output_axis):
        yield from _no("E-INT-NO-PROOF", function=table.function, axis=table.output_axis)
    elif proof.machine.differences(facts.found):
        differ = ", ".join(proof.machine.differences(facts.found))
        yield from _no("E-INT-OTHER-PROOF", axis=table.output_axis, differ=differ)
    elif table.function == "EEC" and proof.sign != 1:
        yield from _no("E-INT-SIGN", axis=table.output_axis, slope=proof.slope)


def _cross(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    if table.function != "EEC":
        yield from _no("E-INT-CROSS", table=table.name, function=table.function)
    if table.output_axis != facts.change.axis:
        yield from _no("E-INT-OTHER-AXIS", table=table.name, axis=facts.change.axis)


def _points(facts: PushFacts) -> Iterator[Refusal]:
    needed, reserved = len(facts.table.deviations), facts.limits.reserved_points
    if needed > reserved:
        axis, index = facts.table.output_axis, facts.table.index
        yield from _no("E-INT-POINTS", axis=axis, index=index, needed=needed, reserved=reserved)


def _grid(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    grid = (table.minimum, table.maximum, table.step)
    intervals = len(table.deviations) - 1
    whole = bool(np.all(np.isfinite(grid))) and table.step > 0 and intervals >= 1
    if not whole or abs((table.maximum - table.minimum) / table.step - intervals) > 1e-6:
        minimum, maximum, step = grid
        count = len(table.deviations)
        yield from _no("E-INT-GRID", table=table.name, minimum=minimum, maximum=maximum, step=step, count=count)


def _findings(facts: PushFacts) -> Iterator[Refusal]:
    for finding in facts.change.findings:
        yield from _no("E-INT-FINDING", table=facts.table.name, finding=finding)


def _values(facts: PushFacts) -> Iterator[Refusal]:
    table, unit = facts.table, facts.table.deviation_unit
    values = np.asarray(table.deviations, dtype=np.float64)
    if values.size == 0 or not np.all(np.isfinite(values)):
        yield from _no("E-INT-FINITE", table=table.name)
        return
    largest = float(np.max(np.abs(values)))
    if largest > MAX_VALUE[facts.unit] + ROUNDING:
        yield from _no("E-INT-VALUE", table=table.name, value=largest, limit=MAX_VALUE[facts.unit], unit=unit)
    slope = float(np.max(np.abs(np.diff(values)), initial=0.0)) / table.step if table.step > 0 else 0.0
    if slope > MAX_SLOPE[facts.unit] + ROUNDING:
        limit, per = MAX_SLOPE[facts.unit], table.input_unit
        yield from _no("E-INT-SLOPE", table=table.name, slope=round(slope, 4), limit=limit, unit=unit, per=per)
    if table.modulo and abs(values[0] - values[-1]) > MAX_AT_REFERENCE:
        yield from _no("E-INT-MODULO", table=table.name, first=values[0], last=values[-1], unit=unit)


def _reference(facts: PushFacts) -> Iterator[Refusal]:
    value = value_at(facts.table, facts.reference)
    if not abs(value) <= MAX_AT_REFERENCE + ROUNDING:
        fields = {"reference": facts.reference, "value": value, "limit": MAX_AT_REFERENCE}
        yield from _no("E-INT-REF-VALUE", table=facts.table.name, unit=facts.table.deviation_unit, **fields)


def _change(facts: PushFacts) -> Iterator[Refusal]:
    old = facts.change.old if facts.change.old_enabled else None
    places = np.asarray(facts.table.positions)
    before = np.array([value_at(old, place) for place in places]) if old is not None else np.zeros(places.shape)
    largest = float(np.max(np.abs(np.asarray(facts.table.deviations) - before), initial=0.0))
    if largest > MAX_CHANGE[facts.unit] + ROUNDING:
        fields = {"change": round(largest, 3), "limit": MAX_CHANGE[facts.unit]}
        yield from _no("E-INT-CHANGE", table=facts.table.name, unit=facts.table.deviation_unit, **fields)


def _agreement(facts: PushFacts) -> Iterator[Refusal]:
    if facts.agreeing_position is None:
        yield from _no("E-INT-NOWHERE", axis=facts.change.axis, limit=MAX_JUMP, unit=facts.table.deviation_unit)


def _age(facts: PushFacts) -> Iterator[Refusal]:
    """A vendor's file has no end time we could trust, so its age is the operator's to know."""
    capture = facts.capture
    if capture is None or (capture.source != "live" and not capture.ended_utc):
        return
    try:
        age = facts.now_utc - datetime.fromisoformat(capture.ended_utc)
    except (ValueError, TypeError):
        yield from _no("E-INT-DATE", axis=capture.axis, found=capture.ended_utc or "nothing")
        return
    if age > MAX_AGE or age < -MAX_AHEAD:
        hours = round(age.total_seconds() / 3600.0, 1)
        limit = MAX_AGE.total_seconds() / 3600.0
        yield from _no("E-INT-AGE", axis=capture.axis, hours=hours, limit=limit)


def _warmth(facts: PushFacts) -> Iterator[Refusal]:
    if facts.capture is None or facts.ambient_now is None:
        return
    then, now = _degc(facts.capture.ambient_end), _degc(facts.ambient_now)
    if then is not None and now is not None and abs(now - then) > MAX_DRIFT_K:
        fields = {"then": round(then, 2), "now": round(now, 2), "limit": MAX_DRIFT_K}
        yield from _no("E-INT-WARMTH", axis=facts.capture.axis, **fields)


def _degc(ambient: Ambient) -> float | None:
    known = [value for value in ambient.material_degc if np.isfinite(value)]
    return float(np.mean(known)) if known else ambient.air_degc


def _coverage(facts: PushFacts) -> Iterator[Refusal]:
    """The table may reach one measuring interval past the outer targets, no further."""
    capture, table = facts.capture, facts.table
    if capture is None or capture.targets.size < 2:
        return
    targets = np.sort(capture.targets)
    widest = max(float(np.max(np.diff(targets))), table.step)
    if table.modulo:
        gap = float(targets[0]) + (table.maximum - table.minimum) - float(targets[-1])
        beyond = max(gap, 0.0) - widest
    else:
        low, high = float(targets[0]) - table.minimum, table.maximum - float(targets[-1])
        beyond = max(low, high) - widest
    if beyond > widest * 0.5 + ROUNDING:
        first, last = float(targets[0]), float(targets[-1])
        span = {"minimum": table.minimum, "maximum": table.maximum}
        yield from _no("E-INT-COVERAGE", table=table.name, first=first, last=last, **span)


def _complete(facts: PushFacts) -> Iterator[Refusal]:
    capture = facts.capture
    if capture is None:
        return
    good = np.isfinite(capture.deviations)
    for target, repetition, approach in capture.suspects:
        good[target, repetition, approach] = False
    short = int(np.sum(np.sum(good, axis=1) < MIN_REPETITIONS))
    if short:
        fields = {"places": short, "total": good.shape[0] * good.shape[2], "needed": MIN_REPETITIONS}
        yield from _no("E-INT-INCOMPLETE", axis=capture.axis, **fields)
    share = len(capture.suspects) / max(capture.deviations.size, 1)
    if share > MAX_SUSPECT_SHARE:
        count, percent = len(capture.suspects), 100.0 * MAX_SUSPECT_SHARE
        yield from _no("E-INT-SUSPECTS", axis=capture.axis, count=count, limit=percent)


def _measured_axis(facts: PushFacts) -> Iterator[Refusal]:
    capture, change = facts.capture, facts.change
    if capture is None:
        return
    if capture.axis != change.axis or capture.axis_unit != change.new.input_unit:
        found = f"{capture.axis} in {capture.axis_unit}"
        yield from _no("E-INT-MEASURED", axis=change.axis, found=found)
    if capture.source == "live" and capture.sense is None:
        yield from _no("E-INT-SENSE", axis=capture.axis)


def _gain(facts: PushFacts) -> Iterator[Refusal]:
    """What is predicted must not be worse than what was measured."""
    if facts.capture is None or facts.change.predicted.size < 2:
        return
    measured, predicted = _spread(_means(facts.capture.deviations)), _spread(facts.change.predicted)
    if predicted > measured * (1.0 + 1e-9):
        fields = {"predicted": round(predicted, 3), "measured": round(measured, 3)}
        yield from _no("E-INT-GAIN", axis=facts.change.axis, unit=facts.table.deviation_unit, **fields)


def _means(deviations: FloatArray) -> FloatArray:
    """Mean of each target over all that is there; a target with nothing is left out."""
    flat = deviations.reshape(deviations.shape[0], -1)
    there = np.isfinite(flat)
    count = np.sum(there, axis=1)
    sums = np.sum(np.where(there, flat, 0.0), axis=1)
    return np.asarray(sums[count > 0] / count[count > 0])


def _spread(values: FloatArray) -> float:
    return float(np.std(values)) if values.size else 0.0


def value_at(table: CompensationTable, position: float) -> float:
    """Deviation of a table at a position in its input axis' unit; a table never loaded (step 0) is zero."""
    if table.step <= 0 or not any(table.deviations):
        return 0.0
    return float(table.at(np.array([position]))[0])


_MACHINE: tuple[Rule, ...] = (_machine, _units, _channel, _mode, _alarms, _axis, _access)
_CONSENT: tuple[Rule, ...] = (_name, _unfinished, _skipped, _nothing, _base, _proof)
_TABLE: tuple[Rule, ...] = (
    _cross,
    _points,
    _grid,
    _findings,
    _values,
    _reference,
    _change,
    _agreement,
)
_MEASURED: tuple[Rule, ...] = (_measured_axis, _age, _warmth, _coverage, _complete, _gain)
