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
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import AxisUnit, DeviationUnit, deviation_scale, deviation_unit
from gateway.domain.captures import Capture
from gateway.domain.values import FloatArray
from gateway.errors import InDoubt
from gateway.evaluate.behaviour.repetitions import MOST_TOLD, out_of_line
from gateway.evaluate.optics.rotary import closure_arcsec
from gateway.evaluate.standards import iso230_2, readings

CLOSES_WITHIN_ARCSEC = 1.0
"""By more than this a turn that comes back to its beginning has drifted, slipped or lost counts."""
SHARE_OF_TRAVEL = 0.01
"""An axis that deviates by more of its travel than this is hardly an axis that was measured right."""
LEAST: Mapping[DeviationUnit, float] = {"um": 100.0, "arcsec": 360.0}
MOST: Mapping[DeviationUnit, float] = {"um": 2000.0, "arcsec": 3600.0}
"""Whatever the travel, deviations that spread over less are believed, over more are doubted; um and arcsec."""
OF_A_TEST = ("S-EVAL-TARGETS", "S-EVAL-STEPS", "S-EVAL-LONG", "S-EVAL-OUT", "S-EVAL-OUT-MORE", "S-EVAL-OUT-KEPT")
TURN_DEG, HALF_TURN_DEG = 360.0, 180.0


def doubts_of(
    targets: ArrayLike, deviations: ArrayLike, axis_unit: AxisUnit, unit: DeviationUnit | None = None
) -> tuple[Doubt, ...]:
    """Every doubt that readings alone leave, the blocking ones first.

    ``targets`` (m,) in mm or deg; ``deviations`` (m, n, 2) in ``unit``, left out: um over mm, arcsec over deg. Raises
    ModelError as `readings.checked`.
    """
    at, x = readings.checked(targets, deviations)
    kind = unit or deviation_unit(axis_unit)
    found = [*_size(at, x, axis_unit, kind), *_arc(at, axis_unit), *_plan(at, x.shape[1], axis_unit)]
    if kind == "arcsec" and axis_unit == "deg":
        found += _closure(at, x)
    found += _scattered(at, x, kind)
    return tuple(sorted(found, key=lambda one: not one.blocking))


def with_doubts(measured: MeasuredSet, accepted: Mapping[str, str] | None = None) -> MeasuredSet:
    """A measured set with the doubts of its readings beside those of its reader, each once, settled as accepted."""
    return replace(measured, doubts=settled(all_doubts(measured), accepted or {}))


def all_doubts(measured: MeasuredSet | Capture, unit: DeviationUnit | None = None) -> tuple[Doubt, ...]:
    """The doubts of the record and those of its readings, each code of the readings once.

    Where a target has no reading at all, and for a location error (B0Z, X0C: no deviations along a path), only the
    record's own.
    """
    if isinstance(measured, Capture):
        unit = measured.unit
        if measured.component[1:2] == "0":
            return measured.doubts
    x = np.asarray(measured.deviations, dtype=np.float64)
    if not np.asarray(measured.targets).size or not np.isfinite(x).any(axis=(1, 2)).all():
        return measured.doubts
    known = {one.code for one in measured.doubts}
    found = doubts_of(measured.targets, x, measured.axis_unit, unit)
    return (*measured.doubts, *(one for one in found if one.code not in known))


def settled(doubts: Iterable[Doubt], accepted: Mapping[str, str]) -> tuple[Doubt, ...]:
    """Doubts, of which those that a person accepted by their code block no more and name the reason."""
    return tuple(
        replace(one, blocking=False, settled=accepted[one.code]) if one.blocking and one.code in accepted else one
        for one in doubts
    )


def blocking(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """The doubts that stop verdict and table."""
    return tuple(one for one in doubts if one.blocking)


def notable(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Those that concern whoever uses the readings: not what a test to a standard asks for besides."""
    return tuple(one for one in doubts if one.blocking or one.settled or one.code not in OF_A_TEST)


def demand_settled(doubts: Iterable[Doubt], where: str) -> None:
    """Raise InDoubt (E-DOUBT-OPEN) where a doubt blocks: what it is, and how a person accepts it."""
    open_ = blocking(doubts)
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


def told(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Doubts as people read them: a blocking one with its code and what to do, an accepted one with the reason."""
    return tuple(_told(one) for one in doubts)


def _told(one: Doubt) -> str:
    place = f"{one.where}: " if one.where else ""
    if one.settled:
        return f"{place}{one.text} ({one.code} accepted: {one.settled})"
    return f"{place}{one.code}: {one.text}; {one.remedy}" if one.blocking else f"{place}{one.text}"


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


def _closure(at: FloatArray, x: FloatArray) -> list[Doubt]:
    """The closing error of whole turns: reported, never spread over the readings."""
    gap = closure_arcsec(at, x)
    if gap is None:
        return []
    names = {"gap": f"{gap:+.3f}", "turn": f"{np.ptp(at):g}", "limit": f"{CLOSES_WITHIN_ARCSEC:g}"}
    if abs(gap) > CLOSES_WITHIN_ARCSEC:
        return [Doubt("S-EVAL-CLOSURE-FAR", blocking=True, names=names, numbers={"gap": gap})]
    return [Doubt("S-EVAL-CLOSURE", names=names, numbers={"gap": gap})]


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


def _scattered(at: FloatArray, x: FloatArray, unit: DeviationUnit) -> list[Doubt]:
    """Readings out of line, the farthest first: a standard's figures keep what was read."""
    out = out_of_line(at, x)
    found = [
        Doubt(
            "S-EVAL-OUT",
            names={"at": f"{at[i]:g}", "way": "+-"[a], "off": f"{off:+.3g}", "unit": unit, "reading": str(j + 1)},
            numbers={"off": off},
        )
        for (i, j, a), off in out[:MOST_TOLD]
    ]
    if len(out) > MOST_TOLD:
        found.append(Doubt("S-EVAL-OUT-MORE", numbers={"more": len(out) - MOST_TOLD}))
    return [*found, Doubt("S-EVAL-OUT-KEPT")] if found else []
