"""Which moments of a motion to look at, and where one pass of the wheel ends and the next begins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
LOOK_S = 0.04
STEP_MM = 0.25
SHORTEST_S = 0.0005
STILL_MM = 1e-6
SPARE = 1.2


def closely(times: FloatArray, x: FloatArray, z: FloatArray, near: BoolArray) -> tuple[FloatArray, BoolArray]:
    """The coarse moments, and between those near the work as many as a quarter of a millimetre of way asks for.

    ``x``, ``z`` and ``near`` may go on beyond ``times``. Returns (n,) times and which lie where the wheel is near.
    """
    wide = near.copy()
    wide[:-1] |= near[1:]
    wide[1:] |= near[:-1]
    ways = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(z)))
    pieces, marks = [times[:1]], [near[:1]]
    for place, (first, last) in enumerate(pairwise(times.tolist())):
        inside = bool(wide[place] and wide[place + 1])
        most = max(int((last - first) / SHORTEST_S), 1)
        count = min(int(np.ceil(SPARE * ways[place] / STEP_MM)) + 1, most) if inside else 1
        pieces.append(np.linspace(first, last, count + 1)[1:])
        marks.append(np.full(count, inside))
    return np.concatenate(pieces), np.concatenate(marks)


def passes(times: FloatArray, z: FloatArray, spaces: NDArray[np.int_]) -> list[slice]:
    """Stretches in which the wheel goes one way through one space without a gap in time."""
    way = _ways(np.diff(z))
    turned = np.zeros(len(z), dtype=np.bool_)
    turned[1:] = (spaces[1:] != spaces[:-1]) | (np.diff(times) > 1.5 * LOOK_S)
    turned[1:-1] |= way[1:] != way[:-1]
    edges = [0, *np.flatnonzero(turned).tolist(), len(z)]
    return [slice(low, high) for low, high in pairwise(edges)]


def _ways(moved: FloatArray) -> FloatArray:
    """+1 or -1 for each step; a stroke that stands still goes on as it went before."""
    way = np.sign(np.where(np.abs(moved) > STILL_MM, moved, 0.0))
    known = np.flatnonzero(way)
    if not len(known):
        return way
    last = np.searchsorted(known, np.arange(len(way)), side="right") - 1
    return np.asarray(way[known[np.maximum(last, 0)]])
