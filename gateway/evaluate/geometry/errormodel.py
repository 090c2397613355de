"""Captures of single errors -> what is known of the machine: angles first, levers, then lengths, then locations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Literal

import numpy as np

from drivers.errors import words
from drivers.units import AxisUnit, rad_to_arcsec, um_to_mm
from gateway.domain import Component, FloatArray, component_unit
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.geometry.abbe import arms, lever_um
from gateway.model.components import at_datum, standard_uncertainty, value
from gateway.model.conventions import first_harmonic, in_phase, mean_of, without_line, without_mean
from gateway.model.fit import fit_polygon, fit_positioning
from gateway.model.known import ErrorModel, LocationError, unmeasured
from gateway.model.regression import slope_of

PAIRS = (("EXC", "EYC"), ("EAC", "EBC"))
OPPOSITE_DEG = 180.0
LEAVES, FAR_ABOVE = 0.15, 4.0
"""What a smooth fit may leave at a target: um or arcsec, and times the standard uncertainty of a mean."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One set-up's deviations (m, n, 2) at targets (m,) in um or arcsec, and how it was mounted.

    ``component`` may end in -R (artefact turned over). ``systematic`` is the standard uncertainty that repetition
    does not show. ``turned_deg`` is where the rotary axis was parked, for a bar; ``stands`` where every axis stood when
    the set-up began, by letter.
    """

    component: str
    letter: str
    axis_unit: AxisUnit
    targets: FloatArray
    deviations: FloatArray
    reference: float = 0.0
    modulo: bool = False
    offset_mm: tuple[float, float, float] | None = None
    systematic: float = 0.0
    own_angle_arcsec: float | None = None
    turned_deg: float | None = None
    stands: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The error without the mark of a turned artefact."""
        return self.component.removesuffix("-R")

    @property
    def kind(self) -> Literal["linear", "rotary"]:
        """Of the axis that moved."""
        return "linear" if self.axis_unit == "mm" else "rotary"

    @property
    def is_motion(self) -> bool:
        """An error motion, no location error."""
        return self.name[1] != "0"


@dataclass(frozen=True, slots=True)
class Means:
    """Means (m,) of a measurement with their standard uncertainties."""

    of: Measurement
    mean: FloatArray
    u: FloatArray

    def less(self, what: FloatArray) -> Means:
        """The same with something (m,) taken off."""
        return replace(self, mean=self.mean - what)

    def fitted(self) -> Component:
        """Fit as it stands; where a smooth curve leaves far more than the scatter, straight lines between the means."""
        one = self.of
        smooth = fit_positioning(
            one.targets,
            self.mean,
            self.u,
            name=one.name,
            axis=one.letter,
            axis_unit=one.axis_unit,
            kind=one.kind,
            modulo=one.modulo,
        )
        known = np.isfinite(self.mean)
        left = float(np.max(np.abs(self.mean - value(smooth, one.targets))[known]))
        if one.kind == "rotary" or left <= max(LEAVES, FAR_ABOVE * float(np.max(self.u[known]))):
            return smooth
        at, mean, u = one.targets[known], self.mean[known], self.u[known]
        return fit_polygon(at, mean, u, name=one.name, axis=one.letter, axis_unit=one.axis_unit)


def error_model(
    measurements: Sequence[Measurement],
    spans: Mapping[str, float],
    *,
    linear_um: float = 5.0,
    angular_arcsec: float = 5.0,
) -> ErrorModel:
    """What these measurements tell; the rest of the 21 is unknown with its span (half width).

    Levers (known offsets) are taken off with fitted angles; an angle that was not measured leaves its share in the
    systematic uncertainty. Raises what `fit_positioning` raises.
    """
    means = [_means(one) for one in measurements]
    motions = {one.of.name: one for one in means if one.of.is_motion}
    angles = {name: one for name, one in motions.items() if component_unit(name, "mm") == "arcsec"}
    work = _Work(dict(spans), linear_um, angular_arcsec)
    for name, one in _centred(angles, work).items():
        work.take(name, one)
    lengths = {name: work.off_lever(one) for name, one in motions.items() if name not in angles}
    for name, one in _centred(lengths, work).items():
        work.take(name, one)
    located, said = _locations([one for one in means if not one.of.is_motion], work)
    known = (*work.motions, *(one.name for one in located))
    unknown = unmeasured(known, spans, linear_um=linear_um, angular_arcsec=angular_arcsec)
    return ErrorModel(tuple(work.motions.values()), located, unknown, work.systematic, (*work.said, *said))


