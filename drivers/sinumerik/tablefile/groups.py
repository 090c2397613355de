"""Assignments sorted by the table they belong to, and one such group -> CompensationTable.

Grid, clamp and memory rules: SINUMERIK FM Extended Functions 03/2013, K3, p. 236-242. Points are
0..k with k = (MAX-MIN)/STEP; what stands above k has no effect; a MAX beyond the memory is shortened.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal

from drivers.errors import FileFormatError, Gap
from drivers.sinumerik.tablefile.archive import Listing
from drivers.sinumerik.tablefile.grammar import Assignment
from drivers.sinumerik.tablefile.variables import VARIABLES
from drivers.sinumerik.terms import SINUMERIK
from drivers.types.tables import CompensationTable
from drivers.types.values import Sense
from drivers.units import AxisUnit

SCALE = {"mm": Decimal(1000), "deg": Decimal(3600)}
MOST_POINTS = 20_000
"""No control reserves more points for one table (840D: 5000); a file or a list that does is not believed."""
_NEEDED = {"axis": ("STEP", "MIN", "MAX"), "cross": ("INPUT_AXIS", "OUTPUT_AXIS", "STEP", "MIN", "MAX")}
_OTHER_COMPUTERS = ("$AN_CEC_INPUT_NCU", "$AN_CEC_OUTPUT_NCU")
GRID = ("STEP", "MIN", "MAX")
_NUMBERED = re.compile(r"AX\d+", re.ASCII)
_WHOLE = Decimal("1e-9")
_ZERO = Decimal(0)


@dataclass(slots=True)
class Group:
    """The raw assignments of one table; ``line`` is where it begins."""

    kind: Literal["axis", "cross"]
    index: int
    axis: str
    line: int
    points: dict[int, Assignment]
    parameters: dict[str, Assignment]

    @property
    def label(self) -> str:
        """The table as the control names it."""
        return f"$AA_ENC_COMP[{self.index},..,{self.axis}]" if self.axis else f"$AN_CEC[{self.index},..]"

    @property
    def never_loaded(self) -> bool:
        """STEP, MIN and MAX 0; or STEP 0 and nothing else, which is all that our own files say of such a table."""
        values = [self.parameters[name].value for name in GRID if name in self.parameters]
        return (len(values) == 3 or self.only_step) and not any(values)

    @property
    def only_step(self) -> bool:
        """Whether nothing but STEP is said of it."""
        return set(self.parameters) == {"STEP"} and not self.points


def groups_of(found: Listing) -> dict[str, Group]:
    """Sort point and parameter assignments by the table they belong to, in order of appearance."""
    groups: dict[str, Group] = {}
    for item in found.assignments:
        if item.name[:4] not in ("$AA_", "$AN_") or item.name in _OTHER_COMPUTERS:
            continue
        stem = "$AN_CEC" if item.name[2] == "N" else "$AA_ENC_COMP"
        index, axis = item.numbers[0], item.axis
        key = f"{SINUMERIK.own}[{index},{axis}]" if axis else f"CEC[{index}]"
        group = groups.get(key)
        if group is None:
            group = groups[key] = Group(
                "axis" if axis else "cross", index, axis=axis, line=item.line, points={}, parameters={}
            )
        if item.name == stem:
            group.points[item.numbers[1]] = item
        else:
            group.parameters[item.name[len(stem) + 1 :]] = item
    return groups


def settings_of(found: Listing) -> dict[str, Decimal]:
    """Switches, weights, backlash, temperature and link numbers by the place they are assigned to; no facts."""
    return {
        item.place: item.value
        for item in found.assignments
        if isinstance(item.value, Decimal)
        and not VARIABLES[item.name].fact
        and (item.name.startswith(("$MA_", "$SN_", "$SA_")) or item.name in _OTHER_COMPUTERS)
    }


def mixed_encoders(groups: Iterable[Group], where: str) -> list[FileFormatError]:
    """Points written for one encoder and parameters for the other: neither table is whole."""
    eec = [group for group in groups if group.kind == "axis"]
    points = {group.axis: group for group in eec if group.points and not group.parameters}
    bare = {group.axis: group for group in eec if group.parameters and not group.points}
    return [
        FileFormatError(
            "E-TABLE-MIX",
            f"{where}, line {bare[axis].line}",
            line=bare[axis].line,
            axis=axis,
            points=points[axis].index,
            parameters=bare[axis].index,
        )
        for axis in points
        if axis in bare
    ]


def axis_unit(axis: str, *, modulo: bool = False) -> AxisUnit:
    """The likely unit of an axis nobody described: deg for modulo tables and names beginning with A, B, C.

    AX1, AX2, ... tell nothing: see `is_numbered`; what is read as mm then is said to be unknown.
    """
    rotary = modulo or (axis[:1] in "ABC" and not axis.startswith("AX"))
    return "deg" if rotary else "mm"


def is_numbered(axis: str) -> bool:
    """AX1, AX2, ...: the number of an axis, which says nothing of what it is."""
    return bool(_NUMBERED.fullmatch(axis))


def unknown_axes(groups: Iterable[Group], units: Mapping[str, AxisUnit]) -> frozenset[str]:
    """Axes of loaded tables of which neither file, machine data nor anybody else says the unit."""
    loaded = [group for group in groups if not group.never_loaded]
    names = {name for group in loaded for name in (group.axis, _text(group, "INPUT_AXIS"), _text(group, "OUTPUT_AXIS"))}
    return frozenset(name for name in names if is_numbered(name) and name not in units)


def units_of(groups: Iterable[Group], known: Mapping[str, AxisUnit]) -> dict[str, AxisUnit]:
    """Units by axis: what is known, and deg for every input axis of a modulo table of the same file."""
    found = dict(known)
    for group in groups:
        modulo = group.parameters.get("IS_MODULO")
        if modulo is not None and modulo.value == 1:
            source = group.axis or _text(group, "INPUT_AXIS")
            found.setdefault(source, "deg")
    return found


@dataclass(frozen=True, slots=True)
class Reader:
    """Turns raw tables into records; ``where`` names the text, ``units`` the unit of each axis by name.

    ``exact``: the step must divide the range, as in what we write; else k = floor((MAX-MIN)/STEP), which is assumed.
    """

    where: str
    units: Mapping[str, AxisUnit]
    cec_sign: Sense
    exact: bool = True

    def unit(self, axis: str, *, modulo: bool = False) -> AxisUnit:
        """The unit of an axis, guessed if nobody said it."""
        return self.units.get(axis) or axis_unit(axis, modulo=modulo)

    def strict(self, group: Group) -> CompensationTable:
        """A table in which every point 0..k stands, none is missing and none is left over."""
        beyond = self.beyond(group)
        if beyond:
            raise FileFormatError(
                "E-TABLE-BEYOND", self.where, line=group.points[beyond[0]].line, point=beyond[0], last=self.last(group)
            )
        return self.whole(group)

    def whole(self, group: Group) -> CompensationTable:
        """A table in which every point 0..k stands; what is left over above k is not looked at."""
        last = self.last(group)
        if len(group.points) <= last or any(number not in group.points for number in range(last + 1)):
            missing = next(number for number in range(last + 1) if number not in group.points)
            near = group.points.get(missing - 1)
            line = near.line if near else group.line
            raise Gap("E-TABLE-GAP", self._at(line), line=line, table=group.label, point=missing, last=last)
        return self._table(group, last, _number(group, "MAX"))

    def beyond(self, group: Group) -> list[int]:
        """Numbers of the points above k, in order."""
        last = self.last(group)
        return sorted(number for number in group.points if number > last)

    def live(self, group: Group) -> CompensationTable:
        """A table as the control sees it: shortened to the reserved points, leftovers unused."""
        step, low, high = _grid(group)
        if step <= 0 or high < low or not group.points:
            return self._table(group, -1, high)
        last = int((high - low) / step + _WHOLE)
        reserved = max(group.points)
        return self._table(group, min(last, reserved), high if last <= reserved else low + reserved * step)

    def last(self, group: Group) -> int:
        """k = (MAX-MIN)/STEP. Raises FileFormatError (E-TABLE-PARAMETER, E-TABLE-GRID, E-TABLE-STEP)."""
        for name in _NEEDED[group.kind]:
            if name not in group.parameters:
                where = self._at(group.line)
                raise FileFormatError("E-TABLE-PARAMETER", where, line=group.line, table=group.label, name=name)
        step, low, high = _grid(group)
        line = group.parameters["STEP"].line
        fields: dict[str, Any] = {
            "line": line,
            "table": group.label,
            "step": float(step),
            "low": float(low),
            "high": float(high),
        }
        if step <= 0 or high <= low:
            raise FileFormatError("E-TABLE-GRID", self._at(line), **fields)
        intervals = (high - low) / step
        if int(intervals + _WHOLE) < 1 or (self.exact and abs(intervals - intervals.to_integral_value()) > _WHOLE):
            raise FileFormatError("E-TABLE-STEP", self._at(line), **fields)
        return int(intervals + _WHOLE)

    def _at(self, line: int) -> str:
        return f"{self.where}, line {line}"

    def _table(self, group: Group, last: int, high: Decimal) -> CompensationTable:
        if last >= MOST_POINTS:
            fields: dict[str, Any] = {"line": group.line, "table": group.label, "last": last, "limit": MOST_POINTS}
            raise FileFormatError("E-TABLE-SIZE", self._at(group.line), **fields)
        output = group.axis or _text(group, "OUTPUT_AXIS")
        source = group.axis or _text(group, "INPUT_AXIS")
        modulo = bool(_number(group, "IS_MODULO")) and last > 0
        input_unit = self.unit(source, modulo=modulo)
        output_unit = input_unit if source == output else self.unit(output)
        direction = int(_number(group, "DIRECTION"))
        return CompensationTable(
            kind=group.kind,
            input_axis=source,
            output_axis=output,
            minimum=float(_number(group, "MIN")),
            maximum=float(high),
            step=float(_number(group, "STEP")),
            deviations=self._deviations(group, last, output_unit),
            modulo=modulo,
            index=group.index,
            input_unit=input_unit,
            output_unit=output_unit,
            direction=1 if direction == 1 else -1 if direction == -1 else 0,
            multiply_by=int(_number(group, "MULT_BY_TABLE")),
            table_type=int(_number(group, "TYPE")),
        )

    def _deviations(self, group: Group, last: int, unit: AxisUnit) -> tuple[float, ...]:
        factor = SCALE[unit] * (self.cec_sign if group.kind == "cross" else 1)
        values = [group.points[number].value if number in group.points else 0 for number in range(last + 1)]
        return tuple(float(Decimal(value) * factor) + 0.0 for value in values) or (0.0,)


def _grid(group: Group) -> tuple[Decimal, Decimal, Decimal]:
    return _number(group, "STEP"), _number(group, "MIN"), _number(group, "MAX")


def _number(group: Group, name: str) -> Decimal:
    item = group.parameters.get(name)
    return item.value if item is not None and isinstance(item.value, Decimal) else _ZERO


def _text(group: Group, name: str) -> str:
    item = group.parameters.get(name)
    return str(item.value) if item is not None else ""
