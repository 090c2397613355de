"""Refractive index of air and the wavelength that follows from it: Edlen, Ciddor, saturation pressure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import exp
from typing import Any, Literal

from drivers.message import digits, words
from drivers.types.sensing import Ambient
from drivers.units import KELVIN_OFFSET, PA_PER_HPA
from gateway.errors import AmbientOutOfRange, ModelError

WAVELENGTH_NM = 632.990577
"""Vacuum wavelength of a stabilised He-Ne laser as used by calibration systems, nm."""
CO2_PPM = 450.0
PA_PER_TORR = 101325.0 / 760.0
REFERENCE_DEGC = 20.0

Equation = Literal["edlen", "ciddor", "edlen-1966"]

# What a workshop can have. Outside of it a sensor is wrong, its unit is, or nothing is connected.
LIMITS: Mapping[str, tuple[float, float, str]] = {
    "air_degc": (-20.0, 50.0, "degC"),
    "pressure_hpa": (600.0, 1150.0, "hPa"),
    "humidity_pct": (0.0, 100.0, "%"),
    "material_degc": (0.0, 60.0, "degC"),
}
# What the equations of the index were made for, a little wider: outside it is another unit.
RANGES: Mapping[str, tuple[float, float, str]] = {
    "t_degc": (-40.0, 100.0, "degC"),
    "pressure_pa": (1e4, 1.4e5, "Pa"),
    "humidity_pct": (-1.0, 101.0, "%"),
    "wavelength_nm": (300.0, 1700.0, "nm"),
}

# IAPWS-IF97, region 4 (saturation line), n1 .. n10.
_IF97 = (
    1.16705214527670e3,
    -7.24213167032060e5,
    -1.70738469400920e1,
    1.20208247024700e4,
    -3.23255503223330e6,
    1.49151086135300e1,
    -4.82326573615910e3,
    4.05113405420570e5,
    -2.38555575678490e-1,
    6.50175348447980e2,
)


def saturation_pressure_pa(t_degc: float) -> float:
    """Saturation vapour pressure of water in Pa (IAPWS-IF97 line; over ice below 0 degC, as NIST does)."""
    kelvin = t_degc + KELVIN_OFFSET
    if t_degc < 0.0:
        theta = kelvin / 273.16
        return 611.657 * exp(-13.928169 * (1 - theta**-1.5) + 34.7078238 * (1 - theta**-1.25))
    n = _IF97
    omega = kelvin + n[8] / (kelvin - n[9])
    a = omega**2 + n[0] * omega + n[1]
    b = n[2] * omega**2 + n[3] * omega + n[4]
    c = n[5] * omega**2 + n[6] * omega + n[7]
    return float(1e6 * (2 * c / (-b + (b**2 - 4 * a * c) ** 0.5)) ** 4)


def _in_range(t_degc: float, pressure_pa: float, humidity_pct: float, wavelength_nm: float) -> None:
    """Raises AmbientOutOfRange (E-EVAL-AMBIENT) for hPa in place of Pa, K of degC, um of nm."""
    for (name, (low, high, unit)), value in zip(
        RANGES.items(), (t_degc, pressure_pa, humidity_pct, wavelength_nm), strict=True
    ):
        if not low <= value <= high:
            fields: dict[str, Any] = {"sensor": name, "value": f"{value:g}", "low": low, "high": high, "unit": unit}
            raise AmbientOutOfRange("E-EVAL-AMBIENT", words("W-EVAL-AIR-INDEX"), **fields)


def edlen(t_degc: float, pressure_pa: float, humidity_pct: float, wavelength_nm: float = WAVELENGTH_NM) -> float:
    """Index n by the updated Edlen equation (Birch & Downs 1993/94) in NIST's form."""
    _in_range(t_degc, pressure_pa, humidity_pct, wavelength_nm)
    s2 = (1000.0 / wavelength_nm) ** 2
    vapour = humidity_pct / 100.0 * saturation_pressure_pa(t_degc)
    standard = (8342.54 + 2406147.0 / (130.0 - s2) + 15998.0 / (38.9 - s2)) * 1e-8
    density = 1.0 + 1e-8 * (0.601 - 0.00972 * t_degc) * pressure_pa
    dry = pressure_pa * standard * density / (96095.43 * (1.0 + 0.0036610 * t_degc))
    water = 1e-10 * (292.75 / (t_degc + KELVIN_OFFSET)) * (3.7345 - 0.0401 * s2) * vapour
    return 1.0 + dry - water


def edlen_1966(t_degc: float, pressure_pa: float, humidity_pct: float, wavelength_nm: float = WAVELENGTH_NM) -> float:
    """Index n by Edlen's equation of 1966, as older laser systems and their result files use it."""
    _in_range(t_degc, pressure_pa, humidity_pct, wavelength_nm)
    s2 = (1000.0 / wavelength_nm) ** 2
    torr = pressure_pa / PA_PER_TORR
    vapour_torr = humidity_pct / 100.0 * saturation_pressure_pa(t_degc) / PA_PER_TORR
    standard = (8342.13 + 2406030.0 / (130.0 - s2) + 15997.0 / (38.9 - s2)) * 1e-8
    density = 1.0 + torr * (0.817 - 0.0133 * t_degc) * 1e-6
    dry = torr * standard * density / (720.775 * (1.0 + 0.0036610 * t_degc))
    return 1.0 + dry - vapour_torr * (5.722 - 0.0457 * s2) * 1e-8


