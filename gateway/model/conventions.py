"""Takes out of a fitted motion what belongs to set-up or location: line, mean, the wave of an eccentric artefact.

Means and waves are those of the axis' own travel: the whole turn of a motion that repeats, else the range measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import design, is_periodic, value

TURN_DEG = 360.0
DENSE = 720


def without_line(component: Component, positions: ArrayLike) -> Component:
    """The component less the least-squares line through its values at positions (m,), mm; nothing is known of a line.

    Straightness has no slope of its own: it is the mounting's, or a squareness error.
    """
    x = np.asarray(positions, dtype=np.float64)
    return _less(component, x, np.column_stack([np.ones_like(x), x - x.mean()]))


def without_mean(component: Component) -> Component:
    """A component of a turning axis less its mean over the axis' travel: that is a location error."""
    x = travel(component)
    return _less(component, x, np.ones((DENSE, 1)))


def travel(component: Component) -> FloatArray:
    """Places (720,) evenly over the travel: the turn of a component that repeats, else the range that was measured."""
    if is_periodic(component):
        return np.arange(DENSE) * TURN_DEG / DENSE
    return np.linspace(*component.domain, DENSE)


def _less(component: Component, x: FloatArray, shapes: FloatArray) -> Component:
    """The component less its projection on shapes (m, s) at positions x (m,); they must lie in its basis."""
    columns = design(component.basis, component.parameters, x)
    rest = columns - shapes @ np.linalg.lstsq(shapes, columns, rcond=None)[0]
    keep = np.linalg.lstsq(columns, rest, rcond=None)[0]
    covariance = keep @ component.covariance @ keep.T
    return replace(component, coefficients=keep @ component.coefficients, covariance=covariance)


def mean_of(component: Component) -> tuple[float, float]:
    """Mean over the axis' travel and its standard uncertainty."""
    g = design(component.basis, component.parameters, travel(component)).mean(axis=0)
    return float(g @ component.coefficients), float(np.sqrt(max(g @ component.covariance @ g, 0.0)))


@dataclass(frozen=True, slots=True)
class Wave:
    """a cos(q) + b sin(q)."""

    a: float
    b: float

    def __call__(self, positions_deg: FloatArray) -> FloatArray:
        """Values at positions, same shape."""
        q = np.deg2rad(positions_deg)
        return np.asarray(self.a * np.cos(q) + self.b * np.sin(q))


def first_harmonic(component: Component) -> Wave:
    """The once-per-turn part: over a part of a turn that of the least-squares wave with a constant."""
    x = travel(component)
    values, q = value(component, x), np.deg2rad(x)
    found = np.linalg.lstsq(np.column_stack([np.ones_like(q), np.cos(q), np.sin(q)]), values, rcond=None)[0]
    return Wave(float(found[1]), float(found[2]))


def in_phase(first: Wave, second: Wave) -> tuple[Wave, Wave]:
    """What an eccentric artefact makes of a pair of cross directions (X and Y, or A and B): u, v turning with the axis.

    first = u cos q - v sin q, second = u sin q + v cos q. The counter-rotating rest is error motion and stays.
    """
    u, v = (first.a + second.b) / 2.0, (second.a - first.b) / 2.0
    return Wave(u, -v), Wave(v, u)
