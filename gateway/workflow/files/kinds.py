"""Every kind of evaluation that files alone allow, by the name that is typed; one call each, the function of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import cast

import numpy as np

from drivers.message import Message, words
from drivers.units import DeviationUnit, arcsec_to_rad, mm_to_um, rad_to_arcsec, um_to_mm
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError
from gateway.evaluate.geometry import rotary_motion
from gateway.evaluate.geometry.angular import COMPONENTS, Kind, angular_motion
from gateway.evaluate.geometry.axis_location import FRAMES, RotaryAxis, from_bar
from gateway.evaluate.geometry.rotary_motion import harmonics
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
from gateway.workflow.files.kind_records import (
    Drawn,
    Figure,
    KindAnswer,
    KindQuestion,
    MeasuredFile,
    count_of,
    means,
    unit_of,
)
from gateway.workflow.run.stages import simulated_set

# Evaluations of linear axes from files: straightness, angular motion, squareness, parallelism, reversal.
#
# Each calls the function that a run calls; here only files become arrays and results become figures.

LINES: tuple[Reference, ...] = ("minimum-zone", "lsq", "end-point")
Files = tuple[MeasuredFile, ...]
POSITION_UM = ("position  mm", "deviation  µm")
SHOWN = {"um": "µm", "arcsec": "arcsec"}
SCATTER_ONLY = (Message.of("S-KIND-U-SCATTER"),)


def evaluate_positioning(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Figures of ISO 230-2 with both directions of every file on one scale."""
    count_of("positioning", files, Message.of("W-KIND-ONE-OR-MORE"))
    unit: DeviationUnit = "um" if files[0].measured.axis_unit == "mm" else "arcsec"
    unit_of("positioning", files, unit)
    figures, curves = [], []
    notes: dict[Message, None] = {}
    for one in files:
        budget, supposed = measured_budget(one.measured)
        notes |= dict.fromkeys(Message.stored(one.text) for one in supposed)
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


