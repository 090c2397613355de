"""Positioning figures of other standards: VDI/DGQ 3441, ASME B5.54, NMTBA, JIS B 6330, names by country."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
from gateway.errors import ModelError
from gateway.evaluate import readings

ISO_EQUIVALENTS: Mapping[str, str] = {
    "GB/T 17421.2-2000": "1997",
    "GB/T 17421.2-2016": "2006",
    "GB/T 17421.2-2023": "2014",
    "JIS B 6190-2:2008": "2006",
    "JIS B 6190-2:2016": "2014",
    "GOST 27843-2006": "1997",
    "GOST ISO 230-2-2016": "2014",
    "DIN ISO 230-2": "2014",
    "BS ISO 230-2": "2014",
    "ASME B5.54-2005": "1997",
    "BS 4656-16": "1988",
}
"""National standards that are an edition of ISO 230-2 (pass it as ``edition``)."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a standard by its own names; ``certainty`` says how sure their formulas are to us."""

    standard: str
    certainty: str
    values: Mapping[str, float]


def vdi3441(deviations: ArrayLike) -> Figures:
    """VDI/DGQ 3441:1977 from complete deviations (m, n, 2), n >= 2, s by n - 1."""
    x = _complete(deviations, 2)
    mean, s = readings.means(x), readings.standard_deviations(x)
    centre, reversal, spread = mean.mean(axis=1), np.abs(mean[:, 0] - mean[:, 1]), 6.0 * s.mean(axis=1)
    half = (reversal + spread) / 2.0
    values = {
        "U_max": reversal.max(),
        "U_mean": reversal.mean(),
        "Ps_max": spread.max(),
        "Ps_mean": spread.mean(),
        "Pa": np.ptp(centre),
        "P": (centre + half).max() - (centre - half).min(),
    }
    return _figures("VDI/DGQ 3441:1977", "formulas from secondary sources", values)


def asme_b554_1992(deviations: ArrayLike) -> Figures:
    """ASME B5.54-1992: no sigma, spreads and ranges of the readings themselves."""
    x = _complete(deviations, 1)
    mean = readings.means(x)
    at_target = x.reshape(x.shape[0], -1)
    values = {
        "rep_up": np.ptp(x[:, :, 0], axis=1).max(),
        "rep_down": np.ptp(x[:, :, 1], axis=1).max(),
        "rep_bi": np.ptp(at_target, axis=1).max(),
        "acc_up": np.ptp(x[:, :, 0]),
        "acc_down": np.ptp(x[:, :, 1]),
        "acc_bi": np.ptp(x),
        "lost_motion": np.abs(mean[:, 0] - mean[:, 1]).max(),
    }
    return _figures("ASME B5.54-1992", "medium", values)


def nmtba(deviations: ArrayLike, *, offset: bool = True) -> Figures:
    """NMTBA 1972, 3 sigma; every value is the half width of a +/- band; `offset` centres the band."""
    x = _complete(deviations, 2)
    mean, s = readings.means(x), readings.standard_deviations(x)
    high, low = mean + 3.0 * s, mean - 3.0 * s
    names = (("A_up", slice(0, 1)), ("A_down", slice(1, 2)), ("A_bi", slice(0, 2)))
    values = {name: _half(high[:, part], low[:, part], offset) for name, part in names}
    values["R_up"], values["R_down"] = 3.0 * s.max(axis=0)
    reversal = np.abs(mean[:, 0] - mean[:, 1])
    values["R_bi"] = ((reversal + 3.0 * s.sum(axis=1)) / 2.0).max()
    return _figures("NMTBA:1972", "low to medium", values)


def _half(high: FloatArray, low: FloatArray, offset: bool) -> float:
    if offset:
        return float(high.max() - low.min()) / 2.0
    return float(max(abs(high.max()), abs(low.min()), abs(high.min()), abs(low.max())))


def jis_b6330(one_pass: ArrayLike, repeated_up: ArrayLike, repeated_down: ArrayLike) -> Figures:
    """JIS B 6330:1980: accuracy from one pass (m,), the rest from repeated readings (places, 7) each way."""
    once = np.asarray(one_pass, dtype=np.float64)
    up, down = (np.asarray(rows, dtype=np.float64) for rows in (repeated_up, repeated_down))
    if once.ndim != 1 or up.ndim != 2 or up.shape != down.shape or not np.isfinite(once).all():
        raise ModelError("E-EVAL-SHAPE", "JIS B 6330", targets=once.shape, deviations=up.shape)
    spread = max(float(np.ptp(rows, axis=1).max()) for rows in (up, down))
    values = {
        "accuracy": np.ptp(once),
        "repeatability": spread / 2.0,
        "lost_motion": np.abs(up.mean(axis=1) - down.mean(axis=1)).max(),
    }
    return _figures("JIS B 6330:1980", "medium", values)


def _complete(deviations: ArrayLike, least: int) -> FloatArray:
    x = np.asarray(deviations, dtype=np.float64)
    if x.ndim != 3 or x.shape[2] != 2 or x.shape[1] < least or not np.isfinite(x).all():
        raise ModelError("E-EVAL-INCOMPLETE", "evaluate", deviations=x.shape, least=least)
    return x


def _figures(standard: str, certainty: str, values: Mapping[str, float]) -> Figures:
    return Figures(standard, certainty, {name: float(value) for name, value in values.items()})
