"""Whole texts of anybody -> TableFile. What a table is restored from is read strictly: see `written`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import partial

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.archive import Listing, listing
from drivers.sinumerik.tablefile.facts import Facts, facts_of
from drivers.sinumerik.tablefile.groups import (
    Group,
    Reader,
    axis_unit,
    groups_of,
    is_numbered,
    mixed_encoders,
    settings_of,
    units_of,
    unknown_axes,
)
from drivers.sinumerik.tablefile.inches import in_metric
from drivers.sinumerik.tablefile.variables import VARIABLES
from drivers.tablefile import TableFile
from drivers.types.tables import CompensationTable
from drivers.types.values import Sense
from drivers.units import AxisUnit

__all__ = ["Source", "TableFile", "known_unit", "read", "read_loosely", "read_sources"]


@dataclass(frozen=True, slots=True)
class Source:
    """One text of a file: where it stands, and what it holds."""

    where: str
    text: str


def read(text: str, where: str, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sense = 1) -> TableFile:
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
    groups = groups_of(found)
    if not found.assignments:
        raise _empty(found, where)
    reader = Reader(where, units_of(groups.values(), units or {}), cec_sign)
    return TableFile(
        tuple(reader.strict(group) for group in groups.values()), settings_of(found), _lengths(found, reader)
    )


def read_loosely(text: str, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
    """Read a file or a back-up as it would act: see `read_sources`."""
    return read_sources((Source(where, text),), units)


def read_sources(sources: Sequence[Source], units: Mapping[str, AxisUnit] | None = None) -> TableFile:
    """Texts of one machine as they would act: points above k and tables never loaded are left out.

    A step that does not divide the range acts as k = floor((MAX-MIN)/STEP), lengths under INCH are converted. What is
    left out or assumed is said in ``notes``. CEC deviations are the stored values. Raises as `read`, and
    E-TABLE-INCH-AXIS.
    """
    listings = [_faultless(source.text, source.where) for source in sources]
    facts = facts_of(listings)
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


def _part(source: Source, found: Listing, facts: Facts, units: Mapping[str, AxisUnit]) -> TableFile:
    if not (found.assignments or found.by_control):
        raise _empty(found, source.where)
    groups = groups_of(found)
    said = units_of(groups.values(), {**facts.units, **units})
    found = in_metric(found, partial(known_unit, said), source.where)
    groups = groups_of(found)
    unknown = unknown_axes(groups.values(), said)
    reader = Reader(source.where, said, 1, exact=False)
    loaded = [group for group in groups.values() if not group.never_loaded]
    tables = tuple(reader.whole(group) for group in loaded)
    notes = (*_notes(reader, groups.values(), tables), *_doubts(groups, source.where, unknown))
    return TableFile(tables, settings_of(found), _lengths(found, reader), notes, unknown=unknown)


def _notes(reader: Reader, groups: Iterable[Group], tables: Sequence[CompensationTable]) -> list[str]:
    notes = [f"{group.label}: never loaded (STEP 0)" for group in groups if group.never_loaded]
    for group, table in zip((one for one in groups if not one.never_loaded), tables, strict=True):
        beyond = reader.beyond(group)
        if beyond:
            notes.append(f"{group.label}: {len(beyond)} points from {beyond[0]} on do not act")
        last = float(table.positions[-1])
        if abs(table.maximum - last) > 1e-9 * max(1.0, table.step):
            grid = f"step {table.step:g} does not divide {table.minimum:g} .. {table.maximum:g}"
            notes.append(f"{group.label}: {grid}; assumed to act up to {last:g}")
    return notes


def _doubts(groups: Mapping[str, Group], where: str, unknown: Iterable[str]) -> list[str]:
    notes = [f"{axis}: linear or rotary is not said; values are as stored, mm or deg" for axis in sorted(unknown)]
    return notes if groups else [*notes, f"{where} holds no compensation table"]


def known_unit(units: Mapping[str, AxisUnit], axis: str) -> AxisUnit | None:
    """What is said of an axis or told by its name; None for a number (AX4) of which nobody says it."""
    return units.get(axis) or (None if is_numbered(axis) else axis_unit(axis))


def _lengths(found: Listing, reader: Reader) -> dict[str, AxisUnit]:
    return {item.place: reader.unit(item.axis) for item in found.assignments if VARIABLES[item.name].length}


def _empty(found: Listing, where: str) -> FileFormatError:
    line = max(found.lines, 1)
    return FileFormatError("E-TABLE-EMPTY", f"{where}, line {line}", line=line)


def _faultless(text: str, where: str) -> Listing:
    found = listing(text, where)
    if found.errors:
        raise found.errors[0]
    mixed = mixed_encoders(groups_of(found).values(), where)
    if mixed:
        raise mixed[0]
    return found
