"""Files of live tables: the blocks that save them, and the strict reader that believes a file only when it is whole.

A program writes the tables, switches and backlash of an axis to a file that can be loaded as a program. WRITE appends
one block, DELETE removes the old file (Job Planning manual; signatures as in the editor completion lists); STOPRE goes
before, because system variables are else read ahead of the axes. `BackupFile` and the lists of its variables define
every line that such a file must contain; the writer and `read_backup` both follow them::

    ;section and number of the run  |  each parameter, point and switch, in order  |  ;mark with the count  |  ;end word
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import groupby
from typing import Any, Literal

from drivers.errors import DeviceRefused, FileFormatError
from drivers.sinumerik.ncprogram.words import file_path
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import Assignment, read_assignment, value_text
from drivers.sinumerik.tablefile.listing import Listing
from drivers.sinumerik.tablefile.reader import TableReader, assigned_settings, group_assignments, units_of
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense
from drivers.units import AxisUnit

# The constant reversal of an axis in NC blocks: MD32450, which acts from NEWCONF on and is off where it is 0.
#
# One value, so half of it can never stand in the control: it is written only behind the release. What acts is MD32450
# x MD32452 (parameter set 0, that of an axis which is no spindle); so the program divides by that factor and compares
# the product. With bit 1 of MD32454 off, a cross table that moves the standing axis a micrometre back would take up
# the whole value there, in the middle of a stroke: a value that is loaded sets that bit, a way back leaves it.
# Sources: texts of MD32450, MD32452 and MD32454; activation NEW CONF by the same.

_HALF_UNIT = Decimal("0.0000005")


def backlash_datum(encoder: int, axis: str) -> str:
    """MD32450 of an axis' measuring system: on where it is not 0."""
    return f"$MA_BACKLASH[{encoder},{axis}]"


def backlash_factor(axis: str) -> str:
    """MD32452 of an axis in parameter set 0."""
    return f"$MA_BACKLASH_FACTOR[0,{axis}]"


def trial_blocks(table: CompensationTable, state: str) -> list[str]:
    """A trial value switched on or off at a stop, for the proof of its sign; ``state``: 1, 0 or what holds it."""
    (value,) = (Decimal(0),) if state == "0" else tables.stored_as_read(table)
    name, share = backlash_datum(table.index, table.output_axis), backlash_factor(table.output_axis)
    held = "" if state in ("0", "1") else f"{state}*"
    return [
        "STOPRE",
        f"{name}={held}{_bracketed_value(value) if held else value_text(value)}/{share}",
        "NEWCONF",
        "STOPRE",
    ]


def _bracketed_value(value: Decimal) -> str:
    return f"({value_text(value)})" if value < 0 else value_text(value)


def backlash_mode(encoder: int, axis: str) -> str:
    """MD32454 of an axis' measuring system: bit 1 keeps the value from answering to movements of other tables."""
    return f"$MA_BACKLASH_MODE[{encoder},{axis}]"


def backlash_assignments(order: PushOrder) -> list[str]:
    """The blocks that write the value; it acts from the next NEWCONF on."""
    (value,) = tables.order_values(order)
    encoder, axis = order.table.index, order.table.output_axis
    deaf = [f"{backlash_mode(encoder, axis)}={backlash_mode(encoder, axis)} B_OR 2"] if order.purpose == "table" else []
    return [*deaf, f"{backlash_datum(encoder, axis)}={value_text(value)}/{backlash_factor(axis)}"]


def backlash_mismatches(order: PushOrder) -> list[str]:
    """Conditions that what stands there, with the factor, is another value, or answers to other tables' movements."""
    (value,) = tables.order_values(order)
    encoder, axis = order.table.index, order.table.output_axis
    hears = [f"({backlash_mode(encoder, axis)} B_AND 2)==0"] if order.purpose == "table" else []
    return [
        *hears,
        f"ABS({backlash_datum(encoder, axis)}*{backlash_factor(axis)}-({value_text(value)}))>{value_text(_HALF_UNIT)}",
    ]


# NC blocks that write live tables, switches and backlash of an axis to a file, loadable as a program.
#
# WRITE appends one block to a file, DELETE removes the old one (Job Planning manual; signatures as in the editor
# completion lists); STOPRE before, because system variables are read ahead of the axes else. What such a file must
# hold, line by line, stands here once: `write_blocks` believes a file only when it holds it.

