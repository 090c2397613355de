"""Is a table within its limits: points, values, slopes, change against the live one; is a foreign table plausible?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from drivers.errors import Gap, TableError, TooManyPoints, ValueOutOfRange, words
from drivers.limits import Limits
from drivers.message import Form, Message, Quantity, digits, term
from drivers.terms import spoken
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit
from gateway.domain.proposals import FindingWeight, TableFinding
from gateway.domain.values import FloatArray
from gateway.table.comparison import acting_mean

BEYOND = 0.05  # of a table's range, at either end: targets are set off from an even grid by so much


def check_points(needed: int, reserved: int, axis: str, kind: Literal["axis", "cross"] = "axis") -> None:
    """Raise TooManyPoints (E-COMP-POINTS) when the controller reserved fewer points than needed.

    ``kind`` says whose memory that is; its name is the control's.
    """
    if needed > reserved:
        memory = term(spoken().own_memory if kind == "axis" else spoken().cross_memory)
        raise TooManyPoints("E-COMP-POINTS", axis, needed=needed, reserved=reserved, memory=memory)


def check(new: CompensationTable, live: CompensationTable, limits: Limits, axis: str) -> tuple[TableFinding, ...]:
    """Findings of a table against limits and against what acts now (`live`, all zero when switched off).

    Raises ValueOutOfRange: E-COMP-VALUE, E-COMP-SLOPE, E-COMP-CHANGE, with position and limit.
    """
    values = np.asarray(new.deviations)
    if not np.isfinite(values).all():
        raise ValueOutOfRange(
            "E-COMP-VALUE", axis, value=Message.of("W-GEAR-NOT-NUMBER"), at="", limit=limits.value, unit=""
        )
    _refuse("E-COMP-VALUE", values, new.positions, limits.value, new, axis)
    slopes = np.diff(values) / new.step
    middles = new.positions[:-1] + new.step / 2.0
    _refuse("E-COMP-SLOPE", slopes, middles, limits.slope, new, axis)
    _refuse("E-COMP-CHANGE", values - acting_mean(live, new.positions), new.positions, limits.change, new, axis)
    steepest = int(np.argmax(np.abs(slopes)))
    if abs(slopes[steepest]) <= limits.warn_slope:
        return ()
    return (
        interlock_finding(
            "W-COMP-STEEP",
            axis,
            slope=digits(slopes[steepest], 3),
            at=Quantity(middles[steepest]),
            limit=limits.warn_slope,
            unit=new.deviation_unit,
            per=new.input_unit,
        ),
    )


def check_reach(
    measured: tuple[float, float], table: tuple[float, float], unit: AxisUnit, axis: str, *, beyond: float = BEYOND
) -> None:
    """Raise Gap (E-COMP-REACH) where a table reaches beyond what was measured: no value is made up there.

    Ranges are (low, high) in mm or deg. Up to a share ``beyond`` of the table the end value is kept at either end, as
    a control does beyond its tables, and that is always said (W-COMP-FLAT).
    """
    (low, high), (minimum, maximum) = measured, table
    if max(low - minimum, maximum - high) > beyond * (maximum - minimum) + 1e-6:
        ends = {"low": f"{low:g}", "high": f"{high:g}", "minimum": f"{minimum:g}", "maximum": f"{maximum:g}"}
        raise Gap("E-COMP-REACH", axis, retryable=False, unit=unit, **ends)


def second_person_finding(code: str, axis: str, **fields: Any) -> TableFinding:
    """A finding that asks for a second person, by its code and fields."""
    return TableFinding(Message(code, fields, Form.ERROR, axis), FindingWeight.ASKS)


def interlock_finding(code: str, axis: str, **fields: Any) -> TableFinding:
    """A finding that an interlock judges by a limit of its own."""
    return TableFinding(Message(code, fields, Form.ERROR, axis), FindingWeight.JUDGED)


def reason(code: str, axis: str, **fields: Any) -> Message:
    """Why an axis gets no table, by code and fields, with what to do."""
    return Message(code, fields, Form.ERROR, axis)


def reasons_of(*several: Message) -> Message:
    """Several reasons as one; a single one stays as it is."""
    return several[0] if len(several) == 1 else Message.of("S-COMP-REASONS", reasons=several)


def _refuse(code: str, values: FloatArray, at: FloatArray, limit: float, table: CompensationTable, axis: str) -> None:
    worst = int(np.argmax(np.abs(values)))
    if abs(values[worst]) > limit:
        raise ValueOutOfRange(
            code,
            axis,
            value=f"{values[worst]:.4g}",
            at=f"{at[worst]:g} {table.input_unit}",
            limit=limit,
            unit=table.deviation_unit,
        )


# ---- Whether a table of another program can be one of a machine's errors: what no axis has is refused, what few have
# told.
#
# Its limits are wider than those of a push: a small mill's screw may well be off by more than we would load anywhere.

IMPLAUSIBLE = 5.0
"""How many times the largest value of a push no axis has: 1 mm, 900 arcsec."""


def implausible_values(tables: Sequence[CompensationTable]) -> tuple[str, ...]:
    """What is doubtful, in words: the largest value and the largest change from a point to its neighbour, once a table.

    Raises TableError (E-EXCHANGE-LARGE).
    """
    return tuple(told for table in tables for told in _doubts(table))


def _doubts(table: CompensationTable) -> list[str]:
    limits, at = Limits.of(table.output_unit), table.positions
    curves = np.asarray([table.deviations, table.reverse or table.deviations], dtype=np.float64)  # (2, m)
    sizes, jumps = np.abs(curves).max(axis=0), np.abs(np.diff(curves, axis=1)).max(axis=0)
    worst = int(sizes.argmax())
    told: dict[str, Any] = {"table": table.name, "axis_unit": table.input_unit, "unit": table.deviation_unit}
    seen: dict[str, Any] = {**told, "position": f"{at[worst]:g}", "value": f"{sizes[worst]:g}"}
    if sizes[worst] > IMPLAUSIBLE * limits.value:
        raise TableError("E-EXCHANGE-LARGE", table.name, limit=digits(IMPLAUSIBLE * limits.value, 6), **seen)
    found = []
    if sizes[worst] > limits.value:
        found.append(words("W-EXCHANGE-LARGE", limit=digits(limits.value, 6), **seen))
    if jumps.size and (beyond := jumps - limits.reversal - limits.slope * np.diff(at)).max() > 0.0:
        place = int(beyond.argmax())
        found.append(
            words(
                "W-EXCHANGE-JUMP",
                low=digits(at[place], 6),
                high=digits(at[place + 1], 6),
                change=digits(jumps[place], 6),
                **told,
            )
        )
    return found
