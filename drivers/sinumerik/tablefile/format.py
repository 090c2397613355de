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
from drivers.sinumerik.tablefile import forms, layers, lint, reader, suspicion
from drivers.sinumerik.tablefile.archive import STOPS, Listing, listing
from drivers.sinumerik.tablefile.facts import facts_of
from drivers.sinumerik.tablefile.groups import (
    Group,
    Reader,
    groups_of,
    mixed_encoders,
    settings_of,
    units_of,
    unknown_axes,
)
from drivers.sinumerik.tablefile.inches import in_metric
from drivers.sinumerik.tablefile.opening import listed, opened
from drivers.sinumerik.tablefile.reader import Source, known_unit
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
        sources = opened(data, where)
        if not sources:
            return TableFile((), notes=(f"{where}: no member of the archive holds compensation data",))
        return reader.read_sources(sources, units)

    def members(self, data: bytes, where: str) -> tuple[ArchiveMember, ...]:
        """What an NC archive holds, in its order; nothing of any other file. Raises FileFormatError (E-ARCHIVE-...)."""
        return listed(data, where)

    def write(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str] = ()) -> str:
        """The text of tables in a form by name; CEC values carry the EEC convention, unproven.

        Raises ConfigError (E-TABLE-FORM, E-TABLE-FORM-AXIS), ValueOutOfRange (E-TABLE-FINITE).
        """
        return forms.render(TableFile(tuple(tables)), forms.named(form, comments))

    def findings(self, data: str | bytes, where: str, machine: TableMachine | None = None) -> tuple[TableFinding, ...]:
        """Everything wrong, doubtful or worth knowing in a table file, in the order of its lines; empty is clean.

        Raises ConfigError (E-TABLE-WHICH) for a control nobody knows.
        """
        known = machine or TableMachine()
        if known.control and known.control not in lint.CONTROLS:
            raise ConfigError("E-TABLE-WHICH", "control", control=known.control, known=", ".join(lint.CONTROLS))
        try:
            sources = opened(data, where)
        except FileFormatError as error:
            return (TableFinding("wrong", error),)
        if not sources:
            return (TableFinding("note", TableError("W-TABLE-NO-TABLES", where)),)
        return _of_sources(sources, known, where)


def _of_sources(sources: Sequence[Source], known: TableMachine, where: str) -> tuple[TableFinding, ...]:
    """Each text of its own, then what all of them do to each other; machine data of one are known to all."""
    taken = [listing(source.text, source.where) for source in sources]
    facts = facts_of(taken)
    units = {**facts.units, **known.units}
    known = replace(known, units=units, acting=facts.acting, reserved=facts.reserved, cross=facts.cross)
    problems: list[TableFinding] = []
    tables: list[CompensationTable] = []
    for source, found in zip(sources, taken, strict=True):
        acting, findings = _of_source(source, found, known)
        problems, tables = [*problems, *findings], [*tables, *acting]
    if all(found.by_control and not found.errors and not groups_of(found) for found in taken):
        problems.append(TableFinding("note", TableError("W-TABLE-NO-TABLES", where)))
    settings = {name: value for found in taken for name, value in settings_of(found).items()}
    if facts.names and any(found.by_control for found in taken):
        names = ", ".join(f"{axis} is {name}{_kind(facts.units.get(axis))}" for axis, name in facts.names.items())
        problems.append(TableFinding("note", TableError("W-TABLE-NAMES", where, names=names)))
    return (*problems, *layers.of_set(tables, settings, where))


def _kind(unit: AxisUnit | None) -> str:
    return {"mm": " (linear)", "deg": " (rotary)"}.get(unit or "", "")


def _of_source(
    source: Source, found: Listing, known: TableMachine
) -> tuple[list[CompensationTable], list[TableFinding]]:
    where, groups = source.where, groups_of(found)
    units = units_of(groups.values(), known.units)
    wrong: list[TrueflankError] = [*found.errors, *mixed_encoders(groups.values(), where)]
    try:
        groups = groups_of(in_metric(found, partial(known_unit, units), where))
    except FileFormatError as error:
        return [], [TableFinding("wrong", one) for one in (*wrong, error)]
    known = replace(known, units=units, unknown=unknown_axes(groups.values(), units))
    problems = [*(TableFinding("wrong", one) for one in wrong), *_of_text(found, where), *_of_units(known, where)]
    own, tables = Reader(where, units, 1, exact=False), []
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
    group: Group, own: Reader, where: str, known: TableMachine
) -> tuple[CompensationTable | None, list[TableFinding]]:
    place = f"{where}, line {group.line}"
    if group.never_loaded:
        return None, [TableFinding("note", TableError("W-TABLE-NEVER", place, table=group.label))]
    try:
        leftover = list(_leftovers(own, group, place))
        table = own.whole(group)
    except (FileFormatError, TableError) as error:
        return None, [TableFinding("wrong", error)]
    suspected = [] if known.unknown & {table.input_axis, table.output_axis} else suspicion.of_table(table, place)
    return table, [*leftover, *lint.of_table(table, place, known), *suspected]


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
