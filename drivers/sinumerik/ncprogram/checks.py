"""Checks on a program: guarded axes, what it moves, and the rules of the language.

Guards are blocks that end the program before its first move when an axis has left its safe place. What a program moves
is read back from its own blocks, so that what people are told cannot differ from what is sent. `check_program` is the
gate before sending: only a `LegalProgram` can be sent.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from typing import Any

from drivers.errors import LocalProtocolError
from drivers.programs import ProgramText
from drivers.sinumerik.legality import Finding, Machine, check
from drivers.sinumerik.ncprogram.blocks import format_number
from drivers.sinumerik.ncprogram.words import Phase, Word, Words
from drivers.types.moves import NEAR, Going, SafePlaces
from drivers.types.stops import StopPlan
from drivers.units import AxisUnit

# What a program does about places: it ends before its first move when a guarded axis has left its safe place.
#
# And what a program moves, read back from its own blocks, so that what people are told cannot differ from what is
# sent.

AWAY = "TF_AWAY"
_MOVE = re.compile(r"SUPA G1 ([A-Z]\w*)=(.+) F=([\d.]+)")
_PLACE = re.compile(r"(?:(DC|ACP|ACN|IC)\()?([^()]+)\)?")
_TERM = re.compile(r"([+-]?)([A-Z_]\w*|[\d.]+)")


@dataclass(frozen=True, slots=True)
class Guard:
    """One axis that must stand within (low, high), mm or deg; ``number`` is its machine axis number, from 1."""

    axis: str
    number: int
    low: float
    high: float


def guard_blocks(words: Words, guards: Iterable[Guard]) -> list[str]:
    """Blocks before the first move; they jump to `AWAY`, the axis' number in the mismatch word, unless all is well.

    $AA_IM is the set position in the machine's coordinates; STOPRE before, because blocks are read ahead of the axes.
    """
    shown = words.name(Word.MISMATCHES)
    out: list[str] = []
    for guard in guards:
        place = f"$AA_IM[{guard.axis}]"
        bounds = ((f"{place}<", guard.low - NEAR), (f"{place}>", guard.high + NEAR))
        tests = [f"IF {left}{format_number(bound)} GOTOF {AWAY}" for left, bound in bounds if isfinite(bound)]
        out += [f"{shown}={guard.number}", *tests] if tests else []
    return ["STOPRE", *out, f"{shown}=0"] if out else []


def away_blocks(words: Words, guards: Iterable[Guard]) -> list[str]:
    """The way out of a program whose axes do not stand where they may; nothing is moved, written or switched by it."""
    if not guard_blocks(words, guards):
        return []
    return [f"{AWAY}:", "STOPRE", f"{words.name(Word.PHASE)}={int(Phase.AWAY)}", "M30"]


def skip_if_there(axis: str, place: float, block: str, *, modulo: bool) -> list[str]:
    """A move that is left out where the axis stands right already."""
    off = f"ABS($AA_IM[{axis}]{'+' if place < 0 else '-'}{format_number(abs(place))})"
    test = f"IF {off}>{format_number(NEAR)}"
    if modulo:
        test = f"IF ({off}>{format_number(NEAR)}) AND (ABS({off}-360.0)>{format_number(NEAR)})"
    return ["STOPRE", test, block, "ENDIF"]


def read_moves(
    text: str, axes: Mapping[str, tuple[str, AxisUnit]], values: Mapping[str, float] | None = None
) -> tuple[Going, ...]:
    """What a program moves, axis by axis in the order of their first moves.

    ``axes`` gives name and unit by the letter in the program, ``values`` what variables in places hold (a place in
    any other variable counts as a turn). Raises KeyError for a letter that is not in ``axes``.
    """
    lines = text.splitlines()
    moves = [(match.groups(), lines[place - 1]) for place, line in enumerate(lines) if (match := _MOVE.fullmatch(line))]
    letters = dict.fromkeys(found[0] for found, _ in moves)
    return tuple(
        _axis_move(*axes[letter], [(one[1], one[2], before) for one, before in moves if one[0] == letter], values or {})
        for letter in letters
    )


def _axis_move(axis: str, unit: AxisUnit, moves: list[tuple[str, str, str]], values: Mapping[str, float]) -> Going:
    read = [_move_target(text, values) for text, _, _ in moves]
    known = [place for place in read if place is not None] or [0.0]
    feeds = [float(feed) for _, feed, _ in moves]
    return Going(
        axis,
        unit,
        first=known[0],
        last=known[-1],
        low=min(known),
        high=max(known),
        feeds=(min(feeds), max(feeds)),
        turns=None in read,
        goes_if_elsewhere=all(before.startswith("IF ") and "$AA_IM[" in before for _, _, before in moves),
    )


def _move_target(text: str, values: Mapping[str, float]) -> float | None:
    """Where a block leads to; None for a step, and for what only the running program knows."""
    match = _PLACE.fullmatch(text)
    if match is None or match[1] == "IC":
        return None
    total = 0.0
    for sign, term in _TERM.findall(match[2]):
        if term[0].isalpha() and term not in values:
            return None
        value = values[term] if term[0].isalpha() else float(term)
        total += -value if sign == "-" else value
    return total


def axes_left_safe(safe: set[str], plan: StopPlan, places: SafePlaces) -> set[str]:
    """The axes that stand in their safe places once a plan has been visited; before it those in ``safe`` did."""
    if not plan.stops:
        return safe
    return safe | {plan.axis} if places.holds(plan.axis, plan.stops[-1].target) else safe - {plan.axis}


def make_guards(places: SafePlaces, axes: Sequence[str], only: Collection[str]) -> tuple[Guard, ...]:
    """Guards of those axes that have a safe place; ``axes`` are machine axis names by their numbers, from 1."""
    return tuple(
        Guard(name, number, *places.ranges[name])
        for number, name in enumerate(axes, start=1)
        if name in only and name in places.ranges
    )


# The gate before a program is sent: only what the printed rules of the language allow becomes a `LegalProgram`.

_KEPT = 16
_QUOTED = re.compile(r'"[^"]*"|\[[^]]*\]')  # and what stands in brackets, which is no place of an axis


@dataclass(frozen=True, slots=True)
class LegalProgram:
    """A program that passed; made by `check_program` alone, and nothing else can be sent."""

    program: ProgramText


def check_program(path: str, text: str, axes: Iterable[str], still: Iterable[str] = ()) -> LegalProgram:
    """The program, judged; ``axes`` are all names that the machine's axes have, ``still`` names that no block may move.

    Raises LocalProtocolError (E-PROGRAM-ILLEGAL) naming path, line and rule of the first finding, and their count;
    E-PROGRAM-MOVES (line, axis) for a block that moves an axis of ``still``.
    """
    for name in still:
        moved = re.compile(rf"(?<![A-Z0-9_$(]){re.escape(name)}(?:\s*=(?!=)|\s*[-+.]?\d)")
        for line, block in enumerate(text.splitlines(), start=1):
            if moved.search(_QUOTED.sub("", block).partition(";")[0]):
                raise LocalProtocolError("E-PROGRAM-MOVES", path, path=path, line=line, axis=name)
    found = _findings(path.rpartition("/")[2], text, frozenset(name.upper() for name in axes))
    if found:
        first = found[0]
        given: dict[str, Any] = {"line": first.line, "rule": first.code, "why": first.what}
        raise LocalProtocolError("E-PROGRAM-ILLEGAL", path, path=path, count=len(found), **given)
    return LegalProgram(ProgramText(path, text))


@lru_cache(maxsize=_KEPT)
def _findings(name: str, text: str, axes: frozenset[str]) -> tuple[Finding, ...]:
    return check(text, name, Machine(axes))
