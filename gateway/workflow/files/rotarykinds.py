"""Evaluations of rotary axes from files: axis location from a test bar, error motions of a turning axis, harmonics."""

from __future__ import annotations

from typing import cast

import numpy as np

from drivers.units import um_to_mm
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.geometry import rotary_motion
from gateway.evaluate.geometry.axis_location import FRAMES, RotaryAxis, from_bar
from gateway.evaluate.geometry.rotary_motion import harmonics
from gateway.evaluate.geometry.straightness import StraightnessRun
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

Files = tuple[MeasuredFile, ...]
MOTIONS = {"radial": 1, "axial": 1, "rotating": 2, "tilt": 2}
USUAL_ORDERS = 12


def axis_location(files: Files, asked: KindQuestion) -> KindAnswer:
    """Lean of a rotary axis from runs up a test bar: for each direction across it a run at 0 and one at 180 deg."""
    count_of(
        "axis-location", files, "two (one direction, at 0 and at 180 deg) or four (the second direction too)", (2, 4)
    )
    unit_of("axis-location", files, "um")
    if asked.axis not in FRAMES:
        raise ModelError("E-EVAL-LOCATION", "location", axis=asked.axis or "?", why="--axis must be A, B or C")
    across = FRAMES[asked.axis][:2]
    pairs = {letter: (_run(files[2 * k]), _run(files[2 * k + 1])) for k, letter in enumerate(across[: len(files) // 2])}
    found = from_bar(cast(RotaryAxis, asked.axis), pairs)
    figures = [Figure(name, value, "arcsec", found.U.get(name)) for name, value in found.values.items()]
    figures += [
        Figure(f"the bar's own lean along {letter}", value, "arcsec") for letter, value in found.artefact.items()
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


def _run(one: MeasuredFile) -> StraightnessRun:
    at, mean, u = means(one.measured)
    return StraightnessRun(at, um_to_mm(mean), None if np.isnan(u).any() else um_to_mm(u))


def motion(files: Files, asked: KindQuestion) -> KindAnswer:
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
        Figure("synchronous without once per turn", found.residual_synchronous, found.unit),
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
        notes=found.flags,
    )


def _turns(one: MeasuredFile, angles: FloatArray) -> FloatArray:
    """Readings (turns, k) of the positive direction. Raises ModelError (E-KIND-ANGLES) for other angles."""
    if not np.array_equal(one.measured.targets, angles):
        raise ModelError("E-KIND-ANGLES", one.label)
    return np.asarray(one.measured.deviations[:, :, 0].T, dtype=np.float64)


def spectrum(files: Files, asked: KindQuestion) -> KindAnswer:
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
    figures.append(Figure("range that is left", found.residual_range, "arcsec"))
    curves = (Drawn(files[0].label, at, mean - found.mean), Drawn("what is left", at, found.residual))
    notes = () if asked.orders else (f"{places} positions a turn tell orders up to {(places - 1) // 2}",)
    axes = ("angle  deg", "deviation  arcsec")
    return KindAnswer(
        kind="harmonics",
        standard="least squares",
        figures=tuple(figures),
        curves=curves,
        axes=axes,
        notes=notes,
    )
