"""Whole texts -> TableFile, and back-ups that the control wrote -> LiveSet."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from decimal import Decimal

from drivers.errors import FileFormatError
from drivers.sinumerik.archive import Listing, listing
from drivers.sinumerik.groups import Group, Reader, Sign, groups_of, mixed_encoders, settings_of, units_of
from drivers.sinumerik.variables import VARIABLES
from drivers.tablefile import TableFile
from drivers.types import CompensationTable, LiveSet, LiveTable
from drivers.units import AxisUnit

__all__ = ["Sign", "TableFile", "read", "read_live", "read_loosely"]


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
    loaded = [group for group in groups.values() if not _empty(group)]
    notes = [f"{group.label}: never loaded (STEP 0)" for group in groups.values() if _empty(group)]
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


def _empty(group: Group) -> bool:
    values = [group.parameters[name].value for name in ("STEP", "MIN", "MAX") if name in group.parameters]
    return len(values) == 3 and not any(values)


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
        raise FileFormatError("E-TABLE-CUT", where, line=found.lines)
    switches, groups = settings_of(found), groups_of(found)
    reader = Reader(where, units_of(groups.values(), units or {}), cec_sign)
    eec = groups.get(f"EEC[{encoder},{axis}]")
    table = reader.live(eec) if eec else _never_loaded(axis, encoder, reader.unit(axis))
    enabled = bool(switches.get(f"$MA_ENC_COMP_ENABLE[{encoder},{axis}]", 0))
    cross = [reader.live(group) for group in groups.values() if group.function == "CEC"]
    return LiveSet(
        axis=axis,
        eec=LiveTable(table, enabled),
        cec=tuple(LiveTable(one, _cec_on(one, switches)) for one in cross if one.output_axis == axis),
        others=tuple(LiveTable(one, _cec_on(one, switches)) for one in cross if one.output_axis != axis),
        backlash=float(switches.get(f"$MA_BACKLASH[{encoder},{axis}]", 0)),
        native=text,
        digest=hashlib.sha256(text.encode()).hexdigest(),
    )


def _cec_on(table: CompensationTable, switches: Mapping[str, Decimal]) -> bool:
    table_on = switches.get(f"$SN_CEC_TABLE_ENABLE[{table.index}]", 0)
    return bool(table_on and switches.get(f"$MA_CEC_ENABLE[{table.output_axis}]", 0))


def _never_loaded(axis: str, encoder: int, unit: AxisUnit) -> CompensationTable:
    return CompensationTable("EEC", axis, axis, 0.0, 0.0, 0.0, (0.0,), index=encoder, input_unit=unit, output_unit=unit)
