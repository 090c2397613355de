"""Straightness and angle instruments: what a set-up shows for the machine's poses, sampled over time.

Straightness: the carrier's way across a straight reference that the mounting leans by ``misalign_mrad`` (its slope
means nothing). Square: the same with one reference for two runs, its arms 90 deg + ``own_angle`` apart. Ball: the way
of a point of the table, seen by indicators. Bar: a line of the table, leaning by ``tilt_mrad``; indicators on the
carrier follow it (um), or two of them at different heights show its direction (arcsec). Every reading grows when
the moved part errs in the + direction of the component's own letter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Sensor, Setup
from simulators.optics.mountings import (
    SETTLED,
    AxisWatcher,
    Mounting,
    OpticsBench,
    StopNoise,
    angle_rad,
    carrier_of,
    letters_of,
)
from simulators.truth import AxisMotion, Curve, Pose, curve, drift_time_s, generator

FloatArray = NDArray[np.float64]
UM = 1e-3
ARCSEC = np.pi / 180.0 / 3600.0
AXES = {"X": 0, "Y": 1, "Z": 2}
# Which way each location error is looked at, by the axis that moves.
LOOKS = {("B0Z", "X"): "Z", ("B0Z", "Z"): "X", ("A0C", "Z"): "Y", ("B0C", "Z"): "X"}

Frames = dict[str, Pose]


def component_of(setup: Setup) -> str:
    """The component without its mark for a reversed artefact."""
    return setup.component.removesuffix("-R")


def line_of_sight(setup: Setup) -> str:
    """The letter along or about which this set-up reads."""
    name = component_of(setup)
    return name[1] if name[0] == "E" else LOOKS.get((name, setup.axis), name[0])


def component_reading(setup: Setup, frames: Frames, motions: dict[str, AxisMotion]) -> FloatArray:
    """What an error-free instrument shows, (n,) or (1,): um, or arcsec for angles; turned round it counts backwards."""
    shown = _facing(setup, frames, motions)
    return -shown if setup.reversed else shown


def _facing(setup: Setup, frames: Frames, motions: dict[str, AxisMotion]) -> FloatArray:
    along = line_of_sight(setup)
    if along in "ABC":
        return _direction(setup, frames, along) if setup.optics == "bar" else _angle(setup, frames, along)
    if setup.optics == "bar":
        return _across_bar(setup, frames, motions, AXES[along])
    if setup.axis == "C":
        return _ball(setup, frames, motions, AXES[along])
    return _across(setup, frames, AXES[along])


def _angle(setup: Setup, frames: Frames, about: str) -> FloatArray:
    return angle_rad(setup, frames, about) / ARCSEC


def _across(setup: Setup, frames: Frames, along: int) -> FloatArray:
    """Way across a straight reference along the moved axis."""
    travel = AXES[setup.axis]
    offset = np.asarray(setup.offset_mm)
    carried, head = frames[carrier_of(setup)].point(offset), frames[setup.head].point(np.zeros(3))
    nominal = offset.copy()
    nominal[travel] += setup.datum
    reference = _reference(setup, travel)
    across = np.zeros(3)
    across[along] = 1.0
    across = across - (across @ reference) * reference
    return np.asarray((carried - head - nominal) @ (across / np.linalg.norm(across))) / UM


def _reference(setup: Setup, travel: int) -> FloatArray:
    """The reference's direction, (3,). A square leans as a whole about Y; its Z arm leans by its own angle too."""
    line = np.zeros(3)
    line[travel] = 1.0
    if setup.optics != "square":
        line[(travel + 1) % 3], line[(travel + 2) % 3] = np.tan(np.asarray(setup.misalign_mrad) * 1e-3)
        return np.asarray(line / np.linalg.norm(line))
    own = setup.own_angle_arcsec * ARCSEC * (-1.0 if setup.component.endswith("-R") else 1.0)
    lean = setup.misalign_mrad[0] * 1e-3 - (own if setup.axis == "Z" else 0.0)
    cos, sin = np.cos(lean), np.sin(lean)
    return np.asarray((cos, 0.0, -sin) if setup.axis == "X" else (sin, 0.0, cos))


def _ball(setup: Setup, frames: Frames, motions: dict[str, AxisMotion], along: int) -> FloatArray:
    """A ball on the table, eccentric by ``eccentric_mm``, against the head; nominal X and Z taken off."""
    place = np.asarray(setup.offset_mm) + np.asarray((setup.eccentric_mm, 0.0, 0.0))
    centre = frames["C"].point(place) - frames[setup.head].point(np.zeros(3))
    nominal = np.zeros((1, 3))
    if "X" in motions:
        nominal = nominal + motions["X"].position[:, None] * np.asarray((1.0, 0.0, 0.0))
    if "Z" in motions and setup.head == "Z":
        nominal = nominal - motions["Z"].position[:, None] * np.asarray((0.0, 0.0, 1.0))
    nominal = nominal + np.asarray((0.0, 0.0, place[2]))
    return np.asarray((centre - nominal)[:, along]) / UM + setup.zero_um