def _means(one: Measurement) -> Means:
    found = robust_means(one.targets, one.deviations)
    # One repetition one way tells nothing of its scatter: the instrument's own uncertainty stands for it.
    u = np.where(np.isfinite(found.u) & (found.u > 0.0), found.u, max(one.systematic, 1e-3))
    return Means(one, found.mean, np.asarray(u))


class _Work:
    """The model as it grows: angles are there before the lengths that need them."""

    def __init__(self, spans: Mapping[str, float], linear_um: float, angular_arcsec: float) -> None:
        self.motions: dict[str, Component] = {}
        self.systematic: dict[str, float] = {}
        self.said: list[str] = []
        self._spans = spans
        self._usual = {"um": linear_um, "arcsec": angular_arcsec}

    def take(self, name: str, one: Means) -> None:
        """Fit and bring to convention; straightness loses its line."""
        at, known = one.of.targets, np.isfinite(one.mean)
        straight = one.of.axis_unit == "mm" and component_unit(name, "mm") == "um" and name[1] != name[2]
        if straight:
            slope, _ = slope_of(at[known], one.mean[known], one.u[known])
            one = one.less(slope * (at - at[known].mean()))
            found = without_line(one.fitted(), at[known])
            told = rad_to_arcsec(um_to_mm(slope))
            self.said.append(words("S-MODEL-SLOPE", name=name, slope=f"{told:+.2f}"))
        else:
            found = one.fitted()
        turning = one.of.axis_unit == "deg" and name[1] != "C"
        self.motions[name] = without_mean(found) if turning else at_datum(found, one.of.reference)
        self.systematic[name] = hypot(self.systematic.get(name, 0.0), one.of.systematic)

    def off_lever(self, one: Means) -> Means:
        """Readings without what the angles did at the offset, where offset and angles are known."""
        name, offset = one.of.name, one.of.offset_mm
        if offset is None:
            return one
        levers = arms(name[1], one.of.letter, offset)
        at = one.of.targets
        angles = {key: value(self.motions[key], at) for key in levers if key in self.motions}
        for key in sorted(set(levers) - set(angles)):
            share = abs(levers[key]) * self._spans.get(key, self._usual["arcsec"]) / 3.0**0.5
            self.systematic[name] = hypot(self.systematic.get(name, 0.0), share)
            self.said.append(words("S-MODEL-LEVER", name=name, angle=key, u=f"{share:.2f}"))
        squares = [(levers[key] * standard_uncertainty(self.motions[key], at)) ** 2 for key in angles]
        u = np.sqrt(one.u**2 + np.sum(squares, axis=0)) if squares else one.u
        return replace(one.less(lever_um(levers, angles, at.size)), u=np.asarray(u))

    def tilt(self, name: str, place: float | None) -> tuple[float, float]:
        """An angular motion at a place and its standard uncertainty, arcsec; unknown ones are 0 within their span."""
        motion = self.motions.get(name)
        if motion is None:
            return 0.0, self._spans.get(name, self._usual["arcsec"]) / 3.0**0.5
        if place is None:
            reach = value(motion, np.linspace(*motion.domain, 101))
            return float(reach.max() + reach.min()) / 2.0, float(np.ptp(reach)) / 12.0**0.5
        at = np.asarray([place])
        return float(value(motion, at)[0]), float(standard_uncertainty(motion, at)[0])


def _centred(found: dict[str, Means], work: _Work) -> dict[str, Means]:
    """Pairs around a turning axis without the wave of an eccentric or leaning artefact."""
    out = dict(found)
    for first, second in PAIRS:
        pair = [found[name] for name in (first, second) if name in found]
        waves = [first_harmonic(one.fitted()) for one in pair]
        if len(pair) == 2:
            waves = list(in_phase(*waves))
        for one, wave in zip(pair, waves, strict=True):
            out[one.of.name] = one.less(wave(one.of.targets))
            code = "S-MODEL-ECCENTRIC" if len(pair) == 2 else "S-MODEL-ONCE"
            size = float(np.hypot(wave.a, wave.b))
            unit = component_unit(one.of.name, "mm")
            work.said.append(words(code, name=one.of.name, size=f"{size:.2f}", unit=unit))
    return out


# ------------------------------------------------------------------------------------------- location errors


