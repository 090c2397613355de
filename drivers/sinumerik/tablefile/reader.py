"""Whole texts of anybody -> TableFile: machine data, assignments grouped by table, tables with their grid.

Tables are restored only from files of our own programs (`drivers.sinumerik.ncprogram.backup`), never from what is read
here. Grid, clamp and memory rules: SINUMERIK FM Extended Functions 03/2013, K3, p. 236-242. Points are 0..k with
k = (MAX-MIN)/STEP; points above k have no effect; a MAX beyond the memory is shortened.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial
from typing import Any, Literal

from drivers.errors import FileFormatError, Gap
from drivers.message import Message
from drivers.sinumerik.tablefile.grammar import VARIABLES, Assignment
from drivers.sinumerik.tablefile.listing import Listing, convert_to_metric, read_listing
from drivers.sinumerik.terms import SINUMERIK
from drivers.tablefile import TableFile
from drivers.types.tables import CompensationTable
from drivers.types.values import Sense
from drivers.units import AxisUnit

# What machine data of a file say of its machine: names, units, encoders and memory of the axes, size of CEC tables.
#
# MD10000 machine axis names (an empty name: no axis of that number), MD30200 encoders of an axis, MD30300 rotary,
# MD32700 which measuring system's table acts, MD38000 and MD18342 reserved points. A file may hold all of them, some
# or none.

NAMES, ROTARY, ENCODERS = "$MN_AXCONF_MACHAX_NAME_TAB", "$MA_IS_ROT_AX", "$MA_NUM_ENCS"
ENABLED, RESERVED, CROSS = "$MA_ENC_COMP_ENABLE", "$MA_MM_ENC_COMP_MAX_POINTS", "$MN_MM_CEC_MAX_POINTS"


@dataclass(frozen=True, slots=True)
class MachineFacts:
    """By axis as the file names it (AX1 or X1); ``names`` gives the machine axis name of AXn.

    ``reserved`` by (encoder index, axis), ``cross`` by table number; what is not in the file is not in here.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, AxisUnit] = field(default_factory=dict)
    acting: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    reserved: Mapping[tuple[int, str], int] = field(default_factory=dict)
    cross: Mapping[int, int] = field(default_factory=dict)


def read_machine_facts(listings: Iterable[Listing]) -> MachineFacts:
    """What the machine data of these texts say; the last word counts, as in the control."""
    items = [item for found in listings for item in found.assignments]
    names = {f"AX{item.numbers[0] + 1}": str(item.value) for item in items if item.name == NAMES and item.value}
    rotary = {item.axis: item.value for item in items if item.name == ROTARY}
    units: dict[str, AxisUnit] = {axis: "deg" if value else "mm" for axis, value in rotary.items()}
    units |= {names[axis]: unit for axis, unit in units.items() if axis in names}
    return MachineFacts(
        names,
        units,
        acting=_acting(items),
        reserved={(item.numbers[0], item.axis): _whole(item) for item in items if item.name == RESERVED},
        cross={item.numbers[0]: _whole(item) for item in items if item.name == CROSS},
    )


def _acting(items: Iterable[Assignment]) -> dict[str, tuple[int, ...]]:
    """The encoder indices whose table is switched on by MD32700, for every axis of which the file says both."""
    on: dict[str, dict[int, bool]] = {}
    count = {item.axis: _whole(item) for item in items if item.name == ENCODERS}
    for item in items:
        if item.name == ENABLED:
            on.setdefault(item.axis, {})[item.numbers[0]] = bool(item.value)
    return {
        axis: tuple(encoder for encoder in sorted(switched) if switched[encoder] and encoder < count.get(axis, 2))
        for axis, switched in on.items()
    }


def _whole(item: Assignment) -> int:
    return int(item.value) if isinstance(item.value, Decimal) else 0


# Assignments sorted by the table they belong to, and one such group -> CompensationTable.
#
# Grid, clamp and memory rules: SINUMERIK FM Extended Functions 03/2013, K3, p. 236-242. Points are 0..k with k = (MAX-
# MIN)/STEP; what stands above k has no effect; a MAX beyond the memory is shortened.

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
class TableGroup:
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


def group_assignments(found: Listing) -> dict[str, TableGroup]:
    """Sort point and parameter assignments by the table they belong to, in order of appearance."""
    groups: dict[str, TableGroup] = {}
    for item in found.assignments:
        if item.name[:4] not in ("$AA_", "$AN_") or item.name in _OTHER_COMPUTERS:
            continue
        stem = "$AN_CEC" if item.name[2] == "N" else "$AA_ENC_COMP"
        index, axis = item.numbers[0], item.axis
        key = f"{SINUMERIK.own}[{index},{axis}]" if axis else f"CEC[{index}]"
        group = groups.get(key)
        if group is None:
            group = groups[key] = TableGroup(
                "axis" if axis else "cross", index, axis=axis, line=item.line, points={}, parameters={}
            )
        if item.name == stem:
            group.points[item.numbers[1]] = item
        else:
            group.parameters[item.name[len(stem) + 1 :]] = item
    return groups


