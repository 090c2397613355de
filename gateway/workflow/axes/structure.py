"""What a captured axis shows: its means, its curve, what lies between the targets, and which axes may be behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.figures import Component
from gateway.evaluate.behaviour.fine_structure import (
    FLOOR,
    HiddenStructure,
    hidden_structure,
    isolated_outlier,
    means_between,
    out_of_line,
)
from gateway.evaluate.behaviour.repetitions import RobustMeans, robust_means
from gateway.model.components import is_periodic, standard_uncertainty, value
from gateway.model.fit import TURN_DEG
from gateway.model.waves import fit_means, usual_gap
from gateway.table.benefit_probability import PosteriorCurves
from gateway.table.posterior_curves import SeenPlaces, draw_posterior_curves

CURVES = 256
FAR_ABOVE = 2.0  # a curve that leaves so many uncertainties of a mean does not follow the axis


@dataclass(frozen=True)
class Structure:
    """Means and curve of a capture, what its check stops say of the curve, and a target far out of line, if any."""

    capture: Capture
    means: RobustMeans
    component: Component
    hidden: HiddenStructure
    lone: float | None

    @property
    def found(self) -> bool:
        """Whether the axis does something that the curve does not follow."""
        left = self.component.residual_rms > FAR_ABOVE * float(np.nanmean(self.means.u)) + FLOOR
        return self.hidden.size > 0.0 or self.lone is not None or left

    @property
    def doubted(self) -> Component:
        """The curve, with what lies between the targets as structure that it does not follow."""
        return replace(self.component, residual_rms=max(self.component.residual_rms, self.hidden.u))

    @property
    def unseen(self) -> float:
        """Stops between the targets know better than targets of their neighbours, but not of one place alone."""
        stops = self.hidden.by == "check stops"
        left = self.component.residual_rms
        return max(self.hidden.size, left) if self.lone is not None or not stops else self.hidden.size

    @property
    def place(self) -> tuple[float, float] | None:
        """The inner target furthest out of the line of its neighbours and how far, where the curve misses the axis."""
        known = np.isfinite(self.means.mean)
        at, mean = self.capture.targets[known], self.means.mean[known]
        if not self.found or at.size <= 2:
            return None
        off = out_of_line(at, mean)
        return float(at[int(np.argmax(off)) + 1]), float(np.max(off))

    @property
    def seen(self) -> SeenPlaces:
        """Means of targets and check stops together."""
        known, stops = np.isfinite(self.means.mean), self.capture.between
        at, mean, u = (one[known] for one in (self.capture.targets, self.means.mean, self.means.u))
        if stops is not None and stops.targets.size:
            stood, doubt = means_between(self.capture.targets, self.capture.deviations, stops)
            there = np.isfinite(stood) & np.isfinite(doubt)
            at, mean = np.append(at, stops.targets[there]), np.append(mean, stood[there])
            u = np.append(u, doubt[there])
        missed = max(self.hidden.seen, self.component.residual_rms, 2.0 * FLOOR)
        turn = TURN_DEG if is_periodic(self.component) else None
        return SeenPlaces(at, mean, u, gap=usual_gap(self.capture.targets), missed=missed, turn=turn)

    def possible(self) -> PosteriorCurves:
        """Axes that explain what was seen."""
        seen = self.seen
        return PosteriorCurves(seen.lattice, draw_posterior_curves(seen, CURVES))


def structure_of(axis: AxisSection, capture: Capture) -> Structure:
    """Fit a capture of an axis and hold its check stops against the curve. Raises ModelError as `fit_positioning`."""
    means = robust_means(capture.targets, capture.deviations)
    means = replace(means, u=np.hypot(means.u, capture.unsteady_u))
    component = fit_means(
        capture.targets,
        means.mean,
        means.u,
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )
    lone = isolated_outlier(capture.targets, means.mean, means.u)
    return Structure(capture, means, component, hidden=between_targets(component, capture), lone=lone)


def between_targets(component: Component, capture: Capture) -> HiddenStructure:
    """What the capture's check stops say of the curve fitted to its targets."""
    period = component.parameters.get("period")

    def curve(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        return value(component, places), standard_uncertainty(component, places)

    return hidden_structure(
        capture.targets,
        capture.deviations,
        capture.unit,
        between=capture.between,
        curve=curve,
        period=float(str(period)) if period is not None else None,
    )
