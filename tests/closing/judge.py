"""The judge of a closing run: the true flank and the least that tables and set-up values could leave on it.

Everything here is asked of the simulated machine itself by grinding parts on it; nothing is known of how the gateway
computes a flank. Units: um, arcsec, mm, deg; + = surplus material.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Part
from simulators.grinding import CycloidDisc, WorkPiece
from simulators.grinding.grinder import rotation_axis_frame
from simulators.truth import Pose, Truth
from tests.closing.tables import Grid, Layout, Table, fitted
from tests.unit.simulators.planned_run import ground

FloatArray = NDArray[np.float64]
UM = 1e-3
SHARE = 0.95
STEP = 2.0
ROUNDS = 2
Crossing = tuple[str, str]
CROSS: tuple[Crossing, ...] = (("X", "Z"), ("X", "C"), ("C", "Z"), ("C", "C"))
OWN: tuple[Crossing, ...] = (("C", "C"),)
"""What a control without cross tables has: of the axes' own tables only that of C shows on a flank."""


@dataclass(frozen=True, slots=True)
class Places:
    """The judged points of every space: profile angles t (T,) of both flanks, heights z (Z,), mm from the middle.

    Middles of cells of equal length over 95 % of the flank and of equal height over the whole width, so that a plain
    mean is one over the flank's area. ``nx``, ``ny``, ``lever`` (T,) say what a shift and a turn do along the normal.
    """

    spaces: FloatArray
    t: FloatArray
    z: FloatArray
    nx: FloatArray
    ny: FloatArray
    lever: FloatArray

    def flank(self, work: WorkPiece) -> FloatArray:
        """The true flank of a part (K, T, Z) in um, one rotation removed."""
        return self.turned_off(work.surplus_um(self.spaces, self.t, self.z))

    def turned_off(self, surplus: FloatArray) -> FloatArray:
        """Without the one rotation about the gear's axis that fits best, and nothing else."""
        lever = np.broadcast_to(self.lever[:, None], surplus.shape)
        return np.asarray(surplus - np.vdot(lever, surplus) / np.vdot(lever, lever) * lever)

    def trued(self, surplus: FloatArray) -> FloatArray:
        """Set right, and without what an eccentric clamping adds: two clampings of one machine then look alike."""
        right = self.set_right(surplus)
        turn = 2.0 * np.pi / len(self.spaces) * self.spaces[:, None]
        runout = (np.cos(turn) * self.nx - np.sin(turn) * self.ny, np.sin(turn) * self.nx + np.cos(turn) * self.ny)
        shapes = np.stack([shape.ravel() for shape in runout], axis=1)
        taken = shapes @ np.linalg.lstsq(shapes, right.mean(axis=2).ravel(), rcond=None)[0]
        return np.asarray(right - taken.reshape(len(self.spaces), -1, 1))

    def set_right(self, surplus: FloatArray) -> FloatArray:
        """Without what x zero, dressing offset and rotation take away at best: tables have to do better than that."""
        shapes = np.stack((self.nx, self.ny, self.lever), axis=1)
        mean = surplus.mean(axis=(0, 2))
        taken = shapes @ np.linalg.lstsq(shapes, mean, rcond=None)[0]
        return np.asarray(surplus - taken[:, None])


def places(part: Part, *, profile: int = 11, width: int = 5) -> Places:
    """Where a part is judged: `profile` points on each flank of every space, at `width` heights."""
    lobes = CycloidDisc(part.gear)
    cells = (np.arange(profile) + 0.5) / profile * SHARE * float(lobes.length(np.asarray([lobes.half]))[0])
    fine = np.linspace(-lobes.half, lobes.half, 20001)
    t = np.interp(np.concatenate((-cells[::-1], cells)), lobes.length(fine), fine)
    return places_at(part, t, ((np.arange(width) + 0.5) / width - 0.5) * part.gear.b)


def places_at(part: Part, t: FloatArray, z: FloatArray) -> Places:
    """These profile angles (T,) and heights (Z,) of every space of a part."""
    point, normal = CycloidDisc(part.gear).profile(t)
    lever = (np.conj(point) * normal).imag
    return Places(np.arange(float(part.gear.zc)), t, z, normal.real, normal.imag, lever)


def rms(flank: FloatArray) -> float:
    """Root of the mean square of a flank."""
    return float(np.sqrt(np.mean(flank**2)))


def b_left(part: Part) -> float:
    """The share of a tangential error that stays on the tooth when C turns the work as well as it can."""
    at = places(part)
    alpha = np.vdot(at.ny, at.lever) / np.vdot(at.lever, at.lever)
    return float(np.linalg.norm(at.ny - alpha * at.lever) / np.linalg.norm(at.ny))


def b_left_on(before: FloatArray, after: FloatArray, at: Places) -> float:
    """The share of B that two flanks (K, T, Z) show: what B and G make after the correction over what B made before.

    What is the same in all spaces is left out, the dressing offset takes that; so is what goes once round, which an
    eccentric part adds.
    """
    shapes = np.stack((at.nx, at.ny, at.lever), axis=1)
    first, last = (np.linalg.lstsq(shapes, flank.mean(axis=2).T, rcond=None)[0] for flank in (before, after))
    was = at.ny[:, None] * _without_runout(first[1])
    stays = at.ny[:, None] * _without_runout(last[1]) + at.lever[:, None] * _without_runout(last[2])
    return float(np.linalg.norm(stays) / np.linalg.norm(was))


def _without_runout(by_space: FloatArray) -> FloatArray:
    """Values (K,) without their mean and what goes once round."""
    waves = np.fft.rfft(by_space)
    waves[:2] = 0.0
    return np.fft.irfft(waves, len(by_space))


