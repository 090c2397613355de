"""Uncertainty of ISO 230-2 results: components of Annex A, combined by the GUM with our own coefficients."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import hypot, inf, sqrt
from types import MappingProxyType

import numpy as np
import scipy

from drivers.message import Message, words
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import DeviationUnit, deg_to_rad, deviation_unit
from gateway.domain.captures import Capture
from gateway.domain.values import COVERAGE, COVERED, FloatArray
from gateway.errors import ModelError

LABEL = words("S-EVAL-U-LABEL")
DEVICE_UM_PER_M, TEMPERATURE_RANGE_K = 0.5, 0.2
"""What is assumed of a laser system (U, k = 2) and of the range of temperatures where no certificate states more."""
EXPANSION_RANGE_PPM_PER_K = 2.0
LATERAL_RANGE_MM = 1.0
"""How far a beam may run off over any travel: by range, not by angle, so that it counts where an axis is short."""
NOTHING_STATED: Mapping[str, float] = MappingProxyType({})
CONTRIBUTIONS = ("device", "misalignment", "temperature", "expansion", "turning", "eve")
RECTANGULAR = 0.6  # ISO/TR 230-9: U = 2 R / (2 sqrt 3) = 0.577 R, printed as 0.6 R


@dataclass(frozen=True, slots=True)
class Budget:
    """Expanded uncertainties (k = 2) of one test, in the deviation unit (um or arcsec), 0 where negligible.

    ``eve`` comes from a drift test of the machine at rest (0.6 E_VE); None takes the scatter of the
    readings themselves, 2 s pooled. The other four are systematic: they act on E, M and A, not on B and R.
    ``turning`` is a rotary calibrator's at a single position: what it makes of a range follows from its shape
    (`turning.of_range`) and is not in ``systematic``.
    """

    device: float = 0.0
    misalignment: float = 0.0
    temperature: float = 0.0
    expansion: float = 0.0
    eve: float | None = None
    turning: float = 0.0

    @property
    def systematic(self) -> float:
        """The systematic terms together, k = 2."""
        return hypot(self.device, self.misalignment, self.temperature, self.expansion)

    def contributions(self) -> dict[str, float]:
        """What U contains besides the scatter of the readings: U (k = 2) by name, those that are not 0."""
        parts = {name: getattr(self, name) for name in CONTRIBUTIONS}
        return {name: value for name, value in parts.items() if value}


def device_um(length_mm: float, calibration_um_per_m: float) -> float:
    """U_DEVICE in um over a length, from a certificate in um/m (k = 2)."""
    return calibration_um_per_m * abs(length_mm) / 1000.0


def misalignment_um(length_mm: float, lateral_range_mm: float) -> float:
    """U_MISALIGNMENT in um: 0.3 R^2 / L, R the range of lateral misalignment in mm, L in m.

    Raises ModelError (E-EVAL-NUMBER) for no length.
    """
    if not abs(length_mm) > 0.0:
        raise ModelError("E-EVAL-NUMBER", "budget", key="length_mm", value=length_mm, must="another than 0")
    return 0.3 * lateral_range_mm**2 / (abs(length_mm) / 1000.0)


def temperature_um(length_mm: float, expansion_ppm_per_k: float, range_k: float) -> float:
    """U_M in um: 0.6 alpha L R(theta), the range of the temperature measurement."""
    return RECTANGULAR * expansion_ppm_per_k * abs(length_mm) / 1000.0 * range_k


def expansion_um(length_mm: float, off_20_k: float, range_ppm_per_k: float) -> float:
    """U_E in um: 0.6 |T - 20| L R(alpha), the range of the expansion coefficient."""
    return RECTANGULAR * abs(off_20_k) * abs(length_mm) / 1000.0 * range_ppm_per_k


def linear_budget(
    length_mm: float,
    *,
    expansion_ppm_per_k: float,
    off_20_k: float,
    calibration_um_per_m: float = DEVICE_UM_PER_M,
    lateral_range_mm: float = LATERAL_RANGE_MM,
    temperature_range_k: float = TEMPERATURE_RANGE_K,
    expansion_range_ppm_per_k: float = EXPANSION_RANGE_PPM_PER_K,
    eve_um: float | None = None,
) -> Budget:
    """The usual budget of a laser on a linear axis of `length_mm`, in um, k = 2."""
    return Budget(
        device=device_um(length_mm, calibration_um_per_m),
        misalignment=misalignment_um(length_mm, lateral_range_mm),
        temperature=temperature_um(length_mm, expansion_ppm_per_k, temperature_range_k),
        expansion=expansion_um(length_mm, off_20_k, expansion_range_ppm_per_k),
        eve=eve_um,
    )


UNKNOWN_OFF_20_K = 15.0
"""Where nobody measured the material: a workshop between 5 and 35 degC."""
ROTARY_DEVICE_ARCSEC = 1.0
EXPANSION_PPM_PER_K = 11.5
"""Of steel, where nobody said another."""


def file_budget(
    unit: DeviationUnit,
    travel: float,
    material_degc: float | None,
    expansion_ppm_per_k: float = EXPANSION_PPM_PER_K,
    eve: float | None = None,
    stated: Mapping[str, float] = NOTHING_STATED,
) -> tuple[Budget, tuple[Doubt, ...]]:
    """The usual budget of a test, and what had to be supposed, as codes with what to do about it.

    ``travel`` in mm or deg. The material's temperature is never taken to be 20 degC: unknown is a wide range.
    ``stated`` by certificates (k = 2) stands in place of what is supposed: um_per_m, kelvin, arcsec.
    """
    if unit == "arcsec":
        turning = stated.get("arcsec", ROTARY_DEVICE_ARCSEC)
        supposed = () if "arcsec" in stated else (Doubt("S-U-ROTARY", names={"U": f"{ROTARY_DEVICE_ARCSEC:g}"}),)
        return Budget(turning=turning, eve=eve), supposed
    off = UNKNOWN_OFF_20_K if material_degc is None else material_degc - 20.0
    ranges = {"lateral": f"{LATERAL_RANGE_MM:g}", "expansion": f"{EXPANSION_RANGE_PPM_PER_K:g}"}
    if "um_per_m" in stated:
        notes = [Doubt("S-U-ALIGNMENT", names=ranges)]
    else:
        notes = [Doubt("S-U-LASER", names={"device": f"{DEVICE_UM_PER_M:g}", **ranges})]
    if material_degc is None:
        low, high = 20.0 - UNKNOWN_OFF_20_K, 20.0 + UNKNOWN_OFF_20_K
        notes.append(Doubt("S-U-MATERIAL", names={"low": f"{low:g}", "high": f"{high:g}"}))
    if travel == 0.0:
        return Budget(eve=eve), tuple(notes)
    budget = linear_budget(
        travel,
        expansion_ppm_per_k=expansion_ppm_per_k,
        off_20_k=off,
        calibration_um_per_m=stated.get("um_per_m", DEVICE_UM_PER_M),
        temperature_range_k=stated["kelvin"] / RECTANGULAR if "kelvin" in stated else TEMPERATURE_RANGE_K,
        eve_um=eve,
    )
    return budget, tuple(notes)


def measured_budget(
    measured: MeasuredSet | Capture,
    material_degc: float | None = None,
    expansion_ppm_per_k: float | None = None,
    stated: Mapping[str, float] = NOTHING_STATED,
) -> tuple[Budget, tuple[Doubt, ...]]:
    """`file_budget` of what was measured: by what is given, else by what it says itself."""
    sensors = measured.ambient_start.material_degc
    read = sum(sensors) / len(sensors) if sensors else None
    given = (expansion_ppm_per_k, _expansion(measured), EXPANSION_PPM_PER_K)
    return file_budget(
        deviation_unit(measured.axis_unit),
        float(np.ptp(measured.targets)),
        read if material_degc is None else material_degc,
        next(value for value in given if value is not None),
        stated=stated,
    )


def _expansion(measured: MeasuredSet | Capture) -> float | None:
    if isinstance(measured, Capture):
        return measured.corrections.details.get("expansion.ppm_per_k")
    return measured.expansion_ppm_per_k


def budget_of(capture: Capture) -> Budget:
    """`measured_budget` of a capture, with what certificates state, and `with_lever`."""
    stated = capture.conditions.stated if capture.conditions is not None else NOTHING_STATED
    return with_lever(measured_budget(capture, stated=stated)[0], capture)


def with_lever(budget: Budget, capture: Capture) -> Budget:
    """The budget with what angles that nobody measured leave of a capture along a line."""
    if capture.axis_unit == "deg":
        return budget
    # A range has two ends, and an angle nobody measured is another at each.
    lever = COVERAGE * sqrt(2.0) * capture.lever_u
    return replace(budget, misalignment=hypot(budget.misalignment, lever))


def expanded_uncertainties(n: int, eve: float, systematic: float, targets: int = 1) -> Mapping[str, float]:
    """U (k = 2) of every ISO 230-2 parameter for n readings per target and approach; `targets` have both.

    Derived for independent readings with expanded uncertainty `eve` each: U(B) = eve sqrt(2/n), U(M) from
    the mean of 2n readings, U(R) and U(A) also from s known to n - 1 degrees of freedom (absent for n = 1).
    Raises ModelError (E-EVAL-NUMBER) without a reading, or for uncertainties that are none.
    """
    for key, value, least in (("n", n, 1), ("eve", eve, 0), ("systematic", systematic, 0)):
        if not least <= value < inf:
            raise ModelError("E-EVAL-NUMBER", "budget", key=key, value=value, must=f"{least} or more")
    two = eve * sqrt(2.0 / n)
    budget = {"B": two, "B_mean": two / sqrt(max(targets, 1)), "M": hypot(eve * sqrt(1.0 / n), systematic)}
    budget |= dict.fromkeys(("E", "E_up", "E_down"), hypot(two, systematic))
    if n > 1:
        spread = sqrt(8.0 / (2.0 * (n - 1)))
        budget |= dict.fromkeys(("R_up", "R_down"), eve * 4.0 / sqrt(2.0 * (n - 1)))
        budget["R"] = eve * hypot(spread, sqrt(2.0 / n))
        accuracy = hypot(eve * hypot(spread, sqrt(2.0 / n)), systematic)
        budget |= dict.fromkeys(("A", "A_up", "A_down"), accuracy)
    return budget


def coverage_factor(confidence: float, degrees_of_freedom: float) -> float:
    """Student's two-sided coverage factor t_p(nu) (GUM table G.2); ``confidence`` 0.95 for 95 %.

    Raises ModelError (E-EVAL-NUMBER) for a confidence that is none, or no degrees of freedom.
    """
    if not 0.0 < confidence < 1.0:
        must = Message.of("W-EVAL-COVERAGE")
        raise ModelError("E-EVAL-NUMBER", "coverage", key="confidence", value=confidence, must=must)
    if not degrees_of_freedom > 0.0:
        key, value = "degrees_of_freedom", degrees_of_freedom
        raise ModelError("E-EVAL-NUMBER", "coverage", key=key, value=value, must="above 0")
    return float(scipy.special.stdtrit(degrees_of_freedom, 0.5 + confidence / 2.0))


def variance_limit(confidence: float, numerator: int, denominator: int) -> float:
    """The quotient of two variances that chance stays below with this confidence (Fisher's F); degrees of freedom.

    Raises ModelError (E-EVAL-NUMBER) for a confidence that is none, or no degrees of freedom.
    """
    if not 0.0 < confidence < 1.0:
        must = Message.of("W-EVAL-COVERAGE")
        raise ModelError("E-EVAL-NUMBER", "variance", key="confidence", value=confidence, must=must)
    for key, value in (("numerator", numerator), ("denominator", denominator)):
        if not 0 < value < inf:
            raise ModelError("E-EVAL-NUMBER", "variance", key=key, value=value, must="above 0")
    return float(scipy.special.fdtri(numerator, denominator, confidence))


# ---- Effect of a rotary calibrator's own error on a range of deviations, by its shape around the turn.
#
# A certificate tells how far a single position may be off. A range is a difference of two positions, and the error
# there is not the same: an eccentric scale is wrong by a wave of one turn, an oval one by a wave of two, each of any
# phase (as the calibrator happened to be clamped), their variances alike. Which two positions make the range may
# change with it, so the error is drawn and taken off (JCGM 101:2008) instead of a law of propagation at the two (GUM
# 5.2).

ORDERS = (1, 2)
DRAWS = 2000
Figures = Callable[[FloatArray], Mapping[str, FloatArray]]


def drawn_errors(at_deg: FloatArray, single: float, rng: np.random.Generator, count: int) -> FloatArray:
    """Errors (count, m) of a calibrator at positions (m,), ``single`` the expanded uncertainty (k = 2) of one."""
    phase = deg_to_rad(at_deg)
    waves = np.concatenate([(np.cos(order * phase), np.sin(order * phase)) for order in ORDERS])
    sizes = rng.standard_normal((count, waves.shape[0])) * single / COVERAGE / np.sqrt(len(ORDERS))
    return np.asarray(sizes @ waves)


def uncertainty_of_ranges(
    at_deg: FloatArray, means: FloatArray, single: float, figures: Figures
) -> Mapping[str, float]:
    """Expanded uncertainty by name: how far figures of means (m, 2) lie from those of the true ones, 95.45 %.

    ``figures`` takes means (draws, m, 2) and gives (draws,) by name; NaN where a figure does not exist.
    """
    errors = drawn_errors(at_deg, single, np.random.default_rng(1), DRAWS)
    read, true = figures(means[None]), figures(means - errors[:, :, None])
    return {name: float(np.quantile(np.abs(one - read[name]), COVERED)) for name, one in true.items()}
