"""From measured axes to a stored proposal: fit, sample on the controller's grid, merge, judge."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.units import deviation_scale
from gateway.config import AxisSection
from gateway.domain import Component, Proposal, TableChange
from gateway.errors import CaptureError
from gateway.evaluate.repetitions import RobustMeans, robust_means
from gateway.model.fit import fit_positioning
from gateway.table import Grid, TableAxis
from gateway.table import Measured as MeasuredMeans
from gateway.table import propose as propose_table
from gateway.workflow import stages
from gateway.workflow.bench import Bench
from gateway.workflow.consents import proposed, tell
from gateway.workflow.measure import Measured


async def propose(at: Bench, measured: Mapping[str, Measured]) -> Proposal:
    """Fit every measured axis and store the proposal for the machine. Raises TableError, ModelError."""
    changes = [await _change(at, at.axis(name), item) for name, item in measured.items()]
    parents = tuple(item.digest for item in measured.values())
    proposal = Proposal(at.machine, tuple(changes), parents, at.clock.utc().isoformat(timespec="seconds"))
    at.folder.put(stages.PROPOSAL, proposal, parents)
    tell(at, proposed(at, proposal))
    for change in changes:
        at.say("P-PROPOSED", axis=change.axis, words=change.skipped or _size(change))
    return proposal


async def _change(at: Bench, axis: AxisSection, item: Measured) -> TableChange:
    capture = item.capture
    if capture.live is None:
        raise CaptureError("E-RUN-LIVE", axis.name)
    means = robust_means(capture.targets, capture.deviations)
    component = _fit(axis, item, means)
    at.folder.put(stages.component(axis.name), component, (item.digest,))
    limits = await at.supervisor.controller.table_limits(axis.name)
    return propose_table(
        TableAxis(axis.name, axis.unit, axis.reference, axis.modulo),
        component,
        MeasuredMeans(capture.targets, means.mean, means.u),
        capture.live,
        Grid(axis.table.minimum, axis.table.maximum, axis.table.step),
        resolution=limits.resolution * deviation_scale(axis.unit),
        reserved_points=limits.reserved_points,
    )


def _fit(axis: AxisSection, item: Measured, means: RobustMeans) -> Component:
    return fit_positioning(
        item.capture.targets,
        means.mean,
        means.u,
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )


def _size(change: TableChange) -> str:
    low, high = min(change.new.deviations), max(change.new.deviations)
    return f"{len(change.new.deviations)} points, {low:+.2f} .. {high:+.2f} {change.new.deviation_unit}"
