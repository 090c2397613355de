"""FANUC pitch error compensation (series 16i to 30i): parameters and points of a punched listing, read only.

Described in the 0i-PB parameter manual (p. 99-100) and the 15i parameter manual (p. 25). Text between lines of "%".
A parameter is N03620P40 or, axis by axis, N03620A1P40A2P140; a point is N10000P.. upwards, one number each.

A point is no value of a curve but an *increment*, in detection units times the magnification (3623): number n belongs
to the section from (n - r - 1) to (n - r) intervals (3624) from the reference position, where r (3620) is the number.
The absolute curve is therefore the sum of the increments outwards from the reference, where it is zero:

    e(r) = 0,   e(n) = e(n - 1) + p(n)   above,   e(n - 1) = e(n) - p(n)   below.

So the numbers lowest (3621) .. highest (3622) give one position more than there are numbers. Of a rotary axis the sum
over a turn is zero, or every turn would add to the error. The printed example is a test of this module.

No public text states the sign of a point against the error, nor does a listing state the detection unit or where the
reference position lies: these are asked. A second series for the negative direction (3605#0, 3626, 3627) is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.exchange.lines import declared_number, directed, number, own_table, shown_line
from drivers.message import digits
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray

POINTS_FROM, MOST_POINTS = 10_000, 4096
REFERENCE, LOWEST, HIGHEST, MAGNIFICATION, INTERVAL, TURN = 3620, 3621, 3622, 3623, 3624, 3625
BIDIRECTIONAL = 3605
PARAMETERS = {"reference": REFERENCE, "lowest": LOWEST, "highest": HIGHEST}
NEEDED = ("reference", "interval", "magnification", "unit_um", "zero")
EXAMPLE = "--column reference=40 --column interval=50 --column magnification=1 --column unit_um=1 --column zero=0"
_BLOCK = re.compile(r"N(\d{1,6})\s*(.*)\Z", re.ASCII)
_WORD = re.compile(r"\s*([A-Z])\s*([+-]?\d*\.?\d*)", re.ASCII)


@dataclass(slots=True)
class _Listing:
    """Points by number, and parameters by number and axis (0: said without an axis)."""

    points: dict[int, float] = field(default_factory=dict)
    parameters: dict[int, dict[int, float]] = field(default_factory=dict)


class FanucListing:
    """Listings of FANUC (implements ports.TableExchange); form "error" or "correction": what a positive point is."""

    suffix = ".txt"
    forms = ("", "error", "correction")

    def text(self, _tables: Sequence[CompensationTable], _form: str, _comments: Sequence[str]) -> str:
        """Nothing is written, for a wrong sign doubles an error. Raises TableError (E-EXCHANGE-READ-ONLY)."""
        raise TableError("E-EXCHANGE-READ-ONLY", "fanuc", control="FANUC")

    def read(self, text: str, where: str, known: ReadAs) -> tuple[CompensationTable, ...]:
        """The curve of one axis. ``known.declared`` says what the listing lacks: see `EXAMPLE`, and axis_number.

        Raises FileFormatError (E-EXCHANGE-...; -SIGN, -DECLARE: what to say).
        """
        found = _listing(text, where)
        facts = _facts(found, known, where)
        numbers = _numbers(found, facts, where)
        increments = np.asarray([found.points[one] for one in numbers])
        reference = round(facts["reference"])
        if not numbers[0] - 1 <= reference <= numbers[-1]:
            raise FileFormatError(
                "E-EXCHANGE-REFERENCE", where, reference=reference, lowest=numbers[0], highest=numbers[-1]
            )
        at, values = summed(increments, reference - numbers[0] + 1)
        positions = facts["zero"] + at * facts["interval"]
        turns = known.unit == "deg" and abs(float(np.ptp(positions)) - 360.0) < 1e-6
        if turns and abs(float(values[-1] - values[0])) > 0.0:
            raise FileFormatError("E-EXCHANGE-TURN", where, sum=digits(values[-1] - values[0], 6))
        curve = directed(values * facts["magnification"] * facts["unit_um"], known.form, where, "FANUC")
        return (own_table(known, positions, curve, curve, modulo=turns),)


def summed(increments: FloatArray, before: int) -> tuple[FloatArray, FloatArray]:
    """Sections (n,) as an absolute curve: places (n + 1,) in intervals from the reference, and values that are 0 there.

    ``before`` sections lie on the negative side.
    """
    curve = np.concatenate([[0.0], np.cumsum(increments)])
    return np.arange(curve.size, dtype=np.float64) - before, curve - curve[before]


def _listing(text: str, where: str) -> _Listing:
    found = _Listing()
    for line, block in _blocks(text, where):
        matched = _BLOCK.match(block)
        if matched is None:
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(block))
        key, values = int(matched[1]), _values(matched[2], line, where)
        if key < POINTS_FROM:
            known = found.parameters.setdefault(key, {})
            twice = set(known) & set(values)
            known |= values
        else:
            twice = {key - POINTS_FROM} & set(found.points)
            if set(values) != {0} or not float(values[0]).is_integer():
                raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(block))
            found.points[key - POINTS_FROM] = values[0]
        if twice:
            raise FileFormatError("E-EXCHANGE-TWICE", where, line=line, key=f"N{matched[1]}")
    if not 1 <= len(found.points) <= MOST_POINTS:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=len(found.points), least=1, most=MOST_POINTS)
    return found


def _blocks(text: str, where: str) -> Iterator[tuple[int, str]]:
    """Lines between the marks, without comments in parentheses and the end of a block."""
    marks = 0
    for line, told in enumerate(text.splitlines(), 1):
        block = re.sub(r"\([^)]*\)", "", told).strip(" \t;\0\x11\x12\x13\x14")
        if block.startswith("%"):
            marks += 1
        elif block:
            if marks != 1:
                raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(block))
            yield line, block.upper()
    if marks != 2:
        raise FileFormatError("E-EXCHANGE-OPEN", where, name="%")


def _values(words: str, line: int, where: str) -> dict[int, float]:
    """Values by axis number, 0 where no axis is named, below 0 those of spindles. The mark Q is no value."""
    found: dict[int, float] = {}
    axis, at = 0, 0
    while at < len(words.rstrip()):
        word = _WORD.match(words, at)
        if word is None or not word[2]:
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(words))
        letter, at = word[1], word.end()
        if letter in "AS":
            axis = round(number(word[2], where, line)) * (1 if letter == "A" else -1)
        elif letter in "PMI":
            found[axis] = number(word[2], where, line)
        elif letter != "Q":
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(words))
    return found


def _facts(found: _Listing, known: ReadAs, where: str) -> dict[str, float]:
    """What the sum needs, from the listing's own parameters or as declared. Raises FileFormatError."""
    said = known.declared
    number_of = round(declared_number(said, "axis_number", where, 0.0))
    own: dict[str, float] = {}
    for name, key in (*PARAMETERS.items(), ("magnification", MAGNIFICATION)):
        value = _of_axis(found.parameters.get(key, {}), number_of, where)
        if value is not None:
            own[name] = value
    reverse = _of_axis(found.parameters.get(BIDIRECTIONAL, {}), number_of, where)
    if reverse is not None and round(reverse) % 10 == 1:
        raise FileFormatError("E-EXCHANGE-BOTH-WAYS", where)
    facts = own | {key: declared_number(said, key, where) for key in (*NEEDED, "lowest", "highest") if key in said}
    missing = [name for name in NEEDED if name not in facts]
    if missing:
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing=", ".join(missing), example=EXAMPLE)
    wrong = [name for name in ("interval", "magnification", "unit_um") if facts[name] <= 0.0]
    if wrong:
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing=f"{wrong[0]} > 0", example=EXAMPLE)
    return facts


def _of_axis(values: Mapping[int, float], axis: int, where: str) -> float | None:
    """A parameter's value for an axis. Raises FileFormatError (E-EXCHANGE-DECLARE) where it has several."""
    mine = {key: value for key, value in values.items() if key >= 0}
    if 0 in mine or not mine:
        return mine.get(0)
    if not axis and len(mine) > 1:
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing="axis_number", example="--column axis_number=1")
    return mine.get(axis or next(iter(mine)))


def _numbers(found: _Listing, facts: Mapping[str, float], where: str) -> list[int]:
    """The axis' point numbers, without a gap. Raises FileFormatError (E-EXCHANGE-GAP)."""
    lowest = round(facts.get("lowest", min(found.points)))
    highest = round(facts.get("highest", max(found.points)))
    if not 0 <= highest - lowest < MOST_POINTS:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=highest - lowest + 1, least=1, most=MOST_POINTS)
    numbers = list(range(lowest, highest + 1))
    missing = next((one for one in numbers if one not in found.points), None)
    if missing is not None:
        raise FileFormatError("E-EXCHANGE-SERIES", where, number=missing, lowest=lowest, highest=highest)
    return numbers
