"""The independent checker: a table as the control holds it, off, judged once more before it is activated; pure.

It shares no code with what makes, merges, judges, converts or compares tables: plain loops over Python's own numbers,
written from the rules as they are printed (docs/architecture.md, sections 5 and 6), with the limits typed anew here. A
fault in those places would have to be made twice to pass. It reads the read-back of the inactive table, not what was
sent, and holds it against three things:

1. the printed rules of one table: |value| <= 0.200 mm or 0.050 deg; slope <= 1.0 um/mm (linear output over a linear
   input: 1.0 um per mm or deg) or 10 arcsec per mm or deg; change against what acted <= 0.120 mm or 0.015 deg; zero at
   the reference within 0.1 um or arcsec; a modulo table spans 360 deg and ends where it begins; an equal step divides
   the range into as many intervals as there are points less one;
2. the approved curve, by linear interpolation at its own points: turned round, of another size, or elsewhere;
3. for an axis table, the readings it was made of: it must contain the deviation = measured - target that is to be
   cancelled. With c = what the table changes and m = the mean reading, both without their means, a correlation below
   -0.5 says a turned sign, and more than ten times the size a wrong unit. Anything closer is the interlocks' to judge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, isnan, sqrt

from drivers.message import Message
from drivers.types.tables import CompensationTable

MOST_VALUE = {"mm": 200.0, "deg": 180.0}
MOST_SLOPE = {"mm": 1.0, "deg": 10.0}
MOST_CHANGE = {"mm": 120.0, "deg": 54.0}
"""0.200 and 0.120 mm in um; 0.050 and 0.015 deg in arcsec."""
MOST_AT_REFERENCE = 0.1
WHOLE = 1e-6
TURNED, MOST_TIMES, SMALLEST = -0.5, 10.0, 0.5
FEWEST = 5


@dataclass(frozen=True, slots=True)
class ApprovedCurve:
    """What a table is held against.

    ``table`` is as approved, ``acted`` what stood in its place and acted (None: nothing did), ``reference`` where it
    must be zero, ``allowed`` what the control's last place may change, um or arcsec. ``measured`` are (target, mean
    reading) pairs of the axis, um or arcsec, with ``acting`` on while they were taken (None: no table).
    """

    table: CompensationTable
    acted: CompensationTable | None
    reference: float
    allowed: float
    measured: tuple[tuple[float, float], ...] = ()
    acting: CompensationTable | None = None


def faults_of(found: CompensationTable, approved: ApprovedCurve) -> tuple[Message, ...]:
    """Everything that is wrong with a table that was read back; empty: it may be activated."""
    if found.kind == "reversal":
        return ()  # one value, written only when it is released
    shape = tuple(_form(found, approved.table))
    if shape:
        return shape
    return (
        *_sizes(found, approved.allowed),
        *_change(found, approved),
        *_reference(found, approved),
        *_against_approved(found, approved),
        *_against_readings(found, approved),
    )


def mean_readings(
    targets: Sequence[float], deviations: Sequence[Sequence[Sequence[float]]]
) -> tuple[tuple[float, float], ...]:
    """(target, mean reading) pairs of readings (m, n, 2); a target without any reading is left out."""
    found = []
    for target, repeated in zip(targets, deviations, strict=True):
        values = [value for both in repeated for value in both if not isnan(value)]
        if values:
            found.append((target, sum(values) / len(values)))
    return tuple(found)


def _places(table: CompensationTable) -> list[float]:
    if table.places:
        return [float(place) for place in table.places]
    return [table.minimum + table.step * number for number in range(len(table.deviations))]


def _curves(table: CompensationTable) -> list[Sequence[float]]:
    return [curve for curve in (table.deviations, table.reverse) if curve]


def _form(found: CompensationTable, wanted: CompensationTable) -> Iterator[Message]:
    """Numbers, grid, turn and units: what nothing else can be judged without."""
    count, span = len(found.deviations), found.maximum - found.minimum
    numbers = [found.minimum, found.maximum, found.step, *found.places, *found.deviations, *found.reverse]
    good = all(isfinite(number) for number in numbers) and count >= 2 and span > 0.0
    good = good and (not found.reverse or len(found.reverse) == count)
    if good and found.places:
        places = found.places
        good = len(places) == count and all(one < two for one, two in pairwise(places))
    elif good:
        good = found.step > 0.0 and abs(span / found.step - (count - 1)) <= WHOLE * count
    if good and found.modulo:
        ends = max(abs(curve[0] - curve[-1]) for curve in _curves(found))
        good = found.input_unit == "deg" and abs(span - 360.0) <= WHOLE and ends <= MOST_AT_REFERENCE
    units = (found.input_unit, found.output_unit, found.input_axis, found.output_axis, found.modulo)
    same = units == (wanted.input_unit, wanted.output_unit, wanted.input_axis, wanted.output_axis, wanted.modulo)
    if not (good and same):
        grid = {"minimum": found.minimum, "maximum": found.maximum, "step": found.step, "count": count}
        yield Message.of("W-CHECK-FORM", **grid, unit=found.input_unit)


def _sizes(found: CompensationTable, allowed: float) -> Iterator[Message]:
    unit, places = found.output_unit, _places(found)
    for curve in _curves(found):
        for place, value in zip(places, curve, strict=True):
            if abs(value) > MOST_VALUE[unit] + allowed:
                yield Message.of("W-CHECK-VALUE", **_at(found, place), value=_short(value), limit=MOST_VALUE[unit])
                break
        for place, after, one, two in zip(places, places[1:], curve, curve[1:], strict=False):
            if abs(two - one) > MOST_SLOPE[unit] * (after - place) + 2.0 * allowed:
                slope = _short((two - one) / (after - place))
                yield Message.of("W-CHECK-SLOPE", **_at(found, place), slope=slope, limit=MOST_SLOPE[unit])
                break


def _change(found: CompensationTable, approved: ApprovedCurve) -> Iterator[Message]:
    most = MOST_CHANGE[found.output_unit]
    for number, curve in enumerate(_curves(found)):
        for place, value in zip(_places(found), curve, strict=True):
            change = value - _value(approved.acted, place, number)
            if abs(change) > most + 2.0 * approved.allowed:
                yield Message.of("W-CHECK-CHANGE", **_at(found, place), change=_short(change), limit=most)
                return


def _reference(found: CompensationTable, approved: ApprovedCurve) -> Iterator[Message]:
    if found.direction:
        return  # half of a pair: the two together are zero there
    curves = range(len(_curves(found)))
    value = sum(_value(found, approved.reference, number) for number in curves) / len(curves)
    if abs(value) > MOST_AT_REFERENCE + approved.allowed:
        yield Message.of(
            "W-CHECK-REFERENCE", **_at(found, approved.reference), value=_short(value), limit=MOST_AT_REFERENCE
        )


def _against_approved(found: CompensationTable, approved: ApprovedCurve) -> Iterator[Message]:
    wanted, worst, place = approved.table, 0.0, approved.table.minimum
    pairs = []
    for number, curve in enumerate(_curves(wanted)):
        for at, value in zip(_places(wanted), curve, strict=True):
            here = _value(found, at, number)
            pairs.append((here, float(value)))
            if abs(here - value) > worst:
                worst, place = abs(here - value), at
    if worst <= approved.allowed + WHOLE:
        return
    both, mine, theirs = (sum(one * two for one, two in pairs), _sum(pairs, 0), _sum(pairs, 1))
    size = both / theirs if theirs > 0.0 else 0.0
    alike = both / sqrt(mine * theirs) if mine > 0.0 and theirs > 0.0 else 0.0
    if alike < TURNED:
        yield Message.of("W-CHECK-SIGN", **_at(found, place))
    elif alike > 1.0 - WHOLE:
        yield Message.of("W-CHECK-SIZE", **_at(found, place), factor=_short(size))
    else:
        yield Message.of("W-CHECK-POINT", **_at(found, place), difference=_short(worst))


def _sum(pairs: Sequence[tuple[float, float]], which: int) -> float:
    return sum(pair[which] ** 2 for pair in pairs)


def _against_readings(found: CompensationTable, approved: ApprovedCurve) -> Iterator[Message]:
    kept = [(at, read) for at, read in approved.measured if found.minimum <= at <= found.maximum]
    if found.kind != "axis" or len(kept) < FEWEST:
        return
    ways = range(len(_curves(found)))
    changes = [
        sum(_value(found, at, way) - _value(approved.acting, at, way) for way in ways) / len(ways) for at, _read in kept
    ]
    change, read = _centred(changes), _centred([one for _at_, one in kept])
    sizes = [sqrt(sum(value**2 for value in one) / len(one)) for one in (change, read)]
    if sizes[0] <= SMALLEST:
        return
    together = sum(one * two for one, two in zip(change, read, strict=True)) / len(kept)
    if sizes[1] > 0.0 and together < TURNED * sizes[0] * sizes[1]:
        yield Message.of("W-CHECK-MEASURED", **_at(found, kept[0][0]), times=_short(-sizes[0] / sizes[1]))
    elif sizes[0] > MOST_TIMES * max(sizes[1], SMALLEST / MOST_TIMES):
        times = _short(sizes[0] / max(sizes[1], SMALLEST / MOST_TIMES))
        yield Message.of("W-CHECK-MEASURED", **_at(found, kept[0][0]), times=times)


def _centred(values: Sequence[float]) -> list[float]:
    mean = sum(values) / len(values)
    return [value - mean for value in values]


def _value(table: CompensationTable | None, place: float, way: int) -> float:
    """By straight lines between points; held beyond the ends, or one turn on for a modulo table; nothing: zero."""
    if table is None or len(table.deviations) < 2:
        return 0.0
    places, curves = _places(table), _curves(table)
    curve = curves[way] if way < len(curves) else curves[0]
    if table.modulo and not places[0] <= place <= places[-1]:
        turn = places[-1] - places[0]
        place -= turn * ((place - places[0]) // turn)
    if place <= places[0]:
        return float(curve[0])
    for before, after, one, two in zip(places, places[1:], curve, curve[1:], strict=False):
        if place <= after:
            return float(one + (two - one) * (place - before) / (after - before))
    return float(curve[-1])


def _at(table: CompensationTable, place: float) -> dict[str, object]:
    deviation = {"mm": "um", "deg": "arcsec"}[table.output_unit]
    return {"place": _short(place), "input_unit": table.input_unit, "unit": deviation}


def _short(value: float) -> float:
    return float(f"{value:.5g}")
