"""What cures each error on the tooth and why some cannot be compensated, in words; pure."""

from __future__ import annotations

from typing import Literal

from drivers.message import words
from drivers.terms import spoken
from gateway.tooth import CureRecord

Tag = Literal["axis", "set-up", "cross", "product", "part", "mech", "none"]


def meaning() -> dict[Tag, str]:
    """Each kind of cure in words."""
    return {
        "axis": f"{spoken().own} table",
        "set-up": "set-up value",
        "cross": f"{spoken().cross} table",
        "product": words("S-WHY-PRODUCT"),
        "part": words("S-WHY-IN-PART"),
        "mech": "mechanical only",
        "none": words("S-WHY-NO-EFFECT"),
    }


MECHANICAL, NONE_NEEDED, IN_PART = "mechanical only", "none needed", " in part"

_ALONG = words("S-WHY-Y")
_LEAN = words("S-WHY-X")
_SWIVEL = words("S-WHY-Z")
_WOBBLE = words("S-WHY-WOBBLE")
_ANY = words("S-WHY-NONE")
_PRODUCT = words("S-WHY-BOTH")
_BY_MOTION = {"Y": _ALONG, "A": _LEAN, "C": _SWIVEL}


def tag(cure: CureRecord) -> Tag:
    """The kind of cure, for a colour and a word; an axis' own deviation belongs to its own table."""
    by = cure.by
    if by == NONE_NEEDED:
        return "none"
    if by == MECHANICAL:
        return "mech"
    if by.endswith(IN_PART):
        return "part"
    if own(cure.error) or by.startswith(spoken().own):
        return "axis"
    if "*" in by:
        return "product"
    return "set-up" if _by_setup(by) else "cross"


def own(name: str) -> bool:
    """Whether an error is an axis' own deviation along or about itself: EXX, EZZ, ECC."""
    return len(name) == 3 and name[0] == "E" and name[1] == name[2]


def _by_setup(by: str) -> bool:
    return "zero" in by or "dressing" in by or by.startswith(("mounting", "set-up"))


def incurable(cure: CureRecord) -> bool:
    """Whether it must stand among what compensation cannot take: mechanical, in part only, or by products alone."""
    return tag(cure) in ("mech", "part", "product")


def why(cure: CureRecord) -> str:
    """Why compensation does not take an error: one or two sentences, by what the error moves."""
    name = cure.error
    if tag(cure) == "product":
        return _PRODUCT
    if name in ("EAC", "EBC"):
        return _WOBBLE
    if name.startswith("E"):
        return _BY_MOTION.get(name[1:2], _ANY)
    return _LEAN if name.startswith("A") else _BY_MOTION.get(name[:1], _ANY)


def what(cure: CureRecord) -> str:
    """What cures it, in words for a table: "table X(Z)", "mechanical only", "none needed"."""
    kind = tag(cure)
    if kind == "axis":
        return f"{spoken().own} table {cure.error[1:2]}({cure.error[2:3]})" if own(cure.error) else cure.by
    return f"{spoken().cross} table {cure.by}" if kind == "cross" and "table" not in cure.by else cure.by
