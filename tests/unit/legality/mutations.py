"""Legal programs with one rule broken: seeded, each with the code and the line that must be found."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tests.unit.legality.broken_first import FIRST
from tests.unit.legality.broken_heads import HEADS
from tests.unit.legality.broken_second import SECOND
from tests.unit.legality.generated import GENERATED
from tests.unit.legality.programs import BACKUP, MEASURE, STEERED, TABLE

HOSTS = (MEASURE, TABLE, BACKUP, STEERED, *GENERATED)
_OPENS = ("FOR ", "WHILE ", "LOOP", "REPEAT\n")
_CLOSES = ("ENDFOR", "ENDWHILE", "ENDLOOP", "UNTIL", "ENDIF")


@dataclass(frozen=True)
class Mutant:
    """A program, the rule that it breaks and where."""

    text: str
    code: str
    line: int


def _depths(lines: Sequence[str]) -> list[int]:
    """How many structures stand open before each line."""
    depth, found = 0, []
    for line in lines:
        found.append(depth)
        words = line.strip() + "\n"
        if words.startswith(_OPENS) or (words.startswith("IF ") and "GOTO" not in words):
            depth += 1
        elif words.startswith(_CLOSES):
            depth -= 1
    return found


def _places(lines: Sequence[str]) -> list[int]:
    """Where a block may be put: behind the first block that works, before the last, nothing open."""
    depths = _depths(lines)
    first = next(n for n, line in enumerate(lines) if line.strip() and not line.startswith(("DEF", ";")))
    return [n for n in range(first + 1, len(lines) - 1) if depths[n] == 0]


def body(rng: random.Random, code: str, blocks: str, offset: int = 0) -> Mutant:
    """``blocks`` put into the working part of some program; the fault stands ``offset`` lines below the first."""
    lines = rng.choice(HOSTS).rstrip("\n").split("\n")
    at = rng.choice(_places(lines))
    lines[at:at] = blocks.split("\n")
    return Mutant("\n".join([*lines, ""]), code, at + 1 + offset)


def head(rng: random.Random, code: str, blocks: str, offset: int = 0) -> Mutant:
    """``blocks`` put before everything else; those that work before a program without definitions."""
    host = TABLE if code in _BEFORE_WORK else rng.choice(HOSTS)
    return Mutant(blocks + "\n" + host, code, 1 + offset)


def end(rng: random.Random, code: str, last: str) -> Mutant:
    """The end word replaced."""
    lines = rng.choice(HOSTS).rstrip("\n").split("\n")
    return Mutant("\n".join([*lines[:-1], last, ""]), code, len(lines))


Breaks = Callable[[random.Random, str, str], Mutant]

_BODY_OFFSETS = {
    "E-LEGAL-CLOSE": {"IF R1==1\nENDFOR\nENDIF": 1},
    "E-LEGAL-OPERATOR": {"REPEAT\nUNTIL R1=3": 1},
    "E-LEGAL-PRIORITY": {"REPEAT\nUNTIL R1>3 OR R2>3": 1},
}

_AT_LAST_LINE = ("E-LEGAL-TWICE", "E-LEGAL-FOR", "E-LEGAL-LIST", "E-LEGAL-PATH")
_BEFORE_WORK = ("E-LEGAL-FOR", "E-LEGAL-LIST")


def _nested(rng: random.Random) -> Mutant:
    pairs = [
        rng.choice((("LOOP", "ENDLOOP"), ("IF R1==1", "ENDIF"), ("REPEAT", "UNTIL R1>1"), ("WHILE R1<1", "ENDWHILE")))
        for _ in range(17)
    ]
    blocks = [opener for opener, _ in pairs] + [closer for _, closer in reversed(pairs)]
    return body(rng, "E-LEGAL-DEPTH", "\n".join(blocks), 16)


def _twice(rng: random.Random, n: int) -> Mutant:
    return body(rng, "E-LEGAL-TWICE", f"UTW{n}:\nR1={n}\nUTW{n}: R2=1", 2)


def _offset(code: str, block: str) -> int:
    """Where the fault stands inside what is put in."""
    lines = block.split("\n")
    if code == "E-LEGAL-ELSE":
        return max(n for n, line in enumerate(lines) if "ELSE" in line.upper())
    if code == "E-LEGAL-DIRECTION":
        return next(n for n, line in enumerate(lines) if "GOTO" in line)
    return _BODY_OFFSETS.get(code, {}).get(block, 0)


def _head_offset(code: str, block: str) -> int:
    if code not in _AT_LAST_LINE:
        return 0
    return 1 if code in _BEFORE_WORK else block.count("\n")


_ENDS = (
    "M0",
    "M1",
    "M3",
    "R1=1",
    "M300",
    "M31",
    "STOPRE",
    'MSG("end")',
    "G4 F1",
    "M20",
    "IF R1==1 GOTOC UEND",
    "UALAST:",
)


def mutants(seed: int) -> list[Mutant]:
    """Every rule broken in at least ten ways, each in a program and at a place that the seed chooses."""
    rng = random.Random(seed)
    made = [
        body(rng, code, block, _offset(code, block)) for code, blocks in (FIRST | SECOND).items() for block in blocks
    ]
    made += [head(rng, code, block, _head_offset(code, block)) for code, blocks in HEADS.items() for block in blocks]
    made += [end(rng, "E-LEGAL-END", last) for last in _ENDS]
    made += [_nested(rng) for _ in range(12)]
    made += [_twice(rng, n) for n in range(12)]
    return made
