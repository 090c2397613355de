"""What is mounted where, which machine it watches, and what differs from stop to stop.

`OpticsBench` holds the mountings and the beams that are broken; `AxisWatcher` gives the axes' motions at any times.
`StopNoise` gives each stop of an axis its own offset (reproducibility) and the odd reading that is off for one stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import CellFile, Noise, Setup
from simulators.truth import AxisMotion, Hysteresis, Pose, Scatter, Truth, generator

FloatArray = NDArray[np.float64]
SETTLED = 1e-9
CHAINS = {"bed": "", "X": "X", "Z": "Z", "C": "XC"}


class MotionSource(Protocol):
    """The machine as an instrument meets it: encoder positions (n,) and travel sense at past clock times."""

    def encoder(self, axis: str, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Encoder-side position in mm or deg and +1/-1, each (n,)."""
        ...


@dataclass(frozen=True, slots=True)
class Mounting:
    """A set-up as it really is: ``optics`` differs from the set-up's when someone took the wrong ones."""

    setup: Setup
    optics: str
    number: int


class OpticsBench:
    """The instruments around the machine; the operator mounts, faults break beams."""

    def __init__(self, truth: Truth, machine: MotionSource) -> None:
        self.truth = truth
        self.machine = machine
        self.broken: set[str] = set()
        self.steps: dict[str, float] = {}
        self._mounted: dict[str, Mounting] = {}
        self._turned: set[str] = set()
        self._count = 0
        self._watchers = 0

    @property
    def cell(self) -> CellFile:
        """The cell's file."""
        return self.truth.cell

    def setup_for(self, component: str, letter: str) -> Setup | None:
        """The set-up the cell file gives for a component on an axis, as it is mounted now; None when there is none."""
        found = (s for s in self.cell.setups if s.component == component and s.axis == letter)
        setup = next(found, None)
        if setup is None or component not in self._turned:
            return setup
        return setup.model_copy(update={"reversed": not setup.reversed})

    def turn_round(self, component: str) -> None:
        """From the next mounting on the optics of a component face the other way than they did."""
        self._turned ^= {component}

    def mount(self, setup: Setup, optics: str | None = None) -> None:
        """Mount a set-up; what else its axis carried is taken off. `optics` if other than the set-up's."""
        self._count += 1
        self.steps.pop(setup.component, None)
        self._mounted = {name: m for name, m in self._mounted.items() if m.setup.axis != setup.axis}
        self._mounted[setup.instrument] = Mounting(setup, optics or setup.optics, self._count)

    def mounted(self, instrument: str) -> Mounting | None:
        """What this instrument is mounted for now."""
        return self._mounted.get(instrument)

    def watcher(self) -> str:
        """A name of its own for who follows the machine's axes from now on."""
        self._watchers += 1
        return f"watcher {self._watchers}"

    def stops_of_run(self, letter: str) -> int:
        """How many stops a run of this axis has, from its own measuring section: two outliers in each."""
        measure = self.cell.axis(letter).measure or {}
        targets = measure.get("targets", {})
        count = len(targets.get("positions", ())) or int(targets.get("count", 0))
        return 2 * count * int(measure.get("repetitions", 5))


class AxisWatcher:
    """Follows the machine's axes for one instrument and keeps their hysteresis, turns and scatter."""

    def __init__(self, bench: OpticsBench) -> None:
        self._bench = bench
        self._name = bench.watcher()
        self._scatter: dict[str, Scatter] = {}
        self._hysteresis: dict[str, Hysteresis] = {}
        self._turns: dict[str, float] = {}

    def motions(self, letters: str, times: FloatArray) -> dict[str, AxisMotion]:
        """The named axes at these successive times; constant ones as arrays of length 1."""
        return {letter: self._one(letter, times) for letter in letters if self._known(letter)}

    def _known(self, letter: str) -> bool:
        return any(axis.letter == letter for axis in self._bench.cell.axes)

    def _one(self, letter: str, times: FloatArray) -> AxisMotion:
        axis = self._bench.cell.axis(letter)
        position, direction = self._bench.machine.encoder(axis.name, times)
        if axis.kind == "rotary":
            position = self._unwrapped(letter, position)
        windup = self._windup(letter, position, direction)
        scatter = self._scattered(letter, position)
        ways = (direction,) if windup is direction else (direction, windup)
        if all(_constant(part) for part in (position, *ways, scatter)):
            return AxisMotion(position[:1], direction[:1], windup[:1], scatter[:1])
        return AxisMotion(position, direction, windup, scatter)

    def _scattered(self, letter: str, position: FloatArray) -> FloatArray:
        size = self._bench.cell.axis(letter).scatter
        if not size:
            return np.zeros(1)
        if letter not in self._scatter:
            self._scatter[letter] = Scatter(size, self._bench.truth.seed, f"scatter {letter}", self._name)
        return self._scatter[letter].follow(position)

    def _unwrapped(self, letter: str, position: FloatArray) -> FloatArray:
        last = self._turns.get(letter, float(position[0]))
        steps = np.diff(position, prepend=last)
        whole = last + np.cumsum((steps + 180.0) % 360.0 - 180.0)
        if np.all(steps == 0.0):
            whole = np.full_like(position, last)
        self._turns[letter] = float(whole[-1])
        return whole

    def _windup(self, letter: str, position: FloatArray, direction: FloatArray) -> FloatArray:
        spec = self._bench.cell.axis(letter).hysteresis
        if spec is None:
            return direction
        if letter not in self._hysteresis:
            self._hysteresis[letter] = Hysteresis(spec.distance)
        return self._hysteresis[letter].follow(position)


