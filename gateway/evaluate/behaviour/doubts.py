"""What readings leave in doubt, found from the readings alone, and what a person's word makes of it; pure.

One function finds them (`doubts_of`), whatever brought the readings: a file, an instrument, a person, a program. A
blocking doubt stops verdict and table (`demand_settled`) until a person has accepted it by its code, with a reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError, text_of
from drivers.message import Form, Message
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import AxisUnit, DeviationUnit, deviation_scale, deviation_unit
from gateway.domain.captures import Capture
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import InDoubt
from gateway.evaluate.behaviour.repetitions import MOST_TOLD, Slip, find_slips, out_of_line
from gateway.evaluate.optics.rotary_calibration import closure
from gateway.evaluate.standards import iso230_2, statistics
from gateway.evaluate.uncertainty.budget import ROTARY_DEVICE_ARCSEC

TINY, DUST = 0.05, 1e-6
"""um or arcsec: deviations of a whole axis that spread over less than the first are those of no machine tool; over less
than the second they are one value, and arithmetic."""
FAR_JUMPS, JUMP_SHARE = 40.0, 0.2
"""A reading jumps where it leaves its neighbours' line by so many times the usual (the median, of a normal scatter 0.8
standard deviations)."""
ALIKE, FEWEST_ALIKE = 0.01, 4
"""Of the travel: numbers of readings that differ so little from those of their targets, at so many of them, are these.
"""
WIDE, FEWEST_STEPS = 3.0, 4
"""A step between targets is wide beyond so many usual ones (medians); of fewer steps none is usual."""
SHARE_OF_TRAVEL = 0.01
"""An axis that deviates by more of its travel than this is hardly an axis that was measured right."""
LEAST: Mapping[DeviationUnit, float] = {"um": 100.0, "arcsec": 360.0}
MOST: Mapping[DeviationUnit, float] = {"um": 2000.0, "arcsec": 3600.0}
"""Whatever the travel, deviations that spread over less are believed, over more are doubted; um and arcsec."""
OF_A_TEST = ("S-EVAL-TARGETS", "S-EVAL-STEPS", "S-EVAL-LONG", "S-EVAL-OUT", "S-EVAL-OUT-MORE", "S-EVAL-OUT-KEPT")
SCATTER = ("S-EVAL-OUT", "S-EVAL-OUT-MORE")
TURN_DEG, HALF_TURN_DEG = 360.0, 180.0


def doubts_of(
    targets: ArrayLike,
    deviations: ArrayLike,
    axis_unit: AxisUnit,
    unit: DeviationUnit | None = None,
    *,
    modulo: bool = False,
    device_arcsec: float = ROTARY_DEVICE_ARCSEC,
) -> tuple[Doubt, ...]:
    """Every doubt that readings alone leave, the blocking ones first.

    ``targets`` (m,) in mm or deg; ``deviations`` (m, n, 2) in ``unit``, left out: um over mm, arcsec over deg.
    ``modulo``: of an axis that turns endlessly, whose turn is closed across its last gap. ``device_arcsec`` is the
    rotary instrument's U (k = 2). Raises ModelError as `readings.checked`.
    """
    at, x = statistics.check_readings(targets, deviations)
    kind = unit or deviation_unit(axis_unit)
    found = [
        *_size(at, x, axis_unit, kind),
        *_positions(at, x, axis_unit, kind),
        *_arc(at, axis_unit),
        *_plan(at, x.shape[1], axis_unit),
    ]
    found += _wide_gap(at, axis_unit, modulo=modulo and axis_unit == "deg")
    if kind == "arcsec" and axis_unit == "deg":
        found += _closure(at, x, device_arcsec)
    wide = any(one.code == "S-EVAL-SPREAD" for one in found)
    found += [one for one in _outliers(at, x, kind) if not (wide and one.code == "S-EVAL-OUT-FAR")]  # the same, once
    return tuple(sorted(found, key=lambda one: not one.blocking))


def with_doubts(
    measured: MeasuredSet, accepted: Mapping[str, str] | None = None, *, modulo: bool = False
) -> MeasuredSet:
    """A measured set with the doubts of its readings beside those of its reader, each once, settled as accepted."""
    return replace(measured, doubts=accept_doubts(all_doubts(measured, modulo=modulo), accepted or {}))


def all_doubts(
    measured: MeasuredSet | Capture,
    unit: DeviationUnit | None = None,
    *,
    modulo: bool = False,
    device_arcsec: float | None = None,
) -> tuple[Doubt, ...]:
    """The doubts of the record and those of its readings, each code of the readings once; arguments as `doubts_of`.

    The rotary instrument's U is that of the record's conditions where none is given. Where a target has no reading at
    all, and for a location error (B0Z, X0C: no deviations along a path), only the record's own.
    """
    device = device_arcsec
    if isinstance(measured, Capture):
        unit = measured.unit
        if device is None and measured.conditions is not None:
            device = measured.conditions.stated.get("arcsec")
        if measured.component[1:2] == "0":
            return measured.doubts
    x = np.asarray(measured.deviations, dtype=np.float64)
    if not np.asarray(measured.targets).size or not np.isfinite(x).any(axis=(1, 2)).all():
        return measured.doubts
    known = {one.code for one in measured.doubts}
    own = ROTARY_DEVICE_ARCSEC if device is None else device
    found = doubts_of(measured.targets, x, measured.axis_unit, unit, modulo=modulo, device_arcsec=own)
    if isinstance(measured, MeasuredSet):  # a capture's unit was proved on the machine
        found = (*_tiny(x, unit or deviation_unit(measured.axis_unit)), *found)
    return (*measured.doubts, *(one for one in found if one.code not in known))


def accept_doubts(doubts: Iterable[Doubt], accepted: Mapping[str, str]) -> tuple[Doubt, ...]:
    """Doubts, of which those that a person accepted by their code block no more and name the reason."""
    return tuple(
        replace(one, blocking=False, settled=accepted[one.code]) if one.blocking and one.code in accepted else one
        for one in doubts
    )


def blocking_doubts(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """The doubts that stop verdict and table."""
    return tuple(one for one in doubts if one.blocking)


def notable_doubts(doubts: Iterable[Doubt], *, scatter: bool = False) -> tuple[Doubt, ...]:
    """Those that concern whoever uses the readings: not what a test to a standard asks for besides.

    With ``scatter`` single readings out of line too, which a fit leaves out.
    """
    kept = SCATTER if scatter else ()
    return tuple(one for one in doubts if one.blocking or one.settled or one.code in kept or one.code not in OF_A_TEST)


def demand_settled(doubts: Iterable[Doubt], where: str) -> None:
    """Raise InDoubt (E-DOUBT-OPEN) where a doubt blocks: what it is, and how a person accepts it."""
    open_ = blocking_doubts(doubts)
    if open_:
        said = "; ".join(f"{one.code}: {one.text}" for one in open_)
        first = open_[0]
        raise InDoubt("E-DOUBT-OPEN", where, doubts=said, codes=", ".join(one.code for one in open_), first=first.code)


def accepted_of(texts: Iterable[str], where: str) -> dict[str, str]:
    """Reasons by code from "CODE=REASON". Raises ConfigError (E-DOUBT-ACCEPT) without a known code or a reason."""
    found: dict[str, str] = {}
    for text in texts:
        code, _, reason = text.partition("=")
        if text_of(code.strip()) is None or not reason.strip():
            raise ConfigError("E-DOUBT-ACCEPT", where, text=text)
        found[code.strip()] = reason.strip()
    return found


def describe_doubts(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Doubts as people read them: a blocking one with its code and what to do, an accepted one with the reason."""
    return tuple(_describe_doubt(one) for one in doubts)


