"""What an error does between its targets, where no fit follows it: how much it may slope and bow over a face.

A polygon's own corners tell: each misses the line between its neighbours. Neighbours that miss alike, or hardly unlike,
belong to waves of three target distances and more, of which a polygon leaves little; the rest is shorter than the
targets can show and counts in full. A face that few targets lie over may be where a guide is worn: then its nearest
targets and those of the whole travel are asked, and the worse of the two counts.
"""

from __future__ import annotations

import numpy as np

from drivers.types.values import FloatArray
from gateway.domain.figures import Component

FEWEST = 6  # targets that tell neighbours apart
LONG = -0.5  # cosine of a wave's phase from target to target: three distances
# Of such a wave's misses, RMS: slope over one target distance and bow over its square that a polygon leaves of it.
SLOPE, BOW = 0.227, 0.109


def slope_and_bow(one: Component, face_mm: float, middle: float | None = None) -> tuple[float, float]:
    """RMS over a face of the slope and of the bow that an error of a linear axis may have beside its fit, um or arcsec.

    A smooth fit leaves what its targets scatter about it (``residual_rms``), of any length: half of it each. Where a
    working window lies around the face's ``middle`` (in the axis' unit), its targets tell and no others.
    """
    nodes, here = nodes_of(one), near(one, face_mm, middle)
    if here is None:
        return one.residual_rms / 2.0**0.5, one.residual_rms / 2.0**0.5
    asked = (here,) if _spans(nodes[here], face_mm, middle) else (here, slice(0, nodes.size))
    found = [_over_face(one, face_mm, part) for part in asked]
    return max(slope for slope, _ in found), max(bow for _, bow in found)


def _over_face(one: Component, face_mm: float, here: slice) -> tuple[float, float]:
    """Slope and bow by these corners alone; few misses know their own spread badly (GUM Supplement 1, 6.4.9)."""
    long, short = long_and_short(one, here)
    nodes = nodes_of(one)[here]
    share, half = min(1.0, face_mm / float(np.mean(np.diff(nodes)))), short / 2.0**0.5
    missed = nodes.size - 2
    few = (missed / (missed - 2)) ** 0.5
    return few * float(np.hypot(SLOPE * share * long, half)), few * float(np.hypot(BOW * share**2 * long, half))


def nodes_of(one: Component) -> FloatArray:
    """Corners of a polygon; none of a smooth fit."""
    return np.asarray(one.parameters.get("nodes", ()) if one.basis == "piecewise" else (), dtype=np.float64)


def near(one: Component, face_mm: float, middle: float | None) -> slice | None:
    """The corners that tell of a face: those over it and one beside it, or as many as are needed; None if few."""
    nodes = nodes_of(one)
    if nodes.size < FEWEST:
        return None
    if middle is None:
        return slice(0, nodes.size)
    first = max(int(np.searchsorted(nodes, middle - face_mm / 2.0)) - 1, 0)
    last = min(int(np.searchsorted(nodes, middle + face_mm / 2.0, side="right")) + 1, nodes.size)
    while last - first < FEWEST:
        before = last == nodes.size or (first > 0 and middle - nodes[first - 1] < nodes[last] - middle)
        first, last = (first - 1, last) if before else (first, last + 1)
    return slice(first, last)


def long_and_short(one: Component, here: slice) -> tuple[float, float]:
    """RMS of what the inner targets miss by long waves, and RMS of structure too short for them."""
    rows = _skipping(nodes_of(one)[here])
    missed, doubt = rows @ one.coefficients[here], rows @ one.covariance[here, here] @ rows.T
    square = max(float(np.mean(missed**2) - np.mean(np.diag(doubt))), 0.0)
    along = float(np.mean(missed[1:] * missed[:-1]) - np.mean(np.diag(doubt, 1)))
    # Independent values of variance w miss by 1.5 w, neighbours by -w together; the longest of the others by LONG.
    short = min(max(LONG * square - along, 0.0) / (1.0 + 1.5 * LONG), square / 1.5)
    return float(np.sqrt(max(square - 1.5 * short, 0.0))), float(np.sqrt(short))


def _spans(nodes: FloatArray, face_mm: float, middle: float | None) -> bool:
    """Whether so many targets are a face's own, and not borrowed from beside it."""
    over = middle is None or np.sum(np.abs(nodes - middle) <= face_mm / 2.0) + 2 >= FEWEST
    return bool(over)


def _skipping(nodes: FloatArray) -> FloatArray:
    """Rows (m - 2, m): each inner value less the line between its neighbours."""
    share = (nodes[1:-1] - nodes[:-2]) / (nodes[2:] - nodes[:-2])
    rows, i = np.zeros((nodes.size - 2, nodes.size)), np.arange(nodes.size - 2)
    rows[i, i], rows[i, i + 1], rows[i, i + 2] = share - 1.0, 1.0, -share
    return rows
