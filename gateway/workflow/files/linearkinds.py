"""Evaluations of linear axes from files: straightness, angular motion, squareness, parallelism, reversal.

Each calls the function that a run calls; here only files become arrays and results become figures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import cast

import numpy as np

from drivers.units import DeviationUnit, arcsec_to_rad, mm_to_um, rad_to_arcsec, um_to_mm
from gateway.domain.values import COVERAGE
from gateway.errors import ModelError
from gateway.evaluate.geometry.angular import COMPONENTS, Kind, angular_motion
from gateway.evaluate.geometry.six_motions import motions_of_axis, point_error, six_motions
from gateway.evaluate.geometry.straightness import (
    COUNTINGS,
    Plane,
    Reference,
    SquarenessRuns,
    StraightnessRun,
    above_90,
    from_runs,
    in_words,
    of_plane,
    reversed_square,
    straightness,
)
from gateway.evaluate.standards import iso230_2
from gateway.evaluate.uncertainty.budget import measured_budget
from gateway.workflow.files.kindrecords import (
    Drawn,
    Figure,
    KindAnswer,
    KindQuestion,
    MeasuredFile,
    count_of,
    means,
    unit_of,
)

LINES: tuple[Reference, ...] = ("minimum-zone", "lsq", "end-point")
Files = tuple[MeasuredFile, ...]
POSITION_UM = ("position  mm", "deviation  µm")
SHOWN = {"um": "µm", "arcsec": "arcsec"}
SCATTER_ONLY = ("U holds the scatter of the readings alone, not what is unknown of the instrument",)


def positioning(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Figures of ISO 230-2 with both directions of every file on one scale."""
    count_of("positioning", files, "one or more")
    unit: DeviationUnit = "um" if files[0].measured.axis_unit == "mm" else "arcsec"
    unit_of("positioning", files, unit)
    figures, curves = [], []
    notes: dict[str, None] = {}
    for one in files:
        budget, supposed = measured_budget(one.measured)
        notes |= dict.fromkeys(one.text for one in supposed)
        found = iso230_2.evaluate_iso230_2(one.measured.targets, one.measured.deviations, unit, budget=budget)
        stated = {"A": found.A, "E": found.E, "M": found.M, "R": found.R, "B": found.B}
        figures += [
            Figure(f"{one.label} {key}", value, unit, found.U.get(key))
            for key, value in stated.items()
            if value is not None
        ]
        for word, mean in (("+", found.mean_up), ("-", found.mean_down)):
            there = np.isfinite(mean)
            curves += [Drawn(f"{one.label} {word}", found.targets[there], mean[there])] if there.any() else []
    axes = POSITION_UM if unit == "um" else ("position  deg", "deviation  arcsec")
    return KindAnswer(
        kind="positioning",
        standard="ISO 230-2:2014",
        figures=tuple(figures),
        curves=tuple(curves),
        axes=axes,
        notes=tuple(notes),
    )