def evaluate_straightness(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Straightness of each file about three lines; the curves are about the least-squares line, on one scale."""
    count_of("straightness", files, Message.of("W-KIND-ONE-OR-MORE"))
    unit_of("straightness", files, "um")
    figures, curves = [], []
    for one in files:
        at, mean, _ = means(one.measured)
        found = {line: straightness(at, mean, line) for line in LINES}
        figures += [Figure(f"{one.label} {line}", found[line].value, "um") for line in LINES]
        slope = float(rad_to_arcsec(um_to_mm(found["lsq"].slope)))
        figures.append(Figure(words("S-KIND-SLOPE", label=one.label), slope, "arcsec"))
        curves.append(Drawn(one.label, at, found["lsq"].residual))
    return KindAnswer(
        kind="straightness",
        standard="ISO 230-1:2012",
        figures=tuple(figures),
        curves=tuple(curves),
        axes=(POSITION_UM[0], words("S-KIND-FROM-LINE")),
    )


def evaluate_angular(files: Files, asked: KindQuestion) -> KindAnswer:
    """Pitch, yaw or roll of a linear axis: figures of ISO 230-2 in arcsec, the range also in urad."""
    count_of("angular", files, Message.of("W-KIND-ONE-OR-MORE"))
    unit_of("angular", files, "arcsec")
    words = sorted({word for axis, word in COMPONENTS if axis == asked.axis})
    if asked.angle not in words:
        known = ", ".join(words) or Message.of("W-KIND-GIVE-AXIS")
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
    notes = (Message.of("S-KIND-TARGETS-MM", angle=asked.angle, axis=asked.axis, name=name), *SCATTER_ONLY)
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


def evaluate_squareness(files: Files, asked: KindQuestion) -> KindAnswer:
    """Squareness from the straightness of two axes along one square; with four files the square is turned over."""
    count_of("squareness", files, Message.of("W-KIND-SQUARE"), (2, 4))
    unit_of("squareness", files, "um")
    artefact = float(arcsec_to_rad(asked.artefact_arcsec))
    signs = _countings(files, asked)
    runs = [_straightness_run(one, sign) for one, sign in zip(files, signs, strict=True)]
    pairs = [from_runs(one, other, artefact) for one, other in zip(runs[::2], runs[1::2], strict=True)]
    above, u, notes = _squareness_of_pairs(pairs)
    found = of_plane(cast(Plane, asked.plane), above)
    figure = Figure(found.name, found.value_arcsec, "arcsec", COVERAGE * float(rad_to_arcsec(u)))
    curves = tuple(Drawn(one.label, *means(one.measured)[:2]) for one in files)
    return KindAnswer(
        kind="squareness",
        standard="ISO 230-1:2012",
        figures=(figure, *_by_other_lines(runs, asked, artefact), *_slopes(pairs)),
        curves=curves,
        axes=POSITION_UM,
        notes=(Message.stored(in_words(asked.plane, float(rad_to_arcsec(above)))), LSQ, *notes, *SCATTER_ONLY),
        fitted=True,
    )


LSQ = Message.of("S-KIND-LINES")
OTHER_LINES: Mapping[Reference, str] = {
    "end-point": words("S-KIND-END-POINTS"),
    "minimum-zone": words("S-KIND-MINIMUM-ZONE"),
}


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
    for line, by_line in OTHER_LINES.items():
        each = [above_90(one, other, line, artefact) for one, other in zip(runs[::2], runs[1::2], strict=True)]
        named = of_plane(cast(Plane, asked.plane), float(np.mean(each)))
        found.append(Figure(f"{named.name} {by_line}", named.value_arcsec, "arcsec"))
    return tuple(found)


def _squareness_of_pairs(pairs: list[SquarenessRuns]) -> tuple[float, float, tuple[Message, ...]]:
    """Angle above 90 deg and its standard uncertainty, rad, and what must be known of the square."""
    if len(pairs) == 1:
        return pairs[0].C0Y, pairs[0].u, (Message.of("S-KIND-SQUARE-ANGLE"),)
    both = reversed_square(pairs[0], pairs[1])
    own = float(rad_to_arcsec(both.own))
    return both.C0Y, both.u, (Message.of("S-KIND-SQUARE-OWN", own=own),)


def _slopes(pairs: list[SquarenessRuns]) -> tuple[Figure, ...]:
    found = []
    for place, pair in enumerate(pairs, 1):
        found.append(Figure(words("S-KIND-SLOPE-FIRST", place=place), float(rad_to_arcsec(pair.slope_x)), "arcsec"))
        found.append(Figure(words("S-KIND-SLOPE-SECOND", place=place), float(rad_to_arcsec(pair.slope_y)), "arcsec"))
    return tuple(found)


def _straightness_run(one: MeasuredFile, sign: int = 1) -> StraightnessRun:
    """A file as a straightness run in mm, by the ``sign`` of its reading; without repeats u is what the line leaves."""
    at, mean, u = means(one.measured)
    return StraightnessRun(at, sign * um_to_mm(mean), None if np.isnan(u).any() else um_to_mm(u))


SAME: Mapping[str, int] = {"same": 1, "opposite": -1}


def evaluate_parallelism(files: Files, asked: KindQuestion) -> KindAnswer:
    """How two straightness runs along one axis diverge, from their least-squares lines; their readings' sides said."""
    count_of("parallelism", files, "two", (2,))
    unit_of("parallelism", files, "um")
    if len(asked.senses) != 1 or asked.senses[0] not in SAME:
        raise ModelError("E-KIND-SIDES", "parallelism", given=",".join(asked.senses) or "-")
    signs = (1, SAME[asked.senses[0]])
    (first, u_first), (second, u_second) = (
        _straightness_run(one, sign).direction() for one, sign in zip(files, signs, strict=True)
    )
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


def evaluate_six_motions(files: Files, asked: KindQuestion) -> KindAnswer:
    """Six motions of one axis with the covariance of their scatter, and the error of a point beside the beam."""
    count_of("six-dof", files, Message.of("W-KIND-SIX"))
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
    notes = [Message.of("S-KIND-POINT", at=where)]
    if shared is not None and at.U is not None and at.U_independent is not None:
        pairs = [(abs(shared[a, b]), a, b) for a in range(len(names)) for b in range(a)]
        _, a, b = max(pairs)
        notes.append(Message.of("S-KIND-CORRELATION", first=names[b], second=names[a], shared=shared[a, b]))
        apart = ", ".join(
            f"{letter} {np.sqrt(2.0) * at.U_independent[:, k].max():.3f}" for k, letter in enumerate("XYZ")
        )
        notes.append(Message.of("S-KIND-INDEPENDENT", apart=apart))
    lost = sum(int((~np.isfinite(sets[name].deviations)).sum()) for name in names)
    notes += [Message.of("S-KIND-MISSING", lost=lost)] if lost else []
    curves = tuple(Drawn(f"point {letter}", found.targets, at.error[:, k]) for k, letter in enumerate("XYZ"))
    return KindAnswer(
        kind="six-dof",
        standard="ISO 230-1:2012",
        figures=tuple(figures),
        curves=curves,
        axes=POSITION_UM,
        notes=(*notes, *SCATTER_ONLY),
    )


def evaluate_reversal(files: Files, _asked: KindQuestion) -> KindAnswer:
    """Reversal B at each target: its largest amount, its mean, and whether it depends on the position."""
    count_of("reversal", files, Message.of("W-KIND-ONE-OR-MORE"))
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
            Figure(words("S-KIND-TRAVEL-RANGE", label=one.label), varies, unit),
        ]
        if found.U.get("B") is not None and varies > found.U["B"]:
            left = Message.of("S-KIND-CONSTANT", left=varies / 2, unit=SHOWN[unit])
            notes.append(Message.of("S-KIND-REVERSAL", label=one.label, left=left))
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