def _describe_doubt(one: Doubt) -> str:
    place = f"{one.where}: " if one.where else ""
    if one.settled:
        return f"{place}{one.text} ({one.code} accepted: {one.settled})"
    return f"{place}{one.code}: {one.text}; {one.remedy}" if one.blocking else f"{place}{one.text}"


def remarks(doubts: Iterable[Doubt]) -> tuple[Message, ...]:
    """Doubts as a record contains them; texts as `told`, a blocking one as an error is told."""
    return tuple(_remark(one) for one in doubts)


def _remark(one: Doubt) -> Message:
    if one.blocking and not one.settled:
        return replace(one.message, form=Form.ERROR, where=one.where)
    said = one.message
    if one.settled:
        said = Message.of("S-DOUBT-SETTLED", doubt=said, named=one.code, reason=one.settled)
    return Message.of("S-DOUBT-AT", where=one.where, doubt=said) if one.where else said


def as_data(doubts: Iterable[Doubt]) -> list[dict[str, object]]:
    """Doubts for --json."""
    return [
        {
            "code": one.code,
            "what": one.text,
            "do": one.remedy,
            "where": one.where,
            "blocking": one.blocking,
            "accepted": one.settled,
        }
        for one in doubts
    ]


# --------------------------------------------------------------------------------------------------- what is looked for


