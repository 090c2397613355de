"""What a plan of set-ups would tell of a cell's machine: readings of its truth, without wires, and their fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.types.sensing import Ambient
from drivers.types.tables import LiveSet
from gateway.domain.captures import Capture, Corrections
from gateway.evaluate.geometry.error_model import error_model
from gateway.evaluate.geometry.measurement import Measurement
from gateway.model.error_model import ErrorModel, LocationError
from simulators.truth import Truth

FloatArray = NDArray[np.float64]
TARGETS = {"X": (-400.0, 0.0, 21), "Z": (0.0, 300.0, 21), "C": (0.0, 345.0, 24)}
SYSTEMATIC = {"EXX": 0.48, "EZZ": 0.4, "ECC": 0.5, "EAX": 0.05, "ECZ": 0.05}
NOISE = {"um": 0.1, "arcsec": 0.12}
BALL_UM, SLOPE_UM_PER_MM, LEAN_U = 8.0, 0.1, 0.055
ARCSEC_PER_UM_PER_MM = 648.0 / np.pi


@dataclass(frozen=True)
class Readings:
    """All readings of one machine by error, and its location errors, each read with its own scatter."""

    measurements: tuple[Measurement, ...]
    locations: tuple[LocationError, ...]

    def model(self, without: tuple[str, ...] = ()) -> ErrorModel:
        """What the gateway makes of them; ``without`` were not measured."""
        kept = [one for one in self.measurements if one.name not in without]
        found = error_model(kept, {})
        unknown = tuple(one for one in found.unknown if one.name in without)
        return replace(found, locations=self.locations, unknown=unknown)

    def capture(self, name: str, axis: str, live: LiveSet, utc: str) -> Capture:
        """The readings of one axis' positioning as a capture."""
        one = next(found for found in self.measurements if found.name == name)
        ambient = Ambient(20.0, 1000.0, 50.0, (20.0,))
        done = Corrections()
        reading = (one.targets, one.deviations, 0.02, ambient, ambient, done, live, None)
        return Capture(axis, name, one.axis_unit, *reading, source="file", started_utc=utc, ended_utc=utc)


def read(truth: Truth, seed: int, repetitions: int = 5, counts: Mapping[str, int] | None = None) -> Readings:
    """Read all 18 motions and the leans of a true machine: with scatter, sloping mountings, eccentric artefacts.

    ``counts`` gives other numbers of targets by axis.
    """
    rng = np.random.default_rng(seed)
    found = []
    for axis, (low, high, usual) in TARGETS.items():
        count = (counts or {}).get(axis, usual)
        at = np.linspace(low, high, count)
        at[1:-1] += rng.uniform(-0.2, 0.2, count - 2) * (at[1] - at[0])
        ball = {pair: rng.normal(0.0, BALL_UM, 2) for pair in ("XY", "AB")}
        found += [_read(truth, letter, axis, at, rng, ball, repetitions) for letter in "XYZABC"]
    leans = leans_of(truth)
    located = [LocationError(name, value + rng.normal(0.0, LEAN_U), LEAN_U, "arcsec") for name, value in leans.items()]
    return Readings(tuple(found), tuple(located))


def _read(
    truth: Truth,
    letter: str,
    axis: str,
    at: FloatArray,
    rng: np.random.Generator,
    ball: dict[str, FloatArray],
    repetitions: int,
) -> Measurement:
    name, turning = f"E{letter}{axis}", axis == "C"
    unit = "um" if letter in "XYZ" else "arcsec"
    value = truth.motion(name, at)
    if turning and letter in "XYAB":
        u, v = ball["XY" if letter in "XY" else "AB"]
        q = np.deg2rad(at)
        value = value + (u * np.cos(q) - v * np.sin(q) if letter in "XA" else u * np.sin(q) + v * np.cos(q))
    elif not turning and unit == "um" and letter != axis:
        value = value + rng.normal(0.0, SLOPE_UM_PER_MM) * (at - at[0])
    deviations = value[:, None, None] + rng.normal(0.0, NOISE[unit], (at.size, repetitions, 2))
    if letter == axis:
        full = truth.deviation(axis, at, 1) - truth.deviation(axis, at, -1)
        deviations = deviations + 0.5 * full[:, None, None] * np.array([1.0, -1.0])
    systematic = SYSTEMATIC.get(name, 0.06 if unit == "um" else 0.025)
    return Measurement(name, axis, "deg" if turning else "mm", at, deviations, 0.0, turning, systematic=systematic)


def leans_of(truth: Truth) -> dict[str, float]:
    """Location errors as the model tells them, arcsec: slopes of straightness, X's tilt at 0 and C's mean in them."""
    x, z = np.linspace(-400.0, 0.0, 41), np.linspace(0.0, 300.0, 31)

    def slope(name: str, at: FloatArray) -> float:
        return float(np.polyfit(at, truth.motion(name, at), 1)[0]) * ARCSEC_PER_UM_PER_MM

    def lean(about: str) -> float:
        turn = truth.motion(f"E{about}C", np.arange(720) / 2.0)
        return truth.location(f"{about}0C") + float(truth.motion(f"E{about}X", np.zeros(1))[0] + np.mean(turn))

    z_slope = slope("EXZ", z)
    square = truth.location("B0Z") + z_slope + slope("EZX", x)
    bar = truth.location("B0Z") + z_slope - lean("B")
    return {"B0Z": square, "A0C": lean("A") + slope("EYZ", z), "B0C": square - bar}
