"""Variables with their indices: of the system, of the user, and the R parameters."""

from __future__ import annotations

import re
from collections.abc import Callable

from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.types import NUMERIC, UNKNOWN

Reads = Callable[[Cursor], str]
_AXIAL = re.compile(r"\$MA_|\$SA_|\$AA_ENC_COMP|\$[AV]A_IM|\$VA_\w*COMP_VAL")
_COUNTED = re.compile(r"\$MN_|\$SN_|\$MC_|\$SC_|\$AN_|\$TC_")
_FRAME_PART = 2  # $P_UIFR[1,X,TR]: an axis and a part behind the frame's own indices


def system_variable(cursor: Cursor, reads: Reads) -> str:
    """Read $NAME[...] and return its type. Raises Illegal for an unknown name or wrong indices."""
    name = cursor.take().text
    datum = dictionary().data.get(name)
    if datum is None:
        raise Illegal("E-LEGAL-VARIABLE", name=name)
    given = indices(cursor, name, reads) if cursor.sees("[") else []
    if datum.type == "FRAME" and len(given) == datum.indices + _FRAME_PART:
        return "REAL"
    if len(given) != datum.indices:
        raise Illegal("E-LEGAL-INDICES", name=name, given=len(given), wanted=datum.indices)
    _judge_places(name, given)
    return datum.type


def user_variable(cursor: Cursor, reads: Reads) -> str:
    """Read a declared variable with its indices and return the element's type."""
    name = cursor.take().text
    declared = cursor.scope.variables[name]
    if not cursor.sees("["):
        return declared.type if not declared.sizes else UNKNOWN
    given = indices(cursor, name, reads, declared.sizes)
    letter = declared.type == "STRING" and len(given) == len(declared.sizes) + 1
    if len(given) != len(declared.sizes) and not letter:
        raise Illegal("E-LEGAL-INDICES", name=name, given=len(given), wanted=len(declared.sizes))
    _judge_numbers(name, given)
    return "CHAR" if letter else declared.type


def parameter(cursor: Cursor, reads: Reads) -> str:
    """Read R10 or R[...]; the number is whole and not negative."""
    text = cursor.take().text
    if len(text) > 1:
        if "." in text:
            raise Illegal("E-LEGAL-R", text=text)
    elif cursor.sees("["):
        given = indices(cursor, "R", reads)
        if len(given) != 1:
            raise Illegal("E-LEGAL-INDICES", name="R", given=len(given), wanted=1)
        _judge_numbers("R", given)
    else:
        raise Illegal("E-LEGAL-R", text=f"R{cursor.token.text}")
    return "REAL"


def indices(cursor: Cursor, name: str, reads: Reads, sizes: tuple[int, ...] = ()) -> list[str]:
    """Read [a,b,...] and return the types; a constant must be whole, not negative and inside its size."""
    cursor.expect("[")
    given: list[str] = []
    while True:
        size = sizes[len(given)] if len(given) < len(sizes) else None
        _judge_constant(cursor, name, size)
        given.append(reads(cursor))
        if not cursor.accept(","):
            break
    cursor.expect("]")
    return given


def _judge_constant(cursor: Cursor, name: str, size: int | None) -> None:
    token, behind = cursor.token, cursor.after
    if token.text == "-" and behind.kind == "number":
        raise Illegal("E-LEGAL-INDEX-VALUE", name=name, value=f"-{behind.text}")
    if token.kind != "number" or behind.text not in (",", "]"):
        return
    whole = re.fullmatch(r"[0-9]{1,9}", token.text)
    if not whole or (size is not None and int(token.text) >= size):
        raise Illegal("E-LEGAL-INDEX-VALUE", name=name, value=token.text)


def _judge_places(name: str, given: list[str]) -> None:
    """The axis of an axial datum stands last; everything else is counted."""
    if _AXIAL.match(name) and given:
        if given[-1] not in ("AXIS", UNKNOWN):
            raise Illegal("E-LEGAL-INDEX-AXIS", name=name, place=len(given))
        _judge_numbers(name, given[:-1])
    elif _COUNTED.match(name):
        _judge_numbers(name, given)


def _judge_numbers(name: str, given: list[str]) -> None:
    for place, kind in enumerate(given, 1):
        if kind not in NUMERIC and kind != UNKNOWN:
            raise Illegal("E-LEGAL-INDEX-NUMBER", name=name, place=place, given=kind)
