"""More targets where an axis does what its curve does not follow: which they are, and what they cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.types.values import FloatArray
from gateway.capture.gathered.raw import RawCapture
from gateway.capture.gathered.widening import affordable, cost_s
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.events import TargetsAdded
from gateway.model.components import value
from gateway.say import Say
from gateway.table import Grid
from gateway.table.benefit_probability import TableDoubt, held_by
from gateway.table.proposal import InstrumentU
from gateway.workflow.axes.structure import Structure, structure_of

MOST_ROUNDS = 3
AT_LEAST = 1.0 / 3.0  # of the targets are added in a round: a wave is told by many places, not by the best few
FEWEST = 3
TOOTH = 0.5  # of a positioning's weight is where the tooth is ground, the rest anywhere on the axis


@dataclass
class MoreTargets:
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
        return np.empty(0) if doubt.rms <= enough else self._chosen(shown, doubt)

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

    def _chosen(self, shown: Structure, doubt: TableDoubt) -> FloatArray:
        capture, gap = shown.capture, shown.seen.gap
        span, left_s = float(np.ptp(capture.targets)), self.axis.measure.extra_hours * 3600.0 - self.spent_s
        can = affordable(self.axis, left_s / 3600.0, span)
        count = min(can, max(FEWEST, int(np.ceil(AT_LEAST * capture.targets.size))))
        known = _known(capture)
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


def _known(capture: Capture) -> FloatArray:
    return capture.targets if capture.between is None else np.append(capture.targets, capture.between.targets)
