"""Laser readings -> geometric displacement at 20 degC: air, dead path, expansion, each once and recorded."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, digits
from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor
from drivers.units import mm_to_um
from gateway.domain.captures import Corrections
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.optics import air
from gateway.evaluate.optics.corrections import applied, begin, refuse_twice

Beam = Literal[1, -1]


def geometric_mm(optical_mm: FloatArray, n: FloatArray | float) -> FloatArray:
    """Displacement in mm from a vacuum optical path in mm: divided by the index n."""
    return np.asarray(optical_mm / n, dtype=np.float64)


def dead_path_corrected(
    shown_mm: FloatArray | float, dead_path_mm: float, n_datum: FloatArray | float, n: FloatArray | float
) -> FloatArray:
    """L = L_shown - D (n - n_datum) / n, mm; D from interferometer to reflector when the datum was set.

    From n (D + L) - n_datum D = N lambda_vac / 2. L counts away from the interferometer.
    """
    return np.asarray(shown_mm - dead_path_mm * (n - n_datum) / n, dtype=np.float64)


def at_20_degc(length_mm: FloatArray | float, expansion_ppm_per_k: float, t_degc: FloatArray | float) -> FloatArray:
    """L / (1 + alpha (T - 20)): a length measured at T as it would be at 20 degC."""
    return np.asarray(length_mm / (1.0 + expansion_ppm_per_k * 1e-6 * (t_degc - air.REFERENCE_DEGC)), dtype=np.float64)


def cosine_error_mm(length_mm: float, lateral_mm: float) -> float:
    """Reading minus travel when the beam runs off by `lateral_mm` over the travel: always negative.

    Raises ModelError (E-EVAL-NUMBER) for no travel.
    """
    if not abs(length_mm) > 0.0:
        raise ModelError("E-EVAL-NUMBER", "length", key="length_mm", value=length_mm, must="another than 0")
    secant = hypot(1.0, lateral_mm / length_mm)
    return -length_mm * (lateral_mm / length_mm) ** 2 / (secant * (1.0 + secant))


def drift_removed(
    times_s: ArrayLike, values: ArrayLike, start: tuple[float, float], end: tuple[float, float]
) -> FloatArray:
    """Values less a drift linear in time between datum readings (time, reading) at start and end."""
    (t0, z0), (t1, z1) = start, end
    if not t1 > t0:
        raise ModelError("E-EVAL-DRIFT-TIME", "drift", start=t0, end=t1)
    at = np.asarray(times_s, dtype=np.float64)
    return np.asarray(values, dtype=np.float64) - (z0 + (z1 - z0) * (at - t0) / (t1 - t0))


def index_course(
    start: Ambient, end: Ambient, fraction: ArrayLike, equation: air.Equation = "edlen"
) -> tuple[FloatArray, float]:
    """Index n at each reading, linear in time between the ambient at start and end; and at the start.

    ``fraction`` is the time of each reading from 0 (start) to 1 (end).
    """
    first, last = air.index(start, equation=equation), air.index(end, equation=equation)
    return first + (last - first) * np.asarray(fraction, dtype=np.float64), first


def material_course(start: Ambient, end: Ambient, fraction: ArrayLike) -> FloatArray:
    """Material temperature in degC at each reading, linear in time between start and end."""
    first, last = air.material_degc(start), air.material_degc(end)
    return first + (last - first) * np.asarray(fraction, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class LinearSetup:
    """How a linear axis was measured. ``datum_mm``: machine coordinate where the reading was made zero.

    ``dead_path_mm``: interferometer to reflector at the datum. ``beam`` +1: the axis' plus direction leads
    away from the interferometer, -1: towards it (it decides the sign of the dead path correction only).
    """

    datum_mm: float
    dead_path_mm: float
    expansion_ppm_per_k: float
    beam: Beam = 1
    equation: air.Equation = "edlen"


def linear_deviations(
    optical_mm: ArrayLike,
    targets_mm: ArrayLike,
    setup: LinearSetup,
    *,
    start: Ambient,
    end: Ambient,
    fraction: ArrayLike = 0.5,
    already: CompensatedFor = "nothing",
    record: Corrections | None = None,
) -> tuple[FloatArray, Corrections]:
    """Deviations in um (shape of `optical_mm`) and what was done to get them.

    ``optical_mm`` (m, n, 2) or (m,): averaged readings relative to the datum, positive in the axis' plus
    direction, NaN where missing; ``targets_mm`` (m,) machine coordinates. ``fraction``: time of each reading
    between start (0) and end (1) of the capture. What the instrument has done (`already`) is left out and
    said; a step already in `record` is refused (ModelError E-EVAL-TWICE). Ambient readings are required
    for what is left to do (AmbientOutOfRange). Expansion acts on target + deviation, from the datum.
    """
    reading = np.asarray(optical_mm, dtype=np.float64)
    travel = spread(np.asarray(targets_mm, dtype=np.float64), reading) - setup.datum_mm
    done = begin(already) if record is None else record
    if already == "nothing" or setup.dead_path_mm:
        n, n_datum = index_course(start, end, fraction, setup.equation)
        if already == "nothing":
            words = Message.of("S-CORR-AIR", equation=setup.equation)
            done = applied(done, "air", words, n_start=n_datum, n_end=_last(n))
            reading = geometric_mm(reading, n)
        reading, done = _less_dead_path(reading, setup, n, n_datum, done)
    if already != "air+material":
        reading, done = _to_20(reading, setup.expansion_ppm_per_k, start, end, fraction, done)
    return mm_to_um(reading - travel), done


def _last(n: FloatArray) -> float:
    """The largest index; a reading that is missing has none."""
    return float(np.nanmax(n))


def expansion_corrected(
    deviations_um: ArrayLike,
    targets_mm: ArrayLike,
    expansion_ppm_per_k: float,
    record: Corrections,
    *,
    datum_mm: float,
    start: Ambient,
    end: Ambient,
    fraction: ArrayLike = 0.5,
) -> tuple[FloatArray, Corrections]:
    """Deviations in um of a file corrected for air only, brought to 20 degC; E-EVAL-TWICE if it was done."""
    deviation = np.asarray(deviations_um, dtype=np.float64)
    travel = spread(np.asarray(targets_mm, dtype=np.float64), deviation) - datum_mm
    lengths, done = _to_20(travel + deviation / 1000.0, expansion_ppm_per_k, start, end, fraction, record)
    return mm_to_um(lengths - travel), done


def _less_dead_path(
    reading: FloatArray, setup: LinearSetup, n: FloatArray, n_datum: float, done: Corrections
) -> tuple[FloatArray, Corrections]:
    words = Message.of("S-CORR-DEAD-PATH", length=digits(setup.dead_path_mm, 6))
    done = applied(done, "dead_path", words, D_mm=setup.dead_path_mm)
    away = dead_path_corrected(setup.beam * reading, setup.dead_path_mm, n_datum, n)
    return setup.beam * away, done


def _to_20(
    lengths_mm: FloatArray,
    expansion_ppm_per_k: float,
    start: Ambient,
    end: Ambient,
    fraction: ArrayLike,
    done: Corrections,
) -> tuple[FloatArray, Corrections]:
    words = Message.of("S-CORR-20", expansion=digits(expansion_ppm_per_k, 6))
    refuse_twice(done, "expansion", words)
    material = material_course(start, end, fraction)
    done = applied(
        done,
        "expansion",
        words,
        ppm_per_k=expansion_ppm_per_k,
        start_degc=air.material_degc(start),
        end_degc=air.material_degc(end),
    )
    return at_20_degc(lengths_mm, expansion_ppm_per_k, material), done


def spread(targets: FloatArray, like: FloatArray) -> FloatArray:
    """Targets (m,) shaped to go with readings (m, ...). Raises ModelError (E-EVAL-SHAPE)."""
    if targets.ndim != 1 or like.ndim == 0 or like.shape[0] != targets.size:
        raise ModelError("E-EVAL-SHAPE", "length", targets=targets.shape, deviations=like.shape)
    return targets.reshape((-1,) + (1,) * (like.ndim - 1))
