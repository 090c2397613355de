"""The curve that bends least through values at places: natural cubic splines, as sums over their nodes; pure."""

from __future__ import annotations

import numpy as np
import scipy

from gateway.domain.values import FloatArray

FEWEST = 6
"""Nodes that carry a curve; fewer carry straight lines."""
CLOSE = 0.1
"""Nodes closer than this share of a gap beside them are one: their scatter is a slope that swings over the gap."""


def apart(places: FloatArray) -> FloatArray:
    """Nodes for places of any order, ascending: those too close together are one in their middle; both ends stay."""
    nodes, counts = np.unique(np.round(places, 6), return_counts=True)
    while nodes.size > 2:
        gaps = np.diff(nodes)
        beside = np.maximum(np.append(gaps[1:], 0.0), np.append(0.0, gaps[:-1]))
        i = int(np.argmin(gaps / beside))
        if gaps[i] >= CLOSE * beside[i]:
            break
        middle = (nodes[i] * counts[i] + nodes[i + 1] * counts[i + 1]) / (counts[i] + counts[i + 1])
        one = nodes[0] if i == 0 else nodes[-1] if i == gaps.size - 1 else middle
        counts = np.concatenate([counts[:i], [counts[i] + counts[i + 1]], counts[i + 2 :]])
        nodes = np.concatenate([nodes[:i], [one], nodes[i + 2 :]])
    return nodes


def cardinal(nodes: FloatArray, positions: FloatArray) -> FloatArray:
    """What each node's value adds at positions within them: (points, nodes), each row's sum 1; nodes ascend."""
    return np.asarray(scipy.interpolate.CubicSpline(nodes, np.eye(nodes.size), bc_type="natural")(positions))


def missing(nodes: FloatArray) -> FloatArray:
    """Rows (nodes - 2, nodes): each inner value less the curve through all others.

    What a curve bends, the integral of its second derivative squared, is y' K y in the values y at its nodes (Green and
    Silverman 1994, section 2.1). The others' curve goes where that is least, so a value misses it by (K y)_k / K_kk.
    """
    h, inner = np.diff(nodes), np.arange(nodes.size - 2)
    q = np.zeros((nodes.size, nodes.size - 2))
    q[inner, inner], q[inner + 1, inner], q[inner + 2, inner] = 1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]
    beside = np.diag(h[1:-1] / 6.0, 1)
    r = np.diag((h[:-1] + h[1:]) / 3.0) + beside + beside.T
    bent = q @ np.linalg.solve(r, q.T)
    return np.asarray((bent / np.diag(bent)[:, None])[1:-1])
