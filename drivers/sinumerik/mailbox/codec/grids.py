"""CompensationTable <-> mailbox numbers: whole nm, 1e-7 deg, 0.1 um and 1e-6 deg, exact or refused.

The back-up over this road is text as a program of ours would write it: one strict reader serves both roads, and any
tool can load it again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any, Literal

from drivers.errors import Gap, TableError, ValueOutOfRange
from drivers.sinumerik.mailbox.codec.frames import MailboxOrder, Picture
from drivers.sinumerik.mailbox.codec.registers import HIGHEST, KINDS, LOWEST, Command, Kind, SwitchBit, TableFlag
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, backup_text
from drivers.sinumerik.tablefile.grammar import position_text, value_text
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit

VALUE_UNIT: Mapping[AxisUnit, Decimal] = {"mm": Decimal("1e-6"), "deg": Decimal("1e-7")}
POSITION_UNIT: Mapping[AxisUnit, Decimal] = {"mm": Decimal("1e-4"), "deg": Decimal("1e-6")}
WEIGHT_UNIT = Decimal("1e-6")


@dataclass(frozen=True, slots=True)
class MailboxAxis:
    """One machine axis as the PLC names it; ``number`` counts from 1, ``factor`` is MD32452."""

    number: int
    name: str
    unit: AxisUnit
    modulo: bool
    factor: Decimal = Decimal(1)

    @property
    def factor_known(self) -> bool:
        """Whether the PLC shows a factor that the control may hold (MD32452: 0.01 .. 100)."""
        return Decimal("0.01") <= self.factor <= 100


def to_whole_units(value: Decimal, unit: Decimal, table: CompensationTable, what: str) -> int:
    """``value`` (mm or deg) as a whole number of ``unit``.

    Raises ValueOutOfRange E-MBX-FRACTION (not expressible: nothing is rounded silently) or E-MBX-RANGE.
    """
    steps = value / unit
    fields: dict[str, Any] = {"table": table.name, "what": what, "value": value, "unit": unit}
    if steps != steps.to_integral_value():
        raise ValueOutOfRange("E-MBX-FRACTION", table.name, **fields)
    if not LOWEST <= steps <= HIGHEST:
        raise ValueOutOfRange("E-MBX-RANGE", table.name, **fields)
    return int(steps)


def as_loadable(table: CompensationTable) -> CompensationTable:
    """A table never loaded as two points of zero: the mailbox can empty a table, but not take its grid away."""
    if table.kind == "reversal" or table.step > 0 or any(table.deviations):
        return table
    return replace(table, minimum=0.0, maximum=1.0, step=1.0, deviations=(0.0, 0.0), modulo=False)


def begin_order(table: CompensationTable, points: int, axes: Mapping[str, MailboxAxis]) -> MailboxOrder:
    """Command 2 for a table of ``points`` points, or of a reversal's one value.

    Registers 18-28 and 31-33 serve commands 3 and 4 as well.

    Raises ValueOutOfRange, Gap (E-TABLE-STEP) and TableError (E-MBX-KIND) for what the map cannot say.
    """
    if table.kind == "reversal":
        return replace(naming_order(table, axes, Command.BEGIN), total=1)
    unit = POSITION_UNIT[axes[table.input_axis].unit]
    low, step, high = (
        to_whole_units(Decimal(repr(float(value))), unit, table, what)
        for what, value in (("MIN", table.minimum), ("STEP", table.step), ("MAX", table.maximum))
    )
    # The control counts k = floor((MAX - MIN) / STEP); points above k have no effect.
    if step <= 0 or not 0 <= high - low - step * (points - 1) < step:
        grid: dict[str, Any] = {"step": table.step, "low": table.minimum, "high": table.maximum}
        raise Gap("E-TABLE-STEP", table.name, table=table.name, **grid)
    named = naming_order(table, axes)
    return MailboxOrder(
        command=Command.BEGIN,
        kind=named.kind,
        index=named.index,
        encoder=named.encoder,
        flags=flags_of(table),
        minimum=low,
        step=step,
        maximum=high,
        total=points,
        first=0,
        count=0,
        input_axis=named.input_axis,
        output_axis=named.output_axis,
        multiply_by=table.multiply_by,
    )


def naming_order(
    table: CompensationTable, axes: Mapping[str, MailboxAxis], command: Command = Command.SELECT
) -> MailboxOrder:
    """A command that names a table and nothing of what is in it."""
    output = axes[table.output_axis].number
    if table.kind != "cross":
        return MailboxOrder(command, KINDS[table.kind], output, table.index)
    return MailboxOrder(command, Kind.CEC, table.index, input_axis=axes[table.input_axis].number, output_axis=output)


def flags_of(table: CompensationTable) -> int:
    """Register 21 of a table. Raises TableError (E-MBX-KIND) for a direction or type that EEC does not have."""
    direction = {0: 0, 1: TableFlag.POSITIVE, -1: TableFlag.NEGATIVE}[table.direction]
    if table.table_type not in (0, 1) or (table.kind == "axis" and (direction or table.table_type)):
        raise TableError("E-MBX-KIND", table.name, table=table.name)
    return int((TableFlag.MODULO if table.modulo else 0) | direction | (TableFlag.CYLINDER if table.table_type else 0))


def numbers_of(table: CompensationTable, values: Sequence[Decimal], axis: MailboxAxis) -> tuple[int, ...]:
    """Stored values (mm or deg) of an output ``axis`` as nm or 1e-7 deg. Raises as `to_whole_units`.

    Of a reversal MD32450, which the control multiplies with the factor of the axis: the nearest one that there is.
    Raises TableError (E-MBX-FACTOR) where that factor is none.
    """
    unit = axis.unit
    if table.kind == "reversal":
        if not axis.factor_known:
            raise TableError("E-MBX-FACTOR", table.name, axis=axis.name, factor=axis.factor)
        shared = (value / axis.factor / VALUE_UNIT[unit] for value in values)
        values = [each.to_integral_value(ROUND_HALF_EVEN) * VALUE_UNIT[unit] for each in shared]
    return tuple(to_whole_units(value, VALUE_UNIT[unit], table, f"point {place}") for place, value in enumerate(values))


@dataclass(frozen=True, slots=True)
class StoredTable:
    """One table as read back: the picture it came with and all reserved points."""

    kind: Literal["axis", "cross"]
    picture: Picture
    points: tuple[int, ...]


def mailbox_backup_text(tables: Sequence[StoredTable], axes: Mapping[int, MailboxAxis], saving: BackupFile) -> str:
    """Loadable text of tables, switches and backlash of one axis, as a program of ours would have written it."""
    axis = next(one for one in axes.values() if one.name == saving.axis)
    own, unit = tables[0].picture, VALUE_UNIT[axis.unit]
    backlash, *factor, eec_switch, cec_switch = backup.axis_settings(saving)
    values = {
        **dict.fromkeys(factor, value_text(axis.factor)),
        backlash: value_text(own.backlash * unit),
        eec_switch: str(int(SwitchBit.EEC in own.switches)),
        cec_switch: str(int(SwitchBit.CEC_AXIS in own.switches)),
    }
    for table in tables:
        values |= _eec(table, axis, saving) if table.kind == "axis" else _cec(table, axes)
    return backup_text(saving, values)


def reserved_points_of(tables: Sequence[StoredTable]) -> ReservedPoints:
    """What the tables that were read have reserved; tables that were not read count as none."""
    cross = {table.picture.selection.index: len(table.points) for table in tables if table.kind == "cross"}
    return ReservedPoints(
        len(tables[0].points), tuple(cross.get(number, 0) for number in range(max(cross, default=-1) + 1))
    )


def _eec(table: StoredTable, axis: MailboxAxis, saving: BackupFile) -> dict[str, str]:
    places = backup.axis_points(saving).places
    values = {
        place: value_text(value * VALUE_UNIT[axis.unit]) for place, value in zip(places, table.points, strict=True)
    }
    return values | {
        f"$AA_ENC_COMP_{name}[{saving.encoder},{axis.name}]": value for name, value in _grid(table, axis.unit).items()
    }


def _cec(table: StoredTable, axes: Mapping[int, MailboxAxis]) -> dict[str, str]:
    grid, index = table.picture.grid, table.picture.selection.index
    source, output = axes[grid.input_axis], axes[grid.output_axis]
    unit = VALUE_UNIT[output.unit]
    direction = {0: 0, TableFlag.POSITIVE: 1, TableFlag.NEGATIVE: -1}[TableFlag(grid.flags & 6)]
    parameters = {
        "INPUT_AXIS": f"({source.name})",
        "OUTPUT_AXIS": f"({output.name})",
        **_grid(table, source.unit),
        "DIRECTION": str(direction),
        "MULT_BY_TABLE": str(grid.multiply_by),
        "TYPE": str(int(bool(grid.flags & TableFlag.CYLINDER))),
    }
    switch, weight = backup.cross_switches(index)
    return {
        **{f"$AN_CEC[{index},{place}]": value_text(value * unit) for place, value in enumerate(table.points)},
        **{f"$AN_CEC_{name}[{index}]": value for name, value in parameters.items()},
        switch: str(int(SwitchBit.CEC_TABLE in table.picture.switches)),
        weight: value_text(table.picture.weight * WEIGHT_UNIT),
    }


def _grid(table: StoredTable, unit: AxisUnit) -> dict[str, str]:
    grid, scale = table.picture.grid, POSITION_UNIT[unit]
    return {
        "STEP": position_text(grid.step * scale),
        "MIN": position_text(grid.minimum * scale),
        "MAX": position_text(grid.maximum * scale),
        "IS_MODULO": str(grid.flags & TableFlag.MODULO),
    }
