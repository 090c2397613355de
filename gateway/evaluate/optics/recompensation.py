"""Re-compensation of imported results: the file's own air and material correction undone, a better one made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, digits
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient
from drivers.units import PA_PER_HPA, mm_to_um, um_to_mm
from gateway.domain.captures import Corrections
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.optics import air
from gateway.evaluate.optics.corrections import applied, begin, undone
from gateway.evaluate.optics.length import spread

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
        t = air.required("air_degc", ambient.air_degc, where)
        p = air.required("pressure_hpa", ambient.pressure_hpa, where) * PA_PER_HPA
        rh = air.required("humidity_pct", ambient.humidity_pct, where)
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
    done = undone(record, "air", words, start_um=half[0], end_um=half[1])
    if was.expansion_ppm_per_k is None:
        return done
    return undone(done, "expansion", words, ppm_per_k=was.expansion_ppm_per_k)


def _apply(record: Corrections, now: Compensation, half: tuple[float, float]) -> Corrections:
    again = Message.of("S-CORR-AIR-AGAIN", equation=now.equation)
    done = applied(record, "air", again, start_um=half[0], end_um=half[1])
    if now.expansion_ppm_per_k is None:
        return done
    words = Message.of("S-CORR-20-AGAIN", expansion=digits(now.expansion_ppm_per_k, 6))
    return applied(done, "expansion", words, ppm_per_k=now.expansion_ppm_per_k)


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
            raise ModelError("E-EVAL-ENV-FACTOR", where, stated=stated, found=f"{worked_out:.8f}", ppm=f"{ppm:.2f}")
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