def _bar(setup: Setup, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """A point of the bar's axis and its direction in the bed frame, each (n, 3)."""
    foot = np.asarray(setup.offset_mm) + np.asarray((setup.eccentric_mm, 0.0, 0.0))
    lean = np.asarray((np.tan(setup.tilt_mrad * 1e-3), 0.0, 1.0))
    return frames["C"].point(foot), frames["C"].rotation @ (lean / np.linalg.norm(lean))


def _direction(setup: Setup, frames: Frames, about: str) -> FloatArray:
    """Lean of the bar about bed A or B."""
    _, way = _bar(setup, frames)
    return np.arctan2(-way[:, 1] if about == "A" else way[:, 0], way[:, 2]) / ARCSEC


def _across_bar(setup: Setup, frames: Frames, motions: dict[str, AxisMotion], along: int) -> FloatArray:
    """Way of an indicator on the carrier across the bar at the indicator's own height."""
    foot, way = _bar(setup, frames)
    seen = frames[carrier_of(setup)].point(np.zeros(3))
    up = (seen[:, 2] - foot[:, 2]) / way[:, 2]
    nominal = motions["X"].position[:, None] * np.asarray((1.0, 0.0, 0.0)) + np.asarray(setup.offset_mm)
    return np.asarray((seen - foot - up[:, None] * way + nominal)[:, along]) / UM


# The instrument over time: geometry, its own errors, and light that may be lost.

BoolArray = NDArray[np.bool_]
UNITS = {"straightness": "um", "angle": "arcsec"}
# Drift and warming move a machine that stands still by less than 5 nm in this time; noise is ten times that.
STANDS_S = 3.0
# What the optics of a set-up are called by the instrument that can tell.
REPORTED_OPTICS = {"angular": "angular", "level": "angular", "linear": "linear", "rotary": "rotary"}


@dataclass(frozen=True, slots=True)
class SensorReadings:
    """A stretch of samples, each (n,): clock time in s, value in um or arcsec, whether there is light.

    Of a head with several probes the value is (n, probes).
    """

    time_s: FloatArray
    value: FloatArray
    beam: BoolArray


class SensorReader:
    """One instrument, sampled from its last sample up to the time it is asked for.

    With the wrong optics, without any, or beyond its range no light returns until `restore_beam` or a new
    mounting; the value then stays what it was.
    """

    def __init__(self, spec: Sensor, bench: OpticsBench, probe: str = "") -> None:
        """``probe``: the letter that one of several probes reads, whatever component its head is mounted for."""
        self.spec = spec
        self._bench = bench
        self._probe = probe
        self._name = f"{spec.name} {probe}".strip()
        seed = bench.truth.seed
        self._rng = generator(seed, self._name, "samples")
        self._watcher = AxisWatcher(bench)
        self._mounting: Mounting | None = None
        self._stops: StopNoise | None = None
        self._own: dict[str, Curve] = {}
        self._stood: tuple[dict[str, AxisMotion], float, FloatArray] | None = None
        self._zero = 0.0
        self._shown = 0.0
        self._next = 0
        self.beam_lost = False

    @property
    def unit(self) -> str:
        """um or arcsec."""
        return UNITS[self.spec.kind]

    @staticmethod
    def reported_optics(mounting: Mounting | None) -> str:
        """What the instrument sees itself mounted with: linear, angular, rotary, straightness, or unknown."""
        return REPORTED_OPTICS.get(mounting.optics, "straightness") if mounting is not None else "unknown"

    def skip_to(self, t: float) -> None:
        """Sample from clock time t on: the instrument was just switched on."""
        self._next = int(t * self.spec.sample_hz) + 1

    def restore_beam(self) -> None:
        """The reading is good again."""
        self.beam_lost = False

    def read(self, until: float) -> SensorReadings:
        """All samples from the last asked for up to clock time `until` (s)."""
        sequence = np.arange(self._next, max(int(until * self.spec.sample_hz) + 1, self._next))
        self._next += len(sequence)
        times = sequence / self.spec.sample_hz
        mounting = self._bench.mounted(self.spec.name)
        if mounting is not self._mounting:
            self._remount(mounting)
        if not len(times) or mounting is None or mounting.optics != mounting.setup.optics:
            return SensorReadings(times, np.full(len(times), self._shown), np.zeros(len(times), dtype=np.bool_))
        return self._lit(times, self._value(self._seen(mounting.setup), times))

    def _seen(self, setup: Setup) -> Setup:
        return setup.model_copy(update={"component": f"E{self._probe}{setup.axis}"}) if self._probe else setup

    def _remount(self, mounting: Mounting | None) -> None:
        self._mounting = mounting
        self._stood = None
        self.beam_lost = mounting is None
        if mounting is not None:
            seed, name = self._bench.truth.seed, f"{self._name} {mounting.number}"
            self._stops = StopNoise(self.spec.noise, self._bench.stops_of_run(mounting.setup.axis), seed, name)
            absolute = component_of(mounting.setup)[1] == "0" and mounting.setup.optics == "ball"
            drawn = float(generator(seed, name, "zero").uniform(-1.0, 1.0))
            self._zero = 0.0 if absolute else drawn * self.spec.zero

    def _value(self, setup: Setup, times: FloatArray) -> FloatArray:
        motions = self._watcher.motions(watched_axes(setup), times)
        moved = self._bench.steps.get(setup.component, 0.0) * (-1.0 if setup.reversed else 1.0)
        value = self._geometry(setup, motions, float(times[-1])) + self._zero + moved
        drift = self.spec.noise.drift_per_h * drift_time_s(times) / 3600.0
        noise = self._rng.normal(0.0, self.spec.noise.sample, len(times))
        return value + drift + noise + self._offsets(motions[setup.axis], len(times))

    def _geometry(self, setup: Setup, motions: dict[str, AxisMotion], t: float) -> FloatArray:
        """What the optics show at these motions with the instrument's own error; kept while the machine stands."""
        if self._stood is not None and t - self._stood[1] < STANDS_S and _same_motions(self._stood[0], motions):
            return self._stood[2]
        frames = self._bench.truth.frames(motions, t)
        value = component_reading(setup, frames, motions) + self._own_error(setup, motions[setup.axis].position)
        self._stood = (motions, t, value) if len(value) == 1 else None
        return value

    def _own_error(self, setup: Setup, place: FloatArray) -> FloatArray:
        axis = self._bench.cell.axis(setup.axis)
        if axis.letter not in self._own:
            rotary, name = axis.kind == "rotary", f"{self._name} own error"
            own = curve(
                self.spec.own_error, axis.travel, rotary=rotary, seed=self._bench.truth.seed, name=name, redraw=False
            )
            self._own[axis.letter] = own
        return self._own[axis.letter](np.mod(place, 360.0) if axis.kind == "rotary" else place)

    def _offsets(self, motion: AxisMotion, count: int) -> FloatArray:
        position = np.broadcast_to(motion.position, count)
        return self._stops.offsets(position, 1.0 / self.spec.sample_hz) if self._stops is not None else np.zeros(count)

    def _lit(self, times: FloatArray, value: FloatArray) -> SensorReadings:
        blocked = self.spec.name in self._bench.broken
        lost = np.logical_or.accumulate((np.abs(value) > self.spec.range) | blocked | self.beam_lost)
        self.beam_lost = bool(lost[-1])
        shown = np.where(lost, self._shown, value)
        self._shown = float(shown[-1])
        return SensorReadings(times, shown, ~lost)


class HeadReader:
    """One head with several probes, all sampled at the same moments: value (n, probes), light where all have it."""

    def __init__(self, spec: Sensor, bench: OpticsBench) -> None:
        self.spec = spec
        self._probes = [SensorReader(spec, bench, probe) for probe in spec.probes]
        mixed = np.full((len(spec.probes), len(spec.probes)), spec.cross_talk)
        np.fill_diagonal(mixed, 1.0)
        self._mixed = mixed

    @staticmethod
    def reported_optics(mounting: Mounting | None) -> str:
        """As of one probe."""
        return SensorReader.reported_optics(mounting)

    def skip_to(self, t: float) -> None:
        """Sample from clock time t on."""
        for one in self._probes:
            one.skip_to(t)

    def restore_beam(self) -> None:
        """The readings are good again."""
        for one in self._probes:
            one.restore_beam()

    @property
    def beam_lost(self) -> bool:
        """Whether any probe has lost its light."""
        return any(one.beam_lost for one in self._probes)

    def read(self, until: float) -> SensorReadings:
        """All samples up to clock time ``until`` (s)."""
        read = [one.read(until) for one in self._probes]
        values = np.stack([one.value for one in read], axis=-1) @ self._mixed
        return SensorReadings(read[0].time_s, values, np.all([one.beam for one in read], axis=0))


def _same_motions(before: dict[str, AxisMotion], now: dict[str, AxisMotion]) -> bool:
    """Whether every axis stands where it stood."""
    return all(_is_at_rest(one, now[letter]) for letter, one in before.items())


def _is_at_rest(before: AxisMotion, now: AxisMotion) -> bool:
    if len(now.position) > 1 or abs(now.position[0] - before.position[0]) > SETTLED:
        return False
    names = ("direction", "windup", "scatter")
    return all(bool(getattr(now, name)[0] == getattr(before, name)[0]) for name in names)


def watched_axes(setup: Setup) -> str:
    """The axes whose error motions reach this reading."""
    chain = "XZC" if setup.optics in {"ball", "bar"} else letters_of(setup)
    return "".join(dict.fromkeys(chain + setup.axis))
