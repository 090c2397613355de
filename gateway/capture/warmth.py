"""What temperature compensation did while an axis was measured, in words; pure."""

from __future__ import annotations

from drivers.message import Message
from drivers.types.tables import LiveSet
from drivers.types.values import FloatArray
from drivers.units import deviation_scale, deviation_unit


def warmth_said(live: LiveSet | None, targets: FloatArray) -> tuple[Message, ...]:
    """One note where it acts, or where nobody could read whether it does; none where nothing acts.

    ``targets`` (m,) in the axis unit.
    """
    if live is None or not targets.size:
        return ()
    shift, unit = live.temperature, live.own.table.output_unit
    if shift is None:
        return (Message.of("W-CAP-WARMTH-UNKNOWN", axis=live.axis),)
    scale = deviation_scale(unit)
    low, high = (float(targets[place]) for place in (0, -1))
    first, last = round(shift.at(low) * scale, 3), round(shift.at(high) * scale, 3)
    if not first and not last:
        return ()
    fields = {"low": low, "high": high, "first": first, "last": last, "unit": deviation_unit(unit)}
    return (Message.of("W-CAP-WARMTH", axis=live.axis, **fields),)
