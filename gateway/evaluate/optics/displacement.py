"""Laser readings -> displacement at 20 degC: air, dead path, expansion; and an imported result compensated anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, digits, fixed
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor
from drivers.units import PA_PER_HPA, mm_to_um, um_to_mm
from gateway.domain.captures import Corrections
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.optics import air
from gateway.evaluate.optics.corrections import begin, record_step, refuse_twice, revert_step

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
            done = record_step(done, "air", words, n_start=n_datum, n_end=_last_index(n))
            reading = geometric_mm(reading, n)
        reading, done = _less_dead_path(reading, setup, n, n_datum, done)
    if already != "air+material":
        reading, done = _to_20(reading, setup.expansion_ppm_per_k, start, end, fraction, done)
    return mm_to_um(reading - travel), done


def _last_index(n: FloatArray) -> float:
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
    done = record_step(done, "dead_path", words, D_mm=setup.dead_path_mm)
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
    done = record_step(
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


# Re-compensation of imported results: the file's own air and material correction undone, a better one made.

FACTOR_KEY = "Env factor"
FACTOR_PPM = 0.5
"""A file's factor that its own readings explain worse than this is of another laser, or the readings are wrong."""


@dataclass(frozen=True, slots=True)
class Compensation:
    """How lengths are counted: equation, expansion (None: not to 20 degC), ambient at start and end.

    ``factor``: half wavelengths in um at start and end as a file states them; None works them out.
    """

    start: Ambient
    end: Ambient
    expansion_ppm_per_k: float | None
    equation: air.Equation = "edlen"
    factor: tuple[float, float] | None = None

    def half_wavelengths(self, where: str) -> tuple[float, float]:
        """Compensated half wavelength in um at start and end. Raises AmbientOutOfRange naming the sensor."""
        return self.factor or (self._worked_out(self.start, where), self._worked_out(self.end, where))

    def _worked_out(self, ambient: Ambient, where: str) -> float:
        t = air.require_reading("air_degc", ambient.air_degc, where)
        p = air.require_reading("pressure_hpa", ambient.pressure_hpa, where) * PA_PER_HPA
        rh = air.require_reading("humidity_pct", ambient.humidity_pct, where)
        if self.expansion_ppm_per_k is None:
            return air.env_factor(
                t,
                p,
                humidity_pct=rh,
                material_t_degc=air.REFERENCE_DEGC,
                expansion_ppm_per_k=0.0,
                equation=self.equation,
            )
        material = air.material_degc(ambient, where)
        return air.env_factor(
            t,
            p,
            humidity_pct=rh,
            material_t_degc=material,
            expansion_ppm_per_k=self.expansion_ppm_per_k,
            equation=self.equation,
        )


def recompensate(
    deviations_um: ArrayLike,
    targets_mm: ArrayLike,
    was: Compensation,
    now: Compensation,
    record: Corrections,
    *,
    datum_mm: float,
    fraction: ArrayLike = 0.5,
) -> tuple[FloatArray, Corrections]:
    """Deviations (m, ...) as they were, counted anew: the same fringes, another half wavelength.

    Acts on target + deviation from the datum. ``fraction``: time of each reading between start 0 and end 1, in
    which both compensations run linearly. The record must hold the instrument's own correction: it is undone
    (E-EVAL-UNDO when it is not there or was undone before) and the new one applied (E-EVAL-TWICE).
    Raises AmbientOutOfRange where readings are missing.
    """
    x, at = np.asarray(deviations_um, dtype=np.float64), np.asarray(targets_mm, dtype=np.float64)
    old, new = was.half_wavelengths("imported file"), now.half_wavelengths("new compensation")
    done = _apply(_undo(record, was, old), now, new)
    travel = spread(at, x) - datum_mm
    when = np.asarray(fraction, dtype=np.float64)
    ratio = (new[0] + (new[1] - new[0]) * when) / (old[0] + (old[1] - old[0]) * when)
    return mm_to_um((travel + um_to_mm(x)) * ratio - travel), done