def _size(at: FloatArray, x: FloatArray, axis_unit: AxisUnit, unit: DeviationUnit) -> list[Doubt]:
    """Deviations that are a share of the travel: another unit, a whole turn, a length read at several places, 9999."""
    known = x[np.isfinite(x)]
    spread = float(np.ptp(known))
    limit = MOST[unit]
    if deviation_unit(axis_unit) == unit and at.size > 1:
        share = SHARE_OF_TRAVEL * float(np.ptp(at)) * deviation_scale(axis_unit)
        limit = min(max(share, LEAST[unit]), limit)
    if spread <= limit:
        return []
    off = np.abs(x - float(np.median(known)))
    place, run, way = np.unravel_index(int(np.nanargmax(off)), off.shape)
    names = {"spread": f"{spread:.6g}", "limit": f"{limit:.6g}", "unit": unit, "axis_unit": axis_unit}
    names |= {"at": f"{at[place]:g}", "value": f"{x[place, run, way]:.6g}", "travel": f"{np.ptp(at):g}"}
    return [Doubt("S-EVAL-SPREAD", blocking=True, names=names, numbers={"spread": spread, "limit": limit})]


def _positions(at: FloatArray, x: FloatArray, axis_unit: AxisUnit, unit: DeviationUnit) -> list[Doubt]:
    """Deviations whose numbers are those of their targets: positions under the heading of deviations.

    1 um/mm with so little left over is a scale error that no axis has by chance.
    """
    if deviation_unit(axis_unit) != unit or at.size < FEWEST_ALIKE:
        return []
    left = x - at[:, None, None]
    if float(np.ptp(left[np.isfinite(left)])) > ALIKE * float(np.ptp(at)):
        return []
    return [Doubt("S-EVAL-POSITIONS", blocking=True, names={"unit": unit, "axis_unit": axis_unit})]


def _tiny(x: FloatArray, unit: DeviationUnit) -> tuple[Doubt, ...]:
    """Deviations smaller than any machine's: millimetres or degrees under a heading of um or arcsec."""
    spread = float(np.ptp(x[np.isfinite(x)]))
    if not DUST < spread < TINY:
        return ()
    names = {"spread": f"{spread:.3g}", "limit": f"{TINY:g}", "unit": unit}
    return (Doubt("S-EVAL-TINY", blocking=True, names=names, numbers={"spread": spread}),)


def _arc(at: FloatArray, axis_unit: AxisUnit) -> list[Doubt]:
    """Targets on both sides of zero of a turn (340 .. 20 deg): in order they would be joined the long way round."""
    found = gap_across(at) if axis_unit == "deg" else None
    if found is None:
        return []
    low, high = found
    names = {"low": f"{low:g}", "high": f"{high:g}", "gap": f"{high - low:g}"}
    return [Doubt("S-EVAL-ARC", blocking=True, names=names, numbers={"low": low, "high": high})]


def gap_across(targets: FloatArray) -> tuple[float, float] | None:
    """The two neighbours (deg) between which more than half a turn was not measured, where the way round is shorter."""
    at = np.sort(np.asarray(targets, dtype=np.float64))
    if at.size < 3 or np.ptp(at) >= TURN_DEG:
        return None
    steps = np.diff(at)
    widest = int(np.argmax(steps))
    if steps[widest] <= HALF_TURN_DEG or TURN_DEG - float(np.ptp(at)) >= steps[widest]:
        return None
    return float(at[widest]), float(at[widest + 1])