@dataclass(frozen=True, slots=True)
class Values:
    """What may be done about a flank: set-up values in um and tables; a C zero is a rotation and not judged."""

    x_um: float = 0.0
    dressing_um: float = 0.0
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Floor:
    """The least RMS in um, what leaves it, and its flank (K, T, Z); ``tight`` names the tables that met a limit."""

    rms_um: float
    values: Values
    flank: FloatArray
    tight: tuple[str, ...]


@dataclass(frozen=True)
class Machine:
    """A true machine with a part in its clamping at a time: grinds whatever is asked."""

    truth: Truth
    part: Part
    seat: Pose
    start_s: float = 0.0
    feed_mm_per_s: float = 50.0

    @property
    def places(self) -> Places:
        """Where its part is judged."""
        return places(self.part)

    def ground(self, values: Values, c_arcsec: float = 0.0) -> FloatArray:
        """The part's surplus (K, T, Z) in um with these set-up values and tables, nothing removed."""
        how: dict[str, Any] = {"start_s": self.start_s, "feed_mm_per_s": self.feed_mm_per_s}
        how |= {"x_mm": values.x_um * UM, "dressing_mm": values.dressing_um * UM, "c_deg": c_arcsec / 3600.0}
        at = self.places
        work = ground(self.truth, self.part, self.seat, corrections=corrections(values.tables), **how)
        return work.surplus_um(at.spaces, at.t, at.z)

    def flank(self, values: Values) -> FloatArray:
        """The same, one rotation removed."""
        return self.places.turned_off(self.ground(values))

    def at_height(self) -> FloatArray:
        """Positions of Z (Z,) that make the judged heights."""
        return self.part.grinding.height_mm + self.places.z

    def at_index(self) -> FloatArray:
        """Positions of C (K,) that make the judged spaces."""
        return np.mod(-360.0 / self.part.gear.zc * self.places.spaces, 360.0)

    def centred(self) -> Machine:
        """The same with its work true to the axis of rotation, as a patient person would clamp it."""
        return replace(self, seat=rotation_axis_frame(self.truth, self.part.grinding.height_mm))


def corrections(tables: Sequence[Table]) -> dict[str, Any]:
    """Tables as what they add to the encoders: by output axis a function of the places of all axes, mm or deg."""

    def added(out: str) -> Any:
        mine = [one for one in tables if one.out == out]
        scale = UM if out != "C" else 1.0 / 3600.0
        return lambda at: scale * sum(one.at(at[one.over]) for one in mine)

    return {out: added(out) for out in {one.out for one in tables}}


def floor(
    machine: Machine, grids: Mapping[str, Grid], *, start: Values | None = None, cross: Sequence[Crossing] = CROSS
) -> Floor:
    """The least RMS that x zero, dressing offset and the cross tables ``cross`` on these grids (by input axis) leave.

    The machine's answer to X, C and dressing is measured by grinding a step of each; least squares under the limits,
    and once more around the answer, because a flank that lies 10 um off answers a thousandth differently. The layer
    of each axis' own table does nothing here that C(C) and a zero do not; products of tables are not used. Raises
    ValueError where a table would break a limit.
    """
    found = start or Values()
    layouts = [Layout(out, over, grids[over]) for out, over in cross]
    tight: tuple[str, ...] = ()
    for _ in range(ROUNDS):
        found, tight = _better(machine, found, layouts)
    flank = machine.flank(found)
    return Floor(rms(flank), found, flank, tight)


def kept_floor(machine: Machine, grids: Mapping[str, Grid], cross: Sequence[Crossing] = CROSS) -> Floor:
    """The floor where no table takes the work's eccentricity and tilt, which change at every clamping.

    Tables are those of the machine with its work centred; x zero and dressing are then set for the work as it sits.
    """
    found, _ = _better(machine, floor(machine.centred(), grids, cross=cross).values, [])
    flank = machine.flank(found)
    return Floor(rms(flank), found, flank, ())


def _ways(machine: Machine, values: Values, base: FloatArray) -> dict[str, FloatArray]:
    """What 1 um of X, 1 um of dressing offset and 1 arcsec of C do to each point, (K, T, Z) um, around ``base``."""
    moved = {
        "X": machine.ground(replace(values, x_um=values.x_um + STEP)),
        "": machine.ground(replace(values, dressing_um=values.dressing_um + STEP)),
        "C": machine.ground(values, c_arcsec=STEP),
    }
    return {name: (flank - base) / STEP for name, flank in moved.items()}


def _better(machine: Machine, now: Values, layouts: Sequence[Layout]) -> tuple[Values, tuple[str, ...]]:
    """One step of Gauss and Newton; tables start from what they are, a table that is not laid out stays."""
    have = {one.name: one for one in now.tables}
    inputs = {"Z": (machine.at_height(), 2), "C": (machine.at_index(), 0)}
    surplus = machine.ground(now)
    ways = _ways(machine, now, surplus)
    columns = [ways[name][..., None] for name in ("X", "", "C")]
    for one in layouts:
        at, along = inputs[one.over]
        shares = np.expand_dims(one.shares(at), tuple(i for i in range(3) if i != along))
        columns.append(ways[one.out][..., None] * shares)
    steps = [one.steps_of(have.get(one.name)) for one in layouts]
    rows = np.concatenate([np.broadcast_to(c, (*surplus.shape, c.shape[-1])) for c in columns], axis=-1)
    answer, tight = fitted(rows.reshape(surplus.size, -1), surplus.ravel(), 3, layouts, steps)
    tables = tuple(one.table(part) for one, part in zip(layouts, answer[3:], strict=True))
    x, dressing = (float(part[0]) for part in answer[:2])
    return Values(now.x_um + x, now.dressing_um + dressing, tables or now.tables), tight
