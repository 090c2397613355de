"""What a result file says of itself: which axis moved and which error it holds, by its own words and its name; pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from gateway.config import AxisSection
from gateway.domain.values import component_unit
from gateway.evaluate.geometry.angular import COMPONENTS, Kind
from gateway.siteplan import LOCATIONS
from gateway.workflow.files.motions import KINDS

_ERROR = re.compile(r"(?<![A-Z0-9])(E[XYZABC][XYZABC]|[AB]0[CZ](?:-R)?|[XY]0C)(?![A-Z0-9])")
_PLACE = re.compile(r"(?<![A-Z0-9])(\d{1,3}) ?(?:DEG|GRAD|°|度)")
_WORD = re.compile(r"[A-Z]+[0-9]*")
BY_FILE, BY_NAME, BY_KIND, BY_ANSWER = "its words", "its name", "its kind", "answer"
AXIS_LETTERS = "XYZABCUVW"


@dataclass(frozen=True, slots=True)
class Guessed:
    """What a file tells: machine axis and error ("" where it does not), the kind in words, and what told it.

    ``foreign`` is an axis named there that the site does not have; ``park`` the angle a bar stood at, deg.
    """

    axis: str = ""
    error: str = ""
    kind: str = ""
    by: str = ""
    foreign: str = ""
    park: float | None = None


def guessed(name: str, driver: str, header: Mapping[str, str], axes: Sequence[AxisSection]) -> Guessed:
    """From the words inside a file first, then from its name; ``driver`` says what such files usually hold."""
    own = " ".join(header.get(key, "") for key in ("TITLE", "Title", "Location", "Comment")).upper()
    stem = name.rpartition(".")[0].upper()
    said, foreign = _axis(header.get("Axis", "").upper(), axes)
    if said is None and not foreign:
        said, foreign = _axis(stem, axes)
    park = next((float(found[1]) for found in map(_PLACE.search, (own, stem)) if found), None)
    for text, by in ((own, BY_FILE), (stem, BY_NAME)):
        found = _ERROR.search(text)
        if found is not None:
            axis = _moved(found[1], axes) or (said.name if said else "")
            return Guessed(axis, found[1], "", by, foreign="" if axis else found[1][2:3], park=park)
    if said is None:
        return Guessed(foreign=foreign, park=park)
    kind, by = _kind(own, stem)
    error = _error(said, kind, f"{own} {stem}", driver)
    return Guessed(said.name, error, kind, by or (BY_KIND if error else ""), park=park)


def _axis(text: str, axes: Sequence[AxisSection]) -> tuple[AxisSection | None, str]:
    """The axis of the site that a text names first; else a letter that is an axis of no site, or ""."""
    foreign = ""
    for word in _WORD.findall(_ERROR.sub(" ", text.replace("_", " "))):
        for axis in axes:
            if word in (axis.name.upper(), axis.letter):
                return axis, ""
        if not foreign and word[0] in AXIS_LETTERS and (word[1:].isdigit() or len(word) == 1):
            foreign = word
    return None, foreign


def _moved(error: str, axes: Sequence[AxisSection]) -> str:
    """The axis that an error motion belongs to, or the only one that moves for a location error."""
    letters = LOCATIONS.get(error.removesuffix("-R"), (error[2:3],))
    found = [axis.name for axis in axes if axis.letter in letters]
    return found[0] if len(letters) == 1 and found else ""


def _kind(own: str, stem: str) -> tuple[str, str]:
    for text, by in ((own, BY_FILE), (stem, BY_NAME)):
        for kind, marks in KINDS.items():
            if any(mark in text for mark in marks):
                return kind, by
    return "", ""


def _error(axis: AxisSection, kind: str, text: str, driver: str) -> str:
    """The error by its letters, "" where the words leave it open."""
    letter = axis.letter
    if axis.kind == "rotary":
        return f"E{letter}{letter}" if driver == "rta" or kind == "position" else ""
    if kind in ("pitch", "yaw", "roll"):
        return COMPONENTS.get((letter, cast(Kind, kind)), "")
    if kind == "straightness":
        across = re.findall(r"(?<![A-Z0-9])([XYZ])\d?(?![A-Z0-9])", text.replace("_", " "))
        other = [one for one in across if one != letter]
        return f"E{other[0]}{letter}" if other else ""
    plain = driver in ("rtl", "pos")
    return f"E{letter}{letter}" if kind == "position" or (plain and not kind) else ""


def choices(axis: AxisSection | None, unit: str, axes: Sequence[AxisSection]) -> tuple[str, ...]:
    """The errors a file may hold, by its axis (None: any of the site's) and the unit of its deviations ("": either)."""
    moved = axes if axis is None else (axis,)
    motions = [f"E{way}{one.letter}" for one in moved for way in "XYZABC" if unit in ("", _unit_of(way, one))]
    letters = {one.letter for one in moved}
    places = [name for name, able in LOCATIONS.items() if letters & set(able)] if unit != "arcsec" else []
    turned = ["B0Z-R"] if "B0Z" in places else []
    return (*motions, *places, *turned)


def _unit_of(way: str, axis: AxisSection) -> str:
    return component_unit(f"E{way}{axis.letter}", axis.unit)
