"""A rotary calibrator on the axis: it turns against the axis, and a laser measures what remains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Calibrator
from simulators.optics.mountings import AxisWatcher, Mounting, OpticsBench, StopNoise, letters_of
from simulators.truth import AxisMotion, curve, drift_time_s, generator

FloatArray = NDArray[np.float64]
ARCSEC_DEG = 1.0 / 3600.0
ECCENTRIC_ARCSEC_PER_MM = 0.5


@dataclass(frozen=True, slots=True)
class CalibratorSamples:
    """A stretch of calibrator samples, each (n,): clock time in s, device and laser in deg, beam there."""

    time_s: FloatArray
    device_deg: FloatArray
    laser_deg: FloatArray
    beam: NDArray[np.bool_]


class RotaryReader:
    """The calibrator's device and laser, sampled from its last sample up to the time it is asked for.

    ``mode`` is "track" (turn against the axis), "hold" (stand) or "turn" (go to an own angle, then hold).
    Reflector angle in space = axis + device; the laser reads asin(sin(angle)) within its range, else the
    beam is lost until `restore_beam`, a new mounting, or until it is followed again from a hold.
    """

    def __init__(self, spec: Calibrator, bench: OpticsBench) -> None:
        self.spec = spec
        self._bench = bench
        seed = bench.truth.seed
        drawn = int(generator(seed, spec.name, "sense").choice((-1, 1)))
        self.sense = drawn if spec.sense == "seed" else spec.sense
        self._rng = generator(seed, spec.name, "samples")
        self._remainders = generator(seed, spec.name, "remainders")
        self._error = curve(
            spec.own_error, (0.0, 360.0), rotary=True, seed=seed, name=f"{spec.name} own error", redraw=False
        )
        self._watcher = AxisWatcher(bench)
        self._mounting: Mounting | None = None
        self._stops: StopNoise | None = None
        self._stop = 0
        self._axis_zero: float | None = None
        self._device = 0.0
        self._remainder = 0.0
        self._goal = 0.0
        self._next = 0
        self.mode = "hold"
        self.beam_lost = False

    def skip_to(self, t: float) -> None:
        """Sample from clock time t on: the instrument was just switched on."""
        self._next = int(t * self.spec.sample_hz) + 1

    def hold(self) -> None:
        """Stand at the present angle."""
        self.mode, self._goal = "hold", self._device

    def track(self) -> None:
        """Turn against the axis from now on, leaving a small remainder to the laser."""
        self.mode = "track"

    def turn(self, by_deg: float) -> None:
        """Turn by an angle of the device's own encoder, then hold."""
        wanted = self.encoder(np.asarray([self._device]))[0] + by_deg
        self.mode, self._goal = "turn", wanted + self._own_error(np.asarray([wanted]))[0]

    def restore_beam(self) -> None:
        """Start the laser's count anew."""
        self.beam_lost = False

    @property
    def turning(self) -> bool:
        """True until a `turn` has arrived."""
        return self.mode == "turn" and bool(abs(self._device - self._goal) > 1e-9)

    def _own_error(self, device: FloatArray) -> FloatArray:
        return self._error(np.mod(device, 360.0)) * ARCSEC_DEG

    def encoder(self, device: FloatArray) -> FloatArray:
        """What the device's own encoder says where it truly stands at these angles, deg."""
        return device - self._own_error(device)

    def read(self, until: float) -> CalibratorSamples:
        """All samples from the last asked for up to clock time `until` (s)."""
        sequence = np.arange(self._next, max(int(until * self.spec.sample_hz) + 1, self._next))
        self._next += len(sequence)
        times = sequence / self.spec.sample_hz
        mounting = self._bench.mounted(self.spec.name)
        if mounting is not self._mounting:
            self._remount(mounting)
        if not len(times):
            return CalibratorSamples(times, times, times, np.zeros(0, dtype=np.bool_))
        if mounting is None:
            return self._unmounted(times)
        return self._mounted(mounting, times)

    def _remount(self, mounting: Mounting | None) -> None:
        self._mounting = mounting
        self._axis_zero = None
        self.beam_lost = mounting is None
        if mounting is not None:
            every = self._bench.stops_of_run(mounting.setup.axis)
            name = f"{self.spec.name} {mounting.number}"
            self._stops = StopNoise(self.spec.noise, every, self._bench.truth.seed, name)
            self._stop, self.mode, self._remainder = 0, "track", 0.0

    def _unmounted(self, times: FloatArray) -> CalibratorSamples:
        device = np.full(len(times), float(self.encoder(np.asarray([self._device]))[0]))
        return CalibratorSamples(times, device, np.zeros(len(times)), np.zeros(len(times), dtype=np.bool_))

    def _mounted(self, mounting: Mounting, times: FloatArray) -> CalibratorSamples:
        axis, motion = self._axis(mounting, times)
        offsets = self._offsets(motion, len(times))
        device = self._follow(axis, len(times))
        laser, beam = self._laser(mounting, axis + device, offsets, times)
        return CalibratorSamples(times, self.encoder(device), laser, beam)

    def _axis(self, mounting: Mounting, times: FloatArray) -> tuple[FloatArray, AxisMotion]:
        """How far the device's seat has really turned in space since it was mounted, (n,) deg."""
        setup = mounting.setup
        motions = self._watcher.motions(letters_of(setup), times)
        motion = motions[setup.axis]
        frames = self._bench.truth.frames(motions, float(times[-1]))
        small = _yaw_deg(frames["C"].rotation, motion.position) + _seat_deg(mounting, motion.position)
        axis = np.broadcast_to(motion.position + small, len(times))
        if self._axis_zero is None:
            self._axis_zero = float(axis[0]) + self._device
        return axis - self._axis_zero, motion

    def _offsets(self, motion: AxisMotion, count: int) -> FloatArray:
        position = np.broadcast_to(motion.position, count)
        if self._stops is None:
            return np.zeros(count)
        offsets = self._stops.offsets(position, 1.0 / self.spec.sample_hz)
        if self._stops.index != self._stop:
            self._stop = self._stops.index
            self._remainder = float(self._remainders.uniform(-1.0, 1.0)) * self.spec.remainder_deg
        return offsets

    def _follow(self, axis: FloatArray, count: int) -> FloatArray:
        """The device's true angle: towards its goal, never faster than it can turn."""
        goal = self._remainder - axis if self.mode == "track" else np.full(count, self._goal)
        reach = self.spec.turn_deg_per_s / self.spec.sample_hz
        if np.all(np.abs(np.diff(goal, prepend=self._device)) <= reach):
            device = goal
        else:
            device = _limit_rate(goal, self._device, reach)
        self._device = float(device[-1])
        return device

    def _laser(
        self, mounting: Mounting, theta: FloatArray, offsets: FloatArray, times: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        if mounting.optics not in {"angular", "rotary"}:
            theta = np.zeros_like(theta)  # no angular reflector: nothing to follow
        beam = self._beam(theta)
        ratio = np.clip(np.sin(np.deg2rad(theta)) * (1.0 + self.spec.spacing_error), -1.0, 1.0)
        drift = self.spec.noise.drift_per_h * drift_time_s(times) / 3600.0
        noise = offsets + drift + self._rng.normal(0.0, self.spec.noise.sample, len(times))
        return self.sense * (np.rad2deg(np.arcsin(ratio)) + noise * ARCSEC_DEG), beam

    def _beam(self, theta: FloatArray) -> NDArray[np.bool_]:
        blocked = self.spec.name in self._bench.broken
        lost = (np.abs(theta) > self.spec.range_deg) | blocked | self.beam_lost
        lost = np.logical_or.accumulate(lost)
        self.beam_lost = bool(lost[-1])
        return ~lost


def _limit_rate(goal: FloatArray, start: float, reach: float) -> FloatArray:
    device, place = np.empty(len(goal)), start
    for index, wanted in enumerate(goal.tolist()):
        place += min(reach, max(-reach, wanted - place))
        device[index] = place
    return device


def _yaw_deg(rotations: FloatArray, position_deg: FloatArray) -> FloatArray:
    """Rotation about Z beyond the commanded turn: what error motions add, (n,) deg."""
    turned = np.deg2rad(position_deg)
    cos, sin = np.cos(turned), np.sin(turned)
    c00 = rotations[:, 0, 0] * cos - rotations[:, 0, 1] * sin
    c11 = rotations[:, 1, 0] * sin + rotations[:, 1, 1] * cos
    c10 = rotations[:, 1, 0] * cos - rotations[:, 1, 1] * sin
    c01 = rotations[:, 0, 0] * sin + rotations[:, 0, 1] * cos
    return np.rad2deg(np.arctan2(c10 - c01, c00 + c11))


def _seat_deg(mounting: Mounting, position_deg: FloatArray) -> FloatArray:
    """What an eccentric and tilted seat of the device adds, (n,) deg."""
    turned = np.deg2rad(position_deg)
    eccentric = ECCENTRIC_ARCSEC_PER_MM * mounting.setup.eccentric_mm * np.cos(turned) * ARCSEC_DEG
    tilt = np.rad2deg((mounting.setup.tilt_mrad * 1e-3) ** 2 / 4.0 * np.sin(2.0 * turned))
    return eccentric + tilt