def straight(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Straightness of each file about three lines; the curves are about the least-squares line, on one scale."""
    count_of("straightness", files, "one or more")
    unit_of("straightness", files, "um")
    figures, curves = [], []
    for one in files:
        at, mean, _ = means(one.measured)
        found = {line: straightness(at, mean, line) for line in LINES}
        figures += [Figure(f"{one.label} {line}", found[line].value, "um") for line in LINES]
        slope = float(rad_to_arcsec(um_to_mm(found["lsq"].slope)))
        figures.append(Figure(f"{one.label} slope taken off", slope, "arcsec"))
        curves.append(Drawn(one.label, at, found["lsq"].residual))
    return KindAnswer(
        kind="straightness",
        standard="ISO 230-1:2012",
        figures=tuple(figures),
        curves=tuple(curves),
        axes=(POSITION_UM[0], "from the least-squares line  µm"),
    )


def angular(files: Files, asked: KindQuestion) -> KindAnswer:
    """Pitch, yaw or roll of a linear axis: figures of ISO 230-2 in arcsec, the range also in urad."""
    count_of("angular", files, "one or more")
    unit_of("angular", files, "arcsec")
    words = sorted({word for axis, word in COMPONENTS if axis == asked.axis})
    if asked.angle not in words:
        known = ", ".join(words) or "give --axis X, Y or Z first"
        raise ModelError("E-EVAL-ANGULAR", "angular", axis=asked.axis or "?", kind=asked.angle or "?", known=known)
    figures, curves, name = [], [], ""
    for one in files:
        targets, angles = one.measured.targets, one.measured.deviations
        found = angular_motion(asked.axis, cast(Kind, asked.angle), targets, angles)
        name, told = found.component, found.evaluation
        stated = {"E": told.E, "R": told.R, "B": told.B, "A": told.A, "M": told.M}
        figures += [
            Figure(f"{one.label} {key}", value, "arcsec", told.U.get(key))
            for key, value in stated.items()
            if value is not None
        ]
        if found.E_urad is not None:
            figures.append(Figure(f"{one.label} E", found.E_urad, "urad"))
        at, mean, _ = means(one.measured)
        curves.append(Drawn(one.label, at, mean))
    notes = (f"{asked.angle} of {asked.axis} is {name}; the targets are read as mm", *SCATTER_ONLY)
    axes = ("position  mm", f"{name}  arcsec")
    words_of = "ISO 230-1:2012, statistics of ISO 230-2:2014"
    return KindAnswer(
        kind="angular",
        standard=words_of,
        figures=tuple(figures),
        curves=tuple(curves),
        axes=axes,
        notes=notes,
    )


def square(files: Files, asked: KindQuestion) -> KindAnswer:
    """Squareness from the straightness of two axes along one square; with four files the square is turned over."""
    count_of(
        "squareness", files, "two (along the first axis, along the second), or four with the square reversed", (2, 4)
    )
    unit_of("squareness", files, "um")
    artefact = float(arcsec_to_rad(asked.artefact_arcsec))
    signs = _countings(files, asked)
    runs = [_run(one, sign) for one, sign in zip(files, signs, strict=True)]
    pairs = [from_runs(one, other, artefact) for one, other in zip(runs[::2], runs[1::2], strict=True)]
    above, u, notes = _told(pairs)
    found = of_plane(cast(Plane, asked.plane), above)
    figure = Figure(found.name, found.value_arcsec, "arcsec", COVERAGE * float(rad_to_arcsec(u)))
    curves = tuple(Drawn(one.label, *means(one.measured)[:2]) for one in files)
    return KindAnswer(
        kind="squareness",
        standard="ISO 230-1:2012",
        figures=(figure, *_by_other_lines(runs, asked, artefact), *_slopes(pairs)),
        curves=curves,
        axes=POSITION_UM,
        notes=(in_words(asked.plane, float(rad_to_arcsec(above))), LSQ, *notes, *SCATTER_ONLY),
        fitted=True,
    )


LSQ = "reference lines: least squares; the other figures are by the line that they name"
OTHER_LINES: Mapping[Reference, str] = {"end-point": "by end points", "minimum-zone": "by minimum zone"}


def _countings(files: Files, asked: KindQuestion) -> list[int]:
    """Sign of each file's slope, by what a person said of its reading. Raises ModelError (E-KIND-SENSES)."""
    said = asked.senses * 2 if len(files) == 4 and len(asked.senses) == 2 else asked.senses
    if len(said) != len(files) or not set(said) <= set(COUNTINGS):
        names = ", ".join(one.label for one in files)
        raise ModelError("E-KIND-SENSES", "squareness", files=names, given=",".join(asked.senses) or "-")
    return [COUNTINGS[one] for one in said]


def _by_other_lines(runs: list[StraightnessRun], asked: KindQuestion, artefact: float) -> tuple[Figure, ...]:
    """The squareness by the other lines of ISO 230-1; of a reversed square the mean of both pairs."""
    found = []
    for line, words in OTHER_LINES.items():
        each = [above_90(one, other, line, artefact) for one, other in zip(runs[::2], runs[1::2], strict=True)]
        named = of_plane(cast(Plane, asked.plane), float(np.mean(each)))
        found.append(Figure(f"{named.name} {words}", named.value_arcsec, "arcsec"))
    return tuple(found)


def _told(pairs: list[SquarenessRuns]) -> tuple[float, float, tuple[str, ...]]:
    """Angle above 90 deg and its standard uncertainty, rad, and what must be known of the square."""
    if len(pairs) == 1:
        return pairs[0].C0Y, pairs[0].u, ("the square's own angle is in the figure, less what --artefact says",)
    both = reversed_square(pairs[0], pairs[1])
    own = float(rad_to_arcsec(both.own))
    return both.C0Y, both.u, (f"the square itself: {own:+.3f} arcsec from 90 deg, taken out by its reversal",)


def _slopes(pairs: list[SquarenessRuns]) -> tuple[Figure, ...]:
    found = []
    for place, pair in enumerate(pairs, 1):
        found.append(Figure(f"slope along the first axis, pair {place}", float(rad_to_arcsec(pair.slope_x)), "arcsec"))
        found.append(Figure(f"slope along the second axis, pair {place}", float(rad_to_arcsec(pair.slope_y)), "arcsec"))
    return tuple(found)


def _run(one: MeasuredFile, sign: int = 1) -> StraightnessRun:
    """A file as a straightness run in mm, by the ``sign`` of its reading; without repeats u is what the line leaves."""
    at, mean, u = means(one.measured)
    return StraightnessRun(at, sign * um_to_mm(mean), None if np.isnan(u).any() else um_to_mm(u))


SAME: Mapping[str, int] = {"same": 1, "opposite": -1}


def parallelism(files: Files, asked: KindQuestion) -> KindAnswer:
    """How two straightness runs along one axis diverge, from their least-squares lines; their readings' sides said."""
    count_of("parallelism", files, "two", (2,))
    unit_of("parallelism", files, "um")
    if len(asked.senses) != 1 or asked.senses[0] not in SAME:
        raise ModelError("E-KIND-SIDES", "parallelism", given=",".join(asked.senses) or "-")
    signs = (1, SAME[asked.senses[0]])
    (first, u_first), (second, u_second) = (_run(one, sign).direction() for one, sign in zip(files, signs, strict=True))
    apart = first - second
    U = COVERAGE * float(np.hypot(u_first, u_second))
    length = float(np.ptp(files[0].measured.targets))
    figures = (
        Figure("parallelism", float(rad_to_arcsec(apart)), "arcsec", float(rad_to_arcsec(U))),
        Figure(f"over {length:g} mm", abs(float(mm_to_um(apart * length))), "um", float(mm_to_um(U * length))),
    )
    curves = tuple(Drawn(one.label, *means(one.measured)[:2]) for one in files)
    return KindAnswer(
        kind="parallelism",
        standard="ISO 230-1:2012",
        figures=figures,
        curves=curves,
        axes=POSITION_UM,
        notes=SCATTER_ONLY,
        fitted=True,
    )


def six_dof(files: Files, asked: KindQuestion) -> KindAnswer:
    """Six motions of one axis with the covariance of their scatter, and the error of a point beside the beam."""
    count_of("six-dof", files, "six motions of one axis: a table of them, or six files")
    sets = {one.label.split()[-1]: one.measured for one in files}
    axis = asked.axis or Counter(name[-1] for name in sets if name[-1] in "XYZ").most_common(1)[0][0]
    targets = [one.targets for name, one in sets.items() if name in motions_of_axis(axis)]
    if any(one.shape != targets[0].shape or not np.array_equal(one, targets[0]) for one in targets):
        raise ModelError("E-SIX-SHAPE", "six-dof", shapes="targets differ")
    first = targets[0] if targets else np.empty(0)
    found = six_motions(axis, first, {name: one.deviations for name, one in sets.items()})
    names, u, shared = motions_of_axis(axis), found.u(), found.correlation()
    figures = []
    for k, name in enumerate(names):
        unit = "um" if name[1] in "XYZ" else "arcsec"
        across = name[1] in "XYZ" and name[1] != axis
        value = straightness(found.targets, found.means[:, k], "lsq").value if across else np.ptp(found.means[:, k])
        U = None if u is None else COVERAGE * float(np.sqrt(2.0) * u[:, k].max())
        figures.append(Figure(f"{name} {'straightness' if across else 'range'}", float(value), unit, U))
    at = point_error(found, asked.offset_mm)
    for place, letter in enumerate("XYZ"):
        U = None if at.U is None else float(np.sqrt(2.0) * at.U[:, place].max())
        figures.append(Figure(f"point along {letter} range", float(np.ptp(at.error[:, place])), "um", U))
    where = ", ".join(f"{one:g}" for one in asked.offset_mm)
    notes = [f"the point stands at ({where}) mm from the measured point of the carriage"]
    if shared is not None and at.U is not None and at.U_independent is not None:
        pairs = [(abs(shared[a, b]), a, b) for a in range(len(names)) for b in range(a)]
        _, a, b = max(pairs)
        notes.append(f"largest correlation of scatter: {names[b]} and {names[a]} {shared[a, b]:+.2f}")
        apart = ", ".join(
            f"{letter} {np.sqrt(2.0) * at.U_independent[:, k].max():.3f}" for k, letter in enumerate("XYZ")
        )
        notes.append(f"U of the point's range with independent channels would be {apart} um")
    lost = sum(int((~np.isfinite(sets[name].deviations)).sum()) for name in names)
    notes += [f"{lost} readings are missing; the channels read at the same stops count"] if lost else []
    curves = tuple(Drawn(f"point {letter}", found.targets, at.error[:, k]) for k, letter in enumerate("XYZ"))
    return KindAnswer(
        kind="six-dof",
        standard="ISO 230-1:2012",
        figures=tuple(figures),
        curves=curves,
        axes=POSITION_UM,
        notes=(*notes, *SCATTER_ONLY),
    )


def reversal(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Reversal B at each target: its largest amount, its mean, and whether it depends on the position."""
    count_of("reversal", files, "one or more")
    figures, curves, notes = [], [], []
    unit: DeviationUnit = "um" if files[0].measured.axis_unit == "mm" else "arcsec"
    unit_of("reversal", files, unit)
    for one in files:
        found = iso230_2.evaluate_iso230_2(one.measured.targets, one.measured.deviations, unit)
        if found.B is None:
            raise ModelError("E-KIND-ONE-WAY", one.label)
        there = np.isfinite(found.B_i)
        mean = float(np.mean(found.B_i[there]))
        varies = float(np.ptp(found.B_i[there]))
        figures += [
            Figure(f"{one.label} B", found.B, unit, found.U.get("B")),
            Figure(f"{one.label} mean", mean, unit),
            Figure(f"{one.label} range over the travel", varies, unit),
        ]
        if found.U.get("B") is not None and varies > found.U["B"]:
            left = f"one constant value leaves up to {varies / 2:.2f} {SHOWN[unit]}"
            notes.append(f"{one.label}: the reversal depends on the position; {left}")
        curves.append(Drawn(one.label, found.targets[there], found.B_i[there]))
    axes = ("position  mm" if unit == "um" else "position  deg", f"reversal B  {SHOWN[unit]}")
    return KindAnswer(
        kind="reversal",
        standard="ISO 230-2:2014",
        figures=tuple(figures),
        curves=tuple(curves),
        axes=axes,
        notes=(*notes, *SCATTER_ONLY),
    )