def _locations(means: Sequence[Means], work: _Work) -> tuple[tuple[LocationError, ...], list[str]]:
    said: list[str] = []
    square = _square([one for one in means if one.of.name == "B0Z"], said)
    found = [square] if square is not None else []
    for name in ("A0C", "B0C"):
        bar = _bar(name, [one for one in means if one.of.name == name], work, said)
        if bar is not None:
            found.append(bar if name == "A0C" else _against_z(bar, square))
    found += [_centre(one) for one in means if one.of.name in ("X0C", "Y0C")]
    return tuple(found), said


def _slope(one: Means) -> tuple[float, float]:
    """Slope of a straightness run in arcsec, with its standard uncertainty; the instrument's over the whole travel."""
    known = np.isfinite(one.mean)
    slope, u = slope_of(one.of.targets[known], one.mean[known], one.u[known])
    travel = float(np.ptp(one.of.targets[known]))
    whole = hypot(u, one.of.systematic / travel)
    return float(rad_to_arcsec(um_to_mm(slope))), float(rad_to_arcsec(um_to_mm(whole)))


def _square(runs: Sequence[Means], said: list[str]) -> LocationError | None:
    """B0Z: both slopes against one square added; the square turned over takes its own angle out."""
    sums: dict[bool, tuple[float, float]] = {}
    for turned in (False, True):
        pair = {one.of.letter: _slope(one) for one in runs if one.of.component.endswith("-R") == turned}
        if len(pair) == 2:
            sums[turned] = sum(s for s, _ in pair.values()), hypot(*(u for _, u in pair.values()))
    if len(sums) == 2:
        (plain, u1), (over, u2) = sums[False], sums[True]
        how = words("S-MODEL-SQUARE", own=f"{(plain - over) / 2.0:+.2f}")
        return LocationError("B0Z", (plain + over) / 2.0, hypot(u1, u2) / 2.0, "arcsec", how)
    own = next((one.of.own_angle_arcsec for one in runs if one.of.own_angle_arcsec is not None), None)
    if len(sums) == 1 and own is not None:
        turned, (total, u) = next(iter(sums.items()))
        how = words("S-MODEL-SQUARE-KNOWN", own=f"{own:+.2f}")
        return LocationError("B0Z", total + own if turned else total - own, u, "arcsec", how)
    if runs:
        said.append(words("S-MODEL-HALF", name="B0Z", need="X and Z, and both again with the square turned over"))
    return None


def _bar(name: str, runs: Sequence[Means], work: _Work, said: list[str]) -> LocationError | None:
    """Lean of Z against a bar in the table, the mean of two places half a turn apart, less the motions that tilt it."""
    at = {one.of.turned_deg % 360.0: _upright(name, one, work) for one in runs if one.of.turned_deg is not None}
    for first, (slope, u) in at.items():
        other = at.get((first + OPPOSITE_DEG) % 360.0)
        if other is not None:
            how = words("S-MODEL-BAR", lean=f"{(slope - other[0]) / 2.0:+.2f}")
            return LocationError(name, (slope + other[0]) / 2.0, hypot(u, other[1]) / 2.0, "arcsec", how)
    if runs:
        said.append(words("S-MODEL-HALF", name=name, need="the table at 0 and at 180 deg"))
    return None


def _upright(name: str, one: Means, work: _Work) -> tuple[float, float]:
    """Slope along a bar without what X and C, where they stood, tilt the table: they are error motions of their own."""
    slope, u = _slope(one)
    sign = -1.0 if name == "A0C" else 1.0
    places = {"X": one.of.stands.get("X"), "C": one.of.turned_deg}
    for letter, place in places.items():
        tilt, tilt_u = work.tilt(f"E{name[0]}{letter}", place)
        slope, u = slope + sign * tilt, hypot(u, tilt_u)
    return slope, u


def _against_z(bar: LocationError, square: LocationError | None) -> LocationError:
    """B0C: the bar shows B0Z - B0C."""
    leans, u = (square.value, square.u) if square is not None else (0.0, 0.0)
    to_z = words("S-MODEL-TO-Z")
    how = bar.how if square is not None else f"{bar.how} {to_z}"
    return LocationError("B0C", leans - bar.value, hypot(u, bar.u), "arcsec", how)


def _centre(one: Means) -> LocationError:
    """Mean place of a ball whose zero was set by a gauge."""
    mean, u = mean_of(one.fitted())
    return LocationError(one.of.name, mean, hypot(u, one.of.systematic), "um", words("S-MODEL-BALL"))