def _constant(values: FloatArray) -> bool:
    return len(values) == 1 or (
        abs(float(values[-1] - values[0])) < SETTLED and bool(np.all(np.abs(values - values[0]) < SETTLED))
    )


def beam_direction(setup: Setup) -> FloatArray:
    """Unit vector of the beam in the bed frame: the axis' ideal direction, tilted by the misalignment."""
    along = {"X": 0, "Y": 1, "Z": 2, "C": 0}[setup.axis]
    beam = np.zeros(3)
    beam[along] = 1.0
    beam[(along + 1) % 3], beam[(along + 2) % 3] = np.tan(np.asarray(setup.misalign_mrad) * 1e-3)
    return np.asarray(beam / np.linalg.norm(beam))


def carrier_of(setup: Setup) -> str:
    """The frame that carries the reflector."""
    return setup.carrier or ("X" if setup.axis == "Y" else setup.axis)


def letters_of(setup: Setup) -> str:
    """The axes whose error motions reach this reading: those between bed and reflector, and bed and head."""
    return "".join(dict.fromkeys(CHAINS[carrier_of(setup)] + CHAINS[setup.head]))


def linear_length_mm(setup: Setup, frames: dict[str, Pose]) -> FloatArray:
    """Beam length to the reflector, (n,) mm in geometry: its displacement projected on the beam."""
    beam = beam_direction(setup)
    reflector = frames[carrier_of(setup)].point(np.asarray(setup.offset_mm))
    head = frames[setup.head].point(np.zeros(3))
    here = (reflector - head) @ beam
    nominal = beam["XYZ".index(setup.axis)] * setup.datum + float(np.asarray(setup.offset_mm) @ beam)
    return setup.dead_path_mm + setup.away * (here - nominal)


def angle_rad(setup: Setup, frames: dict[str, Pose], about: str) -> FloatArray:
    """Rotation of the carrier against the head about one bed axis A, B or C, (n,) rad, for small angles."""
    turned = np.swapaxes(frames[setup.head].rotation, 1, 2) @ frames[carrier_of(setup)].rotation
    high, low = {"A": (2, 1), "B": (0, 2), "C": (1, 0)}[about]
    return np.arcsin(0.5 * (turned[:, high, low] - turned[:, low, high]))


def angular_difference_mm(setup: Setup, frames: dict[str, Pose], about: str) -> FloatArray:
    """What angular optics give a laser: the difference of two paths, S * sin(angle), (n,) mm."""
    return setup.retro_spacing_mm * np.sin(angle_rad(setup, frames, about))


class StopNoise:
    """Counts the stops of one axis and gives each its own reading offset, in um or arcsec.

    A new stop begins as soon as the axis has left the place where it stood for half a second; a switch of
    a compensation table, which moves it by micrometres, does not make a new stop.
    """

    LEFT = 0.01
    STOOD_S = 0.5

    def __init__(self, noise: Noise, every: int, seed: int, name: str) -> None:
        self._noise = noise
        self._every = noise.outliers.every or max(every, 1)
        self._seed = seed
        self._name = name
        self._known: dict[tuple[int, int], float] = {}
        self._rest_s = 0.0
        self._anchor: float | None = None
        self._place: float | None = None
        self._stood_s = 0.0
        self.index = 0

    def offsets(self, position: FloatArray, spacing_s: float) -> FloatArray:
        """The offset of each of these successive samples (n,), `spacing_s` apart."""
        if self._place is None:
            self._anchor = self._place = float(position[0])
        if self._anchor is not None and np.all(np.abs(position - self._anchor) < self.LEFT):
            return self._at_rest(len(position), spacing_s)
        indices = self._follow(position, spacing_s)
        offsets = {index: self.offset(index) for index in dict.fromkeys(indices)}
        return np.asarray([offsets[index] for index in indices])

    def _at_rest(self, count: int, spacing_s: float) -> FloatArray:
        """So many samples while the axis stands: air that moves makes another reading of the same stop."""
        if not self._noise.stop_s:
            return np.full(count, self.offset(self.index))
        since = self._rest_s + spacing_s * np.arange(count)
        self._rest_s += spacing_s * count
        return np.asarray([self.offset(self.index, int(rest)) for rest in since // self._noise.stop_s])

    def _follow(self, position: FloatArray, spacing_s: float) -> list[int]:
        indices = []
        for place in position.tolist():
            still = abs(place - (self._place or 0.0)) < 1e-6
            self._place = place
            self._stood_s = self._stood_s + spacing_s if still else 0.0
            if self._anchor is not None and abs(place - self._anchor) > self.LEFT:
                self.index += 1
                self._anchor, self._rest_s = None, 0.0
            elif self._anchor is None and self._stood_s >= self.STOOD_S:
                self._anchor = place
            indices.append(self.index)
        return indices

    def offset(self, index: int, rest: int = 0) -> float:
        """The offset of the stop with this number, in this stretch of its rest."""
        if (index, rest) not in self._known:
            name = f"stop {index} rest {rest}" if rest else f"stop {index}"
            ordinary = float(generator(self._seed, self._name, name).normal())
            self._known[index, rest] = ordinary * self._noise.stop + self.outlier(index)
        return self._known[index, rest]

    def outlier(self, index: int) -> float:
        """How far the reading of this stop is off beyond noise; 0 for nearly all."""
        spec = self._noise.outliers
        window, place = divmod(index, self._every)
        rng = generator(self._seed, self._name, f"outliers {window}")
        first = min(8, self._every - 1)
        count = min(spec.count, self._every - first)
        chosen = rng.choice(np.arange(first, self._every), size=count, replace=False)
        signs = rng.choice((-1.0, 1.0), size=count)
        return float(spec.size * np.sum(signs[chosen == place]))
