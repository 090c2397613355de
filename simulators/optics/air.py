"""Refractive index of moist air by Ciddor's equations (1996), in the form NIST publishes."""

from __future__ import annotations

from math import exp

WATER_CRITICAL_K = 647.096
WATER_CRITICAL_PA = 22_064_000.0
WAGNER = (
    (-7.85951783, 1.0),
    (1.84408259, 1.5),
    (-11.7866497, 3.0),
    (22.6807411, 3.5),
    (-15.9618719, 4.0),
    (1.80122502, 7.5),
)
GAS_J_PER_MOL_K = 8.314472
WATER_KG_PER_MOL = 0.018015
CO2_PPM = 450.0


def saturation_pa(degc: float) -> float:
    """Saturation vapour pressure of water in Pa (Wagner's equation as quoted by the RCU10 manual)."""
    kelvin = degc + 273.15
    rest = 1.0 - kelvin / WATER_CRITICAL_K
    total = sum(factor * rest**power for factor, power in WAGNER)
    return WATER_CRITICAL_PA * exp(total * WATER_CRITICAL_K / kelvin)


def refractive_index(degc: float, hpa: float, humidity_pct: float, wavelength_nm: float) -> float:
    """Phase refractive index at a vacuum wavelength; 450 ppm CO2. Valid -40 .. 100 degC, 300 .. 1700 nm."""
    pa, kelvin = 100.0 * hpa, degc + 273.15
    vapour = _vapour_fraction(degc, pa, humidity_pct)
    packed = pa / (_compressibility(degc, pa, vapour) * GAS_J_PER_MOL_K * kelvin)
    dry_kg_per_mol = 0.0289635 + 1.2011e-8 * (CO2_PPM - 400.0)
    dry_reference = 101325.0 * dry_kg_per_mol / (0.9995922115 * GAS_J_PER_MOL_K * 288.15)
    dry = (1.0 - vapour) * packed * dry_kg_per_mol / dry_reference
    wet = vapour * packed * WATER_KG_PER_MOL / 0.00985938
    s = (1000.0 / wavelength_nm) ** 2
    return 1.0 + dry * _dry_refractivity(s) + wet * _wet_refractivity(s)


def _vapour_fraction(degc: float, pa: float, humidity_pct: float) -> float:
    enhancement = 1.00062 + 3.14e-8 * pa + 5.60e-7 * degc**2
    return humidity_pct / 100.0 * enhancement * saturation_pa(degc) / pa


def _compressibility(degc: float, pa: float, vapour: float) -> float:
    ratio = pa / (degc + 273.15)
    first = 1.58123e-6 - 2.9331e-8 * degc + 1.1043e-10 * degc**2
    mixed = (5.707e-6 - 2.051e-8 * degc) * vapour + (1.9898e-4 - 2.376e-6 * degc) * vapour**2
    return 1.0 - ratio * (first + mixed) + ratio**2 * (1.83e-11 - 0.765e-8 * vapour**2)


def _dry_refractivity(s: float) -> float:
    return 1e-8 * (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s))


def _wet_refractivity(s: float) -> float:
    return 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)
