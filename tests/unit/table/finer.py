"""Axes with structure finer than their targets, captured as a run does, with more targets where it asks for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from drivers.types.abilities import TableLimits
from drivers.types.sensing import Ambient
from gateway.capture.targets import CHECK_REPETITIONS, between_places, targets_of
from gateway.config import AxisSection
from gateway.domain.captures import Between, Capture
from gateway.domain.proposals import TableChange
from gateway.evaluate.optics import corrections
from gateway.table.comparison import acting_mean
from gateway.workflow.axes.propose import change_of, instrument_of, judge_benefit
from gateway.workflow.axes.structure import AdaptiveTargets, structure_of
from tests.unit.table.world import live, table

Curve = Callable[[np.ndarray], np.ndarray]
REPETITIONS, SCATTER = 5, 0.1


def wave(length: float, size: float) -> Curve:
    return lambda q: size * np.cos(2.0 * np.pi * q / length + 0.3)


def sag(at: float, wide: float, size: float) -> Curve:
    return lambda q: -size * np.clip(1.0 - np.abs(q - at) / (wide / 2.0), 0.0, 1.0)


def section(*, rotary: bool, even: bool, hours: float, step: float, seed: int) -> AxisSection:
    last, count = (345.0, 24) if rotary else (400.0, 21)
    targets = {"first": 0.0, "last": last, "count": count, "offset_fraction": 0.0 if even else 0.2, "seed": seed}
    return AxisSection.model_validate(
        {
            "name": "A1", "letter": "C" if rotary else "X", "kind": "rotary" if rotary else "linear",
            "travel": [0.0, 360.0] if rotary else [-10.0, 410.0], "modulo": rotary,
            "measure": {
                "instrument": "laser", "component": "ECC" if rotary else "EXX", "targets": targets,
                "repetitions": REPETITIONS, "feed": 6000.0, "stable": 0.5, "dwell_s": 0.2, "extra_hours": hours,
            },
            "table": {"minimum": 0.0, "maximum": 360.0 if rotary else 400.0, "step": step},
        }
    )  # fmt: skip


@dataclass(frozen=True)
class Machine:
    """A seeded axis: its truth, how it is measured, and what happens from capture to table."""

    axis: AxisSection
    truth: Curve
    seed: int
    scatter: float = SCATTER

    @property
    def lattice(self) -> np.ndarray:
        return np.arange(0.0, 360.0 if self.axis.modulo else 400.05, 0.1)

    def captured(self, targets: np.ndarray) -> Capture:
        """Scatter, reversal and a little drift; check stops where the site's own targets ask for them."""
        rng = np.random.default_rng([self.seed, len(targets)])
        stops = between_places(targets_of(self.axis), 6, self.seed)
        places = np.concatenate([targets, stops])
        x = np.broadcast_to(self.truth(places)[:, None, None], (places.size, REPETITIONS, 2)).copy()
        x += rng.normal(0.0, self.scatter, x.shape) + np.array([0.4, -0.4]) + rng.normal(0.0, 0.05, (REPETITIONS, 2))
        x -= x[0, 0, 0]
        air = Ambient(20.0, 1013.25, 50.0, ())
        unit = self.axis.unit
        acts = live(table(None, _Span(self.axis), rotary=self.axis.modulo), enabled=False)  # type: ignore[arg-type]
        return Capture(
            "A1", self.axis.measure.component, unit, targets, x[: targets.size], 0.01, air, air,
            corrections.begin("air+material"), acts, None,
            between=Between(stops, x[targets.size :, :CHECK_REPETITIONS]),
        )  # fmt: skip

    def judged(self) -> Judged:
        """Captured, widened as long as the run asks for it, proposed; judged on a fine grid by the truth."""
        said: list[dict[str, Any]] = []
        more = AdaptiveTargets(
            self.axis, cast(Any, None), lambda code, /, **fields: said.append(fields | {"code": code})
        )
        targets = targets_of(self.axis)
        capture = self.captured(targets)
        while (places := more.wanted(capture)).size:
            targets = np.sort(np.append(targets, places))
            capture = self.captured(targets)
        shown = structure_of(self.axis, capture)
        limits = TableLimits(resolution=1e-6, max_value=1.0, reserved_points=5000)
        change = change_of(self.axis, shown, cast(Any, capture.live), limits)
        change = judge_benefit(change, shown, instrument_of(capture))
        now = self.truth(self.lattice)
        then = now - acting_mean(change.new, self.lattice) if not change.skipped else now
        return Judged(change, targets, said, now, then, self.lattice)


@dataclass(frozen=True)
class _Span:
    axis: AxisSection

    @property
    def minimum(self) -> float:
        return self.axis.table.minimum

    @property
    def maximum(self) -> float:
        return self.axis.table.maximum

    @property
    def step(self) -> float:
        return self.axis.table.step

    @property
    def points(self) -> np.ndarray:
        return np.arange(self.minimum, self.maximum + self.step / 2.0, self.step)


@dataclass(frozen=True)
class Judged:
    """What came of a machine: its change, all targets, what was said, the true axis before and after (n,)."""

    change: TableChange
    targets: np.ndarray
    said: list[dict[str, Any]]
    before: np.ndarray
    after: np.ndarray
    lattice: np.ndarray

    @property
    def gain(self) -> float:
        return float(np.std(self.before) - np.std(self.after))

    @property
    def worse(self) -> bool:
        return bool(np.std(self.after) > np.std(self.before) + 0.02 or np.ptp(self.after) > np.ptp(self.before) + 0.1)

    @property
    def off(self) -> float:
        """How far the axis lies off the prediction at the targets, in units of its U, the largest."""
        there = np.interp(self.change.targets, self.lattice, self.after) - self.change.predicted
        return float(np.max(np.abs(there - np.median(there)) / self.change.predicted_U))


def machine(
    seed: int,
    extra: Curve,
    *,
    rotary: bool = False,
    even: bool = False,
    hours: float = 0.5,
    step: float = 0.0,
    size: float = 1.0,
    scatter: float = SCATTER,
) -> Machine:
    """A smooth axis of a seed and ``size`` with something finer on it."""
    rng = np.random.default_rng(seed)
    axis = section(rotary=rotary, even=even, hours=hours, step=step or (5.0 if rotary else 10.0), seed=seed + 1)
    sizes, phases = rng.choice([-1.0, 1.0], 3) * size * np.array([12.0, 6.0, 3.0]), rng.uniform(0.0, 2.0 * np.pi, 3)

    def smooth(q: np.ndarray) -> np.ndarray:
        if rotary:
            parts = [
                a * np.cos((k + 1) * np.radians(q) + p) for k, (a, p) in enumerate(zip(sizes, phases, strict=True))
            ]
            return np.sum(parts, axis=0)
        return np.polynomial.polynomial.polyval((q - 200.0) / 200.0, np.append(0.0, sizes))

    return Machine(axis, lambda q: smooth(q) + extra(q), seed, scatter)
