"""Files of gear measuring machines to figures: curves of involutes, a maker's own values, contour scans of a disc."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from drivers import registry
from drivers.errors import FileFormatError
from drivers.message import Message, words
from drivers.types.circles import MakersFigures
from drivers.types.gearfiles import GearContour, GearCurve, GearCurves
from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import trace_values
from gateway.gear.traces import located_contour
from gateway.workflow.files.kind_records import Drawn, Figure, KindAnswer
from gateway.workflow.files.reading import gear_driver

KIND = "gear"
SIDES = {1: "left", -1: "right"}
LETTERS = {"profile": "alpha", "lead": "beta"}
FEWEST, LEAST_SHARE = 20, 0.5  # points of a flank in a scan, and the share of its arc, that make a profile
WORST = ("F_alpha", "f_Halpha", "f_falpha", "F_beta", "f_Hbeta", "f_fbeta")
MAKERS = Message.of("S-GEAR-MAKER")


def evaluate_gear(files: Sequence[Path], gear: CycloidGear | None = None) -> KindAnswer:
    """Figures of one file of a gear measuring machine. ``gear`` is the disc that a contour scan shows.

    Raises ModelError (E-KIND-FILES: more than one file; E-GEARFILE-SITE: a scan without its gear; E-GEAR-...),
    FileFormatError (E-GEARFILE-UNKNOWN and those of the readers).
    """
    if len(files) != 1:
        raise ModelError("E-KIND-FILES", KIND, found=len(files), wanted="1")
    path = files[0]
    driver = gear_driver(path)
    if not driver:
        raise FileFormatError("E-GEARFILE-UNKNOWN", str(path))
    content = registry.load(driver, "gear-curves")().read(path)
    if isinstance(content, GearCurves):
        return _of_curves(content)
    if isinstance(content, MakersFigures):
        figures = tuple(Figure(one.name, one.value, one.unit) for one in content.figures)
        return _answer(words("S-MAKERS-PROGRAM"), figures, axes=("", ""), notes=(MAKERS,))
    if gear is None:
        raise ModelError("E-GEARFILE-SITE", str(path))
    return _of_contour(content, gear)


def _answer(
    standard: str,
    figures: tuple[Figure, ...],
    *,
    axes: tuple[str, str],
    notes: tuple[Message, ...],
    drawn: tuple[Drawn, ...] = (),
) -> KindAnswer:
    return KindAnswer(kind=KIND, standard=standard, figures=figures, curves=drawn, axes=axes, notes=notes)


def _of_curves(found: GearCurves) -> KindAnswer:
    """Total, slope and form deviation of each curve (ISO 1328-1), pitch from its table; um."""
    figures = [one for curve in found.curves for one in _curve_figures(curve, found.width_mm)]
    notes = [*found.warnings, Message.of("S-GEAR-SLOPE")]
    if not found.width_mm:
        notes.append(Message.of("S-GEAR-LEAD-RANGE"))
    for flank, rows in found.pitch_um.items():
        single, total, runout = rows.T
        side = SIDES[flank]
        figures += [
            Figure(f"{side} f_p", float(np.max(np.abs(single))), "um"),
            Figure(f"{side} F_p", float(np.ptp(total)), "um"),
            Figure(f"{side} F_r", float(np.ptp(runout)), "um"),
        ]
    drawn = tuple(
        Drawn(f"{one.feature} {one.tooth} {SIDES[one.flank]}", one.along_mm, one.deviation_um) for one in found.curves
    )
    axes = (words("S-GEAR-ROLL"), "deviation  µm")
    return _answer("ISO 1328-1:2013", (*figures, *_largest(figures)), axes=axes, drawn=drawn, notes=tuple(notes))


def _curve_figures(curve: GearCurve, width_mm: float) -> Iterator[Figure]:
    low, high = curve.judged_mm
    inside = (curve.along_mm >= low - 1e-9) & (curve.along_mm <= high + 1e-9) & np.isfinite(curve.deviation_um)
    name = f"{curve.feature} {curve.tooth} {SIDES[curve.flank]}"
    letter = LETTERS[curve.feature]
    over = width_mm if curve.feature == "lead" and width_mm else high - low
    yield from _trace(name, letter, curve.along_mm[inside], curve.deviation_um[inside], over)


def _trace(name: str, letter: str, along: FloatArray, deviation: FloatArray, over: float) -> Iterator[Figure]:
    """F, f_H (the slope over a length) and f_f of one trace. Raises ModelError (E-GEAR-TRACE)."""
    values = trace_values(deviation, along)
    slope = float(values.f_H) / float(np.ptp(along))
    yield Figure(f"{name} F_{letter}", float(values.F), "um")
    yield Figure(f"{name} f_H{letter}", slope * over, "um")
    yield Figure(f"{name} f_f{letter}", float(values.f_f), "um")


def _largest(figures: Iterable[Figure]) -> Iterator[Figure]:
    """The largest size of each figure over all curves."""
    known = list(figures)
    for name in WORST:
        sizes = [abs(one.value) for one in known if one.name.endswith(f" {name}")]
        if sizes:
            yield Figure(f"largest {name}", max(sizes), "um")


def _of_contour(contour: GearContour, gear: CycloidGear) -> KindAnswer:
    """Where the axis lies, and the profile of every flank that the scan covers; arc length from the bottom, mm."""
    found = located_contour(gear, contour)
    points, e_um = found.points, found.points.deviation * UM_PER_MM
    arc = gear.arc(points.theta)
    U = 2.0 * found.centre_u_mm * UM_PER_MM
    figures = [
        Figure("axis x", float(found.centre_mm[0]) * UM_PER_MM, "um", float(U[0])),
        Figure("axis y", float(found.centre_mm[1]) * UM_PER_MM, "um", float(U[1])),
        Figure("RMS", float(np.sqrt(np.mean(e_um**2))), "um"),
        Figure("mean surplus", float(np.mean(e_um)), "um"),
    ]
    drawn, left_out = [], []
    least = LEAST_SHARE * gear.limits().half_lobe_arc
    for section in range(int(contour.section.max()) + 1):
        for space in np.unique(points.k):
            for flank, side in SIDES.items():
                mine = (contour.section == section) & (points.k == space) & (np.sign(points.theta) == flank)
                name = f"scan {section + 1} space {int(space)} {side}"
                if np.count_nonzero(mine) < FEWEST or float(np.ptp(arc[mine])) < least:
                    left_out += [name] if np.any(mine) else []
                    continue
                order = np.argsort(arc[mine])
                along, deviation = arc[mine][order], e_um[mine][order]
                figures += _trace(name, "alpha", along, deviation, float(np.ptp(along)))
                drawn.append(Drawn(name, along, deviation))
    notes = (
        *contour.warnings,
        Message.of("S-GEAR-FITTED"),
        *((Message.of("S-GEAR-TOO-LITTLE", left_out=", ".join(left_out)),) if left_out else ()),
    )
    axes = (words("S-GEAR-ARC"), "deviation  µm")
    standard = words("S-GEAR-NOMINAL")
    return _answer(standard, (*figures, *_largest(figures)), axes=axes, drawn=tuple(drawn), notes=notes)
