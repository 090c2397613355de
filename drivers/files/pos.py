"""API laser results, .pos: the mean error at each position, in three blocks of text; mm throughout.

Layout as one public converter reads it: a line naming "Position" and the block ("Bidirectional Avg Error",
"Forward Directional Avg Error", ...), then rows "position error". Means only: what a repetition was is lost.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.assembly import doubted
from drivers.files.numbers import decimal
from drivers.files.tables.sheet import MOST_WORDS, words_above
from drivers.files.text import end_doubts, read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message
from drivers.types.results import MeasuredSet
from drivers.units import mm_to_um, typed_unit

_BREAK = re.compile(r"\r\n|\n|\r")
_BLOCK = re.compile(r"\s*Position\s+(.+?)\s+Avg\.? Error\s*\Z", re.IGNORECASE)
BOTH, FORWARD, BACKWARD = "bidirectional", "forward", "backward"
MEANS_ONLY = Message.of("S-FILE-MEANS")


class PosFormat:
    """File driver "pos": positions and errors in mm; forward and backward means where they are there.

    Raises ConfigError (E-FILE-UNIT) for another unit.
    """

    def __init__(self, unit: str = "", codepage: str = "cp1252", *, confirmed: bool = False) -> None:
        if typed_unit(unit) not in ("", "mm"):
            raise ConfigError("E-FILE-UNIT", "pos", unit=unit, known="mm")
        self._codepage = codepage
        self._confirmed = confirmed

    def read(self, path: Path) -> MeasuredSet:
        """Read a file. Raises FileFormatError with line and reason."""
        where = str(path)
        measured = parse_pos(decode_text(read_bytes(path), self._codepage, where), where)
        return doubted(measured, where, confirmed=self._confirmed)


def parse_pos(text: str, where: str) -> MeasuredSet:
    """A whole file, pure: one repetition of means. Without forward and backward the mean of both stands for both."""
    blocks = _blocks(text, where)
    if not blocks:
        raise FileFormatError("E-FILE-POS", where)
    down = blocks.get(BACKWARD)
    name = next((key for key in (FORWARD, BOTH, *blocks) if key in blocks and key != BACKWARD), "")
    up = blocks.get(name)
    targets = sorted(up or down or {})
    if up is not None and down is not None and sorted(down) != targets:
        raise FileFormatError(
            "E-FILE-COUNT", where, stated=f"{len(up)} positions forward", found=f"{len(down)} backward"
        )
    deviations = np.full((len(targets), 1, 2), np.nan)
    for way, block in enumerate((up, down)):
        if block is not None:
            deviations[:, 0, way] = [block[target] for target in targets]
    words = [line for line in _BREAK.split(text) if any(decimal(token) is None for token in line.split())]
    header = {**words_above("\n".join(words), MOST_WORDS), "Format": "API .pos"}
    warnings = [MEANS_ONLY, *_doubts(name), *end_doubts(text)]
    return MeasuredSet(np.array(targets), mm_to_um(deviations), "mm", header=header, warnings=tuple(warnings))


def _doubts(name: str) -> list[Message]:
    """What stands for the readings from below, where that is not the forward block."""
    if name == FORWARD:
        return []
    if not name:
        return [Message.of("S-FILE-NO-FORWARD")]
    return [Message.of("S-FILE-FORWARD-IS", name=name)]


def _blocks(text: str, where: str) -> dict[str, dict[float, float]]:
    """Block name -> position -> error. A block ends at the first line that is no pair of numbers."""
    found: dict[str, dict[float, float]] = {}
    current: dict[float, float] | None = None
    for at, line in enumerate(_BREAK.split(text), start=1):
        match = _BLOCK.match(line)
        if match:
            current = _begin(found, match[1], at, where)
        elif line.strip():
            pair = [decimal(token) for token in line.split()]
            if current is None:
                if found and len(pair) == 2 and None not in pair:
                    raise FileFormatError("E-FILE-LINE", where, line=at, why=Message.of("W-FILE-AFTER-BLOCK"))
                continue
            if len(pair) != 2 or None in pair:
                if pair and pair[0] is not None:
                    raise FileFormatError(
                        "E-FILE-LINE", where, line=at, why=Message.of("W-FILE-NO-POS-ERROR", found=line.strip())
                    )
                current = None
                continue
            _add(current, float(pair[0] or 0.0), float(pair[1] or 0.0), at, where)
    return {name: block for name, block in found.items() if block}


def _begin(found: dict[str, dict[float, float]], title: str, at: int, where: str) -> dict[float, float]:
    words = title.lower()
    name = next((key for key in (BOTH, FORWARD) if words.startswith(key)), BACKWARD)
    if name == BACKWARD and not words.startswith(("backward", "reverse")):
        name = words
    if name in found:
        raise FileFormatError("E-FILE-LINE", where, line=at, why=f"block {title!r} occurs twice")
    return found.setdefault(name, {})


def _add(block: dict[float, float], position: float, error: float, at: int, where: str) -> None:
    if position in block:
        raise FileFormatError("E-FILE-LINE", where, line=at, why=f"position {position:g} occurs twice")
    block[position] = error
