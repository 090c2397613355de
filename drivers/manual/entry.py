"""What a person typed to a number: one explicit rule for point and comma, nothing guessed, pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

DecimalMark = Literal["point", "comma"]
# Plain decimals only: no exponent, no group marks, no words, and no more digits than any display has.
_NUMBER: dict[DecimalMark, re.Pattern[str]] = {
    "point": re.compile(r"[+-]?[0-9]{1,9}(?:\.[0-9]{1,9})?\Z"),
    "comma": re.compile(r"[+-]?[0-9]{1,9}(?:,[0-9]{1,9})?\Z"),
}
NO_NUMBER, OTHER_MARK, FAR = "W-MANUAL-NUMBER", "W-MANUAL-MARK", "W-MANUAL-FAR"
_MARK: dict[DecimalMark, str] = {"point": ".", "comma": ","}


@dataclass(frozen=True, slots=True)
class ExpectedReading:
    """What the next reading is of and where it should lie: ``value`` +- ``limit`` in the channel's unit."""

    label: str = ""
    value: float = 0.0
    limit: float = float("inf")


@dataclass(frozen=True, slots=True)
class EntryRefused:
    """Why a typed text is no reading: a code of the catalogue with its fields."""

    code: str
    fields: dict[str, str]


def read_entry(
    text: str, mark: DecimalMark, expected: ExpectedReading, unit: str, *, sure: bool
) -> float | EntryRefused:
    """A typed text as a number, or why not.

    The other decimal mark is refused, not turned around: 1.234 may be a thousand. A value outside ``expected`` is
    taken only when it is typed a second time (``sure``).
    """
    typed = text.strip()
    if not typed.isascii() or not _NUMBER[mark].match(typed):
        other: DecimalMark = "comma" if mark == "point" else "point"
        return EntryRefused(
            OTHER_MARK if _NUMBER[other].match(typed) else NO_NUMBER, {"typed": repr(typed[:40]), "mark": mark}
        )
    value = float(typed.replace(_MARK[mark], "."))
    if abs(value - expected.value) > expected.limit and not sure:
        limits = f"{expected.value - expected.limit:g} .. {expected.value + expected.limit:g} {unit}"
        return EntryRefused(FAR, {"typed": typed, "limits": limits})
    return value
