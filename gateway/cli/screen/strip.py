"""A tooth before and after as strips of coloured cells for a terminal, or of plain characters; pure.

One column is a space of the gear (several where the terminal is narrow): the mean of its left flank above, of its right
flank below. Red is surplus, blue is missing material, white is on size, as in the pictures of the report.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from gateway.tooth import FlankMap

FloatArray = NDArray[np.float64]
NARROWEST, WIDEST = 10, 120
HALF = "▀"
RAMPS = {1: (231, 224, 217, 210, 203, 160), -1: (231, 189, 147, 111, 69, 26)}
"""Colours of a terminal's 256, from right to the end of the scale: surplus red, missing blue."""
LEVELS = (0.15, 0.5)
"""Shares of the scale at which a plain strip changes its character."""
PLAIN = {0: ".", 1: "+", 2: "#", -1: "-", -2: "="}


def cells(flank: FlankMap, width: int) -> FloatArray:
    """Means (2, N) um of left and right flanks, space by space, N at most ``width``; + surplus."""
    spaces, points, _ = flank.deviation_um.shape
    sides = flank.deviation_um.reshape(spaces, 2, points // 2, -1).mean(axis=(2, 3)).T
    if spaces <= width:
        return np.repeat(sides, width // spaces, axis=1)
    edges = np.linspace(0, spaces, width + 1).astype(int)
    return np.stack([sides[:, low:high].mean(axis=1) for low, high in pairwise(edges)], axis=1)


def strips(named: Sequence[tuple[str, FlankMap]], columns: int, *, colours: bool) -> tuple[Text, ...]:
    """One line for each named flank with its RMS, all on one scale; none wider than ``columns``."""
    head = max(len(name) for name, _ in named) + 1
    tail = max(len(_rms(flank)) for _, flank in named) + 1
    width = max(min(columns - head - tail, WIDEST), NARROWEST)
    rows = [(name, flank, cells(flank, width)) for name, flank in named]
    top = max(1e-9, *(float(np.max(np.abs(row))) for _, _, row in rows))
    paint = _coloured if colours else _plain
    return tuple(Text.assemble(f"{name:<{head}}", paint(row / top), f" {_rms(flank)}") for name, flank, row in rows)


def top_um(named: Sequence[tuple[str, FlankMap]]) -> float:
    """The end of the scale of such strips at their widest, um."""
    return max(float(np.max(np.abs(cells(flank, WIDEST)))) for _, flank in named)


def _rms(flank: FlankMap) -> str:
    return f"{flank.rms_um:.2f}"


def _coloured(row: FloatArray) -> Text:
    return Text.assemble(*((HALF, f"color({_colour(left)}) on color({_colour(right)})") for left, right in row.T))


def _colour(share: float) -> int:
    """White at 0, red at 1, blue at -1."""
    ramp = RAMPS[1 if share > 0.0 else -1]
    return ramp[min(round(abs(share) * (len(ramp) - 1)), len(ramp) - 1)]


def _plain(row: FloatArray) -> Text:
    """The flank of each column that is further off."""
    largest = np.take_along_axis(row, np.argmax(np.abs(row), axis=0)[None], axis=0)[0]
    levels = np.sign(largest).astype(int) * np.searchsorted(LEVELS, np.abs(largest), side="right")
    return Text("".join(PLAIN[int(level)] for level in levels))
