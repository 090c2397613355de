"""The machine as it really is: every error motion of every axis, known to the cell alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from simulators.cellfile import CellAxis, CellFile, DriftSection, Terms
from simulators.truth.climate import Climate, Weather, drift_time_s, drift_value
from simulators.truth.curves import Curve, curve, generator
from simulators.truth.kinematics import (
    BED,
    AxisMotion,
    FloatArray,
    Hysteresis,
    Pose,
    Scatter,
    fixed_pose,
    rotation,
    slide_pose,
    table_pose,
)

__all__ = [
    "AxisMotion",
    "Climate",
    "Curve",
    "Hysteresis",
    "Pose",
    "Scatter",
    "Truth",
    "Weather",
    "curve",
    "drift_time_s",
    "fixed_pose",
    "generator",
]

ARCSEC = np.pi / 180.0 / 3600.0
UM = 1e-3
DIRECTIONS = "XYZABC"
MOST_KEPT = 32
Kept = TypeVar("Kept")


class Truth:
    """True error motions of a cell. Sign: deviation = went too far is positive. um, arcsec, mm, deg.

    `seed` redraws every term from the cell file's kinds and sizes; `flip` reverses every error's sign.
    """

    def __init__(self, cell: CellFile, seed: int | None = None, *, flip: bool = False) -> None:
        self.cell = cell
        self.seed = cell.seed if seed is None else seed
        self.sign = -1.0 if flip else 1.0
        self._redraw = seed is not None and seed != cell.seed
        self._curves = self._named(cell.truth.motions, "")
        self._ways = self._named(cell.truth.reversals, "reversal ")
        self._reversal: dict[str, Curve] = {
            a.letter: self._curve(a.reversal, a, f"reversal {a.letter}") for a in cell.axes
        }
        self._location = {name: self._located(name, value) for name, value in cell.truth.locations.items()}
        self._axes: dict[str, CellAxis] = {axis.letter: axis for axis in cell.axes}
        self._rest: dict[str, tuple[float, FloatArray]] = {}
        # What fixed errors make of a frame, by their values: the same for every sample of a run.
        self._directions: dict[tuple[float, ...], FloatArray] = {}
        self._seats: dict[tuple[float, ...], Pose] = {}
        self.climate = Climate(cell.climate)

    def _curve(self, terms: Terms, axis: CellAxis, name: str) -> Curve:
        return curve(terms, axis.travel, rotary=axis.kind == "rotary", seed=self.seed, name=name, redraw=self._redraw)

    def _named(self, wanted: Mapping[str, Terms], kind: str) -> dict[str, Curve]:
        letters = {axis.letter for axis in self.cell.axes}
        return {
            name: self._curve(terms, self.cell.axis(name[2]), f"{kind}{name}")
            for name, terms in wanted.items()
            if name[2] in letters
        }

    def _located(self, name: str, value: float) -> float:
        drawn = float(generator(self.seed, name).uniform(-1.1, 1.1)) if self._redraw else 1.0
        return self.sign * drawn * value

    def motion(self, name: str, position: FloatArray) -> FloatArray:
        """An error motion such as EYX at axis positions (n,), um or arcsec, without any reversal."""
        found = self._curves.get(name)
        place = np.asarray(position, dtype=np.float64)
        if found is None:
            return np.zeros_like(place)
        if place.shape != (1,):
            return self.sign * found(self._turned(name[2], place))
        # An axis that stands is asked for again and again.
        at, value = self._rest.get(name, (np.nan, place))
        if at != place[0]:
            value = self.sign * found(self._turned(name[2], place))
            self._rest[name] = float(place[0]), value
        return value.copy()

    def _turned(self, letter: str, position: FloatArray) -> FloatArray:
        return np.mod(position, 360.0) if self._axes[letter].kind == "rotary" else position

    def way(self, name: str, motion: AxisMotion) -> FloatArray:
        """What a motion such as EYX has of its way of travel: half the difference on + approach, minus half on -."""
        found = self._ways.get(name)
        if found is None:
            return np.zeros(1)
        return np.asarray(0.5 * self.sign * motion.direction * found(self._turned(name[2], motion.position)))

    def location(self, name: str, t: float | None = None) -> float:
        """A location error such as B0Z, um or arcsec: as the cell file has it, or as it is at time t (s)."""
        moving = self.cell.truth.moving.get(name)
        moved = 0.0 if moving is None or t is None else self.sign * self._drifted(moving, t)
        return self._location.get(name, 0.0) + moved

    def _drifted(self, drift: DriftSection, t: float) -> float:
        return drift_value(drift, t, self.climate.true(t).material_degc)

    def reversal(self, letter: str, motion: AxisMotion) -> FloatArray:
        """Half of B with the sense of travel, um or arcsec: + approach B/2, - approach -B/2."""
        axis = self._axes[letter]
        full = self._reversal[letter](self._turned(letter, motion.position))
        half = np.asarray(0.5 * self.sign * motion.direction * full)
        if axis.hysteresis is not None:
            half = half + 0.5 * self.sign * axis.hysteresis.size * motion.windup
        return half

    def deviation(self, axis: str, positions: FloatArray, direction: int, t: float = 0.0) -> FloatArray:
        """Deviation of the bare mechanism at encoder positions (n,), at 20 degC, reversal fully built up.

        um or arcsec; `axis` by name or letter; `t` in s of the cell's clock, for its drift.
        """
        spec = self.cell.axis(axis)
        place = np.asarray(positions, dtype=np.float64)
        sense = np.full_like(place, float(direction))
        return self.along(spec.letter, AxisMotion(place, sense, sense), t)

    def along(self, letter: str, motion: AxisMotion, t: float) -> FloatArray:
        """The axis' own deviation (EXX, EZZ, ECC, ...) with reversal and drift, um or arcsec."""
        axis = self._axes[letter]
        drift = axis.drift_per_h * drift_time_s(t) / 3600.0 + self._drifted(axis.drift, t)
        own = self.motion(f"E{letter}{letter}", motion.position) + self.reversal(letter, motion)
        return own + self.sign * drift + motion.scatter

    def _six(self, letter: str, motion: AxisMotion, t: float) -> tuple[FloatArray, FloatArray]:
        names = [f"E{to}{letter}" for to in DIRECTIONS]
        own = DIRECTIONS.index(letter)
        rows = [
            self.along(letter, motion, t)
            if place == own
            else self.motion(name, motion.position) + self.way(name, motion)
            for place, name in enumerate(names)
        ]
        six = np.empty((len(rows), max(row.shape[0] for row in rows)))
        for place, row in enumerate(rows):
            six[place] = row
        return six[:3] * UM, six[3:] * ARCSEC

    def _expanded(self, letter: str, position: FloatArray, t: float) -> FloatArray:
        axis = self._axes[letter]
        warm = axis.expansion_ppm_per_k * 1e-6 * (self.climate.true(t).material_degc - 20.0)
        return position + (position - axis.thermal_origin) * warm

    def _direction(self, letter: str, ideal: tuple[float, float, float], t: float) -> FloatArray:
        angles = tuple(self.location(f"{about}0{letter}", t) * ARCSEC for about in "ABC")
        found = self._directions.get(angles + ideal)
        if found is None:
            found = np.asarray(rotation(np.asarray(angles)[:, None])[0] @ np.asarray(ideal))
            self._directions = _bounded(self._directions) | {angles + ideal: found}
        return found

    def frames(self, motions: Mapping[str, AxisMotion], t: float) -> dict[str, Pose]:
        """The frames "bed", "X", "Z" and "C" at these axis motions and time, as far as the cell has them."""
        frames = {"bed": BED, "X": BED, "Z": BED}
        for letter, ideal in (("X", (1.0, 0.0, 0.0)), ("Z", (0.0, 0.0, 1.0))):
            if letter in motions:
                shift, tilt = self._six(letter, motions[letter], t)
                q = self._expanded(letter, motions[letter].position, t)
                frames[letter] = slide_pose(q, self._direction(letter, ideal, t), shift, tilt)
        if "C" in motions:
            shift, tilt = self._six("C", motions["C"], t)
            turned = np.deg2rad(motions["C"].position)
            frames["C"] = table_pose(turned, frames["X"].then(self._seat(t)), shift, tilt)
        return frames

    def _seat(self, t: float) -> Pose:
        shift = tuple(self.location(f"{name}0C", t) * UM for name in "XYZ")
        tilt = tuple(self.location(f"{name}0C", t) * ARCSEC for name in "ABC")
        found = self._seats.get(shift + tilt)
        if found is None:
            found = fixed_pose((shift[0], shift[1], shift[2]), (tilt[0], tilt[1], tilt[2]))
            self._seats = _bounded(self._seats) | {shift + tilt: found}
        return found


def _bounded(known: dict[tuple[float, ...], Kept]) -> dict[tuple[float, ...], Kept]:
    """The same, or nothing of it where errors that move would fill it."""
    return known if len(known) < MOST_KEPT else {}
