"""Numbers as files print them: plain decimals, a comma only where no point occurs at all; and room for them.

A short file may claim a huge grid: it is refused before it gets one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from drivers.errors import FileFormatError
from drivers.types.values import FloatArray

MOST_READINGS = 4_000_000
LONGEST_FIXED = 18
MOST_TOLD = 8
NO_NUMBER = frozenset({"", "nan", "n/a", "na", "#n/a", "#nv", "null", "none"})
# Of a target in mm or deg, of a deviation in um or arcsec: a kilometre that the axis is off is no measurement.
FARTHEST = 1e9
_DECIMAL = re.compile(r"[+-]?(?:\d{1,18}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,2})?\Z", re.ASCII)
_WHOLE = re.compile(r"\d{1,9}\Z", re.ASCII)


def decimal(token: str, *, comma: bool = False) -> float | None:
    """The number, or None where the token is none; with `comma` a comma stands for the point."""
    if comma:
        token = token.replace(",", ".") if token.count(",") <= 1 and "." not in token else ""
    return float(token) if _DECIMAL.match(token) else None


def missing(token: str) -> bool:
    """Whether a cell says that there is no reading: empty, dashes, or what spreadsheets write for no number."""
    return token.strip("-–—").lower() in NO_NUMBER


def untaken(lines: Iterable[int], read: Iterable[int]) -> tuple[str, ...]:
    """A note of lines that hold no reading at all: where all of a target's do, the result has no such target."""
    known = set(read)
    left = [str(line) for line in lines if line not in known]
    more = f" and {len(left) - MOST_TOLD} more" if len(left) > MOST_TOLD else ""
    return (f"no reading was taken in line {', '.join(left[:MOST_TOLD])}{more}",) if left else ()


def whole(token: str) -> int | None:
    """The whole number from 0, or None."""
    return int(token) if _WHOLE.match(token) else None


def beyond(target: float, deviation: float) -> bool:
    """Whether no measurement can hold this target (mm, deg) or deviation (um, arcsec)."""
    return not (abs(target) <= FARTHEST and abs(deviation) <= FARTHEST)


def uses_comma(tokens: str) -> bool:
    """True where these numbers are written with a decimal comma: commas occur and points do not."""
    return "," in tokens and "." not in tokens


def fixed(value: float) -> str:
    """Six decimals as capture programs print them, or as many as it takes to give the same double back."""
    text = f"{value:.6f}"
    return text if float(text) == value and len(text) < LONGEST_FIXED else repr(value)


def no_readings(targets: int, repetitions: int, where: str) -> FloatArray:
    """Room for readings of both directions, all NaN, shape (targets, repetitions, 2).

    Raises FileFormatError (E-FILE-SIZE) where the file asks for more than any measurement has.
    """
    if 2 * targets * repetitions > MOST_READINGS:
        raise FileFormatError("E-FILE-SIZE", where, targets=targets, repetitions=repetitions, limit=MOST_READINGS)
    return np.full((targets, repetitions, 2), np.nan)
