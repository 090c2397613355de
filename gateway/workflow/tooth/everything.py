"""How each axis will deviate once every proposed table acts, cross tables too, and the words for it; pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from drivers.message import Message, fixed
from drivers.types.tables import factors_of
from gateway.domain.proposals import TableChange
from gateway.table.comparison import taken_by_cross
from gateway.tooth import AxisOutlook


def outlooks(own: Sequence[TableChange], cross: Sequence[TableChange]) -> tuple[AxisOutlook, ...]:
    """One for each axis table's change, proposed or left alone, with the cross tables that are proposed.

    Measured was while no cross table acted between the site's axes, so what is proposed is all that will.
    """
    proposed = [one for one in cross if not one.skipped]
    tables = [one for one in own if one.new.kind == "axis"]
    return tuple(_outlook(one, [other for other in proposed if other.axis == one.axis]) for one in tables)


def told_of(found: Sequence[AxisOutlook]) -> Iterator[Message]:
    """What cross tables make of an axis, in words; nothing of an axis that none acts on."""
    for one in found:
        fields = {"axis": one.axis, "M": fixed(one.M), "U": fixed(one.M_U), "unit": one.unit}
        if one.spoilt:
            yield Message.of("S-TOOTH-AXIS-ACTING", alone=fixed(one.M_alone), **fields)
        for name, size in one.moved_by.items():
            yield Message.of("S-TOOTH-AXIS-MOVED", other=name, size=fixed(size), **fields)


def _outlook(own: TableChange, tables: Sequence[TableChange]) -> AxisOutlook:
    factors = factors_of(one.new for one in tables)
    by_itself = [one.new for one in tables if one.new.input_axis == own.axis and one.new.index not in factors]
    deviation = own.predicted - taken_by_cross(by_itself, own.axis, own.targets)
    known = np.where(np.isfinite(deviation), deviation, np.nanmean(deviation))
    ends = own.predicted_U[[int(np.argmax(known)), int(np.argmin(known))]]
    return AxisOutlook(
        axis=own.axis,
        unit=own.new.deviation_unit,
        targets=own.targets,
        deviation=deviation,
        U=own.predicted_U,
        M=float(np.nanmax(deviation) - np.nanmin(deviation)),
        M_U=float(np.hypot(*ends)),
        M_alone=float(np.nanmax(own.predicted) - np.nanmin(own.predicted)),
        moved_by={one.new.input_axis: float(np.ptp(one.new.deviations)) for one in tables if one.new not in by_itself},
    )