def assigned_settings(found: Listing) -> dict[str, Decimal]:
    """Switches, weights, backlash, temperature and link numbers by the place they are assigned to; no facts."""
    return {
        item.place: item.value
        for item in found.assignments
        if isinstance(item.value, Decimal)
        and not VARIABLES[item.name].fact
        and (item.name.startswith(("$MA_", "$SN_", "$SA_")) or item.name in _OTHER_COMPUTERS)
    }


def find_mixed_encoders(groups: Iterable[TableGroup], where: str) -> list[FileFormatError]:
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


def unknown_axes(groups: Iterable[TableGroup], units: Mapping[str, AxisUnit]) -> frozenset[str]:
    """Axes of loaded tables of which neither file, machine data nor anybody else says the unit."""
    loaded = [group for group in groups if not group.never_loaded]
    names = {name for group in loaded for name in (group.axis, _text(group, "INPUT_AXIS"), _text(group, "OUTPUT_AXIS"))}
    return frozenset(name for name in names if is_numbered(name) and name not in units)


def units_of(groups: Iterable[TableGroup], known: Mapping[str, AxisUnit]) -> dict[str, AxisUnit]:
    """Units by axis: what is known, and deg for every input axis of a modulo table of the same file."""
    found = dict(known)
    for group in groups:
        modulo = group.parameters.get("IS_MODULO")
        if modulo is not None and modulo.value == 1:
            source = group.axis or _text(group, "INPUT_AXIS")
            found.setdefault(source, "deg")
    return found


@dataclass(frozen=True, slots=True)
class TableReader:
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

    def strict(self, group: TableGroup) -> CompensationTable:
        """A table in which every point 0..k stands, none is missing and none is left over."""
        beyond = self.beyond(group)
        if beyond:
            raise FileFormatError(
                "E-TABLE-BEYOND", self.where, line=group.points[beyond[0]].line, point=beyond[0], last=self.last(group)
            )
        return self.whole(group)

    def whole(self, group: TableGroup) -> CompensationTable:
        """A table in which every point 0..k stands; what is left over above k is not looked at."""
        last = self.last(group)
        if len(group.points) <= last or any(number not in group.points for number in range(last + 1)):
            missing = next(number for number in range(last + 1) if number not in group.points)
            near = group.points.get(missing - 1)
            line = near.line if near else group.line
            raise Gap("E-TABLE-GAP", self._at(line), line=line, table=group.label, point=missing, last=last)
        return self._table(group, last, _number(group, "MAX"))

    def beyond(self, group: TableGroup) -> list[int]:
        """Numbers of the points above k, in order."""
        last = self.last(group)
        return sorted(number for number in group.points if number > last)

    def live(self, group: TableGroup) -> CompensationTable:
        """A table as the control sees it: shortened to the reserved points, leftovers unused."""
        step, low, high = _grid(group)
        if step <= 0 or high < low or not group.points:
            return self._table(group, -1, high)
        last = int((high - low) / step + _WHOLE)
        reserved = max(group.points)
        return self._table(group, min(last, reserved), high if last <= reserved else low + reserved * step)

    def last(self, group: TableGroup) -> int:
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

    def _table(self, group: TableGroup, last: int, high: Decimal) -> CompensationTable:
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

    def _deviations(self, group: TableGroup, last: int, unit: AxisUnit) -> tuple[float, ...]:
        factor = SCALE[unit] * (self.cec_sign if group.kind == "cross" else 1)
        values = [group.points[number].value if number in group.points else 0 for number in range(last + 1)]
        return tuple(float(Decimal(value) * factor) + 0.0 for value in values) or (0.0,)


def _grid(group: TableGroup) -> tuple[Decimal, Decimal, Decimal]:
    return _number(group, "STEP"), _number(group, "MIN"), _number(group, "MAX")


def _number(group: TableGroup, name: str) -> Decimal:
    item = group.parameters.get(name)
    return item.value if item is not None and isinstance(item.value, Decimal) else _ZERO


def _text(group: TableGroup, name: str) -> str:
    item = group.parameters.get(name)
    return str(item.value) if item is not None else ""


# Whole files.


@dataclass(frozen=True, slots=True)
class TextSource:
    """One text of a file: where it stands, and what it holds."""

    where: str
    text: str


def read_tables(text: str, where: str, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sense = 1) -> TableFile:
    """Read a table file strictly. Positions in the input axis' unit, deviations in um or arcsec.

    ``units`` gives the unit of each axis by name; what is missing is guessed by `groups.axis_unit`. ``cec_sign``
    is the machine's proven CEC sign; without proof (+1) CEC deviations are the stored values themselves.
    What we never write, such as machine data that describe the machine, is refused.
    Raises FileFormatError or Gap with line and reason (E-TABLE-...).
    """
    found = _faultless(text, where)
    foreign = next((item for item in found.assignments if VARIABLES[item.name].fact), None)
    if foreign is not None:
        raise FileFormatError("E-TABLE-NAME", where, line=foreign.line, name=foreign.name)
    groups = group_assignments(found)
    if not found.assignments:
        raise _empty(found, where)
    reader = TableReader(where, units_of(groups.values(), units or {}), cec_sign)
    return TableFile(
        tuple(reader.strict(group) for group in groups.values()), assigned_settings(found), _lengths(found, reader)
    )


