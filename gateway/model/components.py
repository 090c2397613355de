"""Error motions as functions of position: the bases, their values and standard uncertainties."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.model.cubic import cardinal

LONGEST_WAVE = 12
"""Orders of a turn above this are waves of worm or scale, not the axis' shape."""
Parameters = Mapping[str, Any]


def value(component: Component, positions: ArrayLike) -> FloatArray:
    """Value of a component at positions (any shape) in its own unit.

    Outside its domain a periodic component repeats and any other holds its end value: nothing is
    extrapolated.
    """
    at = np.asarray(positions, dtype=np.float64)
    return (_design_at(component, at.ravel()) @ component.coefficients).reshape(at.shape)


def standard_uncertainty(component: Component, positions: ArrayLike) -> FloatArray:
    """Standard uncertainty of the fitted value at positions: sqrt(g' V g), GUM.

    V holds the readings' scatter and the scatter of what the fit leaves; structure that lies between the
    targets and is not seen by them is ``residual_rms``, to be added where it matters.
    """
    at = np.asarray(positions, dtype=np.float64)
    g = _design_at(component, at.ravel())
    variance = np.einsum("ij,jk,ik->i", g, component.covariance, g)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(at.shape)


def motion_uncertainty(component: Component, positions: ArrayLike) -> FloatArray:
    """Standard uncertainty of the error motion itself at positions: of the fit, and of what it does not follow.

    A constant through readings that change by much is well known as a constant, and says little of any one place.
    """
    return np.hypot(standard_uncertainty(component, positions), component.residual_rms)


def at_datum(component: Component, reference: float) -> Component:
    """The component with its value at the reference taken off everywhere; its uncertainty is zero there.

    The offset of a positioning deviation is the machine zero and no error motion.
    """
    g = _design_at(component, np.asarray([reference]))[0]
    ones = _one_everywhere(component, g.size)
    shift = np.eye(g.size) - np.outer(ones, g)
    return replace(
        component,
        coefficients=shift @ component.coefficients,
        covariance=shift @ component.covariance @ shift.T,
    )


def _one_everywhere(component: Component, size: int) -> FloatArray:
    """Hats and splines add up to one everywhere; the other bases carry their constant in the first term."""
    waves = 2 * len(component.parameters.get("lengths", ()))  # type: ignore[arg-type]
    if component.parameters.get("smooth", component.basis) in ("piecewise", "cubic", "bspline"):
        return np.append(np.ones(size - waves), np.zeros(waves))
    return np.asarray(np.eye(size)[0])


def without_waves(component: Component) -> Component:
    """The component without its short waves; itself where it has none."""
    turns = component.basis == "fourier"
    orders = component.parameters.get("orders", ()) if turns else ()
    short = [n > LONGEST_WAVE for n in orders]  # type: ignore[attr-defined]
    if not any(short) and component.basis != "waved":
        return component
    kept = component.coefficients.copy()
    if turns:
        kept[1:][np.repeat(short, 2)] = 0.0
    else:
        kept[-2 * len(component.parameters["lengths"]) :] = 0.0  # type: ignore[arg-type]
    return replace(component, coefficients=kept)


def is_periodic(component: Component) -> bool:
    """Whether the component repeats (a full turn of a rotary axis)."""
    return component.parameters.get("period") is not None


def design(basis: str, parameters: Parameters, positions: FloatArray) -> FloatArray:
    """Basis functions (points, coefficients) at positions inside the domain.

    Raises ModelError (E-MODEL-BASIS) for an unknown name.
    """
    if basis not in _BASES:
        raise ModelError("E-MODEL-BASIS", "model", basis=basis, known=", ".join(_BASES))
    return _BASES[basis](parameters, positions)


def _design_at(component: Component, positions: FloatArray) -> FloatArray:
    inside = positions if is_periodic(component) else np.clip(positions, *component.domain)
    return design(component.basis, component.parameters, inside)


def _constant(_parameters: Parameters, positions: FloatArray) -> FloatArray:
    return np.ones((positions.size, 1))


def _polynomial(parameters: Parameters, positions: FloatArray) -> FloatArray:
    scaled = (positions - parameters["centre"]) / parameters["scale"]
    return np.vander(scaled, int(parameters["degree"]) + 1, increasing=True)


def _fourier(parameters: Parameters, positions: FloatArray) -> FloatArray:
    turn = 2.0 * np.pi * positions / parameters["period"]
    columns = [np.ones_like(turn)]
    for order in parameters["orders"]:
        columns += [np.cos(order * turn), np.sin(order * turn)]
    return np.stack(columns, axis=1)


def _bspline(parameters: Parameters, positions: FloatArray) -> FloatArray:
    knots = np.asarray(parameters["knots"], dtype=np.float64)
    return np.asarray(scipy.interpolate.BSpline.design_matrix(positions, knots, 3).toarray())


def _piecewise(parameters: Parameters, positions: FloatArray) -> FloatArray:
    nodes = np.asarray(parameters["nodes"], dtype=np.float64)
    period = parameters.get("period")
    return hats(nodes, positions) if period is None else periodic_hats(nodes, float(period), positions)


def _cubic(parameters: Parameters, positions: FloatArray) -> FloatArray:
    return cardinal(np.asarray(parameters["nodes"], dtype=np.float64), positions)


def _waved(parameters: Parameters, positions: FloatArray) -> FloatArray:
    """A smooth basis, then cosine and sine of each wave."""
    phases = [2.0 * np.pi * positions / length for length in parameters["lengths"]]
    waves = [one for phase in phases for one in (np.cos(phase), np.sin(phase))]
    return np.column_stack([_BASES[parameters["smooth"]](parameters, positions), *waves])


_BASES: Mapping[str, Callable[[Parameters, FloatArray], FloatArray]] = {
    "constant": _constant,
    "polynomial": _polynomial,
    "fourier": _fourier,
    "bspline": _bspline,
    "piecewise": _piecewise,
    "cubic": _cubic,
    "waved": _waved,
}


def hats(nodes: FloatArray, positions: FloatArray) -> FloatArray:
    """Hat functions (points, nodes) of ascending nodes; end values hold outside."""
    found = np.zeros((positions.size, nodes.size))
    rows = np.arange(positions.size)
    if nodes.size == 1:
        found[:, 0] = 1.0
        return found
    left = np.clip(np.searchsorted(nodes, positions, side="right") - 1, 0, nodes.size - 2)
    share = np.clip((positions - nodes[left]) / (nodes[left + 1] - nodes[left]), 0.0, 1.0)
    found[rows, left] = 1.0 - share
    found[rows, left + 1] = share
    return found


def periodic_hats(nodes: FloatArray, period: float, positions: FloatArray) -> FloatArray:
    """Hat functions (points, nodes) that repeat after `period`; ascending nodes within one period."""
    wrapped = nodes[0] + np.mod(positions - nodes[0], period)
    closed = hats(np.append(nodes, nodes[0] + period), wrapped)
    found = closed[:, :-1].copy()
    found[:, 0] += closed[:, -1]
    return found
