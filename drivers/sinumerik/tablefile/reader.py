"""Whole texts of anybody -> TableFile. What a table is restored from is read strictly: see `written`."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.archive import Listing, listing
from drivers.sinumerik.tablefile.groups import Reader, Sign, groups_of, mixed_encoders, settings_of, units_of
from drivers.sinumerik.tablefile.variables import VARIABLES
from drivers.tablefile import TableFile
from drivers.units import AxisUnit

__all__ = ["Sign", "TableFile", "read", "read_loosely"]


def read(text: str, where: str, units: Mapping[str, AxisUnit] | None = None, cec_sign: Sign = 1) -> TableFile:
    """Read a table file strictly. Positions in the input axis' unit, deviations in um or arcsec.

    ``units`` gives the unit of each axis by name; what is missing is guessed by `groups.axis_unit`. ``cec_sign``
    is the machine's proven CEC sign; without proof (+1) CEC deviations are the stored values themselves.
    Raises FileFormatError or Gap with line and reason (E-TABLE-...).
    """
    found = _faultless(text, where)
    groups = groups_of(found)
    reader = Reader(where, units_of(groups.values(), units or {}), cec_sign)
    return TableFile(
        tuple(reader.strict(group) for group in groups.values()), settings_of(found), _lengths(found, reader)
    )


def read_loosely(text: str, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
    """Read a file or a back-up as it would act: points above k and tables never loaded (STEP 0) are left out.

    What is left out is said in ``notes``. CEC deviations are the stored values. Raises as `read`.
    """
    found = _faultless(text, where)
    groups = groups_of(found)
    reader = Reader(where, units_of(groups.values(), units or {}), 1)
    loaded = [group for group in groups.values() if not group.never_loaded]
    notes = [f"{group.label}: never loaded (STEP 0)" for group in groups.values() if group.never_loaded]
    tables = []
    for group in loaded:
        tables.append(reader.whole(group))
        beyond = reader.beyond(group)
        if beyond:
            notes.append(f"{group.label}: {len(beyond)} points from {beyond[0]} on do not act")
    return TableFile(tuple(tables), settings_of(found), _lengths(found, reader), tuple(notes))


def _lengths(found: Listing, reader: Reader) -> dict[str, AxisUnit]:
    return {item.place: reader.unit(item.axis) for item in found.assignments if VARIABLES[item.name].length}


def _faultless(text: str, where: str) -> Listing:
    found = listing(text, where)
    if found.errors:
        raise found.errors[0]
    if not found.assignments:
        line = max(found.lines, 1)
        raise FileFormatError("E-TABLE-EMPTY", f"{where}, line {line}", line=line)
    mixed = mixed_encoders(groups_of(found).values(), where)
    if mixed:
        raise mixed[0]
    return found