def read_tables_loosely(text: str, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
    """Read a file or a back-up as it would act: see `read_sources`."""
    return read_sources((TextSource(where, text),), units)


def read_sources(sources: Sequence[TextSource], units: Mapping[str, AxisUnit] | None = None) -> TableFile:
    """Texts of one machine as they would act: points above k and tables never loaded are left out.

    A step that does not divide the range acts as k = floor((MAX-MIN)/STEP), lengths under INCH are converted. What is
    left out or assumed is said in ``notes``. CEC deviations are the stored values. Raises as `read_tables`, and
    E-TABLE-INCH-AXIS.
    """
    listings = [_faultless(source.text, source.where) for source in sources]
    facts = read_machine_facts(listings)
    parts = [_part(source, found, facts, units or {}) for source, found in zip(sources, listings, strict=True)]
    return TableFile(
        tuple(table for part in parts for table in part.tables),
        _settings(parts),
        lengths={name: unit for part in parts for name, unit in part.lengths.items()},
        notes=tuple(note for part in parts for note in part.notes),
        names=facts.names,
        units=facts.units,
        unknown=frozenset(axis for part in parts for axis in part.unknown),
    )


def _settings(parts: Sequence[TableFile]) -> dict[str, Decimal]:
    """Settings of all parts; of an archive, which holds those of every axis and table, those that belong to a table."""
    settings = {name: value for part in parts for name, value in part.settings.items()}
    if len(parts) < 2:
        return settings
    tables = [table for part in parts for table in part.tables]
    axes = {axis for table in tables for axis in (table.input_axis, table.output_axis)}
    numbers = {str(table.index) for table in tables if table.kind == "cross"}
    ours = {"$MA": axes, "$SA": axes, "$SN": numbers, "$AN": numbers}
    return {name: value for name, value in settings.items() if _last_index(name) in ours.get(name[:3], axes)}


def _last_index(place: str) -> str:
    return place.rpartition("[")[2].rstrip("]").rpartition(",")[2]


def _part(source: TextSource, found: Listing, facts: MachineFacts, units: Mapping[str, AxisUnit]) -> TableFile:
    if not (found.assignments or found.by_control):
        raise _empty(found, source.where)
    groups = group_assignments(found)
    said = units_of(groups.values(), {**facts.units, **units})
    found = convert_to_metric(found, partial(known_unit, said), source.where)
    groups = group_assignments(found)
    unknown = unknown_axes(groups.values(), said)
    reader = TableReader(source.where, said, 1, exact=False)
    loaded = [group for group in groups.values() if not group.never_loaded]
    tables = tuple(reader.whole(group) for group in loaded)
    notes = (*_notes(reader, groups.values(), tables), *_doubts(groups, source.where, unknown))
    return TableFile(tables, assigned_settings(found), _lengths(found, reader), notes, unknown=unknown)


def _notes(reader: TableReader, groups: Iterable[TableGroup], tables: Sequence[CompensationTable]) -> list[Message]:
    notes = [Message.of("W-TABLE-FILE-NEVER", label=group.label) for group in groups if group.never_loaded]
    for group, table in zip((one for one in groups if not one.never_loaded), tables, strict=True):
        beyond = reader.beyond(group)
        if beyond:
            notes.append(Message.of("W-TABLE-BEYOND", label=group.label, count=len(beyond), beyond=beyond[0]))
        last = float(table.positions[-1])
        if abs(table.maximum - last) > 1e-9 * max(1.0, table.step):
            grid = Message.of("W-TABLE-STEP-RANGE", step=table.step, minimum=table.minimum, maximum=table.maximum)
            notes.append(Message.of("W-TABLE-ASSUMED", label=group.label, grid=grid, last=last))
    return notes


def _doubts(groups: Mapping[str, TableGroup], where: str, unknown: Iterable[str]) -> list[Message]:
    notes = [Message.of("W-TABLE-KIND-UNSAID", axis=axis) for axis in sorted(unknown)]
    return notes if groups else [*notes, Message.of("W-TABLE-FILE-NONE", file=where)]


def known_unit(units: Mapping[str, AxisUnit], axis: str) -> AxisUnit | None:
    """What is said of an axis or told by its name; None for a number (AX4) of which nobody says it."""
    return units.get(axis) or (None if is_numbered(axis) else axis_unit(axis))


def _lengths(found: Listing, reader: TableReader) -> dict[str, AxisUnit]:
    return {item.place: reader.unit(item.axis) for item in found.assignments if VARIABLES[item.name].length}


def _empty(found: Listing, where: str) -> FileFormatError:
    line = max(found.lines, 1)
    return FileFormatError("E-TABLE-EMPTY", f"{where}, line {line}", line=line)


def _faultless(text: str, where: str) -> Listing:
    found = read_listing(text, where)
    if found.errors:
        raise found.errors[0]
    mixed = find_mixed_encoders(group_assignments(found).values(), where)
    if mixed:
        raise mixed[0]
    return found
