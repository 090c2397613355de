"""What a captured axis shows: its means, its curve, what lies between the targets, and which axes may be behind it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.types.values import FloatArray
from gateway.capture.collection import RawCapture
from gateway.capture.revisits import affordable, cost_s
from gateway.config import AxisSection, SiteFile
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
from gateway.events import TargetsAdded
from gateway.gear.grinding import Grinding
from gateway.model.components import is_periodic, standard_uncertainty, value
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.model.fit import TURN_DEG
from gateway.model.waves import fit_means, usual_gap
from gateway.say import Say
from gateway.study.inputs import gear_of, load_gear
from gateway.table import Grid
from gateway.table.benefit_probability import PosteriorCurves, TableDoubt, held_by
from gateway.table.posterior_curves import SeenPlaces, draw_posterior_curves
from gateway.table.proposal import InstrumentU

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


# More targets where an axis does what its curve does not follow: which they are, and what they cost.

MOST_ROUNDS = 3
AT_LEAST = 1.0 / 3.0  # of the targets are added in a round: a wave is told by many places, not by the best few
FEWEST = 3
TOOTH = 0.5  # of a positioning's weight is where the tooth is ground, the rest anywhere on the axis


@dataclass
class AdaptiveTargets:
    """Asked after each round of an axis' capture: which places shall be targets too. Counts what the rounds cost.

    ``corrected`` makes deviations of what was read. ``tooth`` are places of the axis where the work is ground, in its
    unit; empty: it has none. ``share`` of the weight lies there.
    """

    axis: AxisSection
    corrected: Callable[[RawCapture], Capture]
    say: Say
    tooth: FloatArray = field(default_factory=lambda: np.empty(0))
    share: float = TOOTH
    spent_s: float = 0.0
    rounds: int = 0

    def __call__(self, raw: RawCapture) -> FloatArray:
        """Places (k,), none where the curve follows the axis, or where no time is left."""
        return self.wanted(self.corrected(raw))

    def wanted(self, capture: Capture) -> FloatArray:
        """The same of what was captured, corrected."""
        if not self.axis.measure.extra_hours or self.rounds >= MOST_ROUNDS:
            return np.empty(0)
        shown = structure_of(self.axis, capture)
        if not shown.found:
            return np.empty(0)
        doubt = self._doubt(shown)
        enough = max(InstrumentU.usual(capture.unit).constant / 2.0, float(np.nanmean(shown.means.u)))
        return np.empty(0) if doubt.rms <= enough else self._choose_places(shown, doubt)

    def _doubt(self, shown: Structure) -> TableDoubt:
        possible, table = shown.possible(), self.axis.table
        held = held_by(Grid(table.minimum, table.maximum, table.step), possible.lattice, modulo=self.axis.modulo)
        curves = possible.curves - value(shown.component, possible.lattice)
        # The zero of an axis is no matter of its table, so every curve may be shifted.
        curves = curves - np.mean(curves, axis=1, keepdims=True)
        return TableDoubt(possible.lattice, curves, held, self._weights(possible.lattice))

    def _weights(self, lattice: FloatArray) -> FloatArray:
        """What each place counts: the whole axis, and more where the tooth is ground."""
        even = np.full(lattice.size, 1.0 / lattice.size)
        period = 360.0 if self.axis.modulo else np.inf
        away = np.abs(self.tooth[:, None] - lattice[None, :])
        near = np.minimum(away, np.abs(period - away % period) if self.axis.modulo else away) <= self.axis.table.step
        used = near.sum(axis=0).astype(np.float64)
        return even if not used.any() else (1.0 - self.share) * even + self.share * used / used.sum()

    def _choose_places(self, shown: Structure, doubt: TableDoubt) -> FloatArray:
        capture, gap = shown.capture, shown.seen.gap
        span, left_s = float(np.ptp(capture.targets)), self.axis.measure.extra_hours * 3600.0 - self.spent_s
        can = affordable(self.axis, left_s / 3600.0, span)
        count = min(can, max(FEWEST, int(np.ceil(AT_LEAST * capture.targets.size))))
        known = _known_deviations(capture)
        places = doubt.places(known, count, float(np.nanmean(shown.means.u)), gap) if count >= FEWEST else np.empty(0)
        price = cost_s(self.axis, places.size or FEWEST, span)
        told: dict[str, Any] = {"doubt": f"{doubt.rms:.2g}", "unit": capture.unit, "count": int(places.size)}
        told |= {"axis": self.axis.name, "minutes": f"{price / 60.0:.0f}", "left": f"{left_s / 60.0:.0f}"}
        if places.size:
            TargetsAdded(**told).tell(self.say)
        else:
            self.say("P-MORE-NONE", **told)
        self.spent_s += price
        self.rounds += 1
        return np.round(places, 3)


def _known_deviations(capture: Capture) -> FloatArray:
    return capture.targets if capture.between is None else np.append(capture.targets, capture.between.targets)


# Where along an axis the work of the site is ground.

HEIGHTS = 25


def tooth_places(site: SiteFile, site_path: Path, axis: AxisSection) -> FloatArray:
    """Positions (n,) of an axis, mm or deg, at which the flank of the site's work is made; none without work.

    Raises ConfigError (E-STUDY-...), ModelError (E-GEAR-...) for a gear file that is none.
    """
    if site.work is None:
        return np.empty(0)
    file = load_gear(site_path.parent / site.work.gear)
    gear = gear_of(file)
    grinding = Grinding(
        chain_of_errors(ErrorModel(), height_mm=site.work.height_mm), gear, file.grinding.centre_distance_mm
    )
    heights = np.linspace(-0.5, 0.5, HEIGHTS) * gear.b
    commands = grinding.commands(np.arange(gear.zc)[:, None], heights[None, :])
    if axis.letter not in commands:
        return np.empty(0)
    places = np.unique(np.round(np.atleast_1d(commands[axis.letter]), 6))
    return np.asarray(np.rad2deg(places) % 360.0 if axis.kind == "rotary" else places)
