"""The machine as it really is: every error motion of every axis, known to the cell alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simulators.cellfile import CellAxis, CellFile
from simulators.cellfile.terms import Terms
from simulators.truth.chain import BED, FloatArray, Pose, rotation, slide, still, table
from simulators.truth.climate import Climate, Weather
from simulators.truth.drift import drifted_s
from simulators.truth.terms import Curve, curve, generator

__all__ = ["AxisMotion", "Climate", "Hysteresis", "Truth", "Weather", "generator"]

ARCSEC = np.pi / 180.0 / 3600.0
UM = 1e-3
DIRECTIONS = "XYZABC"


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """An axis over some samples: encoder position (n,) in mm or deg, its travel sense and its wind-up.

    ``direction`` is +1 or -1, the last travel; ``windup`` runs from -1 to +1 as hysteresis builds up.
    Arrays of length 1 stand for "all the time".
    """

    position: FloatArray
    direction: FloatArray
    windup: FloatArray


class Truth:
    """True error motions of a cell. Sign: deviation = went too far is positive. um, arcsec, mm, deg.

    `seed` redraws every term from the cell file's kinds and sizes; `flip` reverses every error's sign.
    """

    def __init__(self, cell: CellFile, seed: int | None = None, *, flip: bool = False) -> None:
        self.cell = cell
        self.seed = cell.seed if seed is None else seed
        self.sign = -1.0 if flip else 1.0
        self._redraw = seed is not None and seed != cell.seed
        self._curves = {
            name: self._curve(terms, cell.axis(name[2]), name)
            for name, terms in cell.truth.motions.items()
            if any(axis.letter == name[2] for axis in cell.axes)
        }
        self._reversal: dict[str, Curve] = {
            a.letter: self._curve(a.reversal, a, f"reversal {a.letter}") for a in cell.axes
        }
        self._location = {name: self._located(name, value) for name, value in cell.truth.locations.items()}
        self._rest: dict[str, tuple[float, FloatArray]] = {}
        self.climate = Climate(cell.climate)

    def _curve(self, terms: Terms, axis: CellAxis, name: str) -> Curve:
        return curve(terms, axis.travel, rotary=axis.kind == "rotary", seed=self.seed, name=name, redraw=self._redraw)

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
        return np.mod(position, 360.0) if self.cell.axis(letter).kind == "rotary" else position

    def location(self, name: str) -> float:
        """A location error such as B0Z, um or arcsec."""
        return self._location.get(name, 0.0)

    def reversal(self, letter: str, motion: AxisMotion) -> FloatArray:
        """Half of B with the sense of travel, um or arcsec: + approach B/2, - approach -B/2."""
        axis = self.cell.axis(letter)
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
        axis = self.cell.axis(letter)
        drift = self.sign * axis.drift_per_h * drifted_s(t) / 3600.0
        return self.motion(f"E{letter}{letter}", motion.position) + self.reversal(letter, motion) + drift

    def _six(self, letter: str, motion: AxisMotion, t: float) -> tuple[FloatArray, FloatArray]:
        rows = [self.motion(f"E{to}{letter}", motion.position) for to in DIRECTIONS]
        rows[DIRECTIONS.index(letter)] = self.along(letter, motion, t)
        size = np.broadcast_shapes(*(row.shape for row in rows))
        six = np.stack([np.broadcast_to(row, size) for row in rows])
        return six[:3] * UM, six[3:] * ARCSEC

    def _expanded(self, letter: str, position: FloatArray, t: float) -> FloatArray:
        axis = self.cell.axis(letter)
        warm = axis.expansion_ppm_per_k * 1e-6 * (self.climate.true(t).material_degc - 20.0)
        return position + (position - axis.thermal_origin) * warm

    def _direction(self, letter: str, ideal: tuple[float, float, float]) -> FloatArray:
        angles = np.asarray([[self.location(f"{about}0{letter}") * ARCSEC] for about in "ABC"])
        return np.asarray(rotation(angles)[0] @ np.asarray(ideal))

    def frames(self, motions: Mapping[str, AxisMotion], t: float) -> dict[str, Pose]:
        """The frames "bed", "X", "Z" and "C" at these axis motions and time, as far as the cell has them."""
        frames = {"bed": BED, "X": BED, "Z": BED}
        for letter, ideal in (("X", (1.0, 0.0, 0.0)), ("Z", (0.0, 0.0, 1.0))):
            if letter in motions:
                shift, tilt = self._six(letter, motions[letter], t)
                q = self._expanded(letter, motions[letter].position, t)
                frames[letter] = slide(q, self._direction(letter, ideal), shift, tilt)
        if "C" in motions:
            shift, tilt = self._six("C", motions["C"], t)
            turned = np.deg2rad(motions["C"].position)
            frames["C"] = table(turned, frames["X"].then(self._seat()), shift, tilt)
        return frames

    def _seat(self) -> Pose:
        shift = tuple(self.location(f"{name}0C") * UM for name in "XYZ")
        tilt = tuple(self.location(f"{name}0C") * ARCSEC for name in "ABC")
        return still((shift[0], shift[1], shift[2]), (tilt[0], tilt[1], tilt[2]))


class Hysteresis:
    """Follows one axis and says how far its reversal has built up: -1 to +1 over the given distance.

    The stop operator of Prandtl and Ishlinskii: the state follows travel, and saturates.
    """

    def __init__(self, distance: float) -> None:
        self._distance = distance
        self._last: float | None = None
        self._state = -1.0

    def follow(self, position: FloatArray) -> FloatArray:
        """The state at each of these successive positions (n,)."""
        start = position[0] if self._last is None else self._last
        self._last = float(position[-1])
        travel = np.diff(position, prepend=start) / self._distance
        if not travel.any():
            return np.full(len(position), self._state)
        states = np.empty(len(position))
        state = self._state
        for index, moved in enumerate(travel.tolist()):
            state = min(1.0, max(-1.0, state + moved))
            states[index] = state
        self._state = state
        return states
