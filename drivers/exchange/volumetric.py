"""Volumetric compensation of TwinCAT CNC (TF5280): sets of the 21 errors as ISG CSV and as Etalon Exchange (Vendor).

Described on Beckhoff's pages 296429067 (ISG CSV), 296430091 (Etalon Exchange), 296426379 (units: parameters in mm and
rad, arguments in mm and deg). The names are those of ISO 230-1. No page says the sign of a parameter: the files hold
error = actual - nominal and say so; the control has a key that turns all of them (P-VOLC "negate").

A block of ISG CSV may have several arguments (pages 1218769547, 296429067). An argument that stays at one position is
none. An error whose values differ over its own axis alone is an error motion (`ErrorCurve`); any other one is kept as
it is over all its arguments (`ErrorField`), and only this format can hold it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.errors import FileFormatError
from drivers.exchange.lines import comment, content, number, only_motions, rising
from drivers.types.exchange import ErrorCurve, ErrorField, ErrorSet
from drivers.types.values import FloatArray
from drivers.units import AxisUnit, DeviationUnit, arcsec_to_rad, mm_to_um, rad_to_arcsec, um_to_mm

MARK = "//"
SIGN_COMMENT = "errors = actual - nominal, names of ISO 230-1; sign not settled in public: prove it (key negate)"
UNITS_COMMENT = "parameters in mm and rad, arguments in mm and deg"
_MOTION = re.compile(r"E[XYZABC][XYZABC]\Z")
_LOCATION = re.compile(r"[XYZABC]0[XYZABC]\Z")
_NAME = re.compile(r"\[(\w{3})\]\Z", re.ASCII)
DECIMALS = 12


class IsgCsv:
    """White-space columns with a header of names; "#" begins a new block (implements ports.ErrorExchange)."""

    suffix = ".csv"

    def text(self, errors: ErrorSet, comments: Sequence[str]) -> str:
        """A block of location errors, then one for each axis and set of positions; m rows each."""
        blocks = [_located(errors)] if errors.locations else []
        blocks += [_block(group) for group in _groups(errors.curves)]
        blocks += [_field_block(one) for one in errors.fields]
        said = [f"{MARK} {comment(line)}" for line in (UNITS_COMMENT, SIGN_COMMENT, *comments)]
        return "\n".join(said) + "\n" + "#\n".join(blocks)

    def read(self, text: str, where: str) -> ErrorSet:
        """Error motions, location errors, and fields over several axes. Raises FileFormatError (E-EXCHANGE-...)."""
        found = _Found()
        for block in _blocks(text, where):
            _read_block(block, where, found)
        return _whole(found, where)


class EtalonExchange:
    """Sections [NAME] with VALUE = or Gridpoints = { ... } (implements ports.ErrorExchange)."""

    suffix = ".txt"

    def text(self, errors: ErrorSet, comments: Sequence[str]) -> str:
        """One section for each error. Raises TableError (E-EXCHANGE-FIELD) for one over several axes."""
        only_motions(errors, "etalon-exchange")
        lines = [f"{MARK} {comment(line)}" for line in (UNITS_COMMENT, SIGN_COMMENT, *comments)]
        for name, value in errors.locations.items():
            lines += [f"[{name}]", f"VALUE = {_in_file(value, ErrorSet.location_unit(name)):.{DECIMALS}f}"]
        for curve in errors.curves:
            rows = zip(curve.positions, curve.values, strict=True)
            told = (f"  {at:.6f} {_in_file(value, curve.unit):.{DECIMALS}f}" for at, value in rows)
            lines += [f"[{curve.name}]", "Gridpoints = {", *told, "}"]
        return "\n".join(lines) + "\n"

    def read(self, text: str, where: str) -> ErrorSet:
        """Raises FileFormatError (E-EXCHANGE-...)."""
        sections = _Found()
        lines = content(text, MARK, where)
        for line, told in lines:
            found = _NAME.match(told)
            if found is None:
                raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=told[:60])
            _read_section(found.group(1).upper(), lines, where, sections)
        return _whole(sections, where)


@dataclass(slots=True)
class _Found:
    """What was read so far."""

    curves: list[ErrorCurve] = field(default_factory=list)
    locations: dict[str, float] = field(default_factory=dict)
    fields: list[ErrorField] = field(default_factory=list)


def _in_file(value: float, unit: DeviationUnit) -> float:
    return um_to_mm(value) if unit == "um" else arcsec_to_rad(value)


def _from_file(values: FloatArray, unit: DeviationUnit) -> FloatArray:
    return np.round(mm_to_um(values) if unit == "um" else rad_to_arcsec(values), 6)


def axis_unit(letter: str) -> AxisUnit:
    """A, B and C turn."""
    return "deg" if letter in "ABC" else "mm"


def _located(errors: ErrorSet) -> str:
    values = (_in_file(value, ErrorSet.location_unit(name)) for name, value in errors.locations.items())
    return " ".join(errors.locations) + "\n" + " ".join(f"{value:.{DECIMALS}f}" for value in values) + "\n"


def _groups(curves: Sequence[ErrorCurve]) -> Iterator[list[ErrorCurve]]:
    """Curves of one axis at the same positions share a block."""
    rest = list(curves)
    while rest:
        first = rest[0]
        same = [
            one for one in rest if one.argument == first.argument and np.array_equal(one.positions, first.positions)
        ]
        yield same
        rest = [one for one in rest if not any(one is taken for taken in same)]


def _block(group: Sequence[ErrorCurve]) -> str:
    header = " ".join((group[0].argument, *(one.name for one in group)))
    rows = [header]
    for place, at in enumerate(group[0].positions):
        values = (f"{_in_file(float(one.values[place]), one.unit):.{DECIMALS}f}" for one in group)
        rows.append(" ".join((f"{at:.6f}", *values)))
    return "\n".join(rows) + "\n"


def _blocks(text: str, where: str) -> Iterator[list[tuple[int, str]]]:
    block: list[tuple[int, str]] = []
    for line, told in content(text, MARK, where):
        if told.startswith("#"):
            if block:
                yield block
            block = []
        else:
            block.append((line, told))
    if block:
        yield block


def _read_block(block: Sequence[tuple[int, str]], where: str, found: _Found) -> None:
    line, header = block[0]
    names = [name.upper() for name in header.split()]
    arguments = [name for name in names if len(name) == 1 and name in "XYZABC"]
    bad = [name for name in names if name not in arguments and not _MOTION.match(name) and not _LOCATION.match(name)]
    if bad or len(set(names)) != len(names) or len(arguments) == len(names):
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=line, found=header[:80])
    table = np.asarray([_row(told, len(names), where, at) for at, told in block[1:]], dtype=np.float64)
    if not table.size:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=0, least=1, most=100_000)
    if not arguments and len(block) != 2:
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=line, found=header[:80])
    places = {name: table[:, names.index(name)] for name in arguments}
    for column, name in enumerate(names):
        if _LOCATION.match(name):
            _locate(name, table[:, column], found, (where, line))
        elif name not in arguments:
            _over_axes(name, places, table[:, column], found=found, place=(where, line))


def _locate(name: str, values: FloatArray, found: _Found, place: tuple[str, int]) -> None:
    """A location error: one value however many rows. Raises FileFormatError (E-EXCHANGE-TWICE)."""
    if name in found.locations or np.any(values != values[0]):
        raise FileFormatError("E-EXCHANGE-TWICE", place[0], line=place[1], key=name)
    found.locations[name] = float(_from_file(values[:1], ErrorSet.location_unit(name))[0])


def _over_axes(
    name: str, places: dict[str, FloatArray], values: FloatArray, *, found: _Found, place: tuple[str, int]
) -> None:
    """An error motion where only its own axis matters, else a field over the arguments that change."""
    moving = {axis: at for axis, at in places.items() if np.ptp(at) > 0.0}
    own = moving.get(name[2])
    if not moving or (own is not None and len(moving) == 1):
        found.curves.append(_curve(name, own if own is not None else values[:0], values, place))
        return
    rows = np.stack(list(moving.values()), axis=1)
    if len(np.unique(rows, axis=0)) != len(rows):
        raise FileFormatError("E-EXCHANGE-RISING", place[0], row=_repeated(rows), position=", ".join(moving))
    if own is not None:
        at, first, which = np.unique(own, return_index=True, return_inverse=True)
        if np.array_equal(values, values[first][which]):
            found.curves.append(_curve(name, at, values[first], place))
            return
    unit = ErrorField(name, tuple(moving), rows, values).unit
    found.fields.append(ErrorField(name, tuple(moving), rows, _from_file(values, unit)))


def _repeated(rows: FloatArray) -> int:
    """Number of the first row (from 1) that stood before."""
    _, first = np.unique(rows, axis=0, return_index=True)
    return int(np.setdiff1d(np.arange(len(rows)), first)[0]) + 1


def _field_block(one: ErrorField) -> str:
    values = (_in_file(float(value), one.unit) for value in one.values)
    rows = (
        " ".join((*(f"{at:.6f}" for at in places), f"{value:.{DECIMALS}f}"))
        for places, value in zip(one.points, values, strict=True)
    )
    return "\n".join([" ".join((*one.arguments, one.name)), *rows]) + "\n"


def _row(told: str, width: int, where: str, line: int) -> list[float]:
    words = told.split()
    if len(words) != width:
        raise FileFormatError("E-EXCHANGE-WIDTH", where, line=line, found=len(words), width=width)
    return [number(word, where, line) for word in words]


def _curve(name: str, at: FloatArray, values: FloatArray, place: tuple[str, int]) -> ErrorCurve:
    where, line = place
    if at.size < 2:
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=line, found=name)
    rising(at, where)
    found = ErrorCurve(name, axis_unit(name[2]), at, values)
    return ErrorCurve(name, found.axis_unit, at, _from_file(values, found.unit))


def _read_section(name: str, lines: Iterator[tuple[int, str]], where: str, into: _Found) -> None:
    line, told = next(lines, (0, ""))
    key, _, value = (part.strip() for part in told.partition("="))
    if _LOCATION.match(name) and key.upper() == "VALUE":
        unit = ErrorSet.location_unit(name)
        if name in into.locations:
            raise FileFormatError("E-EXCHANGE-TWICE", where, line=line, key=name)
        into.locations[name] = float(_from_file(np.asarray([number(value, where, line)]), unit)[0])
        return
    if not _MOTION.match(name) or key.lower() != "gridpoints" or value != "{":
        raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=told[:60])
    rows: list[list[float]] = []
    for at, inside in lines:
        if inside == "}":
            table = np.asarray(rows, dtype=np.float64).reshape(-1, 2)
            into.curves.append(_curve(name, table[:, 0], table[:, 1], (where, at)))
            return
        rows.append(_row(inside, 2, where, at))
    raise FileFormatError("E-EXCHANGE-OPEN", where, name=name)


def _whole(found: _Found, where: str) -> ErrorSet:
    """Raises FileFormatError (E-EXCHANGE-TWICE, E-EXCHANGE-COUNT)."""
    names = [*(one.name for one in found.curves), *(one.name for one in found.fields)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FileFormatError("E-EXCHANGE-TWICE", where, line=0, key=twice[0])
    if not names and not found.locations:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=0, least=1, most=100_000)
    return ErrorSet(tuple(found.curves), found.locations, fields=tuple(found.fields))
