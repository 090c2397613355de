"""Damages small files in many ways, seeded: bytes, numbers, lines; and counts what a reader makes of them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import ConfigError, FileFormatError

SPICE = [b"", b"-", b".", b",", b";", b"nan", b"1e9", b"inf", b"::", b":", b'"', b"\r\n", b"\n", b"\t", b"0", b"1"]
SPICE += [b"9", b"\xff", b"\x00", b" ", b"+", b"e", b"E", b"#", b"<", b">", b"&lt;", b"1,5", b"-0", b"99999999999"]
SPICE += [b"\xc3\xa9"]
DIGIT = re.compile(rb"[0-9]")


def mutate(data: bytes, rng: random.Random) -> bytes:
    """One to three changes."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(CHANGES)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data)) if data else 0
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


def _spice(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(SPICE) + data[at + rng.randrange(3) :]


def _digit(data: bytes, rng: random.Random) -> bytes:
    found = DIGIT.search(data, rng.randrange(len(data) + 1)) or DIGIT.search(data)
    if found is None:
        return data
    return data[: found.start()] + rng.choice((b"0", b"5", b"9", b"12", b"", b"7.")) + data[found.end() :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[first]
        case 1:
            lines.insert(second, lines[first])
        case 2:
            lines[first], lines[second] = lines[second], lines[first]
        case _:
            lines = lines[: first + 1]
    return b"\n".join(lines)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


CHANGES = (_flip, _spice, _spice, _digit, _digit, _lines, _lines, _cut)


@dataclass
class Score:
    """How many were accepted, and refused by which code."""

    accepted: int
    refused: dict[str, int]


def run(
    bases: list[bytes], read: Callable[[bytes], object], check: Callable[[bytes, object], None], count: int, seed: int
) -> Score:
    """Read ``count`` mutations; whatever is accepted must pass ``check``; whatever is refused must say so properly."""
    rng, score = random.Random(seed), Score(0, {})
    for number in range(count):
        data = mutate(bases[number % len(bases)], rng)
        try:
            found = read(data)
        except (FileFormatError, ConfigError) as error:
            line = error.fields.get("line")
            if error.code == "E-FILE-LINE" and not (isinstance(line, int) and line >= 1 and error.fields.get("why")):
                raise AssertionError(f"seed {seed}, mutation {number}: no line or reason: {error}") from error
            score.refused[error.code] = score.refused.get(error.code, 0) + 1
            continue
        except Exception as error:
            raise AssertionError(f"seed {seed}, mutation {number}: {error!r} of {data!r}") from error
        score.accepted += 1
        try:
            check(data, found)
        except Exception as error:
            raise AssertionError(f"seed {seed}, mutation {number}: {error!r}: {data!r}") from error
    return score
