"""Little machines with check stops, drift, outliers and, if wanted, errors that hide between the targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gateway.capture.targets import CHECK_REPETITIONS, Cycle, between_places, cycle_visits
from gateway.domain.captures import Between
from gateway.evaluate.behaviour.dynamics import Steadiness, steadiness
from gateway.evaluate.behaviour.fine_structure import HiddenStructure, hidden_structure
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.model.components import standard_uncertainty, value
from gateway.model.fit import fit_positioning

Curve = Callable[[np.ndarray], np.ndarray]
SECONDS_A_STOP = 4.0


@dataclass(frozen=True)
class Captured:
    """One capture: targets (m,), deviations and times (m, n, 2), check stops, and the truth of the mean."""

    targets: np.ndarray
    deviations: np.ndarray
    times: np.ndarray
    between: Between
    truth: Curve
    rotary: bool

    def fit(self) -> Curve:
        means = robust_means(self.targets, self.deviations)
        return lambda q: value(self._component(means), q)

    def _component(self, means: object) -> object:
        kind = "rotary" if self.rotary else "linear"
        unit = "deg" if self.rotary else "mm"
        return fit_positioning(
            self.targets, means.mean, means.u, name="E", axis="A", axis_unit=unit, kind=kind, modulo=self.rotary
        )

    def hidden(self, *, fitted: bool = True) -> HiddenStructure:
        """Against the usual fit, given or left to the room."""
        component = self._component(robust_means(self.targets, self.deviations))

        def curve(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return value(component, q), standard_uncertainty(component, q)

        period = 360.0 if self.rotary else None
        chosen = curve if fitted else None
        return hidden_structure(self.targets, self.deviations, "um", between=self.between, curve=chosen, period=period)

    def steady(self) -> Steadiness:
        return steadiness(self.times, self.deviations, "um")


def captured(
    seed: int,
    *,
    rotary: bool = False,
    extra: Curve | None = None,
    even: bool = False,
    count: int = 21,
    repetitions: int = 4,
    scatter: float = 0.15,
    cycle: Cycle = "standard",
    disturbed: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Captured:
    """A seeded machine with a smooth error, reversal, slow drift and two readings out of line.

    ``extra`` is added to the mean error, ``disturbed`` (times -> um) to every reading.
    """
    rng = np.random.default_rng(seed)
    span = 345.0 if rotary else 400.0
    gap = span / (count - 1)
    offsets = 0.0 if even else rng.uniform(-0.2, 0.2, count) * gap
    targets = np.clip(np.linspace(0.0, span, count) + offsets, 0.0, span)
    smooth = _turn(rng) if rotary else _line(rng)

    def truth(q: np.ndarray) -> np.ndarray:
        return smooth(q) + (extra(q) if extra is not None else 0.0)

    stops = between_places(targets, 6, seed)
    places = np.sort(np.concatenate([targets, stops]))
    checks = np.flatnonzero(np.isin(places, stops))
    times = np.full((places.size, repetitions, 2), np.nan)
    kept = [
        s for s in cycle_visits(cycle, places, repetitions) if s.label not in checks or s.repetition < CHECK_REPETITIONS
    ]
    for number, stop in enumerate(kept):
        times[stop.label, stop.repetition, 0 if stop.approach == 1 else 1] = number * SECONDS_A_STOP
    half = 0.5 * rng.uniform(0.3, 1.5) * np.array([1.0, -1.0])
    x = truth(places)[:, None, None] + half + rng.normal(scale=scatter, size=times.shape)
    x = x + 0.3 * times / 3600.0 + 0.1 * np.sin(times / 400.0) + (disturbed(times) if disturbed is not None else 0.0)
    known = np.argwhere(np.isfinite(times))
    for index in rng.choice(len(known), 2, replace=False):
        x[tuple(known[index])] += rng.choice([-3.0, 3.0])
    rest = np.setdiff1d(np.arange(places.size), checks)
    between = Between(places[checks], x[checks, :CHECK_REPETITIONS])
    return Captured(targets, x[rest], times[rest], between, truth, rotary)


def _turn(rng: np.random.Generator) -> Curve:
    sizes, phases = rng.normal(size=3) * [7.0, 4.0, 2.0], rng.uniform(0.0, 2.0 * np.pi, 3)
    return lambda q: sum(
        a * np.cos((k + 1) * np.radians(q) + p) for k, (a, p) in enumerate(zip(sizes, phases, strict=True))
    )


def _line(rng: np.random.Generator) -> Curve:
    sizes = rng.normal(size=4) * [8.0, 5.0, 3.0, 1.0]
    return lambda q: np.polynomial.polynomial.polyval((q - 200.0) / 200.0, np.append(0.0, sizes))
