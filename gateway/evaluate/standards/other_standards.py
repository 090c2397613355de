"""Positioning figures of other standards: VDI/DGQ 3441, ASME B5.54-1992, NMTBA, JIS B 6330; gaps flagged.

Each has a formula on readings (..., m, n, 2), for one test or many trials, and a function that labels it. A gap
is treated as for ISO 230-2: own n everywhere, a target without one approach out of what needs both, absent
figures None, everything said in ``flags``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards import parameters, readings
from gateway.evaluate.standards.certainty import RECALLED, Certainty

Values = Mapping[str, FloatArray]
Formulas = Callable[[FloatArray], Values]
JIS_REPETITIONS, JIS_PLACES = 7, 3
# Mean range over sigma of n normal readings (d2 of control charts), for the range estimator of VDI/DGQ 3441.
D2: Final = {2: 1.128, 3: 1.693, 4: 2.059, 5: 2.326, 6: 2.534, 7: 2.704, 8: 2.847, 9: 2.970, 10: 3.078}


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a standard by its own names, None where absent; ``certainty`` says how sure the formulas are."""

    standard: str
    certainty: Certainty
    values: Mapping[str, float | None]
    flags: tuple[Message, ...] = ()


def vdi3441(deviations: ArrayLike, *, estimator: Literal["n-1", "range"] = "n-1") -> Figures:
    """VDI/DGQ 3441:1977 from deviations (m, n, 2); `estimator` "range" takes s from the mean range over d2.

    Raises ModelError as `readings.checked`; E-EVAL-RANGE-RUNS where no d2 is known for the repetitions.
    """
    x = _checked(deviations)
    s = range_deviations(x) if estimator == "range" else readings.standard_deviations(x)
    return _figures("VDI/DGQ 3441:1977", vdi_of_table(readings.means(x), s), x, "s, Ps, P")


def vdi_of_table(mean: FloatArray, s: FloatArray) -> Values:
    """P_sj = 6 s_j, U_j = |B_j|, P = max(x_j + (U_j + P_sj)/2) - min(x_j - (U_j + P_sj)/2), and the rest."""
    centre, reversal = mean.mean(axis=-1), np.abs(mean[..., 0] - mean[..., 1])
    spread = 6.0 * s.mean(axis=-1)
    half = (reversal + spread) / 2.0
    return {
        "U_max": parameters.top(reversal),
        "U_mean": parameters.average(reversal),
        "Ps_max": parameters.top(spread),
        "Ps_mean": parameters.average(spread),
        "Pa": parameters.span(centre, centre),
        "P": parameters.span(centre + half, centre - half),
    }


def range_deviations(x: FloatArray) -> FloatArray:
    """Standard deviations (m, 2) from ranges over d2, NaN where n < 2. Raises ModelError (E-EVAL-RANGE-RUNS)."""
    n = readings.counts(x)
    if int(n.max()) > max(D2):
        raise ModelError("E-EVAL-RANGE-RUNS", "VDI/DGQ 3441", repetitions=int(n.max()), most=max(D2))
    factor = np.array([D2.get(count, np.nan) for count in range(max(D2) + 1)])[n]
    return np.asarray(_spread(x, -2) / factor)


def asme_b554_1992(deviations: ArrayLike) -> Figures:
    """ASME B5.54-1992: no sigma, spreads and ranges of the readings themselves."""
    x = _checked(deviations)
    return _figures("ASME B5.54-1992", asme_1992_formulas(x), x, "repeatability")


def asme_1992_formulas(x: FloatArray) -> Values:
    """Largest spread at a target, range of all readings, lost motion from the means; (..., m, n, 2)."""
    mean, n = readings.means(x), readings.counts(x)
    repeated = (n > 1).any(axis=-2)
    at_target = np.where(n > 1, _spread(x, -2), np.nan)
    up, down = parameters.top(at_target[..., 0]), parameters.top(at_target[..., 1])
    both = (n > 0).all(axis=-1)
    bidirectional = np.where(both, _spread(x, (-2, -1)), np.nan)
    return {
        "rep_up": up,
        "rep_down": down,
        "rep_bi": np.where(repeated.all(axis=-1), parameters.top(bidirectional), np.nan),
        "acc_up": _spread(x[..., 0], (-2, -1)),
        "acc_down": _spread(x[..., 1], (-2, -1)),
        "acc_bi": np.where(n.any(axis=-2).all(axis=-1), _spread(x, (-3, -2, -1)), np.nan),
        "lost_motion": parameters.top(np.abs(mean[..., 0] - mean[..., 1])),
    }


