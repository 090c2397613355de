"""Curves over an axis from the cell file's terms, redrawn by a seed when a cell is asked for another self."""

from __future__ import annotations

from collections.abc import Callable
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Terms
from simulators.cellfile.curves import (
    Constant,
    Harmonic,
    PolynomialTerm,
    Screw,
    SeededCurve,
    Step,
    TableTerm,
    Term,
    Wear,
    Worm,
)

FloatArray = NDArray[np.float64]
Curve = Callable[[FloatArray], FloatArray]


def generator(seed: int, *names: str) -> np.random.Generator:
    """A random generator of its own for each named thing of a cell: adding one never changes another."""
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])


def curve(terms: Terms, travel: tuple[float, float], rotary: bool, seed: int, name: str, redraw: bool) -> Curve:
    """The sum of all terms as a function of positions (n,) in mm or deg, giving um or arcsec (n,).

    With `redraw` each term keeps its kind and order and gets another size, sign, phase or place.
    """
    parts: list[Curve] = []
    for index, term in enumerate(terms):
        rng = generator(seed, name, str(index))
        wanted = _redrawn(term, travel, rng) if redraw else term
        parts.append(_single(wanted, travel, rotary, rng))
    if not parts:
        return np.zeros_like
    return lambda q: np.sum([part(q) for part in parts], axis=0)


def _redrawn(term: Term, travel: tuple[float, float], rng: np.random.Generator) -> Term:
    size = float(rng.uniform(0.8, 1.1) * rng.choice((-1.0, 1.0)))
    match term:
        case Constant():
            return term.model_copy(update={"value": size * term.value})
        case PolynomialTerm():
            return term.model_copy(update={"coefficients": tuple(size * c for c in term.coefficients)})
        case Harmonic():
            phase = float(rng.uniform(0.0, 360.0))
            return term.model_copy(update={"amplitude": size * term.amplitude, "phase_deg": phase})
        case TableTerm():
            return term.model_copy(update={"values": tuple(size * value for value in term.values)})
        case Step():
            return term.model_copy(update={"height": size * term.height, "at": _place(travel, rng)})
        case Screw() | Worm():
            phase = float(rng.uniform(0.0, 360.0))
            amplitudes = tuple(size * amplitude for amplitude in term.amplitudes)
            return term.model_copy(update={"amplitudes": amplitudes, "phase_deg": phase})
        case Wear():  # a guide wears where it is used and never grows: only its place and depth are drawn
            return term.model_copy(update={"depth": abs(size) * term.depth, "at": _place(travel, rng)})
        case SeededCurve():
            return term


def _place(travel: tuple[float, float], rng: np.random.Generator) -> float:
    span = travel[1] - travel[0]
    return float(rng.uniform(travel[0] + 0.2 * span, travel[1] - 0.2 * span))


def _single(term: Term, travel: tuple[float, float], rotary: bool, rng: np.random.Generator) -> Curve:
    match term:
        case Constant(value=value):
            return lambda q: np.full_like(q, value)
        case PolynomialTerm():
            return _polynomial(term)
        case Harmonic():
            return _harmonic(term)
        case TableTerm():
            points, values = np.asarray(term.positions), np.asarray(term.values)
            return lambda q: np.interp(q, points, values)
        case Step(at=at, height=height):
            return lambda q: np.where(q >= at, height, 0.0)
        case Screw(pitch=pitch):
            return _turning(term.amplitudes, pitch, term.phase_deg)
        case Worm():
            return _turning(term.amplitudes, 360.0 * term.starts / term.teeth, term.phase_deg)
        case Wear():
            return _worn(term)
        case SeededCurve():
            return _random(term, travel, rotary, rng)


def _polynomial(term: PolynomialTerm) -> Curve:
    coefficients = np.asarray(term.coefficients)
    return lambda q: np.polynomial.polynomial.polyval((q - term.center) / term.scale, coefficients)


def _harmonic(term: Harmonic) -> Curve:
    period = term.period if term.period is not None else 360.0 / (term.order or 1)
    phase = np.deg2rad(term.phase_deg)
    return lambda q: term.amplitude * np.cos(2.0 * np.pi * q / period + phase)


def _turning(amplitudes: tuple[float, ...], pitch: float, phase_deg: float) -> Curve:
    """Waves of a driving shaft that turns once in ``pitch``."""
    orders, heights = np.arange(1, len(amplitudes) + 1), np.asarray(amplitudes)

    def turning(q: FloatArray) -> FloatArray:
        shaft = 2.0 * np.pi * np.asarray(q, dtype=np.float64) / pitch + np.deg2rad(phase_deg)
        return np.asarray(np.cos(np.multiply.outer(shaft, orders)) @ heights)

    return turning


def _worn(term: Wear) -> Curve:
    def worn(q: FloatArray) -> FloatArray:
        along = np.clip((q - term.at) / term.length, -0.5, 0.5)
        return np.asarray(-0.5 * term.depth * (1.0 + np.cos(2.0 * np.pi * along)))

    return worn


def _random(term: SeededCurve, travel: tuple[float, float], rotary: bool, rng: np.random.Generator) -> Curve:
    """Waves of falling size, scaled so that the curve's greatest value over the travel is `size`."""
    span = 360.0 if rotary else travel[1] - travel[0]
    whole = np.arange(1, max(round(term.waves), 1) + 1)
    rates = 2.0 * np.pi * (whole if rotary else np.linspace(0.35, term.waves, len(whole))) / span
    heights = rng.normal(size=len(rates)) / np.sqrt(whole)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(rates))

    def raw(q: FloatArray) -> FloatArray:
        waves = np.cos(np.multiply.outer(np.asarray(q, dtype=np.float64), rates) + phases)
        return np.asarray(waves @ heights)

    start = 0.0 if rotary else travel[0]
    peak = float(np.max(np.abs(raw(start + span * np.linspace(0.0, 1.0, 721))))) or 1.0
    return lambda q: term.size / peak * raw(q)