# Evaluations of rotary axes from files: axis location from a test bar, error motions of a turning axis, harmonics.

MOTIONS = {"radial": 1, "axial": 1, "rotating": 2, "tilt": 2}
USUAL_ORDERS = 12


def evaluate_axis_location(files: Files, asked: KindQuestion) -> KindAnswer:
    """Lean of a rotary axis from runs up a test bar: for each direction across it a run at 0 and one at 180 deg."""
    count_of("axis-location", files, Message.of("W-KIND-BAR"), (2, 4))
    unit_of("axis-location", files, "um")
    if asked.axis not in FRAMES:
        raise ModelError("E-EVAL-LOCATION", "location", axis=asked.axis or "?", why="--axis must be A, B or C")
    across = FRAMES[asked.axis][:2]
    pairs = {
        letter: (_bar_run(files[2 * k]), _bar_run(files[2 * k + 1]))
        for k, letter in enumerate(across[: len(files) // 2])
    }
    found = from_bar(cast(RotaryAxis, asked.axis), pairs)
    figures = [Figure(name, value, "arcsec", found.U.get(name)) for name, value in found.values.items()]
    figures += [
        Figure(words("S-KIND-BAR-LEAN", letter=letter), value, "arcsec") for letter, value in found.artefact.items()
    ]
    curves = tuple(Drawn(one.label, *means(one.measured)[:2]) for one in files)
    axes = ("height  mm", "deviation  µm")
    return KindAnswer(
        kind="axis-location",
        standard="ISO 230-1:2012",
        figures=tuple(figures),
        curves=curves,
        axes=axes,
        notes=found.flags,
        fitted=True,
    )


def _bar_run(one: MeasuredFile) -> StraightnessRun:
    at, mean, u = means(one.measured)
    return StraightnessRun(at, um_to_mm(mean), None if np.isnan(u).any() else um_to_mm(u))


def evaluate_rotary_motion(files: Files, asked: KindQuestion) -> KindAnswer:
    """Error motion of a turning axis (ISO 230-7): each repetition of a file is a turn, its targets are angles in deg.

    One sensor for radial (fixed direction) and axial motion, two files for a rotating direction (0 and 90 deg) and for
    tilt (far, near). Files of 360 deg carry readings in um under the heading of a table with a target in deg.
    """
    if asked.motion not in MOTIONS:
        raise ModelError("E-KIND-MOTION", "rotary-motion", motion=asked.motion, known=", ".join(MOTIONS))
    count_of("rotary-motion", files, f"{MOTIONS[asked.motion]} for {asked.motion}", (MOTIONS[asked.motion],))
    if asked.motion == "tilt" and asked.distance_mm <= 0.0:
        raise ModelError("E-KIND-DISTANCE", "rotary-motion")
    angles = files[0].measured.targets
    turns = [_turns(one, angles) for one in files]
    found = {
        "radial": lambda: rotary_motion.radial_fixed(angles, turns[0]),
        "axial": lambda: rotary_motion.axial(angles, turns[0]),
        "rotating": lambda: rotary_motion.radial_rotating(angles, turns[0], turns[1]),
        "tilt": lambda: rotary_motion.tilt(angles, turns[0], turns[1], asked.distance_mm),
    }[asked.motion]()
    figures = [
        Figure("total", found.total, found.unit),
        Figure("synchronous", found.synchronous, found.unit),
        Figure(words("S-KIND-SYNC"), found.residual_synchronous, found.unit),
    ]
    if found.asynchronous is not None:
        figures.append(Figure("asynchronous", found.asynchronous, found.unit))
    figures.append(Figure("once per turn", found.fundamental.amplitude, found.unit))
    curves = [Drawn(f"turn {place}", angles, turn) for place, turn in enumerate(found.residual, 1)]
    curves = [*curves, Drawn("average", angles, found.average)]
    axes = ("angle  deg", f"{found.kind}  {'µm' if found.unit == 'um' else found.unit}")
    return KindAnswer(
        kind="rotary-motion",
        standard=found.standard,
        figures=tuple(figures),
        curves=tuple(curves),
        axes=axes,
        polar=True,
        notes=tuple(map(Message.stored, found.flags)),
    )


def _turns(one: MeasuredFile, angles: FloatArray) -> FloatArray:
    """Readings (turns, k) of the positive direction. Raises ModelError (E-KIND-ANGLES) for other angles."""
    if not np.array_equal(one.measured.targets, angles):
        raise ModelError("E-KIND-ANGLES", one.label)
    return np.asarray(one.measured.deviations[:, :, 0].T, dtype=np.float64)


def evaluate_harmonics(files: Files, asked: KindQuestion) -> KindAnswer:
    """Harmonics of a rotary axis' deviation: amplitude and phase by order, and what they leave."""
    count_of("harmonics", files, "one", (1,))
    unit_of("harmonics", files, "arcsec")
    at, mean, _ = means(files[0].measured)
    places = np.unique(np.round(at % 360.0, 9)).size
    most = min(USUAL_ORDERS, (places - 1) // 2)
    orders = asked.orders or tuple(range(1, most + 1))
    found = harmonics(at, mean, orders)
    figures = [Figure("range", float(np.ptp(mean)), "arcsec")]
    for order, one in found.harmonics.items():
        figures.append(Figure(f"order {order} amplitude", one.amplitude, "arcsec"))
        figures.append(Figure(f"order {order} phase", one.phase_deg, "deg"))
    figures.append(Figure(words("S-KIND-RANGE-LEFT"), found.residual_range, "arcsec"))
    curves = (Drawn(files[0].label, at, mean - found.mean), Drawn(words("S-KIND-LEFT"), at, found.residual))
    notes = () if asked.orders else (Message.of("S-KIND-ORDERS", places=places, highest=(places - 1) // 2),)
    axes = ("angle  deg", "deviation  arcsec")
    return KindAnswer(
        kind="harmonics",
        standard="least squares",
        figures=tuple(figures),
        curves=curves,
        axes=axes,
        notes=notes,
    )


Evaluate = Callable[[tuple[MeasuredFile, ...], KindQuestion], KindAnswer]
KINDS: Mapping[str, Evaluate] = {
    "positioning": evaluate_positioning,
    "straightness": evaluate_straightness,
    "angular": evaluate_angular,
    "squareness": evaluate_squareness,
    "parallelism": evaluate_parallelism,
    "six-dof": evaluate_six_motions,
    "reversal": evaluate_reversal,
    "axis-location": evaluate_axis_location,
    "rotary-motion": evaluate_rotary_motion,
    "harmonics": evaluate_harmonics,
}


def known_kind(kind: str) -> None:
    """Raises ModelError (E-KIND-NAME) before any file is read."""
    if kind not in KINDS:
        raise ModelError("E-KIND-NAME", "--kind", kind=kind, known=", ".join(KINDS))


def evaluate_kind(kind: str, files: tuple[MeasuredFile, ...], asked: KindQuestion) -> KindAnswer:
    """Evaluate files of one kind. Raises ModelError (E-KIND-NAME, E-KIND-FILES, E-KIND-UNIT and those of the kind)."""
    known_kind(kind)
    answer = KINDS[kind](files, asked)
    if any(simulated_set(one.measured) for one in files):
        return replace(answer, simulated=True, notes=(*answer.notes, Message.of("S-RUN-SIMULATED")))
    return answer
