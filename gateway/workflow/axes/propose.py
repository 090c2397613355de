"""From measured axes to a stored proposal: fit, sample on the controller's grid, merge, judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import deviation_scale
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.figures import Component
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import CaptureError
from gateway.evaluate.behaviour.fine_structure import Hidden, hidden_structure, lonely
from gateway.evaluate.behaviour.repetitions import RobustMeans, robust_means
from gateway.interlocks import not_worth_it
from gateway.model.components import standard_uncertainty, value
from gateway.model.fit import fit_means
from gateway.table import Grid, MeasuredMeans
from gateway.table import propose as propose_table
from gateway.workflow import stages
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.consents import proposed, tell
from gateway.workflow.selftests import warnings


async def propose(at: Bench, measured: Mapping[str, MeasuredAxis]) -> Proposal:
    """Fit every measured axis and store the proposal for the machine. Raises TableError, ModelError."""
    changes = await axis_changes(at, measured)
    return keep(at, changes, tuple(item.digest for item in measured.values()))


async def axis_changes(at: Bench, measured: Mapping[str, MeasuredAxis]) -> tuple[TableChange, ...]:
    """The axis table's change of every measured axis, its fit stored. Raises TableError, ModelError."""
    return tuple([await _change(at, at.axis(name), item) for name, item in measured.items()])


def keep(at: Bench, changes: tuple[TableChange, ...], parents: tuple[str, ...]) -> Proposal:
    """Store a proposal of these changes for the machine, and tell it."""
    said = warnings(at, (change.axis for change in changes if not change.skipped))
    proposal = Proposal(at.machine, changes, parents, at.clock.utc().isoformat(timespec="seconds"), warnings=said)
    at.folder.put(stages.PROPOSAL, proposal, parents)
    tell(at, proposed(at, proposal))
    for change in changes:
        at.say("P-PROPOSED", axis=change.name, words=change.skipped or size_of(change))
    return proposal


async def _change(at: Bench, axis: AxisSection, item: MeasuredAxis) -> TableChange:
    capture = item.capture
    if capture.live is None:
        raise CaptureError("E-RUN-LIVE", axis.name)
    means = robust_means(capture.targets, capture.deviations)
    means = replace(means, u=np.hypot(means.u, capture.unsteady_u))
    component = _fit(axis, item, means)
    hidden = between_targets(component, capture)
    at.say("P-HIDDEN", axis=axis.name, words=hidden.words)
    at.folder.put(stages.hidden(axis.name), hidden, (item.digest,))
    unseen = _unseen(component, hidden, lonely(capture.targets, means.mean, means.u))
    component = replace(component, residual_rms=max(component.residual_rms, hidden.u))
    at.folder.put(stages.component(axis.name), component, (item.digest,))
    limits = await at.supervisor.controller.table_limits(axis.name, "axis", axis.encoder)
    change = propose_table(
        axis.facts,
        component,
        measured=MeasuredMeans(targets=capture.targets, means=means.mean, u=means.u, rest=_rest(means), unseen=unseen),
        live=capture.live,
        grid=Grid(axis.table.minimum, axis.table.maximum, axis.table.step),
        resolution=limits.resolution * deviation_scale(axis.unit),
        reserved_points=limits.reserved_points,
    )
    against = () if change.skipped else not_worth_it(capture, change)
    return replace(change, skipped="; ".join(one.words for one in against)) if against else change


def between_targets(component: Component, capture: Capture) -> Hidden:
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


def _unseen(component: Component, hidden: Hidden, lone: float | None) -> float:
    """Stops between the targets know better than what targets say of their neighbours, but not of one place alone."""
    stops = hidden.by == "check stops"
    return max(hidden.size, component.residual_rms) if lone is not None or not stops else hidden.size


def _rest(means: RobustMeans) -> float:
    half = (means.mean_up - means.mean_down) / 2.0
    reversal = float(np.mean(half[np.isfinite(half)] ** 2)) if np.isfinite(half).any() else 0.0
    return float(np.sqrt(reversal + np.nan_to_num(means.s) ** 2))


def _fit(axis: AxisSection, item: MeasuredAxis, means: RobustMeans) -> Component:
    return fit_means(
        item.capture.targets,
        means.mean,
        means.u,
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )


def size_of(change: TableChange) -> str:
    """Points and span of the new table, in words."""
    low, high = min(change.new.deviations), max(change.new.deviations)
    return f"{len(change.new.deviations)} points, {low:+.2f} .. {high:+.2f} {change.new.deviation_unit}"