def ciddor(
    t_degc: float,
    pressure_pa: float,
    humidity_pct: float,
    wavelength_nm: float = WAVELENGTH_NM,
    co2_ppm: float = CO2_PPM,
) -> float:
    """Index n by Ciddor's equation (Appl. Opt. 35 (1996) 1566) in NIST's form."""
    _in_range(t_degc, pressure_pa, humidity_pct, wavelength_nm)
    kelvin = t_degc + KELVIN_OFFSET
    s2 = (1000.0 / wavelength_nm) ** 2
    vapour_fraction = _vapour_fraction(t_degc, pressure_pa, humidity_pct)
    standard = 1e-8 * (5792105.0 / (238.0185 - s2) + 167917.0 / (57.362 - s2))
    carbonated = standard * (1.0 + 5.34e-7 * (co2_ppm - 450.0))
    water = 1.022e-8 * (295.235 + 2.6422 * s2 - 0.03238 * s2**2 + 0.004028 * s2**3)
    molar_mass = 0.0289635 + 1.2011e-8 * (co2_ppm - 400.0)
    standard_air = 101325.0 * molar_mass / (_compressibility(288.15, 101325.0, 0.0) * 8.314472 * 288.15)
    standard_vapour = 1333.0 * 0.018015 / (_compressibility(293.15, 1333.0, 1.0) * 8.314472 * 293.15)
    gas = _compressibility(kelvin, pressure_pa, vapour_fraction) * 8.314472 * kelvin
    vapour_density = vapour_fraction * pressure_pa * 0.018015 / gas
    air_density = (1.0 - vapour_fraction) * pressure_pa * molar_mass / gas
    return 1.0 + air_density / standard_air * carbonated + vapour_density / standard_vapour * water


def _vapour_fraction(t_degc: float, pressure_pa: float, humidity_pct: float) -> float:
    enhancement = 1.00062 + 3.14e-8 * pressure_pa + 5.60e-7 * t_degc**2
    return humidity_pct / 100.0 * enhancement * saturation_pressure_pa(t_degc) / pressure_pa


def _compressibility(kelvin: float, pressure_pa: float, vapour_fraction: float) -> float:
    t = kelvin - KELVIN_OFFSET
    first = 1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2
    first += (5.707e-6 - 2.051e-8 * t) * vapour_fraction
    first += (1.9898e-4 - 2.376e-6 * t) * vapour_fraction**2
    second = 1.83e-11 - 0.765e-8 * vapour_fraction**2
    ratio = pressure_pa / kelvin
    return 1.0 - ratio * first + ratio**2 * second


EQUATIONS: Mapping[Equation, Callable[[float, float, float, float], float]] = {
    "edlen": edlen,
    "ciddor": ciddor,
    "edlen-1966": edlen_1966,
}


def index(
    ambient: Ambient,
    *,
    equation: Equation = "edlen",
    wavelength_nm: float = WAVELENGTH_NM,
    where: str = "ambient",
) -> float:
    """Index n of the air a sensor set describes; nothing is assumed.

    Raises AmbientOutOfRange (E-EVAL-SENSOR, E-EVAL-AMBIENT) naming the sensor and its limits, ModelError (E-EVAL-WORD).
    """
    if equation not in EQUATIONS:
        raise ModelError("E-EVAL-WORD", where, key="equation", value=equation, known=", ".join(EQUATIONS))
    t = require_reading("air_degc", ambient.air_degc, where)
    p = require_reading("pressure_hpa", ambient.pressure_hpa, where) * PA_PER_HPA
    rh = require_reading("humidity_pct", ambient.humidity_pct, where)
    return EQUATIONS[equation](t, p, rh, wavelength_nm)


def material_degc(ambient: Ambient, where: str = "ambient") -> float:
    """Mean of the material sensors in degC; AmbientOutOfRange when there is none or one is impossible."""
    if not ambient.material_degc:
        require_reading("material_degc", None, where)
    values = [require_reading("material_degc", value, where) for value in ambient.material_degc]
    return sum(values) / len(values)


def require_reading(sensor: str, value: float | None, where: str) -> float:
    """The reading of a sensor of `LIMITS`, or AmbientOutOfRange."""
    low, high, unit = LIMITS[sensor]
    if value is None:
        raise AmbientOutOfRange("E-EVAL-SENSOR", where, sensor=sensor)
    if not low <= value <= high:
        raise AmbientOutOfRange(
            "E-EVAL-AMBIENT", where, sensor=sensor, value=digits(value, 6), low=low, high=high, unit=unit
        )
    return value


def env_factor(
    t_degc: float,
    pressure_pa: float,
    humidity_pct: float,
    material_t_degc: float,
    expansion_ppm_per_k: float,
    *,
    wavelength_nm: float = WAVELENGTH_NM,
    equation: Equation = "edlen-1966",
) -> float:
    """Compensated half wavelength in um, lambda / 2 / n / (1 + alpha (T - 20)): an .rtl's "Env factor"."""
    n = EQUATIONS[equation](t_degc, pressure_pa, humidity_pct, wavelength_nm)
    stretch = 1.0 + expansion_ppm_per_k * 1e-6 * (material_t_degc - REFERENCE_DEGC)
    return wavelength_nm / 2000.0 / n / stretch


def sensitivities(t_degc: float, pressure_pa: float, humidity_pct: float) -> tuple[float, float, float]:
    """Change of n per degC, per Pa and per % of humidity (central differences of the Edlen equation)."""

    def slope(dt: float, dp: float, dh: float) -> float:
        high = edlen(t_degc + dt, pressure_pa + dp, humidity_pct + dh)
        low = edlen(t_degc - dt, pressure_pa - dp, humidity_pct - dh)
        return (high - low) / 2.0

    return slope(0.01, 0.0, 0.0) / 0.01, slope(0.0, 10.0, 0.0) / 10.0, slope(0.0, 0.0, 0.1) / 0.1
