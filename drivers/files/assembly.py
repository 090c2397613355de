"""From readings to a measured set, the one way for every layout: units, datum, turns, and what cannot be true."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivers.errors import FileFormatError
from drivers.files.numbers import FARTHEST, MOST_TOLD, UNIT_LINES, no_readings
from drivers.files.readings import Readings, Rows, Whole
from drivers.files.tables.statements import remarks
from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.types.values import FloatArray
from drivers.units import READING_UNITS, TARGET_UNITS, AxisUnit, deviation_scale, deviation_unit, unit_named

MOST_SHARE = 0.02  # of the targets' range: an axis that goes so wrong is none, columns changed about are
LARGEST = {"mm": 5000.0, "deg": 1000.0}
APART, MARK_APART, MARK_LEAST = 30.0, 10.0, 20.0
"""A reading is out of line by so many robust spreads, a mark for no reading by fewer; um or arcsec at least."""
SAME_LENGTH = 0.05  # of the targets' range: readings that differ less while the targets run through it are one length
HALF_TURN, TURN = 180.0, 360.0
TYPICAL = 1.4826  # of the median distance from the median: the standard deviation of what is normal
FEWEST_NINES = 3
MARKS = {999.0, *(float(2**power - 1) for power in (15, 16, 31, 32)), *(10.0**power for power in range(6, 10))}
LEAST_FOR_SPREAD = 3
INCHES = ("inch", "uin")
_COUNTED = dict.fromkeys(("targets", "target positions", "ziele", "zielpositionen", "目标数", "目标点数"), "targets")
_COUNTED |= dict.fromkeys(("runs", "passes", "repetitions", "cycles", "läufe", "wiederholungen", "zyklen"), "runs")
_COUNTED |= dict.fromkeys(("循环次数", "重复次数", "次数"), "runs")
VENDOR_UNITS = {"mm": ("mm", "um"), "deg": ("deg", "arcsec", "mrad", "urad")}
READING_LINES = tuple(
    f"{what} {unit}"
    for what in ("reading", "readings", "deviation", "error", "data", "value", "result")
    for unit in ("unit", "units")
)
NEAR = 0.002  # of the mean step: places so near each other that no pass stopped at both are one target


def assembled(
    found: Readings,
    where: str,
    *,
    header: Mapping[str, str],
    warnings: tuple[Message, ...] = (),
    confirmed: bool = False,
) -> MeasuredSet:
    """Targets (m,) rising in mm or deg, deviations (m, n, 2) in um or arcsec.

    Raises FileFormatError: E-FILE-ROWS; E-FILE-LINE for a target that occurs twice in a run, or a number that no
    measurement holds; E-FILE-LENGTH and E-FILE-SAME for a length in place of positions;
    E-FILE-EXCHANGED for targets in the column of positions. Readings out of line by orders
    of magnitude are a blocking doubt, unless a person ``confirmed`` them.
    """
    lost = np.isnan(found.rows.value)
    rows = found.rows.where(~lost) if lost.any() else found.rows
    if not len(rows):
        raise FileFormatError("E-FILE-ROWS", where)
    if found.quantity == "length":
        count = np.unique(rows.target).size
        raise FileFormatError("E-FILE-LENGTH", where, line=int(rows.line[0]), targets=count)
    if found.quantity in ("position", "deviation") and not confirmed:
        _refuse_exchanged(rows, where, alone=found.quantity == "position")
    targets, crossed = _unwrapped(found, rows)
    own = TARGET_UNITS[found.target_unit][1]  # a reading counts as its target does, not as the target of the record
    from_ = targets if found.quantity == "increment" else rows.target * own
    values, turned = _deviations(found, rows, from_, where)
    beyond = ~((np.abs(targets) <= FARTHEST) & (np.abs(values) <= FARTHEST))
    if beyond.any():
        row = rows.row(int(np.argmax(beyond)))
        why = Message.of("W-FILE-NO-MEASUREMENT", target=row.target, quantity=found.quantity, value=row.value)
        raise _wrong(where, row.line, why)
    targets, joined = _near_ones_joined(rows, targets)
    both = (found.target_unit, found.unit)
    units = other_unit(both, header, where, reading=found.unit, confirmed=confirmed)
    grid = _arranged(rows, targets, values, where)
    doubts = (*found.doubts, *crossed, *turned, *joined, *units, *_missing(found.rows.where(lost)))
    doubts += _counts(header, grid, where)
    measured = MeasuredSet(grid.targets, grid.deviations, found.axis_unit, header=header, doubts=doubts)
    kept = _judged(measured, where, grid, apart=found.apart, confirmed=confirmed, refuses=True)
    return replace(kept, warnings=(*_notes(kept.deviations), *warnings))


def doubted(measured: MeasuredSet, where: str, *, confirmed: bool = False) -> MeasuredSet:
    """A set that a vendor's file holds as deviations: the same marks left out, a blocking doubt about wild readings.

    Words of its head about unit, factor, zero or sign, which its layout does not have, are doubts too.
    """
    stated = [(0, f"{key}: {line}") for key, text in measured.header.items() for line in text.splitlines()]
    units = VENDOR_UNITS[measured.axis_unit]
    doubts = (
        *other_unit(units, measured.header, where, confirmed=confirmed),
        *remarks(stated, where, confirmed=confirmed),
    )
    measured = replace(_through_zero(measured, where), doubts=(*measured.doubts, *doubts))
    lines = np.zeros(measured.deviations.shape, np.int64)
    grid = _Grid(measured.targets, measured.deviations, measured.deviations, lines)
    return _judged(measured, where, grid, apart=False, confirmed=confirmed, refuses=False)


def _wrong(where: str, line: int, why: str | Message) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


# ------------------------------------------------------------------------------------------------- units and turns


def _unwrapped(found: Readings, rows: Rows) -> tuple[FloatArray, tuple[Doubt, ...]]:
    """Targets in mm or deg; where an axis was measured through the end of its turn, 340 deg counts as -20 deg."""
    kind, scale = TARGET_UNITS[found.target_unit]
    targets = rows.target * scale
    if kind != "deg" or not bool(np.all((targets >= 0.0) & (targets <= TURN))):
        return targets, ()
    if (arc := across_zero(targets.tolist())) is not None:
        crossed = Doubt("S-READ-CROSSED", "", numbers={"first": arc[1], "as_target": arc[1] - TURN})
        return np.where(targets >= arc[1], targets - TURN, targets), (crossed,)
    passes = [(way, targets[which].tolist()) for way, which in _passes(rows)]
    cuts = [_cut(own, -1.0 if way else 1.0) for way, own in passes]
    known = [one for one in cuts if one is not None]
    if not known or len(known) < len([own for _way, own in passes if len(own) > 1]):
        return targets, ()
    low, high = max(one[0] for one in known), min(one[1] for one in known)
    if low >= high:
        return targets, ()
    moved = np.where(targets >= high, targets - TURN, targets)
    doubt = Doubt("S-READ-CROSSED", "", numbers={"first": high, "as_target": high - TURN})
    return moved, (doubt,)


def _passes(rows: Rows) -> list[tuple[int, Whole]]:
    """Way and places of each pass, in the order of its readings."""
    key = rows.run * 2 + rows.approach
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order])) + 1
    return [(int(rows.approach[own[0]]), own) for own in np.split(order, starts)]


def across_zero(targets: Sequence[float]) -> tuple[float, float] | None:
    """The neighbours (deg, 0 .. 360) between which over half a turn was not measured; None where there are none.

    The arc that was measured then runs through zero, in whatever order its targets were written. Where the step across
    zero would be more than half as wide as that gap, nobody can tell which of the two was measured.
    """
    at = sorted(set(targets))
    if len(at) < LEAST_FOR_SPREAD or at[0] < 0.0 or at[-1] > TURN:
        return None
    gap, low, high = max((after - before, before, after) for before, after in pairwise(at))
    return (low, high) if gap > max(HALF_TURN, 2.0 * (TURN - (at[-1] - at[0]))) and at[-1] - at[0] < TURN else None


def _through_zero(measured: MeasuredSet, where: str) -> MeasuredSet:
    """The same with the targets before zero counted below it, where the measured arc runs through zero."""
    arc = across_zero(measured.targets.tolist()) if measured.axis_unit == "deg" else None
    if arc is None:
        return measured
    targets = np.where(measured.targets >= arc[1], measured.targets - TURN, measured.targets)
    order = np.argsort(targets)
    doubt = Doubt("S-READ-CROSSED", where, numbers={"first": arc[1], "as_target": arc[1] - TURN})
    return replace(
        measured,
        targets=targets[order],
        deviations=measured.deviations[order],
        doubts=(*measured.doubts, doubt),
    )


def _cut(targets: list[float], sense: float) -> tuple[float, float] | None:
    """The largest target after and the smallest before the one place where a pass jumps back by over half a turn."""
    steps = [sense * (after - before) for before, after in pairwise(targets)]
    jumps = [at for at, step in enumerate(steps) if step < -HALF_TURN]
    if len(jumps) != 1 or any(step < 0.0 for at, step in enumerate(steps) if at != jumps[0]):
        return None
    one, other = targets[: jumps[0] + 1], targets[jumps[0] + 1 :]
    high, low = (one, other) if sense > 0 else (other, one)
    return max(low), min(high)


def _deviations(found: Readings, rows: Rows, targets: FloatArray, where: str) -> tuple[FloatArray, tuple[Doubt, ...]]:
    """Deviations in um or arcsec; angles are subtracted as angles, a whole turn more or less is none."""
    scale = deviation_scale(found.axis_unit)
    if found.quantity == "deviation":
        values = found.scale * rows.value * READING_UNITS[found.unit][1]
    else:
        factor, own = TARGET_UNITS[found.unit][1], TARGET_UNITS[found.target_unit][1]
        read = found.scale * rows.value * factor
        if found.quantity == "increment":
            values = (_summed(rows, read, targets, where) - targets) * scale
        else:
            values = (read - (targets - found.datum * own)) * scale
    if not found.circular:
        return values, ()
    whole = np.round(values / (TURN * scale))
    over = (whole != 0.0) & (np.abs(values) <= FARTHEST * scale)  # what is farther is no measurement, and stays so
    whole = np.where(over, whole, 0.0)
    if not over.any():
        return values, ()
    doubt = Doubt("S-READ-TURNS", where, numbers={"count": int(over.sum())}, names={"stops": _told(rows.where(over))})
    return values - whole * TURN * scale, (doubt,)


def _summed(rows: Rows, read: FloatArray, targets: FloatArray, where: str) -> FloatArray:
    """Positions out of steps: the first stop of a run is its datum, and its own step must be zero."""
    last: dict[tuple[int, int], float] = {}
    found = []
    columns = (rows.approach.tolist(), rows.run.tolist(), read.tolist(), targets.tolist())
    for at, (way, run, step, target) in enumerate(zip(*columns, strict=True)):
        key = (way, run)
        if key not in last and step != 0.0:
            row = rows.row(at)
            raise _wrong(where, row.line, Message.of("W-FILE-FIRST-STEP", run=row.run, value=row.value))
        last[key] = last[key] + step if key in last else target
        found.append(last[key])
    return np.array(found)


# --------------------------------------------------------------------------------------------------------- the grid


@dataclass(frozen=True, slots=True)
class _Grid:
    """Arrays of one shape (m, n, 2): deviations in um or arcsec, the numbers as written, their lines (0: unknown)."""

    targets: FloatArray
    deviations: FloatArray
    written: FloatArray
    lines: np.ndarray


def other_unit(
    units: Collection[str], header: Mapping[str, str], where: str, *, reading: str = "", confirmed: bool
) -> tuple[Doubt, ...]:
    """A line of the file's head that names a unit of lengths or angles which no number of the file has.

    ``units`` are those that the file's numbers have, ``reading`` that of the readings where it is one alone.
    """
    kinds = {TARGET_UNITS[one][0] for one in units}
    inches = {one in INCHES for one in units if TARGET_UNITS[one][0] == "mm"}
    for key, text in header.items():
        plain = " ".join(key.lower().replace("_", " ").split())
        if plain not in UNIT_LINES and plain not in READING_LINES:
            continue
        system = {"imperial": "inch", "metric": "mm"}.get(text.strip().lower(), "")
        unit = unit_named(text.strip().strip("[]()")) or system
        if not unit or TARGET_UNITS[unit][0] not in kinds:
            continue
        alike = unit in units or (unit in ("mm", "inch") and inches == {unit == "inch"})
        if (plain in READING_LINES and reading and unit != reading) or not alike:
            names = {"stated": text.strip()[:40], "found": ", ".join(dict.fromkeys(units))}
            return (Doubt("S-READ-UNITS", where, blocking=not confirmed, names=names),)
    return ()


def _counts(header: Mapping[str, str], grid: _Grid, where: str) -> tuple[Doubt, ...]:
    """Numbers of targets or runs that the file states and does not hold: it may have been cut, or joined."""
    count, runs, _ways = grid.deviations.shape
    passes = int((~np.isnan(grid.deviations)).any(axis=0).sum())
    found = []
    for key, text in header.items():
        plain = re.sub(
            r"^(?:number|no|anzahl|nombre|numero|número)\.?(?: of| der| de| di)? ", "", key.lower().strip(" .:#")
        )
        held = {"targets": {count}, "runs": {runs, passes}}.get(_COUNTED.get(plain, ""), set())
        if held and text.strip().isdecimal() and int(text) not in held:
            names = {"stated": f"{key}: {text.strip()}"[:60], "found": f"{count} x {runs}"}
            found.append(Doubt("S-READ-COUNT", where, names=names))
    return tuple(found)


def _near_ones_joined(rows: Rows, targets: FloatArray) -> tuple[FloatArray, tuple[Doubt, ...]]:
    """Targets as commanded, where each pass wrote them a little different (37.4998, 37.5001): else none is repeated.

    Every reading keeps the deviation from its own target. Nothing is joined that one pass read at two places.
    """
    key = rows.run * 2 + rows.approach
    most = int(np.unique(key, return_counts=True)[1].max())
    places, which = np.unique(targets, return_inverse=True)
    if places.size <= most or most < LEAST_FOR_SPREAD:
        return targets, ()
    apart = np.diff(places) >= NEAR * float(np.ptp(places)) / (most - 1)
    group = np.append(0, np.cumsum(apart))[which]
    visits = np.unique(np.stack([group, key]), axis=1).shape[1]
    if apart.all() or visits < key.size:  # none are near; or a pass stopped at two such, which are two targets
        return targets, ()
    middle = (np.bincount(group, weights=targets) / np.bincount(group))[group]
    alone = np.isclose(middle, targets, rtol=0.0, atol=1e-9)
    numbers = {"written": places.size, "places": int(group.max()) + 1, "apart": float(np.abs(targets - middle).max())}
    return np.where(alone, targets, np.round(middle, 6)), (Doubt("S-READ-NEAR", "", numbers=numbers),)


def _arranged(rows: Rows, targets: FloatArray, values: FloatArray, where: str) -> _Grid:
    places = np.unique(targets + 0.0)
    places[places == 0.0] = targets[targets == 0.0][:1]  # as it was written, -0 or 0
    at = np.searchsorted(places, targets)
    column = _repetitions(rows)
    deviations = no_readings(len(places), 1 + int(column.max()), where)
    written = deviations.copy()
    lines = np.zeros(deviations.shape, np.int64)
    cell = (at, column, rows.approach)
    flat = np.ravel_multi_index(cell, deviations.shape)
    if int(np.bincount(flat, minlength=deviations.size).max()) > 1:
        again = np.ones(flat.size, np.bool_)
        again[np.unique(flat, return_index=True)[1]] = False
        row = rows.row(int(np.argmax(again)))
        raise _wrong(where, row.line, Message.of("W-FILE-RUN-TWICE", target=row.target, run=row.run))
    deviations[cell], written[cell], lines[cell] = values, rows.value, rows.line
    return _Grid(places, deviations, written, lines)


def _repetitions(rows: Rows) -> Whole:
    """The repetition of each reading, from 0. Numbers that no way shares count one-way passes, as vendors do."""
    ways = [rows.approach == way for way in (0, 1)]
    numbers = [np.unique(rows.run[own]) for own in ways]
    if np.intersect1d(numbers[0], numbers[1]).size:
        numbers = [np.union1d(numbers[0], numbers[1])] * 2
    found = np.zeros(len(rows), np.int32)
    for own, known in zip(ways, numbers, strict=True):
        found[own] = np.searchsorted(known, rows.run[own])
    return found


def _missing(lost: Rows) -> tuple[Doubt, ...]:
    count = len(lost)
    return (Doubt("S-READ-MISSING", "", numbers={"count": count}, names={"stops": _told(lost)}),) if count else ()


def _told(rows: Rows) -> str:
    """Lines with their targets, a few of them and how many more."""
    every = sorted(set(zip(rows.line.tolist(), rows.target.tolist(), strict=True)))
    return _several(f"line {line} ({target:g})" for line, target in every)


def _several(texts: Iterable[str]) -> str:
    every = list(texts)
    more = f" and {len(every) - MOST_TOLD} more" if len(every) > MOST_TOLD else ""
    return ", ".join(every[:MOST_TOLD]) + more


# ------------------------------------------------------------------------------------------------ what cannot be true


def _judged(
    measured: MeasuredSet, where: str, grid: _Grid, *, apart: bool, confirmed: bool, refuses: bool
) -> MeasuredSet:
    """Marks of no reading left out by name; one length refused; a blocking doubt about wild readings or sizes."""
    kind = measured.axis_unit
    span = 0.0 if apart else float(np.ptp(grid.targets)) * deviation_scale(kind)
    if refuses and not confirmed:
        _refuse_length(grid, span, kind, where)
    known = grid.deviations[~np.isnan(grid.deviations)]
    limit = min(LARGEST[kind], span * MOST_SHARE) if span > 0.0 else LARGEST[kind]
    center = float(np.median(known))
    spread = TYPICAL * float(np.median(np.abs(known - center)))
    away = np.abs(np.nan_to_num(grid.deviations - center))
    enough = known.size >= LEAST_FOR_SPREAD
    wild = enough & (away > max(limit, APART * spread))
    odd = enough & (away > max(MARK_LEAST, MARK_APART * spread))
    marks = _nines(grid.written, odd) | (wild & _marks(grid.written)) if odd.any() or wild.any() else wild
    doubts = measured.doubts
    if marks.any() and not confirmed and 2 * int(marks.sum()) < known.size:
        measured, grid = _without(measured, grid, marks)
        doubts += (Doubt("S-READ-MARKS", where, names={"stops": _named(grid, marks)}),)
        measured, grid = _whole(measured, grid)
        return _judged(replace(measured, doubts=doubts), where, grid, apart=apart, confirmed=confirmed, refuses=refuses)
    largest = float(np.max(np.abs(known)))
    size = np.abs(np.nan_to_num(grid.deviations))
    if wild.any() or largest > LARGEST[kind] or 0.0 < span * MOST_SHARE < largest:
        stops = _named(grid, wild if wild.any() else size == largest)
        names = {"unit": deviation_unit(kind), "stops": stops}
        doubts += (Doubt("S-READ-SIZE", where, blocking=not confirmed, names=names, numbers={"largest": largest}),)
    return replace(measured, doubts=doubts)


def _refuse_exchanged(rows: Rows, where: str, *, alone: bool) -> None:
    """Targets are visited again and again, readings are not: where it is the other way round, so are the columns.

    Positions may go by the numbers ``alone``. Deviations are often rounded to few values; they are targets where each
    occurs as often as any other and all passes run straight through them, while no target occurs twice.
    """
    targets, values = np.unique(rows.target).size, np.unique(rows.value).size
    exchanged = targets > LEAST_FOR_SPREAD * values > LEAST_FOR_SPREAD
    if not alone:
        steps = [np.diff(rows.value[own]) for _way, own in _passes(rows)]
        counts = np.unique(rows.value, return_counts=True)[1]
        straight = all(bool((one > 0.0).all() or (one < 0.0).all()) for one in steps)
        often = values > LEAST_FOR_SPREAD and counts[0] > 1 and bool((counts == counts[0]).all())
        exchanged = straight and often and targets > 0.9 * len(rows)
    if exchanged:
        raise FileFormatError("E-FILE-EXCHANGED", where, line=int(rows.line[0]), targets=targets, values=values)


def _refuse_length(grid: _Grid, span: float, kind: AxisUnit, where: str) -> None:
    """Readings that stay the same while the targets run through their range are those of one length."""
    if span <= 0.0:
        return
    scale = deviation_scale(kind)
    places = (grid.deviations / scale + grid.targets[:, None, None])[~np.isnan(grid.deviations)]
    if float(np.ptp(places)) >= SAME_LENGTH * span / scale:
        return
    line = int(grid.lines.max(where=grid.lines > 0, initial=0))
    raise FileFormatError(
        "E-FILE-SAME", where, low=float(places.min()), high=float(places.max()), unit=kind, line=line,
        first=float(grid.targets[0]), last=float(grid.targets[-1]),
    )  # fmt: skip


def _marks(written: FloatArray) -> np.ndarray:
    """Where a number as written is one that counters show for no reading: a full register, 0, or one repeated."""
    size = np.nan_to_num(np.abs(written))
    return np.isin(size, sorted(MARKS)) | (size == 0.0) | _repeated(written)


def _nines(written: FloatArray, among: np.ndarray) -> np.ndarray:
    """Where a number consists of nines: 999, 9999, 99.9."""
    found = np.zeros(written.shape, bool)
    for at in zip(*np.nonzero(among), strict=True):
        value = abs(float(written[at]))
        digits = repr(value).removesuffix(".0").replace(".", "")
        found[at] = len(digits) >= FEWEST_NINES and set(digits) == {"9"}
    return found


def _repeated(written: FloatArray) -> np.ndarray:
    """Where the same number stands at more than one target."""
    target = np.broadcast_to(np.arange(written.shape[0])[:, None, None], written.shape)
    there = ~np.isnan(written)
    pairs = np.unique(np.stack([written[there], target[there].astype(np.float64)]), axis=1)
    values, counts = np.unique(pairs[0], return_counts=True)
    return np.isin(written, values[counts > 1])


def _named(grid: _Grid, which: np.ndarray) -> str:
    found = sorted(
        {
            (int(grid.lines[at]), float(grid.targets[at[0]]), float(grid.written[at]))
            for at in zip(*np.nonzero(which), strict=True)
        }
    )
    return _several(
        f"line {line} (target {target:g}: {value:g})" if line else f"target {target:g} ({value:g})"
        for line, target, value in found
    )


def _without(measured: MeasuredSet, grid: _Grid, marks: np.ndarray) -> tuple[MeasuredSet, _Grid]:
    deviations = np.where(marks, np.nan, grid.deviations)
    return replace(measured, deviations=deviations), replace(grid, deviations=deviations)


def _whole(measured: MeasuredSet, grid: _Grid) -> tuple[MeasuredSet, _Grid]:
    """Without targets at which nothing was read."""
    there = ~np.isnan(grid.deviations).all(axis=(1, 2))
    cut = _Grid(grid.targets[there], grid.deviations[there], grid.written[there], grid.lines[there])
    return replace(measured, targets=cut.targets, deviations=cut.deviations), cut


def _notes(deviations: FloatArray) -> tuple[Message, ...]:
    ways = [way for way in (0, 1) if not np.isnan(deviations[:, :, way]).all()]
    missing = int(np.isnan(deviations[:, :, ways]).sum())
    one_way = (Message.of("S-FILE-ONE-WAY"),) if len(ways) == 1 else ()
    return one_way + ((Message.of("S-FILE-MISSING", count=missing),) if missing else ())
