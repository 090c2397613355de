"""Compensation table files for tools that need no hardware: lint, diff, convert (implements ports.TableFormat)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from drivers.errors import ConfigError, FileFormatError, TableError
from drivers.sinumerik.tablefile import forms, layers, lint, reader, suspicion
from drivers.sinumerik.tablefile.archive import Listing, listing
from drivers.sinumerik.tablefile.groups import Group, Reader, groups_of, mixed_encoders, settings_of, units_of
from drivers.tablefile import TableFile, TableFinding, TableMachine
from drivers.types import CompensationTable
from drivers.units import AxisUnit

_AXIS_HEADER = re.compile(r"%_N_(AX\d{1,2})_EEC_INI")


class TableFiles:
    """Reads, writes and judges table files of the SINUMERIK 840D family."""

    def read(self, text: str, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
        """A file or a back-up as it would act; `notes` say what does not. Raises FileFormatError, TableError."""
        return reader.read_loosely(text, where, units)

    def write(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str] = ()) -> str:
        """The text of tables in a form by name; CEC values carry the EEC convention, unproven.

        Raises ConfigError (E-TABLE-FORM, E-TABLE-FORM-AXIS), ValueOutOfRange (E-TABLE-FINITE).
        """
        return forms.render(TableFile(tuple(tables)), forms.named(form, comments))

    def findings(self, text: str, where: str, machine: TableMachine | None = None) -> tuple[TableFinding, ...]:
        """Everything wrong, doubtful or worth knowing in a table file, in the order of its lines; empty is clean.

        Raises ConfigError (E-TABLE-WHICH) for a control nobody knows.
        """
        known = machine or TableMachine()
        if known.control and known.control not in lint.CONTROLS:
            raise ConfigError("E-TABLE-WHICH", "control", control=known.control, known=", ".join(lint.CONTROLS))
        found = listing(text, where)
        groups = groups_of(found)
        problems = [TableFinding("wrong", error) for error in (*found.errors, *mixed_encoders(groups.values(), where))]
        problems += _of_text(found, where)
        tables: list[CompensationTable] = []
        own = Reader(where, units_of(groups.values(), known.units), 1)
        for group in groups.values():
            table, findings = _of_group(group, own, where, known)
            problems += findings
            tables += [table] if table else []
        return (*problems, *layers.of_set(tables, settings_of(found), where))


def _of_text(found: Listing, where: str) -> Iterator[TableFinding]:
    """What the text as such tells: nothing in it, cut off, ends, check sums, headers that do not fit."""
    if not found.assignments and not found.errors:
        yield TableFinding("wrong", FileFormatError("E-TABLE-EMPTY", where))
    elif found.assignments and not found.ended:
        yield TableFinding("wrong", FileFormatError("E-TABLE-CUT", where, line=found.lines))
    if len(found.ends) > max(len(found.headers), 1):
        words = ", ".join(f"{word} in line {line}" for line, word in found.ends[:4])
        yield TableFinding("doubtful", TableError("W-TABLE-ENDS", where, words=words))
    plain = [item.line for item in found.assignments if item.line not in found.checked]
    if found.checked and plain:
        count = len(plain)
        yield TableFinding("doubtful", TableError("W-TABLE-EDITED", where, line=plain[0], count=count))
    elif found.checked:
        yield TableFinding("note", TableError("W-TABLE-CHECK-SUMS", where, count=len(found.checked)))
    yield from _headers(found, where)


def _headers(found: Listing, where: str) -> Iterator[TableFinding]:
    marks = [*found.headers, (found.lines + 1, "")]
    for (line, name), (end, _next) in pairwise(marks):
        inside = [item for item in found.assignments if line < item.line < end]
        other = "$AN_CEC" if name.endswith("_EEC_INI") else "$AA_ENC" if name.endswith("_CEC_INI") else ""
        axis = _AXIS_HEADER.fullmatch(name)
        for item in inside:
            foreign = axis and item.name.startswith("$AA_") and re.fullmatch(r"AX\d+", item.axis)
            if (other and item.name.startswith(other)) or (axis and foreign and item.axis != axis[1]):
                fields: dict[str, Any] = {"line": item.line, "header": name, "place": item.place}
                yield TableFinding("doubtful", TableError("W-TABLE-HEADER", where, **fields))
                break


def _of_group(
    group: Group, own: Reader, where: str, known: TableMachine
) -> tuple[CompensationTable | None, list[TableFinding]]:
    place = f"{where}, line {group.line}"
    if group.only_step and group.never_loaded:
        return None, [TableFinding("note", TableError("W-TABLE-NEVER", place, table=group.label))]
    try:
        leftover = list(_leftovers(own, group, place))
        table = own.whole(group)
    except (FileFormatError, TableError) as error:
        return None, [TableFinding("wrong", error)]
    return table, [*leftover, *lint.of_table(table, place, known), *suspicion.of_table(table, place)]


def _leftovers(own: Reader, group: Group, where: str) -> Iterator[TableFinding]:
    """Points above k: harmless while they are zero, live again as soon as somebody widens the range."""
    beyond = own.beyond(group)
    if not beyond:
        return
    first, last = beyond[0], own.last(group)
    loaded = [number for number in beyond if group.points[number].value]
    if loaded:
        first = loaded[0]
        error = FileFormatError("E-TABLE-BEYOND", where, line=group.points[first].line, point=first, last=last)
        yield TableFinding("wrong", error)
    else:
        yield TableFinding("note", TableError("W-TABLE-LEFT", where, table=group.label, count=len(beyond), last=last))
