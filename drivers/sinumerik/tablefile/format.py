"""Compensation table files for tools that need no hardware: lint, diff, convert (implements ports.TableFormat).

A text is one source; of an NC archive the members of the active NC data are, each under its own name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

from drivers.errors import ConfigError, FileFormatError, TableError, TrueflankError
from drivers.message import Message
from drivers.sinumerik.tablefile import lint, reader, writer
from drivers.sinumerik.tablefile.container import list_members, read_texts
from drivers.sinumerik.tablefile.listing import STOPS, Listing, convert_to_metric, read_listing
from drivers.sinumerik.tablefile.reader import (
    TableGroup,
    TableReader,
    TextSource,
    assigned_settings,
    find_mixed_encoders,
    group_assignments,
    known_unit,
    read_machine_facts,
    units_of,
    unknown_axes,
)
from drivers.tablefile import ArchiveMember, TableFile, TableFinding, TableMachine
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit

_AXIS_HEADER = re.compile(r"%_N_(AX\d{1,2})_EEC_INI")


class TableFiles:
    """Reads, writes and judges table files of the SINUMERIK 840D family."""

    def read(self, data: str | bytes, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
        """A file, a back-up or an NC archive as it would act; `notes` say what does not.

        Raises FileFormatError, TableError.
        """
        sources = read_texts(data, where)
        if not sources:
            return TableFile((), notes=(Message.of("W-ARCHIVE-NONE", file=where),))
        return reader.read_sources(sources, units)

    def members(self, data: bytes, where: str) -> tuple[ArchiveMember, ...]:
        """What an NC archive holds, in its order; nothing of any other file. Raises FileFormatError (E-ARCHIVE-...)."""
        return list_members(data, where)

    def write(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str] = ()) -> str:
        """The text of tables in a form by name; CEC values carry the EEC convention, unproven.

        Raises ConfigError (E-TABLE-FORM, E-TABLE-FORM-AXIS), ValueOutOfRange (E-TABLE-FINITE).
        """
        return writer.render_file(TableFile(tuple(tables)), writer.find_form(form, comments))

    def findings(self, data: str | bytes, where: str, machine: TableMachine | None = None) -> tuple[TableFinding, ...]:
        """Everything wrong, doubtful or worth knowing in a table file, in the order of its lines; empty is clean.

        Raises ConfigError (E-TABLE-WHICH) for a control nobody knows.
        """
        known = machine or TableMachine()
        if known.control and known.control not in lint.CONTROLS:
            raise ConfigError("E-TABLE-WHICH", "control", control=known.control, known=", ".join(lint.CONTROLS))
        try:
            sources = read_texts(data, where)
        except FileFormatError as error:
            return (TableFinding("wrong", error),)
        if not sources:
            return (TableFinding("note", TableError("W-TABLE-NO-TABLES", where)),)
        return _of_sources(sources, known, where)


def _of_sources(sources: Sequence[TextSource], known: TableMachine, where: str) -> tuple[TableFinding, ...]:
    """Each text of its own, then what all of them do to each other; machine data of one are known to all."""
    taken = [read_listing(source.text, source.where) for source in sources]
    facts = read_machine_facts(taken)
    units = {**facts.units, **known.units}
    known = replace(known, units=units, acting=facts.acting, reserved=facts.reserved, cross=facts.cross)
    problems: list[TableFinding] = []
    tables: list[CompensationTable] = []
    for source, found in zip(sources, taken, strict=True):
        acting, findings = _of_source(source, found, known)
        problems, tables = [*problems, *findings], [*tables, *acting]
    if all(found.by_control and not found.errors and not group_assignments(found) for found in taken):
        problems.append(TableFinding("note", TableError("W-TABLE-NO-TABLES", where)))
    settings = {name: value for found in taken for name, value in assigned_settings(found).items()}
    if facts.names and any(found.by_control for found in taken):
        names = ", ".join(f"{axis} is {name}{_kind(facts.units.get(axis))}" for axis, name in facts.names.items())
        problems.append(TableFinding("note", TableError("W-TABLE-NAMES", where, names=names)))
    return (*problems, *lint.lint_set(tables, settings, where))


def _kind(unit: AxisUnit | None) -> str:
    return {"mm": " (linear)", "deg": " (rotary)"}.get(unit or "", "")


def _of_source(
    source: TextSource, found: Listing, known: TableMachine
) -> tuple[list[CompensationTable], list[TableFinding]]:
    where, groups = source.where, group_assignments(found)
    units = units_of(groups.values(), known.units)
    wrong: list[TrueflankError] = [*found.errors, *find_mixed_encoders(groups.values(), where)]
    try:
        groups = group_assignments(convert_to_metric(found, partial(known_unit, units), where))
    except FileFormatError as error:
        return [], [TableFinding("wrong", one) for one in (*wrong, error)]
    known = replace(known, units=units, unknown=unknown_axes(groups.values(), units))
    problems = [*(TableFinding("wrong", one) for one in wrong), *_of_text(found, where), *_of_units(known, where)]
    own, tables = TableReader(where, units, 1, exact=False), []
    for group in groups.values():
        table, findings = _of_group(group, own, where, known)
        problems += findings
        tables += [table] if table else []
    return tables, problems


def _of_units(known: TableMachine, where: str) -> Iterator[TableFinding]:
    if known.unknown:
        axes = sorted(known.unknown)
        error = TableError("W-TABLE-UNIT", where, axes=", ".join(axes), axis=axes[0])
        yield TableFinding("doubtful", error)


def _of_text(found: Listing, where: str) -> Iterator[TableFinding]:
    """What the text as such tells: nothing in it, cut off, ends, check sums, headers that do not fit."""
    if not (found.assignments or found.errors or found.by_control):
        yield TableFinding("wrong", FileFormatError("E-TABLE-EMPTY", where))
    elif found.assignments and not found.ended:
        yield TableFinding("wrong", FileFormatError("E-TABLE-CUT", where, line=found.lines))
    if found.passed:
        error = TableError("W-TABLE-OTHER-DATA", where, count=found.passed, line=found.first_passed)
        yield TableFinding("note", error)
    ends = [one for one in found.ends if one[1] not in STOPS]
    for line, word in found.ends[:-1]:
        if word in STOPS:  # the control waits there for NC START, and reads on
            yield TableFinding("note", TableError("W-TABLE-STOP", where, line=line, word=word))
    if len(ends) > max(len(found.headers), 1):
        words = ", ".join(f"{word} in line {line}" for line, word in ends[:4])
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
    group: TableGroup, own: TableReader, where: str, known: TableMachine
) -> tuple[CompensationTable | None, list[TableFinding]]:
    place = f"{where}, line {group.line}"
    if group.never_loaded:
        return None, [TableFinding("note", TableError("W-TABLE-NEVER", place, table=group.label))]
    try:
        leftover = list(_leftovers(own, group, place))
        table = own.whole(group)
    except (FileFormatError, TableError) as error:
        return None, [TableFinding("wrong", error)]
    suspected = [] if known.unknown & {table.input_axis, table.output_axis} else lint.doubt_units(table, place)
    return table, [*leftover, *lint.lint_table(table, place, known), *suspected]


def _leftovers(own: TableReader, group: TableGroup, where: str) -> Iterator[TableFinding]:
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
