"""Whose control a file of tables belongs to, by its text; and formats that nobody has described in public.

Each layout that a public document describes is recognised by marks that no table of readings has. `--from` also knows
the names of controls whose files nobody describes: an error says what is public of them, and what to do instead.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

LOOKED_AT = 4096  # characters: marks of a layout stand at its head
_FANUC = re.compile(r"\A[\s\0\x11-\x14]*%[^\n]*\n\s*(?:\([^)]*\)\s*)?N\d{1,6}\s*[APQ][+-]?\d", re.ASCII)
_NUMBERS = r"[+-]?\d[\d.]*\s*,\s*[+-]?\d[\d.]*\s*,\s*[+-]?\d"


class Recognised(NamedTuple):
    """A control's file: ``control`` its name for people; ``format`` the name for --from, ``to`` a format for sheets."""

    control: str
    format: str
    to: str = "table-csv"


MARKS: Mapping[Recognised, re.Pattern[str]] = {
    Recognised("FANUC", "fanuc"): _FANUC,
    Recognised("HEIDENHAIN (.COM)", "heidenhain"): re.compile(r"\A\s*BEGIN\s+[\w-]+\s*\.COM\b", re.IGNORECASE),
    Recognised("HEIDENHAIN (.CMA)", "heidenhain-cma"): re.compile(r"\A\s*BEGIN\s+[\w-]+\s*\.CMA\b", re.IGNORECASE),
    Recognised("HEIDENHAIN ND", "heidenhain-nd"): re.compile(r"\A\s*[#*]\s*\n\s*ND[- ]?\d{3}", re.IGNORECASE),
    Recognised("Aerotech", "aerotech"): re.compile(r"^\s*:START(?:2D)?\s+\d", re.IGNORECASE | re.MULTILINE),
    Recognised("Weihong NK / EasyRoute (axeserr.dat)", "axeserr"): re.compile(
        rf"\A(?:[^\S\n]*(?:;[^\n]*|unit\s*=\s*\w+\s*)?\n)*\s*\[[XYZABC]\d?\]\s*\n(?:\s*;[^\n]*\n)*\s*{_NUMBERS}",
        re.IGNORECASE,
    ),
    Recognised("TwinCAT / ISG", "twincat"): re.compile(r"^\s*kw\.(?:ssfk|crosscomp)\.", re.MULTILINE),
    Recognised("Etalon / TRAC-CAL (exchange)", "etalon-exchange", "error-csv"): re.compile(
        r"^\s*\[(?:E[XYZABC][XYZABC]|[XYZABC]0[XYZABC])\]\s*\n\s*(?:VALUE|Gridpoints)\s*=", re.IGNORECASE | re.MULTILINE
    ),
    Recognised("TwinCAT / ISG (volumetric)", "isg-volumetric", "error-csv"): re.compile(
        r"^[^\S\n]*(?:[XYZABC][^\S\n]+)+(?:E[XYZABC][XYZABC][^\S\n]*)+$", re.MULTILINE
    ),
}
UNPUBLISHED: Mapping[str, str] = {
    "fagor": "E-EXCHANGE-FAGOR",
    "mitsubishi": "E-EXCHANGE-MITSUBISHI",
    "heidenhain-cma": "E-EXCHANGE-CMA",
    **dict.fromkeys(("heidenhain-nd", "centroid", "mach3", "mach4", "siemens-vcs"), "E-EXCHANGE-UNPUBLISHED"),
}
"""Formats by name whose layout is not public, or that hold no values; with what is said of them."""


def recognise(text: str) -> Recognised | None:
    """The control whose table this is; None for any other text. Only the first characters are looked at."""
    head = text[:LOOKED_AT].replace("\r\n", "\n").replace("\r", "\n")
    return next((name for name, mark in MARKS.items() if mark.search(head)), None)
