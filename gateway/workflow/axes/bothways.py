"""An axis' change where the control holds a curve for each direction: the reversal goes into the table itself."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import Gap
from drivers.types.abilities import TableLimits
from drivers.types.tables import LiveSet
from drivers.units import deviation_scale
from gateway.config import AxisSection
from gateway.domain.proposals import FindingWeight, TableChange, TableFinding
from gateway.model.components import is_periodic, value
from gateway.table import Grid
from gateway.table import effective
from gateway.table.limits import check_reach
from gateway.table.merging import with_directions
from gateway.workflow.axes.reversing import SeenReversal


def left_of(turned: TableChange, seen: SeenReversal) -> TableChange:
    """The reversal's change as far as it matters for the table beside it: what a fitted B leaves of B."""
    return turned if seen.advice.within else replace(turned, predicted=seen.B - value(seen.curve, turned.targets))


def in_directions(
    axis: AxisSection, change: TableChange, live: LiveSet, limits: TableLimits, seen: SeenReversal
) -> TableChange:
    """The same change with a column for each direction; a reversal alone makes one too. Raises as `with_directions`."""
    curve = None if seen.advice.within else seen.curve
    said: tuple[TableFinding, ...] = ()
    if curve is not None and not is_periodic(curve):
        try:
            check_reach(curve.domain, (axis.table.minimum, axis.table.maximum), axis.unit, axis.name)
        except Gap as error:  # fewer targets were read in both directions than in one: the mean may have its table
            curve, said = None, (TableFinding(error.message, FindingWeight.REFUSES),)
    if change.skipped and (curve is None or live.cross):
        return replace(change, findings=(*change.findings, *said))
    new = with_directions(
        axis.facts,
        None if change.skipped else change.new,
        effective(live.own),
        reversal=curve,
        grid=Grid(axis.table.minimum, axis.table.maximum, axis.table.step),
        resolution=limits.resolution * deviation_scale(axis.unit),
    )
    return replace(change, new=new, skipped=None, findings=(*change.findings, *said))
