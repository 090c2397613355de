"""A file that a program of ours wrote -> LiveSet, believed only when it proves that it is whole and fresh.

It must begin with the section and number of the very run that was to write it, hold every line that
`drivers.sinumerik.ncprogram.backup` names, each once and in its order, and end with the count of them and the end word.
Nothing is filled in: a missing point is no zero, a missing switch not "off". Files of others are read elsewhere
(`drivers.sinumerik.tablefile.reader`) and are never what a table is restored from.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from drivers.errors import FileFormatError
from drivers.sinumerik.ncprogram import backup, reversing
from drivers.sinumerik.ncprogram.backup import END_WORD, Saving
from drivers.sinumerik.tablefile.archive import Listing
from drivers.sinumerik.tablefile.grammar import Assignment, assignment
from drivers.sinumerik.tablefile.groups import Reader, groups_of, settings_of, units_of
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense
from drivers.units import AxisUnit

_FIRST = re.compile(r";TRUEFLANK [A-Z]+ \d+ \w+ ENCODER \d", re.ASCII)
_LAST = re.compile(r"(;TRUEFLANK END [A-Z]+ \d+ LINES )(\d{1,9})", re.ASCII)
_SHOWN = 60
_MARKS = 2  # the lines after those that are counted


def read_written(
    text: str, where: str, saving: Saving, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sense = 1
) -> LiveSet:
    """Every table that moves the axis of ``saving``, its switches and backlash, from the file of that very run.

    ``units`` gives the unit of each axis by name, ``cec_sign`` is the machine's proven CEC sign. Points beyond the end
    stay unused, as in the control; an EEC table never loaded (STEP 0) is one zero point, a CEC table never loaded is
    not listed. The digest is that of what the file says: marks of the run are left out of it.
    Raises FileFormatError: E-SAVED-CUT (no begin or end), E-SAVED-OTHER (another run, section or axis), E-SAVED-COUNT,
    E-SAVED-LINE (missing, twice or out of order), and those of `grammar.assignment`.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    _check_marks(lines, saving, where)
    sheet = _Sheet(lines[:-_MARKS], where)
    loaded = _taken(sheet, saving)
    body = "\n".join((*lines[1:-_MARKS], END_WORD, ""))
    return _live_set(sheet, saving, loaded, units or {}, cec_sign, text, hashlib.sha256(body.encode()).hexdigest())


def text_of(saving: Saving, values: Mapping[str, str]) -> str:
    """The file that a program would have written, from values by place; a CEC table without points is never loaded.

    Raises KeyError for a place without value.
    """
    places = [*backup.own_points(saving).places, *backup.own_parameters(saving)]
    for table in backup.reserved_tables(saving.memory):
        whole = (*backup.cross_points(table, saving).places, *backup.cross_axes(table), *backup.cross_parameters(table))
        places += [*(whole if whole[0] in values else (backup.cross_step(table),)), *backup.cross_switches(table)]
    places += backup.axis_settings(saving)
    lines = [saving.first_line, *(f"{place}={values[place]}" for place in places)]
    return "\n".join([*lines, f"{saving.last_mark}{len(lines)}", END_WORD, ""])


def _check_marks(lines: list[str], saving: Saving, where: str) -> None:
    """Begin and end before all else: they say whose file it is and how long it must be."""
    if not lines or not _FIRST.fullmatch(lines[0]):
        raise _cut(where, 1, lines[0] if lines else "")
    if lines[0] != saving.first_line:
        raise _other(where, lines[0], saving.first_line)
    if lines[-1] != END_WORD:
        raise _cut(where, len(lines), lines[-1])
    match = _LAST.fullmatch(lines[-_MARKS])
    if match is None:
        raise _cut(where, len(lines) - 1, lines[-_MARKS])
    if match[1] != saving.last_mark:
        raise _other(where, lines[-_MARKS], saving.last_mark.rstrip())
    if int(match[2]) != len(lines) - _MARKS:
        raise FileFormatError("E-SAVED-COUNT", where, said=int(match[2]), count=len(lines) - _MARKS)


def _cut(where: str, line: int, text: str) -> FileFormatError:
    return FileFormatError("E-SAVED-CUT", where, line=line, text=text[:_SHOWN])


def _other(where: str, found: str, wanted: str) -> FileFormatError:
    return FileFormatError("E-SAVED-OTHER", where, found=found[:_SHOWN].lstrip(";"), wanted=wanted.lstrip(";"))


@dataclass(slots=True)
class _Sheet:
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
        item = assignment(self.lines[self.at], self.at + 1, self.where)
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


def _taken(sheet: _Sheet, saving: Saving) -> frozenset[int]:
    """Take every line that must be there; returns the numbers of the CEC tables that are loaded."""
    for place in (*backup.own_points(saving).places, *backup.own_parameters(saving)):
        sheet.take(place)
    loaded = frozenset(table for table in backup.reserved_tables(saving.memory) if _cross_taken(sheet, table, saving))
    for place in backup.axis_settings(saving):
        sheet.take(place)
    sheet.over()
    return loaded


def _cross_taken(sheet: _Sheet, table: int, saving: Saving) -> bool:
    """One CEC table: all of it, or the STEP 0 of one never loaded. Its switch and weight always."""
    step, points = backup.cross_step(table), backup.cross_points(table, saving).places
    never = sheet.next_is(step)
    whole = (*points, *backup.cross_axes(table), *backup.cross_parameters(table))
    for place in (step,) if never else whole:
        value = sheet.take(place).value
        if place == step and (value == 0) != never:
            sheet.at -= 1
            raise sheet.refused(f"{points[0]}, or {step}=0" if never else f"{step} other than 0")
        if place == backup.cross_axes(table)[1] and value not in backup.switched_axes(saving):
            sheet.at -= 1
            raise sheet.refused(f"{place} with a known axis")
    for place in backup.cross_switches(table):
        sheet.take(place)
    return not never


def _live_set(
    sheet: _Sheet,
    saving: Saving,
    loaded: frozenset[int],
    units: Mapping[str, AxisUnit],
    cec_sign: Sense,
    text: str,
    digest: str,
) -> LiveSet:
    found = Listing(
        tuple(sheet.items), (), ended=True, headers=(), ends=(), checked=frozenset(), lines=len(sheet.lines)
    )
    switches, groups = settings_of(found), groups_of(found)
    reader = Reader(sheet.where, units_of(groups.values(), units), cec_sign)
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
        backlash=float(switches[reversing.datum(encoder, axis)] * switches.get(reversing.factor(axis), Decimal(1))),
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
