"""What an error does between its targets, where no fit follows it: how much it may slope and bow over a face.

A curve through all targets shows it by itself: each target misses the curve through all others. That counts in full:
structure too short for the targets and a guide worn at the face look alike there. What is worn far from the face counts
no more than usual misses do.
"""

from __future__ import annotations

import numpy as np

from drivers.types.values import FloatArray
from gateway.domain.figures import Component
from gateway.model.cubic import FEWEST, missing

MAD_TO_SIGMA = 1.4826
# Mean target distances beside a face from which a hollow that targets see still reaches it, and how many standard
# deviations of the usual misses a target further away may miss by.
BESIDE, USUAL = 2.0, 4.0


def slope_and_bow(one: Component, face_mm: float, middle: float | None = None) -> tuple[float, float]:
    """RMS over a face of the slope and of the bow that an error of a linear axis may have beside its fit, um or arcsec.

    Half of what lies between the targets each; a smooth fit leaves what its targets scatter about it
    (``residual_rms``). Where a working window lies around the face's ``middle`` (in the axis' unit), its targets tell
    and no others.
    """
    here = near(one, face_mm, middle)
    unseen = one.residual_rms
    if here is not None:
        unseen = _between(one, here, None if middle is None else around(one, face_mm, middle))
    return unseen / 2.0**0.5, unseen / 2.0**0.5


def nodes_of(one: Component) -> FloatArray:
    """Places that a curve goes through; none of a smooth fit."""
    return np.asarray(one.parameters.get("nodes", ()) if one.basis == "cubic" else (), dtype=np.float64)


def near(one: Component, face_mm: float, middle: float | None) -> slice | None:
    """The nodes that tell of a face: those over it and one beside it where they are enough, else all; None if few."""
    nodes = nodes_of(one)
    if nodes.size < FEWEST:
        return None
    if middle is None:
        return slice(0, nodes.size)
    first = max(int(np.searchsorted(nodes, middle - face_mm / 2.0)) - 1, 0)
    last = min(int(np.searchsorted(nodes, middle + face_mm / 2.0, side="right")) + 1, nodes.size)
    return slice(first, last) if last - first >= FEWEST else slice(0, nodes.size)


def around(one: Component, face_mm: float, middle: float) -> tuple[float, float]:
    """From where to where targets see what reaches the face."""
    beside = face_mm / 2.0 + BESIDE * float(np.mean(np.diff(nodes_of(one))))
    return middle - beside, middle + beside


def _between(one: Component, here: slice, reaching: tuple[float, float] | None) -> float:
    """RMS of what would scatter independently at the inner targets as much as these miss the curve through the others.

    A fault of a guide at one place beyond what is ``reaching`` the face counts no more there than usual misses do.
    """
    nodes = nodes_of(one)
    rows, at = missing(nodes)[here.start : here.stop - 2], nodes[here][1:-1]
    rows /= np.sum(rows**2, axis=1, keepdims=True) ** 0.5
    missed, doubt = rows @ one.coefficients, np.einsum("ij,jk,ik->i", rows, one.covariance, rows)
    if reaching is not None:
        most = USUAL * MAD_TO_SIGMA * float(np.median(np.abs(missed)))
        far = (at < reaching[0]) | (at > reaching[1])
        missed = np.where(far, np.clip(missed, -most, most), missed)
    return float(np.sqrt(max(float(np.mean(missed**2 - doubt)), 0.0)))