Section = Literal["LIVE", "BACK", "READ"]
END_WORD = "M17"
_LONGEST_VALUE = 16  # equals sign, line end, and a number of 14 signs
_CEC_PARAMETERS = ("STEP", "MIN", "MAX", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO", "TYPE")
ERROR, POINT, _COUNTER, _CEC = "UERR", "UPOINT", "ULINES", "UCEC"
VARIABLES = f"{ERROR}, {POINT}, {_COUNTER}, {_CEC}"


@dataclass(frozen=True, slots=True)
class ReservedPoints:
    """What the control reserved: EEC points of the axis' encoder (MD38000), CEC points by table (MD18342).

    ``axes`` are the machine axis names: a program can compare values of type AXIS, but not write them down.
    ``file_kb`` is how large a written file may become (MD11420), 0 where that is not known.
    """

    eec_points: int
    cec_points: tuple[int, ...] = ()
    axes: tuple[str, ...] = ()
    file_kb: int = 0


@dataclass(frozen=True, slots=True)
class BackupFile:
    """One file of ours: which run wrote it, and of what. ``number`` is the program's transaction number or token.

    ``factor``: MD32452 stands in it; a road that cannot read that factor writes no line for it.
    """

    section: Section
    number: int
    axis: str
    encoder: int
    memory: ReservedPoints
    factor: bool = True

    @property
    def path(self) -> str:
        """Where the program writes it."""
        return file_path(self.section, self.axis)

    @property
    def first_line(self) -> str:
        """A comment to the control: whose file this is."""
        return f";TRUEFLANK {self.section} {self.number} {self.axis} ENCODER {self.encoder}"

    @property
    def last_mark(self) -> str:
        """The comment before the end word, up to the count of the lines before it."""
        return f";TRUEFLANK END {self.section} {self.number} LINES "


@dataclass(frozen=True, slots=True)
class PointRange:
    """The reserved points of one table: names ``left`` number ``right``, numbers from 0."""

    left: str
    right: str
    count: int

    @property
    def places(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(f"{self.left}{number}{self.right}" for number in range(self.count))


def axis_points(saving: BackupFile) -> PointRange:
    """Points of the axis' EEC table."""
    return PointRange(f"$AA_ENC_COMP[{saving.encoder},", f",{saving.axis}]", saving.memory.eec_points)


def axis_parameters(saving: BackupFile) -> tuple[str, ...]:
    """Parameters of the axis' EEC table; none where nothing is reserved."""
    names = ("STEP", "MIN", "MAX", "IS_MODULO") if saving.memory.eec_points else ()
    return tuple(f"$AA_ENC_COMP_{name}[{saving.encoder},{saving.axis}]" for name in names)


def cross_points(table: int, saving: BackupFile) -> PointRange:
    """Points of a CEC table."""
    return PointRange(f"$AN_CEC[{table},", "]", saving.memory.cec_points[table])


def cross_axes(table: int | str) -> tuple[str, ...]:
    """Input and output axis of a CEC table."""
    return f"$AN_CEC_INPUT_AXIS[{table}]", f"$AN_CEC_OUTPUT_AXIS[{table}]"


def cross_parameters(table: int | str) -> tuple[str, ...]:
    """The other parameters of a CEC table."""
    return tuple(f"$AN_CEC_{name}[{table}]" for name in _CEC_PARAMETERS)


def cross_step(table: int | str) -> str:
    """What alone is written of a CEC table that was never loaded: its STEP, which is 0."""
    return f"$AN_CEC_STEP[{table}]"


def cross_switches(table: int | str) -> tuple[str, ...]:
    """SD41300 and SD41310 of a CEC table, loaded or not."""
    return f"$SN_CEC_TABLE_ENABLE[{table}]", f"$SN_CEC_TABLE_WEIGHT[{table}]"


def axis_settings(saving: BackupFile) -> tuple[str, ...]:
    """Backlash with its factor, EEC and CEC switch of the axis, the CEC switch of every other: tables may act there."""
    own = f"[{saving.encoder},{saving.axis}]"
    switches = (f"$MA_CEC_ENABLE[{axis}]" for axis in switched_axes(saving))
    factor = (backlash_factor(saving.axis),) if saving.factor else ()
    return f"$MA_BACKLASH{own}", *factor, f"$MA_ENC_COMP_ENABLE{own}", *switches


def switched_axes(saving: BackupFile) -> tuple[str, ...]:
    """The axes whose CEC switch is written, the file's own first."""
    return tuple(dict.fromkeys((saving.axis, *saving.memory.axes)))


def reserved_tables(memory: ReservedPoints) -> tuple[int, ...]:
    """Numbers of the CEC tables that have memory."""
    return tuple(table for table, points in enumerate(memory.cec_points) if points)


def backup_blocks(saving: BackupFile, failed: str) -> list[str]:
    """Blocks that write everything which moves the axis to its file; they jump to ``failed`` if they cannot.

    They use the integers `VARIABLES`, which the program must define. All reserved points are written, so that
    leftovers beyond the end of a table are on record too. The lines are counted as they are written.
    Raises DeviceRefused (E-NC-FILE-LIMIT) where the file would outgrow what the control lets a file become.
    """
    _check_size(saving)
    write = _BlockWriter(saving.path, failed)
    out = [f'DELETE({ERROR},"{saving.path}")', "STOPRE", f"{_COUNTER}=0", *write.text(f'"{saving.first_line}"')]
    if saving.memory.eec_points:
        out += [*write.points(axis_points(saving)), *write.values(axis_parameters(saving))]
    for run in _runs_of_equal_size(saving.memory):
        points = cross_points(run[0], saving).count
        if len(run) == 1:
            out += _cross_blocks(write, run[0], points, saving)
        else:
            out += [f"FOR {_CEC}={run[0]} TO {run[-1]}", *_cross_blocks(write, _CEC, points, saving), "ENDFOR"]
    out += write.values(axis_settings(saving))
    return [*out, *write.text(f'"{saving.last_mark}"<<{_COUNTER}'), *write.text(f'"{END_WORD}"')]


def _runs_of_equal_size(memory: ReservedPoints) -> Iterator[tuple[int, ...]]:
    """Numbers of CEC tables in a row that have equally many points: one loop writes them all."""
    for _, group in groupby(reserved_tables(memory), key=lambda table: memory.cec_points[table]):
        numbers = tuple(group)
        rows = groupby(enumerate(numbers), key=lambda item: item[1] - item[0])
        yield from (tuple(number for _, number in row) for _, row in rows)


def file_size(saving: BackupFile) -> int:
    """Bytes that the file has at most, all tables loaded and every number as long as numbers are."""
    places = [*axis_points(saving).places, *axis_parameters(saving), *axis_settings(saving)]
    for table in reserved_tables(saving.memory):
        places += [*cross_points(table, saving).places, *cross_parameters(table), *cross_switches(table)]
        places += cross_axes(table)
    marks = len(saving.first_line) + len(saving.last_mark) + len(END_WORD)
    return marks + sum(len(place) + _LONGEST_VALUE for place in places)


def required_kilobytes(savings: Iterable[BackupFile]) -> int:
    """What MD11420 must be for the largest of these files."""
    return max((-(-file_size(saving) // 1024) for saving in savings), default=1)


def _check_size(saving: BackupFile) -> None:
    needed, limit = required_kilobytes([saving]), saving.memory.file_kb
    if 0 < limit < needed:
        raise DeviceRefused("E-NC-FILE-LIMIT", saving.path, needed_kb=needed, limit_kb=limit, axis=saving.axis)


def _cross_blocks(write: _BlockWriter, table: int | str, points: int, saving: BackupFile) -> list[str]:
    """A CEC table, or the one whose number a variable holds; never loaded (STEP 0) it has no axes: its STEP says so."""
    inner = write.points(PointRange(f"$AN_CEC[{table},", "]", points))
    for name in cross_axes(table):
        for axis in saving.memory.axes:
            inner += [f"IF {name}==({axis})", *write.text(f'"{_variable_in_text(name)}=({axis})"'), "ENDIF"]
    inner += write.values(cross_parameters(table))
    never = write.values((cross_step(table),))
    switches = write.values(cross_switches(table))
    return [f"IF {cross_step(table)}<>0", *inner, "ELSE", *never, "ENDIF", *switches]


def _variable_in_text(name: str) -> str:
    """A name inside a text: the number of a table that a variable holds is put in when the program runs."""
    return name.replace(f"[{_CEC}", f'["<<{_CEC}<<"')


@dataclass(frozen=True, slots=True)
class _BlockWriter:
    path: str
    failed: str

    def text(self, *texts: str) -> list[str]:
        """A line for each text, counted once all of them are written."""
        out = [
            block
            for text in texts
            for block in (f'WRITE({ERROR},"{self.path}",{text})', f"IF {ERROR}<>0 GOTOF {self.failed}")
        ]
        return [*out, f"{_COUNTER}={_COUNTER}+{len(texts)}"]

    def values(self, names: Iterable[str]) -> list[str]:
        return self.text(*(f'"{_variable_in_text(name)}="<<{name}' for name in names))

    def points(self, points: PointRange) -> list[str]:
        left, right = points.left, points.right
        text = f'"{_variable_in_text(left)}"<<{POINT}<<"{right}="<<{left}{POINT}{right}'
        return [f"FOR {POINT}=0 TO {points.count - 1}", *self.text(text), "ENDFOR"]


# A file that a program of ours wrote -> LiveSet, believed only when it proves that it is whole and fresh.
#
# It must begin with the section and number of the very run that was to write it, hold every line that
# `drivers.sinumerik.ncprogram.backup` names, each once and in its order, and end with the count of them and the end
# word. Nothing is filled in: a missing point is no zero, a missing switch not "off". Files of others are read
# elsewhere (`drivers.sinumerik.tablefile.reader`) and are never what a table is restored from.

_FIRST = re.compile(r";TRUEFLANK [A-Z]+ \d+ \w+ ENCODER \d", re.ASCII)
_LAST = re.compile(r"(;TRUEFLANK END [A-Z]+ \d+ LINES )(\d{1,9})", re.ASCII)
_SHOWN = 60
_MARKS = 2  # the lines after those that are counted


def read_backup(
    text: str, where: str, saving: BackupFile, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sense = 1
) -> LiveSet:
    """Every table that moves the axis of ``saving``, its switches and backlash, from the file of that very run.

    ``units`` gives the unit of each axis by name, ``cec_sign`` is the machine's proven CEC sign. Points beyond the end
    stay unused, as in the control; an EEC table never loaded (STEP 0) is one zero point, a CEC table never loaded is
    not listed. The digest is that of what the file says: marks of the run are left out of it.
    Raises FileFormatError: E-SAVED-CUT (no begin or end), E-SAVED-OTHER (another run, section or axis), E-SAVED-COUNT,
    E-SAVED-LINE (missing, twice or out of order), and those of `grammar.read_assignment`.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    _check_marks(lines, saving, where)
    sheet = _BackupLines(lines[:-_MARKS], where)
    loaded = _take_lines(sheet, saving)
    body = "\n".join((*lines[1:-_MARKS], END_WORD, ""))
    return _live_set(sheet, saving, loaded, units or {}, cec_sign, text, hashlib.sha256(body.encode()).hexdigest())


def backup_text(saving: BackupFile, values: Mapping[str, str]) -> str:
    """The file that a program would have written, from values by place; a CEC table without points is never loaded.

    Raises KeyError for a place without value.
    """
    places = [*axis_points(saving).places, *axis_parameters(saving)]
    for table in reserved_tables(saving.memory):
        whole = (*cross_points(table, saving).places, *cross_axes(table), *cross_parameters(table))
        places += [*(whole if whole[0] in values else (cross_step(table),)), *cross_switches(table)]
    places += axis_settings(saving)
    lines = [saving.first_line, *(f"{place}={values[place]}" for place in places)]
    return "\n".join([*lines, f"{saving.last_mark}{len(lines)}", END_WORD, ""])


def _check_marks(lines: list[str], saving: BackupFile, where: str) -> None:
    """Begin and end before all else: they say whose file it is and how long it must be."""
    if not lines or not _FIRST.fullmatch(lines[0]):
        raise _cut_off_error(where, 1, lines[0] if lines else "")
    if lines[0] != saving.first_line:
        raise _other_file_error(where, lines[0], saving.first_line)
    if lines[-1] != END_WORD:
        raise _cut_off_error(where, len(lines), lines[-1])
    match = _LAST.fullmatch(lines[-_MARKS])
    if match is None:
        raise _cut_off_error(where, len(lines) - 1, lines[-_MARKS])
    if match[1] != saving.last_mark:
        raise _other_file_error(where, lines[-_MARKS], saving.last_mark.rstrip())
    if int(match[2]) != len(lines) - _MARKS:
        raise FileFormatError("E-SAVED-COUNT", where, said=int(match[2]), count=len(lines) - _MARKS)


def _cut_off_error(where: str, line: int, text: str) -> FileFormatError:
    return FileFormatError("E-SAVED-CUT", where, line=line, text=text[:_SHOWN])


def _other_file_error(where: str, found: str, wanted: str) -> FileFormatError:
    return FileFormatError("E-SAVED-OTHER", where, found=found[:_SHOWN].lstrip(";"), wanted=wanted.lstrip(";"))


@dataclass(slots=True)
class _BackupLines:
    """The lines before the count, taken one after the other; ``at`` is the place of the next."""

    lines: list[str]
    where: str
    at: int = 1
    items: list[Assignment] = field(default_factory=list)

    def next_is(self, place: str) -> bool:
        """Whether the next line assigns to this place."""
        return self.at < len(self.lines) and self.lines[self.at].startswith(f"{place}=")

    def take(self, place: str) -> Assignment:
        """The assignment that must stand here. Raises FileFormatError (E-SAVED-LINE...)."""
        if not self.next_is(place):
            raise self.refused(place)
        item = read_assignment(self.lines[self.at], self.at + 1, self.where)
        self.at += 1
        self.items.append(item)
        return item

    def refused(self, wanted: str) -> FileFormatError:
        text = self.lines[self.at][:_SHOWN] if self.at < len(self.lines) else "the end"
        return FileFormatError("E-SAVED-LINE", self.where, line=self.at + 1, text=text, wanted=wanted)

    def over(self) -> None:
        """Raises FileFormatError (E-SAVED-LINE) when a line is left."""
        if self.at < len(self.lines):
            raise self.refused("the end")


def _take_lines(sheet: _BackupLines, saving: BackupFile) -> frozenset[int]:
    """Take every line that must be there; returns the numbers of the CEC tables that are loaded."""
    for place in (*axis_points(saving).places, *axis_parameters(saving)):
        sheet.take(place)
    loaded = frozenset(table for table in reserved_tables(saving.memory) if _take_cross_table(sheet, table, saving))
    for place in axis_settings(saving):
        sheet.take(place)
    sheet.over()
    return loaded


def _take_cross_table(sheet: _BackupLines, table: int, saving: BackupFile) -> bool:
    """One CEC table: all of it, or the STEP 0 of one never loaded. Its switch and weight always."""
    step, points = cross_step(table), cross_points(table, saving).places
    never = sheet.next_is(step)
    whole = (*points, *cross_axes(table), *cross_parameters(table))
    for place in (step,) if never else whole:
        value = sheet.take(place).value
        if place == step and (value == 0) != never:
            sheet.at -= 1
            raise sheet.refused(f"{points[0]}, or {step}=0" if never else f"{step} other than 0")
        if place == cross_axes(table)[1] and value not in switched_axes(saving):
            sheet.at -= 1
            raise sheet.refused(f"{place} with a known axis")
    for place in cross_switches(table):
        sheet.take(place)
    return not never


def _live_set(
    sheet: _BackupLines,
    saving: BackupFile,
    loaded: frozenset[int],
    units: Mapping[str, AxisUnit],
    cec_sign: Sense,
    text: str,
    digest: str,
) -> LiveSet:
    found = Listing(
        tuple(sheet.items), (), ended=True, headers=(), ends=(), checked=frozenset(), lines=len(sheet.lines)
    )
    switches, groups = assigned_settings(found), group_assignments(found)
    reader = TableReader(sheet.where, units_of(groups.values(), units), cec_sign)
    axis, encoder = saving.axis, saving.encoder
    eec = groups.get(f"EEC[{encoder},{axis}]")
    table = reader.live(eec) if eec else never_loaded(axis, encoder, reader.unit(axis))
    cross = [reader.live(groups[f"CEC[{number}]"]) for number in sorted(loaded)]
    tables = [LiveTable(one, _cec_on(one, switches)) for one in cross]
    return LiveSet(
        axis=axis,
        own=LiveTable(table, bool(switches[f"$MA_ENC_COMP_ENABLE[{encoder},{axis}]"])),
        cross=tuple(one for one in tables if one.table.output_axis == axis),
        others=tuple(one for one in tables if one.table.output_axis != axis),
        backlash=float(switches[backlash_datum(encoder, axis)] * switches.get(backlash_factor(axis), Decimal(1))),
        native=text,
        digest=digest,
        sense=cec_sign,
    )


def _cec_on(table: CompensationTable, switches: Mapping[str, Decimal]) -> bool:
    table_on = switches[f"$SN_CEC_TABLE_ENABLE[{table.index}]"]
    return bool(table_on and switches[f"$MA_CEC_ENABLE[{table.output_axis}]"])


def never_loaded(axis: str, encoder: int, unit: AxisUnit) -> CompensationTable:
    """An EEC table with nothing in it."""
    nothing: dict[str, Any] = {"index": encoder, "input_unit": unit, "output_unit": unit}
    return CompensationTable(
        "axis", axis, output_axis=axis, minimum=0.0, maximum=0.0, step=0.0, deviations=(0.0,), **nothing
    )
