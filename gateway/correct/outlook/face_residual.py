"""What an error does between its targets, where no fit follows it: how much it may slope and bow over a face.

A polygon's own corners tell: each misses the line between its neighbours. Neighbours that miss alike, or hardly unlike,
belong to waves of three target distances and more, of which a polygon leaves little; the rest is shorter than the
targets can show and counts in full. Where a face has few targets of its own, a guide may be worn just there: what a
curve through all targets bows away from the polygon over the face counts beside what the whole travel tells.
"""

from __future__ import annotations

import numpy as np
import scipy

from drivers.types.values import FloatArray
from gateway.domain.figures import Component

FEWEST = 6  # targets that tell neighbours apart
LONG = -0.5  # cosine of a wave's phase from target to target: three distances
MAD_TO_SIGMA = 1.4826
# Of such a wave's misses, RMS: slope over one target distance and bow over its square that a polygon leaves of it.
SLOPE, BOW = 0.227, 0.109
# A spline tells most of a hollow that few targets lie in, not all: so much more than it shows is to be expected.
BENT, ACROSS = 1.5, 17
# Mean target distances beside a face from which a hollow that targets see still reaches it, and how many standard
# deviations of the usual misses a target further away may miss by.
BESIDE, USUAL = 2.0, 4.0


def slope_and_bow(one: Component, face_mm: float, middle: float | None = None) -> tuple[float, float]:
    """RMS over a face of the slope and of the bow that an error of a linear axis may have beside its fit, um or arcsec.

    A smooth fit leaves what its targets scatter about it (``residual_rms``), of any length: half of it each. Where a
    working window lies around the face's ``middle`` (in the axis' unit), its targets tell and no others.
    """
    here = near(one, face_mm, middle)
    if here is None:
        return one.residual_rms / 2.0**0.5, one.residual_rms / 2.0**0.5
    nodes = nodes_of(one)[here]
    long, short = long_and_short(one, here, None if middle is None else around(one, face_mm, middle))
    share, half = min(1.0, face_mm / float(np.mean(np.diff(nodes)))), short / 2.0**0.5
    slope, bow = float(np.hypot(SLOPE * share * long, half)), float(np.hypot(BOW * share**2 * long, half))
    if middle is None or nodes.size < nodes_of(one).size:
        return slope, bow
    seen = _bent(one, face_mm, middle)
    return float(np.hypot(slope, BENT * seen[0])), float(np.hypot(bow, BENT * seen[1]))


def _bent(one: Component, face_mm: float, middle: float) -> tuple[float, float]:
    """RMS over a face of slope and bow that a natural cubic spline through the corners has beside the polygon."""
    x = np.linspace(-1.0, 1.0, ACROSS)
    at, nodes = middle + x * face_mm / 2.0, nodes_of(one)
    curve = scipy.interpolate.CubicSpline(nodes, one.coefficients, bc_type="natural")
    beside = curve(at) - np.interp(at, nodes, one.coefficients)
    shapes = np.stack([np.ones(ACROSS), 3.0**0.5 * x, 5.0**0.5 * 0.5 * (3.0 * x**2 - 1.0)], axis=1)
    _, slope, bow = np.linalg.lstsq(shapes, beside, rcond=None)[0]
    return abs(float(slope)), abs(float(bow))


def nodes_of(one: Component) -> FloatArray:
    """Corners of a polygon; none of a smooth fit."""
    return np.asarray(one.parameters.get("nodes", ()) if one.basis == "piecewise" else (), dtype=np.float64)


def near(one: Component, face_mm: float, middle: float | None) -> slice | None:
    """The corners that tell of a face: those over it and one beside it where they are enough, else all; None if few."""
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


def long_and_short(one: Component, here: slice, reaching: tuple[float, float] | None = None) -> tuple[float, float]:
    """RMS of what the inner targets miss by long waves, and RMS of structure too short for them.

    A fault of a guide at one place beyond what is ``reaching`` the face counts no more there than usual misses do.
    """
    nodes = nodes_of(one)[here]
    rows = _skipping(nodes)
    missed, doubt = rows @ one.coefficients[here], rows @ one.covariance[here, here] @ rows.T
    if reaching is not None:
        far = (nodes[1:-1] < reaching[0]) | (nodes[1:-1] > reaching[1])
        most = USUAL * MAD_TO_SIGMA * float(np.median(np.abs(missed)))
        missed = np.where(far, np.clip(missed, -most, most), missed)
    square = max(float(np.mean(missed**2) - np.mean(np.diag(doubt))), 0.0)
    along = float(np.mean(missed[1:] * missed[:-1]) - np.mean(np.diag(doubt, 1)))
    # Independent values of variance w miss by 1.5 w, neighbours by -w together; the longest of the others by LONG.
    short = min(max(LONG * square - along, 0.0) / (1.0 + 1.5 * LONG), square / 1.5)
    return float(np.sqrt(max(square - 1.5 * short, 0.0))), float(np.sqrt(short))


def _skipping(nodes: FloatArray) -> FloatArray:
    """Rows (m - 2, m): each inner value less the line between its neighbours."""
    share = (nodes[1:-1] - nodes[:-2]) / (nodes[2:] - nodes[:-2])
    rows, i = np.zeros((nodes.size - 2, nodes.size)), np.arange(nodes.size - 2)
    rows[i, i], rows[i, i + 1], rows[i, i + 2] = share - 1.0, 1.0, -share
    return rows
