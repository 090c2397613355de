"""What a capture program of somebody else needs: a program that stands still at each target, and the list of targets.

Such programs trigger when the reading stands still, so the axis must stand longer than they settle.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import ConfigError, words
from drivers.programs import DwellPlan
from gateway.capture.duration import plan_s
from gateway.capture.targets import measuring_plan, targets_of
from gateway.config import AxisSection, SiteFile
from gateway.domain.values import FloatArray

MARGIN_S = 1.0  # beyond the settling: the person's clock and the control's are two
LARGEST_STEP_DEG = 10.0
CALIBRATOR_FEED = 720.0  # deg/min; what a rotary calibrator's own drive follows over larger steps, as remembered


@dataclass(frozen=True, slots=True)
class DwellWish:
    """Seconds at each target, seconds that the capture program settles, and the calibrator's fastest feed, deg/min."""

    dwell_s: float = 6.0
    settling_s: float = 2.0
    calibrator_feed: float = CALIBRATOR_FEED


def dwell_plans(site: SiteFile, wish: DwellWish) -> tuple[tuple[AxisSection, DwellPlan], ...]:
    """One plan for each axis that has targets.

    Raises ConfigError (E-DWELL-SHORT, E-DWELL-TARGETS).
    """
    if wish.dwell_s < wish.settling_s + MARGIN_S:
        least = wish.settling_s + MARGIN_S
        raise ConfigError("E-DWELL-SHORT", "--dwell", dwell=f"{wish.dwell_s:g}", least=f"{least:g}")
    axes = [(axis, targets_of(axis)) for axis in site.axes]
    found = tuple((axis, _plan(axis, at, wish)) for axis, at in axes if at.size)
    if not found:
        raise ConfigError("E-DWELL-TARGETS", site.site.name)
    return found


def _plan(axis: AxisSection, at: FloatArray, wish: DwellWish) -> DwellPlan:
    plan = measuring_plan(axis, at, "", name=f"TFDWEL{axis.letter}")
    return DwellPlan(replace(plan, feed=feed_of(axis, at, wish)), wish.dwell_s)


def feed_of(axis: AxisSection, at: FloatArray, wish: DwellWish) -> float:
    """The site's feed, lowered where a rotary calibrator would not follow; mm/min or deg/min."""
    widest = float(np.max(np.diff(at), initial=0.0))
    slow = axis.kind == "rotary" and widest >= LARGEST_STEP_DEG
    return min(axis.measure.feed, wish.calibrator_feed) if slow else axis.measure.feed


def said(axis: AxisSection, plan: DwellPlan) -> str:
    """What a person should know of this program: stops, hours, and a feed that is not the site's."""
    count = len(plan.stops.stops)
    hours = plan_s(replace(plan.stops, dwell_s=plan.dwell_s), 0.0) / 3600.0
    text = words("P-DWELL-PLAN", axis=axis.name, stops=count, dwell=f"{plan.dwell_s:g}", hours=f"{hours:.1f}")
    if plan.stops.feed < axis.measure.feed:
        feed, own = f"{plan.stops.feed:g}", f"{axis.measure.feed:g}"
        text += words("P-DWELL-FEED", feed=feed, own=own)
    return text


def target_lists(axis: AxisSection, plan: DwellPlan) -> dict[str, str]:
    """The targets as text (one a line) and as CSV in the order of the stops, by file name."""
    at = sorted({stop.target for stop in plan.stops.stops})
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["stop", f"target_{axis.unit}", "direction", "repetition"])
    for place, stop in enumerate(plan.stops.stops, 1):
        writer.writerow([place, f"{stop.target:.6f}", "+" if stop.approach > 0 else "-", stop.repetition + 1])
    lines = "".join(f"{target:.6f}\n" for target in at)
    return {f"dwell-{axis.letter}-targets.txt": lines, f"dwell-{axis.letter}-stops.csv": table.getvalue()}
