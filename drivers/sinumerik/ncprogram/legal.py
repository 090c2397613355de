"""The gate before a program is sent: only what the printed rules of the language allow becomes a `LegalProgram`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from drivers.errors import LocalProtocolError
from drivers.programs import ProgramText
from drivers.sinumerik.legality import Finding, Machine, check

_KEPT = 16
_QUOTED = re.compile(r'"[^"]*"|\[[^]]*\]')  # and what stands in brackets, which is no place of an axis


@dataclass(frozen=True, slots=True)
class LegalProgram:
    """A program that passed; made by `legal` alone, and nothing else can be sent."""

    program: ProgramText


def legal(path: str, text: str, axes: Iterable[str], still: Iterable[str] = ()) -> LegalProgram:
    """The program, judged; ``axes`` are all names that the machine's axes have, ``still`` names that no block may move.

    Raises LocalProtocolError (E-PROGRAM-ILLEGAL) naming path, line and rule of the first finding, and their count;
    E-PROGRAM-MOVES (line, axis) for a block that moves an axis of ``still``.
    """
    for name in still:
        moved = re.compile(rf"(?<![A-Z0-9_$(]){re.escape(name)}(?:\s*=(?!=)|\s*[-+.]?\d)")
        for line, block in enumerate(text.splitlines(), start=1):
            if moved.search(_QUOTED.sub("", block).partition(";")[0]):
                raise LocalProtocolError("E-PROGRAM-MOVES", path, path=path, line=line, axis=name)
    found = _found(path.rpartition("/")[2], text, frozenset(name.upper() for name in axes))
    if found:
        first = found[0]
        given: dict[str, Any] = {"line": first.line, "rule": first.code, "why": first.what}
        raise LocalProtocolError("E-PROGRAM-ILLEGAL", path, path=path, count=len(found), **given)
    return LegalProgram(ProgramText(path, text))


@lru_cache(maxsize=_KEPT)
def _found(name: str, text: str, axes: frozenset[str]) -> tuple[Finding, ...]:
    return check(text, name, Machine(axes))