def _spread(x: FloatArray, axis: int | tuple[int, ...]) -> FloatArray:
    return np.asarray(np.fmax.reduce(x, axis=axis) - np.fmin.reduce(x, axis=axis))


def nmtba(deviations: ArrayLike, *, offset: bool = True) -> Figures:
    """NMTBA 1972, 3 sigma; every value is the half width of a +/- band; `offset` centres the band."""
    x = _checked(deviations)
    return _figures("NMTBA:1972", nmtba_of_table(*readings.moments(x), offset=offset), x, "s, R, A")


def nmtba_of_table(mean: FloatArray, s: FloatArray, *, offset: bool = True) -> Values:
    """A from x +/- 3 s, R_bi = (|B_i| + 3 s+ + 3 s-)/2; half widths; means and s (..., m, 2)."""
    both = np.isfinite(s).any(axis=-2).all(axis=-1)
    high, low = mean + 3.0 * s, mean - 3.0 * s
    names = (("A_up", slice(0, 1)), ("A_down", slice(1, 2)), ("A_bi", slice(0, 2)))
    values = {name: _half(high[..., part], low[..., part], offset) for name, part in names}
    reversal = np.abs(mean[..., 0] - mean[..., 1])
    return values | {
        "A_bi": np.where(both, values["A_bi"], np.nan),
        "R_up": parameters.top(3.0 * s[..., 0]),
        "R_down": parameters.top(3.0 * s[..., 1]),
        "R_bi": parameters.top((reversal + 3.0 * s.sum(axis=-1)) / 2.0),
    }


def _half(high: FloatArray, low: FloatArray, offset: bool) -> FloatArray:
    if offset:
        return parameters.whole_span(high, low) / 2.0
    ends = np.stack([high, low], axis=-1)
    return np.asarray(np.fmax.reduce(np.abs(ends), axis=(-3, -2, -1)))


def jis_of_test(deviations: ArrayLike) -> Figures:
    """JIS B 6330:1980 of an ordinary test (m, n, 2): first passes for accuracy, every target a place; flagged."""
    x = _checked(deviations)
    found = _figures("JIS B 6330:1980", jis_formulas(x), x, "repeatability", JIS_REPETITIONS)
    return Figures(found.standard, found.certainty, found.values, (*found.flags, *_jis_flags(x.shape[0])))


def jis_formulas(x: FloatArray) -> Values:
    """Accuracy: range of the first pass, the worse direction; repeatability: half the largest spread."""
    mean, n = readings.means(x), readings.counts(x)
    at_target = np.where(n > 1, _spread(x, -2), np.nan)
    return {
        "accuracy": parameters.top(_spread(x[..., 0, :], -2)),
        "repeatability": np.asarray(np.fmax.reduce(at_target, axis=(-2, -1)) / 2.0),
        "lost_motion": parameters.top(np.abs(mean[..., 0] - mean[..., 1])),
    }


def _jis_flags(places: int) -> tuple[Message, ...]:
    return (Message.of("S-EVAL-PLACES", places=places, wanted=JIS_PLACES),) if places != JIS_PLACES else ()


def _checked(deviations: ArrayLike) -> FloatArray:
    x = np.asarray(deviations, dtype=np.float64)
    return readings.checked(np.arange(x.shape[0] if x.ndim else 0), x)[1]


def _figures(standard: str, values: Values, x: FloatArray, lost: str, wanted: int = 5) -> Figures:
    flags = readings.gaps(readings.counts(x), wanted, lost)
    return Figures(standard, RECALLED, parameters.stated(values), flags)
