"""Lists of an axis' error with a public sign: Weihong NK / EasyRoute ``axeserr.dat`` and Aerotech ``.cal`` of one axis.

axeserr.dat (EasyRoute manual p. 68, NK200 manual p. 64-65): ``unit = mm`` (also as ``;unit=mm``), a section ``[X]`` for
each axis, rows nominal, forward, backward. The values are the *error* of each direction, at rising machine coordinates.

Aerotech (help.aerotech.com, Axis Calibration): comments begin with ; or ', ``:START n SAMPLEDIST= POSUNIT=PRIMARY
CORUNIT=PRIMARY/k``, values, ``:END``. A value is the *correction*, so error = -value, as four programs that write such
files do; it acts alike in both directions, straight between points. The file does not contain the position of its first
value, which is declared: ``--column start=-100``; axes are numbered from 1: ``--column axis_number=1`` where a file has
several. A table over two axes (``:START2D``) is no table of one axis and is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.exchange.lines import (
    comment,
    curves_of,
    declared_number,
    letter_of,
    number,
    one_axis,
    own_table,
    rising,
    shown_line,
)
from drivers.message import digits
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.units import MM_PER_INCH, deviation_scale

UNITS = {"mm": 1.0, "inch": MM_PER_INCH, "in": MM_PER_INCH}
LINEAR = "XYZUVW"
MOST_ROWS = 100_000
VALUES_A_LINE = 6
EVEN = 1e-6  # mm or deg
_UNIT = re.compile(r";?\s*unit\s*=\s*(\w+)\s*\Z", re.IGNORECASE)
_SECTION = re.compile(r"\[\s*([A-Z])\d?\s*\]\Z", re.IGNORECASE)
_KEY = re.compile(r"([A-Z]\w*)=(\S+)\Z", re.IGNORECASE)
_CORRECTION_UNIT = re.compile(r"PRIMARY(?:/(\d+(?:\.\d+)?))?\Z", re.IGNORECASE)


class AxesErr:
    """axeserr.dat (implements ports.TableExchange): a table with both curves for each section."""

    suffix = ".dat"
    forms = ("",)

    def text(self, tables: Sequence[CompensationTable], _form: str, comments: Sequence[str]) -> str:
        """The section of one linear axis, mm. Raises TableError (E-EXCHANGE-ONE, E-EXCHANGE-LETTER)."""
        table = one_axis(tables, "axeserr")
        letter = letter_of(table, "axeserr", LINEAR)
        rows = [
            f"{at:.4f}, {forward / 1000.0:.6f}, {reverse / 1000.0:.6f}"
            for at, forward, reverse in zip(*curves_of(table), strict=True)
        ]
        said = ["nominal, error forward, error backward; error = actual - nominal", *comments]
        return "\n".join(["unit = mm", *(f"; {comment(one)}" for one in said), f"[{letter}]", *rows]) + "\n"

    def read(self, text: str, where: str, _known: ReadAs) -> tuple[CompensationTable, ...]:
        """Every axis of the file. Raises FileFormatError (E-EXCHANGE-...; -DECLARE for a file without its unit)."""
        scale = 0.0
        found: dict[str, list[list[float]]] = {}
        rows: list[list[float]] | None = None
        for line, told in enumerate(text.splitlines(), 1):
            plain = told.strip(" \t\0\x1a")
            said = _UNIT.match(plain)
            if said:
                scale = UNITS.get(said[1].lower(), 0.0) if not scale else 0.0
                if not scale:
                    raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(plain))
            elif plain and not plain.startswith(";"):
                section = _SECTION.match(plain)
                if section:
                    rows = _new_section(found, section[1].upper(), where, line)
                elif rows is None:
                    raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(plain))
                else:
                    rows.append(_row(plain.partition(";")[0], where, line))
        if not found:
            raise FileFormatError("E-EXCHANGE-COUNT", where, rows=0, least=2, most=MOST_ROWS)
        if not scale:
            raise FileFormatError("E-EXCHANGE-DECLARE", where, missing="unit", example="unit = mm")
        return tuple(_table(axis, values, scale, where) for axis, values in found.items())


def _new_section(found: dict[str, list[list[float]]], axis: str, where: str, line: int) -> list[list[float]]:
    if axis in found:
        raise FileFormatError("E-EXCHANGE-TWICE", where, line=line, key=f"[{axis}]")
    if axis not in LINEAR:
        raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=f"[{axis}]")
    return found.setdefault(axis, [])


def _row(told: str, where: str, line: int) -> list[float]:
    words = [word.strip() for word in told.split(",")]
    if len(words) != 3:
        raise FileFormatError("E-EXCHANGE-WIDTH", where, line=line, found=len(words), width=3)
    return [number(word, where, line) for word in words]


def _table(axis: str, values: list[list[float]], scale: float, where: str) -> CompensationTable:
    if len(values) < 2:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=len(values), least=2, most=MOST_ROWS)
    at, forward, reverse = np.asarray(values, dtype=np.float64).T * scale
    rising(at, where)
    um = deviation_scale("mm")
    return own_table(ReadAs(axis, "mm"), at, np.round(forward * um, 6), np.round(reverse * um, 6))


# ---- Aerotech


@dataclass(slots=True)
class _Block:
    """One :START .. :END: axis number, its keys, its values; ``line`` where it begins."""

    axis: int
    line: int
    keys: dict[str, str] = field(default_factory=dict)
    values: list[float] = field(default_factory=list)


class AerotechCal:
    """Calibration of one axis (implements ports.TableExchange); form "mean" writes the mean of two directions."""

    suffix = ".cal"
    forms = ("", "mean")

    def text(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str]) -> str:
        """A block of axis 1. Raises TableError (E-EXCHANGE-ONE, E-EXCHANGE-STEP, E-EXCHANGE-CURVES)."""
        table = one_axis(tables, "aerotech")
        at, forward, reverse = curves_of(table)
        if table.reverse and form != "mean":
            largest = float(np.max(np.abs(forward - reverse)))
            raise TableError("E-EXCHANGE-CURVES", "aerotech", table=table.name, largest=digits(largest, 3))
        steps = np.diff(at)
        if at.size < 2 or float(np.ptp(steps)) > EVEN:
            low, high = (f"{one:g}" for one in (steps.min(), steps.max())) if at.size > 1 else ("-", "-")
            raise TableError("E-EXCHANGE-STEP", "aerotech", stated=low, found=high)
        parts, unit = (1000.0, "um") if table.output_unit == "mm" else (3600.0, "arcsec")
        own_comments = [
            f"the first value is at {at[0]:.6g} {table.input_unit}, which the file cannot state",
            f"value = correction = -(actual - nominal), in {unit}; enter the number of axis {table.name} in :START",
            *comments,
        ]
        values = [f"{-value:.4f}" for value in (forward + reverse) / 2.0 + 0.0]
        lines = [" ".join(values[k : k + VALUES_A_LINE]) for k in range(0, len(values), VALUES_A_LINE)]
        step = float(np.mean(steps))
        head = f":START 1 SAMPLEDIST={step:.9g} POSUNIT=PRIMARY CORUNIT=PRIMARY/{parts:g}"
        return "\n".join([*(f"; {comment(one)}" for one in own_comments), head, *lines, ":END"]) + "\n"

    def read(self, text: str, where: str, known: ReadAs) -> tuple[CompensationTable, ...]:
        """The table of one axis. Raises FileFormatError (E-EXCHANGE-...; -DECLARE: what to say)."""
        blocks = list(_aerotech_blocks(text, where))
        wanted = round(declared_number(known.declared, "axis_number", where, 0.0))
        mine = [one for one in blocks if wanted in (0, one.axis)]
        if not blocks or len(mine) != 1:
            if blocks:
                axes = ", ".join(str(one.axis) for one in blocks)
                missing, example = f"axis_number ({axes})", f"--column axis_number={blocks[0].axis}"
                raise FileFormatError("E-EXCHANGE-DECLARE", where, missing=missing, example=example)
            raise FileFormatError("E-EXCHANGE-COUNT", where, rows=0, least=2, most=MOST_ROWS)
        block = mine[0]
        if "start" not in known.declared:
            raise FileFormatError("E-EXCHANGE-DECLARE", where, missing="start", example="--column start=-100")
        start = declared_number(known.declared, "start", where)
        step, parts = _aerotech_units(block, where)
        if not 2 <= len(block.values) <= MOST_ROWS:
            raise FileFormatError("E-EXCHANGE-COUNT", where, rows=len(block.values), least=2, most=MOST_ROWS)
        at = start + step * np.arange(len(block.values), dtype=np.float64)
        curve = np.round(-np.asarray(block.values) / parts * deviation_scale(known.unit), 6) + 0.0
        return (own_table(known, at, curve, curve),)


def _aerotech_blocks(text: str, where: str) -> Iterator[_Block]:
    block: _Block | None = None
    for line, told in enumerate(text.splitlines(), 1):
        words = re.split(r"[;']", told, maxsplit=1)[0].strip(" \t\0\x1a\ufeff").split()
        if not words:
            continue
        first = words[0].upper()
        if first == ":START2D":
            raise FileFormatError("E-EXCHANGE-PLANE", where, line=line)
        if first == ":START":
            if block is not None and block.values:
                raise FileFormatError("E-EXCHANGE-OPEN", where, name=f":START {block.axis}")
            block = _started(block, words[1:], where, line)
        elif first == ":END" and block is not None:
            yield block
            block = None
        elif block is not None and not first.startswith(":"):
            block.values += [number(word, where, line) for word in words]
        else:
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(told.strip()))
    if block is not None:
        raise FileFormatError("E-EXCHANGE-OPEN", where, name=f":START {block.axis}")


def _started(block: _Block | None, words: Sequence[str], where: str, line: int) -> _Block:
    """A new block by its axis number, or further keys of the one that has begun."""
    rest = list(words)
    if rest and rest[0].isdecimal():
        if block is not None:
            raise FileFormatError("E-EXCHANGE-OPEN", where, name=f":START {block.axis}")
        block = _Block(int(rest.pop(0)[:6]), line)
    for word in rest:
        key = _KEY.match(word)
        name = key[1].upper() if key else ""
        if block is None or key is None or name not in AEROTECH_KEYS or name in block.keys:
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(word))
        block.keys[name] = key[2]
    if block is None:
        raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=":START")
    return block


AEROTECH_KEYS = ("SAMPLEDIST", "POSUNIT", "CORUNIT", "HOMEDIRECTION", "HOMEOFFSET")


def _aerotech_units(block: _Block, where: str) -> tuple[float, float]:
    """Distance of the values, and how many of their unit make one of the axis. Raises FileFormatError."""
    for key in ("SAMPLEDIST", "POSUNIT", "CORUNIT"):
        if key not in block.keys:
            raise FileFormatError("E-EXCHANGE-KEY", where, line=block.line, found=f":START without {key}")
    unit = _CORRECTION_UNIT.match(block.keys["CORUNIT"])
    if unit is None or block.keys["POSUNIT"].upper() != "PRIMARY":
        found = f"POSUNIT={block.keys['POSUNIT']} CORUNIT={block.keys['CORUNIT']}"
        raise FileFormatError("E-EXCHANGE-KEY", where, line=block.line, found=shown_line(found))
    step, parts = number(block.keys["SAMPLEDIST"], where, block.line), float(unit[1] or 1.0)
    if step <= 0.0 or parts <= 0.0:
        raise FileFormatError("E-EXCHANGE-NUMBER", where, line=block.line, token=block.keys["SAMPLEDIST"][:40])
    return step, parts
