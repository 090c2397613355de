"""What a rotary calibrator's own error does to a range of deviations: by its shape around the turn.

A certificate tells how far a single position may be off. A range is a difference of two positions, and the error there
is not the same: an eccentric scale is wrong by a wave of one turn, an oval one by a wave of two, each of any phase (as
the calibrator happened to be clamped), their variances alike. Which two positions make the range may change with it, so
the error is drawn and taken off (JCGM 101:2008) instead of a law of propagation at the two (GUM 5.2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from drivers.units import deg_to_rad
from gateway.domain.values import COVERAGE, COVERED, FloatArray

ORDERS = (1, 2)
DRAWS = 2000
Figures = Callable[[FloatArray], Mapping[str, FloatArray]]


def drawn_errors(at_deg: FloatArray, single: float, rng: np.random.Generator, count: int) -> FloatArray:
    """Errors (count, m) of a calibrator at positions (m,), ``single`` the expanded uncertainty (k = 2) of one."""
    phase = deg_to_rad(at_deg)
    waves = np.concatenate([(np.cos(order * phase), np.sin(order * phase)) for order in ORDERS])
    sizes = rng.standard_normal((count, waves.shape[0])) * single / COVERAGE / np.sqrt(len(ORDERS))
    return np.asarray(sizes @ waves)


def of_ranges(at_deg: FloatArray, means: FloatArray, single: float, figures: Figures) -> Mapping[str, float]:
    """Expanded uncertainty by name: how far figures of means (m, 2) lie from those of the true ones, 95.45 %.

    ``figures`` takes means (draws, m, 2) and gives (draws,) by name; NaN where a figure does not exist.
    """
    errors = drawn_errors(at_deg, single, np.random.default_rng(1), DRAWS)
    read, true = figures(means[None]), figures(means - errors[:, :, None])
    return {name: float(np.quantile(np.abs(one - read[name]), COVERED)) for name, one in true.items()}