def _closure(at: FloatArray, x: FloatArray, device_arcsec: float) -> list[Doubt]:
    """The closing error of whole turns: reported, never spread over the readings.

    It blocks beyond what the set itself can tell apart: the instrument's U (k = 2; as its certificate states it, else
    the one that budgets suppose) joined with the scatter of the runs. A turn that comes back to its beginning with
    more has drifted, slipped or lost counts.
    """
    found = closure(at, x)
    if found is None:
        return []
    # A single run does not show how it would scatter: then no instrument is better than the supposed one.
    device_arcsec = device_arcsec if found.u > 0.0 else max(device_arcsec, ROTARY_DEVICE_ARCSEC)
    limit = float(np.hypot(device_arcsec, COVERAGE * found.u))
    names = {"gap": f"{found.gap:+.3f}", "turn": f"{np.ptp(at):g}", "limit": f"{limit:.3g}"}
    names |= {"device": f"{device_arcsec:g}"}
    if abs(found.gap) > limit:
        numbers = {"gap": found.gap, "limit": limit}
        return [Doubt("S-EVAL-CLOSURE-FAR", blocking=True, names=names, numbers=numbers)]
    return [Doubt("S-EVAL-CLOSURE", names=names, numbers={"gap": found.gap, "limit": limit})]


def _wide_gap(at: FloatArray, axis_unit: AxisUnit, *, modulo: bool) -> list[Doubt]:
    """A step between neighbours that is far wider than the usual one: whatever curve is laid through them, is guessed.

    On a modulo axis the step from the last target round to the first one counts too, as far as it is bridged.
    """
    places = np.unique(np.mod(np.round(at, 6), TURN_DEG)) if modulo else np.unique(at)
    if places.size < FEWEST_STEPS:
        return []
    around = np.append(places, places[0] + TURN_DEG) if modulo else places
    steps = np.diff(around)
    usual, widest = float(np.median(steps)), int(np.argmax(steps))
    wide = float(steps[widest])
    if wide <= WIDE * usual or (axis_unit == "deg" and wide > HALF_TURN_DEG):  # a gap so wide is no bridge: `_arc`
        return []
    low, high = float(around[widest]), float(around[widest + 1])
    names = {"low": f"{low:g}", "high": f"{high:g}", "gap": f"{wide:g}", "usual": f"{usual:g}", "unit": axis_unit}
    return [Doubt("S-EVAL-GAP", names=names, numbers={"low": low, "high": high})]


def _plan(at: FloatArray, repetitions: int, axis_unit: AxisUnit) -> list[Doubt]:
    """What a plan of targets (m,) lacks: too few of them for the travel, or equal steps (they alias a pitch)."""
    travel = float(np.ptp(at))
    if not travel > 0.0:
        return []
    least, runs = iso230_2.minimum_targets("linear" if axis_unit == "mm" else "rotary", travel)
    found: list[Doubt] = []
    if at.size < least:
        found.append(Doubt("S-EVAL-TARGETS", numbers={"targets": at.size, "least": least}))
    steps = np.diff(np.sort(at))
    if at.size > 2 and float(np.ptp(steps)) <= 1e-6 * travel:
        found.append(Doubt("S-EVAL-STEPS"))
    if runs == 1 and repetitions > 1:
        found.append(Doubt("S-EVAL-LONG"))
    return found


def _outliers(at: FloatArray, x: FloatArray, unit: DeviationUnit) -> list[Doubt]:
    """Readings out of line, the farthest first: a standard's figures keep what was read.

    One that is so far off that no axis does it stops verdict and table: a mark for no reading, another unit, a bump.
    """
    out = out_of_line(at, x)
    found = [
        Doubt("S-EVAL-OUT", names=_place(at, one, unit) | {"off": f"{off:+.3g}"}, numbers={"off": off})
        for one, off in out[:MOST_TOLD]
    ]
    if len(out) > MOST_TOLD:
        found.append(Doubt("S-EVAL-OUT-MORE", numbers={"more": len(out) - MOST_TOLD}))
    jumps = _lone_jumps(at, x, unit)
    known = {one for one, _off in out}
    slipped = find_slips(at, x)[:MOST_TOLD]
    found += [
        Doubt("S-EVAL-JUMP", names=_place(at, one, unit) | {"off": f"{off:+.3g}"}, numbers={"off": off})
        for one, off in jumps[:1]
        if one not in known
    ]
    far = max([*out, *jumps], key=lambda one: abs(one[1]), default=None)
    if far is not None and abs(far[1]) > LEAST[unit]:
        names = _place(at, far[0], unit) | {"off": f"{far[1]:+.4g}", "limit": f"{LEAST[unit]:g}"}
        found.append(Doubt("S-EVAL-OUT-FAR", blocking=True, names=names, numbers={"off": far[1]}))
    found += [] if jumps else [_slip(one, unit) for one in slipped]
    return [*found, Doubt("S-EVAL-OUT-KEPT")] if found else []