def _undo(record: Corrections, was: Compensation, half: tuple[float, float]) -> Corrections:
    words = Message.of("S-CORR-UNDONE")
    done = revert_step(record, "air", words, start_um=half[0], end_um=half[1])
    if was.expansion_ppm_per_k is None:
        return done
    return revert_step(done, "expansion", words, ppm_per_k=was.expansion_ppm_per_k)


def _apply(record: Corrections, now: Compensation, half: tuple[float, float]) -> Corrections:
    again = Message.of("S-CORR-AIR-AGAIN", equation=now.equation)
    done = record_step(record, "air", again, start_um=half[0], end_um=half[1])
    if now.expansion_ppm_per_k is None:
        return done
    words = Message.of("S-CORR-20-AGAIN", expansion=digits(now.expansion_ppm_per_k, 6))
    return record_step(done, "expansion", words, ppm_per_k=now.expansion_ppm_per_k)


def compensation_of(measured: MeasuredSet, where: str = "file") -> Compensation:
    """What an imported set was compensated with, by its own readings and its factor where it states one.

    Raises ModelError (E-EVAL-ENV-FACTOR) when the factor contradicts the readings beside it; E-EVAL-UNDO when
    the set was not compensated by its instrument.
    """
    if measured.compensated_for == "nothing":
        raise ModelError("E-EVAL-UNDO", where, step="air", done="none", asked="re-compensation")
    expansion = measured.expansion_ppm_per_k if measured.compensated_for == "air+material" else None
    found = Compensation(measured.ambient_start, measured.ambient_end, expansion, "edlen-1966")
    factor = stated_factor(measured.header, where)
    if factor is None:
        return found
    for stated, worked_out in zip(factor, found.half_wavelengths(where), strict=True):
        ppm = (stated / worked_out - 1.0) * 1e6
        if abs(ppm) > FACTOR_PPM:
            raise ModelError("E-EVAL-ENV-FACTOR", where, stated=stated, found=fixed(worked_out, 8), ppm=fixed(ppm, 2))
    return Compensation(
        start=found.start, end=found.end, expansion_ppm_per_k=expansion, equation="edlen-1966", factor=factor
    )


def stated_factor(header: Mapping[str, str], where: str = "file") -> tuple[float, float] | None:
    """The two half wavelengths (um) of a header's "Env factor", None without. Raises E-EVAL-ENV-FACTOR."""
    text = next((value for key, value in header.items() if key.strip().lower() == FACTOR_KEY.lower()), None)
    if text is None:
        return None
    try:
        first, last = (float(token.replace(",", ".")) for token in text.split()[:2])
    except ValueError:
        raise ModelError("E-EVAL-ENV-FACTOR", where, stated=text, found="two numbers", ppm="-") from None
    return first, last


def recompensated_set(
    measured: MeasuredSet,
    *,
    equation: air.Equation = "edlen",
    expansion_ppm_per_k: float | None = None,
    material_degc: float | None = None,
) -> tuple[FloatArray, Corrections]:
    """Deviations (m, n, 2) in um of an imported linear set with a better equation, expansion or temperature.

    None keeps the file's expansion coefficient and its material readings. Datum: the first target.
    """
    was = compensation_of(measured)
    alpha = was.expansion_ppm_per_k if expansion_ppm_per_k is None else expansion_ppm_per_k
    ends = [_at(ambient, material_degc) for ambient in (measured.ambient_start, measured.ambient_end)]
    now = Compensation(ends[0], ends[1], alpha, equation)
    record = begin(measured.compensated_for)
    datum = float(measured.targets[0])
    return recompensate(measured.deviations, measured.targets, was=was, now=now, record=record, datum_mm=datum)


def _at(ambient: Ambient, material_degc: float | None) -> Ambient:
    if material_degc is None:
        return ambient
    return Ambient(
        air_degc=ambient.air_degc,
        pressure_hpa=ambient.pressure_hpa,
        humidity_pct=ambient.humidity_pct,
        material_degc=(material_degc,),
        age_s=ambient.age_s,
    )
