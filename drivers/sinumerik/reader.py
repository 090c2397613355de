"""Assignments -> CompensationTable and LiveSet: the meaning of table files and of back-ups.

Grid, clamp and memory rules: SINUMERIK FM Extended Functions 03/2013, K3, p. 236-242. Points are
0..k with k = (MAX-MIN)/STEP; what stands above k has no effect; a MAX beyond the memory is shortened.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal

from drivers.errors import FileFormatError, Gap
from drivers.sinumerik.grammar import Assignment, Listing, listing
from drivers.types import CompensationTable, LiveSet, LiveTable
from drivers.units import AxisUnit

Sign = Literal[1, -1]
SCALE = {"mm": Decimal(1000), "deg": Decimal(3600)}
_NEEDED = {"EEC": ("STEP", "MIN", "MAX"), "CEC": ("INPUT_AXIS", "OUTPUT_AXIS", "STEP", "MIN", "MAX")}
_WHOLE = Decimal("1e-9")


@dataclass(frozen=True, slots=True)
class TableFile:
    """What a table file holds: its tables in order of appearance, and the switches and backlash it sets."""

    tables: tuple[CompensationTable, ...]
    switches: Mapping[str, Decimal]


def read(text: str, where: str, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sign = 1) -> TableFile:
    """Read a table file strictly. Positions in the input axis' unit, deviations in um or arcsec.

    ``units`` gives the unit of each axis by name; what is missing is guessed by `axis_unit`. ``cec_sign``
    is the machine's proven CEC sign; without proof (+1) CEC deviations are the stored values themselves.
    Raises FileFormatError or Gap with line and reason (E-TABLE-...).
    """
    found = listing(text, where)
    if found.errors:
        raise found.errors[0]
    groups = groups_of(found)
    if not groups:
        raise FileFormatError("E-TABLE-EMPTY", where)
    reader = Reader(where, units or {}, cec_sign)
    tables = tuple(reader.strict(group) for group in groups.values())
    return TableFile(tables, switches_of(found))


def read_live(
    text: str,
    where: str,
    axis: str,
    encoder: int,
    units: Mapping[str, AxisUnit] | None = None,
    cec_sign: Sign = 1,
) -> LiveSet:
    """Read a back-up that the control wrote: every table that moves ``axis``, switches and backlash.

    Points beyond the end stay unused, as in the control; a table never loaded (STEP 0) is one zero point.
    Raises FileFormatError (E-TABLE-CUT) when the end word is missing: the file was not written to its end.
    """
    found = listing(text, where)
    if found.errors:
        raise found.errors[0]
    if not found.ended:
        raise FileFormatError("E-TABLE-CUT", where)
    switches, groups = switches_of(found), groups_of(found)
    reader = Reader(where, units or {}, cec_sign)
    eec = groups.get(f"EEC[{encoder},{axis}]")
    table = reader.live(eec) if eec else _never_loaded(axis, encoder, reader.unit(axis))
    enabled = bool(switches.get(f"$MA_ENC_COMP_ENABLE[{encoder},{axis}]", 0))
    cross = [reader.live(group) for group in groups.values() if group.function == "CEC"]
    return LiveSet(
        axis=axis,
        eec=LiveTable(table, enabled),
        cec=tuple(LiveTable(one, _cec_on(one, switches)) for one in cross if one.output_axis == axis),
        backlash=float(switches.get(f"$MA_BACKLASH[{encoder},{axis}]", 0)),
        native=text,
        digest=hashlib.sha256(text.encode()).hexdigest(),
    )


def axis_unit(axis: str, *, modulo: bool = False) -> AxisUnit:
    """The likely unit of an axis nobody described: deg for modulo tables and names beginning with A, B, C."""
    rotary = modulo or (axis[:1] in "ABC" and not axis.startswith("AX"))
    return "deg" if rotary else "mm"


def _cec_on(table: CompensationTable, switches: Mapping[str, Decimal]) -> bool:
    table_on = switches.get(f"$SN_CEC_TABLE_ENABLE[{table.index}]", 0)
    return bool(table_on and switches.get(f"$MA_CEC_ENABLE[{table.output_axis}]", 0))


def _never_loaded(axis: str, encoder: int, unit: AxisUnit) -> CompensationTable:
    return CompensationTable("EEC", axis, axis, 0.0, 0.0, 0.0, (0.0,), index=encoder, input_unit=unit, output_unit=unit)


@dataclass(slots=True)
class Group:
    """The raw assignments of one table."""

    function: Literal["EEC", "CEC"]
    index: int
    axis: str
    points: dict[int, Assignment]
    parameters: dict[str, Assignment]

    @property
    def label(self) -> str:
        return f"$AA_ENC_COMP[{self.index},..,{self.axis}]" if self.axis else f"$AN_CEC[{self.index},..]"


def groups_of(found: Listing) -> dict[str, Group]:
    """Sort point and parameter assignments by the table they belong to, in order of appearance."""
    groups: dict[str, Group] = {}
    for item in found.assignments:
        stem = next((stem for stem in ("$AA_ENC_COMP", "$AN_CEC") if item.name.startswith(stem)), "")
        if not stem:
            continue
        key = f"EEC[{item.numbers[0]},{item.axis}]" if item.axis else f"CEC[{item.numbers[0]}]"
        function: Literal["EEC", "CEC"] = "EEC" if item.axis else "CEC"
        group = groups.setdefault(key, Group(function, item.numbers[0], item.axis, {}, {}))
        if item.name == stem:
            group.points[item.numbers[1]] = item
        else:
            group.parameters[item.name.removeprefix(stem + "_")] = item
    return groups


def switches_of(found: Listing) -> dict[str, Decimal]:
    """Switches, weights and backlash by the place they are assigned to."""
    stems = ("$MA_", "$SN_")
    return {
        item.place: item.value
        for item in found.assignments
        if item.name.startswith(stems) and isinstance(item.value, Decimal)
    }


@dataclass(frozen=True, slots=True)
class Reader:
    """Turns raw tables into records; ``where`` names the text, ``units`` the unit of each axis by name."""

    where: str
    units: Mapping[str, AxisUnit]
    cec_sign: Sign

    def unit(self, axis: str, *, modulo: bool = False) -> AxisUnit:
        return self.units.get(axis) or axis_unit(axis, modulo=modulo)

    def strict(self, group: Group) -> CompensationTable:
        """A table in which every point 0..k stands, none is missing and none is left over."""
        for name in _NEEDED[group.function]:
            if name not in group.parameters:
                raise FileFormatError("E-TABLE-PARAMETER", self.where, table=group.label, name=name)
        last = self._intervals(group)
        beyond = [number for number in sorted(group.points) if number > last]
        if beyond:
            line = group.points[beyond[0]].line
            raise FileFormatError("E-TABLE-BEYOND", self.where, line=line, point=beyond[0], last=last)
        if len(group.points) <= last:  # counted first: a huge MAX must not make us walk to it
            missing = next(number for number in range(last + 1) if number not in group.points)
            raise Gap("E-TABLE-GAP", self.where, table=group.label, point=missing, last=last)
        return self._table(group, last, self._number(group, "MAX"))

    def live(self, group: Group) -> CompensationTable:
        """A table as the control sees it: shortened to the reserved points, leftovers unused."""
        step, low, high = self._grid(group)
        if step <= 0 or high < low or not group.points:
            return self._table(group, -1, high)
        last = int((high - low) / step + _WHOLE)
        reserved = max(group.points)
        return self._table(group, min(last, reserved), high if last <= reserved else low + reserved * step)

    def _intervals(self, group: Group) -> int:
        step, low, high = self._grid(group)
        table = group.label
        if step <= 0 or high <= low:
            raise FileFormatError("E-TABLE-GRID", self.where, table=table, step=step, low=low, high=high)
        intervals = (high - low) / step
        if abs(intervals - intervals.to_integral_value()) > _WHOLE:
            raise FileFormatError("E-TABLE-STEP", self.where, table=table, step=step, low=low, high=high)
        return int(intervals.to_integral_value())

    def _grid(self, group: Group) -> tuple[Decimal, Decimal, Decimal]:
        step, low, high = (self._number(group, name) for name in ("STEP", "MIN", "MAX"))
        return step, low, high

    def _table(self, group: Group, last: int, high: Decimal) -> CompensationTable:
        output = group.axis or self._text(group, "OUTPUT_AXIS")
        source = group.axis or self._text(group, "INPUT_AXIS")
        modulo = bool(self._number(group, "IS_MODULO")) and last > 0
        input_unit = self.unit(source, modulo=modulo)
        output_unit = input_unit if source == output else self.unit(output)
        low, step = self._number(group, "MIN"), self._number(group, "STEP")
        sign = self.cec_sign if group.function == "CEC" else 1
        direction = int(self._number(group, "DIRECTION"))
        if direction not in (-1, 0, 1):
            raise FileFormatError("E-TABLE-DIRECTION", self.where, table=group.label, value=direction)
        return CompensationTable(
            function=group.function,
            input_axis=source,
            output_axis=output,
            minimum=float(low),
            maximum=float(high),
            step=float(step),
            deviations=self._deviations(group, last, output_unit, sign),
            modulo=modulo,
            index=group.index,
            input_unit=input_unit,
            output_unit=output_unit,
            direction=1 if direction == 1 else -1 if direction == -1 else 0,
            multiply_by=int(self._number(group, "MULT_BY_TABLE")),
            table_type=int(self._number(group, "TYPE")),
        )

    def _deviations(self, group: Group, last: int, unit: AxisUnit, sign: Sign) -> tuple[float, ...]:
        values = [group.points[number].value if number in group.points else 0 for number in range(last + 1)]
        return tuple(float(Decimal(value) * SCALE[unit] * sign) + 0.0 for value in values) or (0.0,)

    def _number(self, group: Group, name: str) -> Decimal:
        item = group.parameters.get(name)
        return item.value if item is not None and isinstance(item.value, Decimal) else Decimal(0)

    def _text(self, group: Group, name: str) -> str:
        item = group.parameters.get(name)
        return str(item.value) if item is not None else ""