def _slip(one: Slip, unit: DeviationUnit) -> Doubt:
    """A jump that only the scatter of its own set shows, where no reading is farther out."""
    names = {"low": f"{one.low:g}", "high": f"{one.high:g}", "way": "+-"[one.way], "reading": str(one.repetition + 1)}
    names |= {"off": f"{one.size:+.3g}", "limit": f"{one.limit:.3g}", "unit": unit}
    code = "S-EVAL-SLIP" if one.low != one.high else "S-EVAL-BUMP"
    return Doubt(code, names=names, numbers={"off": one.size, "limit": one.limit})


def _place(at: FloatArray, one: tuple[int, int, int], unit: DeviationUnit) -> dict[str, str]:
    return {"at": f"{at[one[0]]:g}", "way": "+-"[one[2]], "unit": unit, "reading": str(one[1] + 1)}


def _lone_jumps(at: FloatArray, x: FloatArray, unit: DeviationUnit) -> list[tuple[tuple[int, int, int], float]]:
    """Readings that leave the line between their neighbours of the same pass, and how far: without repetitions too.

    Far is `FAR_JUMPS` times what is usual in the set, and a part of what no axis does. The farthest is the first.
    """
    order, shortest = np.argsort(at, kind="stable"), float(np.ptp(at)) * 1e-9
    q, passes = at[order], x[order].reshape(x.shape[0], -1)
    known = np.isfinite(passes)
    whole = known.all(axis=0)
    # Passes that reached every target are judged together, the others one by one.
    groups = [(order, np.flatnonzero(whole))] if whole.any() else []
    groups += [(order[known[:, one]], np.array([one])) for one in np.flatnonzero(~whole)]
    found, usual = [], []
    for there, which in groups:
        if there.size <= FEWEST_STEPS:
            continue
        value = passes[:, which] if there.size == q.size else passes[known[:, which[0]]][:, which]
        steps = np.maximum(np.diff(at[there]), shortest)[:, None]
        share = steps[:-1] / (steps[:-1] + steps[1:])
        off = value[1:-1] - ((1.0 - share) * value[:-2] + share * value[2:])
        # At an end there is one neighbour alone: what the set usually changes by up to it is no jump.
        slope = np.median(np.diff(value, axis=0) / steps, axis=0)
        first = value[0] - value[1] + slope * steps[0]
        last = value[-1] - value[-2] - slope * steps[-1]
        usual.append(np.abs(off).ravel())
        best, each = np.argmax(np.abs(off), axis=0), np.arange(which.size)
        inner, at_first = off[best, each], np.abs(first) > np.abs(last)
        end = np.where(at_first, first, last)
        # A wrong reading beside an end is as far from it as from its line; a wrong end leaves half of it there.
        at_end = np.abs(end) > 1.5 * np.abs(inner)
        place = np.where(at_end, np.where(at_first, there[0], there[-1]), there[best + 1])
        jumps = zip(which.tolist(), place.tolist(), np.where(at_end, end, inner).tolist(), strict=True)
        found += [((place_of, *divmod(one, x.shape[2])), jump) for one, place_of, jump in jumps]
    limit = max(JUMP_SHARE * LEAST[unit], FAR_JUMPS * float(np.median(np.concatenate(usual)))) if usual else 0.0
    return sorted((one for one in found if abs(one[1]) > limit), key=lambda one: (-abs(one[1]), one[0][1:]))
