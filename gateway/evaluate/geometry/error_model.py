"""Captures of single errors -> what is known of the machine: angles first, levers, then lengths, then locations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from drivers.message import Message, Quantity, fixed
from drivers.units import arcsec_to_rad, rad_to_arcsec, um_to_mm
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, component_unit
from gateway.errors import ModelError
from gateway.evaluate.geometry.axis_location import from_ball, from_bar
from gateway.evaluate.geometry.measurement import Lever, Means, Measurement, means_of, said_beyond
from gateway.evaluate.geometry.straightness import StraightnessRun, from_runs, of_plane, reversed_square, straightness
from gateway.model.components import (
    KnownRange,
    at_datum,
    first_harmonic,
    in_phase,
    near_value,
    value,
    without_line,
    without_mean,
)
from gateway.model.error_model import ErrorModel, LocationError, unmeasured_errors

PAIRS = (("EXC", "EYC"), ("EAC", "EBC"))


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
    means = [means_of(one) for one in measurements]
    motions = {one.of.name: one for one in means if one.of.is_motion}
    angles = {name: one for name, one in motions.items() if component_unit(name, "mm") == "arcsec"}
    work = _Work(dict(spans), linear_um, angular_arcsec)
    for name, one in _without_eccentricity(angles, work).items():
        work.take(name, one)
    lengths = {name: work.off_lever(one) for name, one in motions.items() if name not in angles}
    for name, one in _without_eccentricity(lengths, work).items():
        work.take(name, one)
    located, said = locations([one for one in means if not one.of.is_motion], work.tilt)
    known = (*work.motions, *(one.name for one in located))
    unknown = unmeasured_errors(known, spans, linear_um=linear_um, angular_arcsec=angular_arcsec)
    return ErrorModel(
        motions=tuple(work.motions.values()),
        locations=located,
        unknown=unknown,
        systematic=work.systematic,
        said=(*work.said, *said),
    )


# ------------------------------------------------------------------------------------------ the model as it grows


class _Work:
    """The model as it grows: angles are there before the lengths that need them."""

    def __init__(self, spans: Mapping[str, float], linear_um: float, angular_arcsec: float) -> None:
        self.motions: dict[str, Component] = {}
        self.systematic: dict[str, float] = {}
        self.said: list[Message] = []
        self._spans = spans
        self._usual = {"um": linear_um, "arcsec": angular_arcsec}

    def take(self, name: str, one: Means) -> None:
        """Fit and bring to convention; straightness loses its line."""
        at, known = one.of.targets, np.isfinite(one.mean)
        straight = one.of.axis_unit == "mm" and component_unit(name, "mm") == "um" and name[1] != name[2]
        if straight:
            slope = straightness(at[known], one.mean[known], "lsq").slope
            one = one.less(slope * (at - at[known].mean()))
            found = without_line(one.fitted(), at[known])
            told = rad_to_arcsec(um_to_mm(slope))
            self.said.append(Message.of("S-MODEL-SLOPE", name=name, slope=fixed(told, signed=True)))
        else:
            found = one.fitted()
        turning = one.of.axis_unit == "deg" and name[1] != name[2]
        self.motions[name] = without_mean(found) if turning else at_datum(found, self._datum(found, one.of.reference))
        self.systematic[name] = hypot(self.systematic.get(name, 0.0), one.of.systematic)

    def _datum(self, found: Component, reference: float) -> float:
        """The reference, or where it was not reached the nearest position that was measured."""
        known = KnownRange.of(found)
        if known.has(reference):
            return reference
        nearest = min(found.domain, key=lambda end: abs(end - reference))
        ends = {"low": Quantity(known.low), "high": Quantity(known.high), "unit": found.axis_unit}
        self.said.append(
            Message.of(
                "S-MODEL-DATUM", name=found.name, reference=Quantity(reference), nearest=Quantity(nearest), **ends
            )
        )
        return nearest

    def off_lever(self, one: Means) -> Means:
        """Readings without what the angles did at the offset, where offset and angles are known."""
        name, offset = one.of.name, one.of.offset_mm
        if offset is None:
            return one
        usual, at = self._usual["arcsec"], one.of.targets
        lever = Lever.of(name, one.of.letter, offset, angles=self.motions, spans=self._spans, usual_arcsec=usual)
        self.systematic[name] = hypot(self.systematic.get(name, 0.0), lever.open_u)
        for key, share in lever.open_um.items():
            self.said.append(Message.of("S-MODEL-LEVER", name=name, angle=key, u=fixed(share)))
        self.said += lever.estimated(at)
        return replace(one.less(lever.um(at)), u=np.hypot(one.u, lever.u(at)))

    def tilt(self, name: str, place: float | None) -> tuple[float, float]:
        """An angular motion at a place and its standard uncertainty, arcsec; unknown ones are 0 within their span.

        So is one far from where it was measured.
        """
        motion = self.motions.get(name)
        if motion is None:
            return 0.0, self._spans.get(name, self._usual["arcsec"]) / 3.0**0.5
        if place is None:
            reach = value(motion, np.linspace(*motion.domain, 101))
            return float(reach.max() + reach.min()) / 2.0, float(np.ptp(reach)) / 12.0**0.5
        known, at = KnownRange.of(motion), np.asarray([place])
        try:
            found, u = near_value(motion, at)
        except ModelError:
            ends = {"low": Quantity(known.low), "high": Quantity(known.high), "unit": motion.axis_unit}
            self.said.append(Message.of("S-MODEL-OUTSIDE", name=name, position=Quantity(place), **ends))
            return 0.0, self._spans.get(name, self._usual["arcsec"]) / 3.0**0.5
        self.said += said_beyond(motion, at)
        return float(found[0]), float(u[0])


def _without_eccentricity(found: dict[str, Means], work: _Work) -> dict[str, Means]:
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
            work.said.append(Message.of(code, name=one.of.name, size=fixed(size), unit=unit))
    return out


# ---- Location errors of the bed frame from set-ups of square, bar and ball; each says how it was determined.

OPPOSITE_DEG = 180.0
# The direction in which a bar is read for each lean, and the sign with which a tilt of the table counts in it.
BARS = {"A0C": ("Y", -1.0), "B0C": ("X", 1.0)}
Tilt = Callable[[str, float | None], tuple[float, float]]


def locations(means: Sequence[Means], tilt: Tilt) -> tuple[tuple[LocationError, ...], list[Message]]:
    """Location errors that the set-ups determine, and words on those they do not.

    ``tilt`` tells an angular motion at a place (or over its reach) and its standard uncertainty, arcsec. Raises
    ModelError (E-MODEL-SQUARES) where set-ups give several angles of one square.
    """
    said: list[Message] = []
    square = _square([one for one in means if one.of.name == "B0Z"], said)
    found = [square] if square is not None else []
    for name in BARS:
        bar = _bar(name, [one for one in means if one.of.name == name], tilt, said)
        if bar is not None:
            found.append(bar if name == "A0C" else _against_z(bar, square))
    found += [_centre(one) for one in means if one.of.name in ("X0C", "Y0C")]
    return tuple(found), said


def _run(one: Means, sign: float = 1.0, lean_arcsec: float = 0.0, lean_u_arcsec: float = 0.0) -> StraightnessRun:
    """The readings as a run in mm, a lean added; the instrument's uncertainty tilts the whole travel."""
    known = np.isfinite(one.mean)
    at, mean, u = one.of.targets[known], um_to_mm(one.mean[known]), um_to_mm(one.u[known])
    lean = arcsec_to_rad(lean_arcsec) * (at - at.mean())
    whole = hypot(um_to_mm(one.of.systematic) / float(np.ptp(at)), arcsec_to_rad(lean_u_arcsec))
    return StraightnessRun(at, sign * (mean + lean), u, whole)


def _square(runs: Sequence[Means], said: list[Message]) -> LocationError | None:
    """B0Z: both slopes against one square added; the square turned over takes its own angle out."""
    pairs: dict[bool, tuple[StraightnessRun, StraightnessRun]] = {}
    for turned in (False, True):
        pair = {one.of.letter: _run(one) for one in runs if one.of.component.endswith("-R") == turned}
        if len(pair) == 2:
            first, second = pair.values()
            pairs[turned] = first, second
    if len(pairs) == 2:
        found = reversed_square(from_runs(*pairs[False]), from_runs(*pairs[True]))
        own_angle = fixed(float(rad_to_arcsec(found.own)), signed=True)
        how = Message.of("S-MODEL-SQUARE", own=own_angle)
        return _b0z(found.C0Y, found.u, how)
    angles = {one.of.own_angle_arcsec for one in runs if one.of.own_angle_arcsec is not None}
    if len(angles) > 1:  # of one square: two set-ups say two
        raise ModelError("E-MODEL-SQUARES", "B0Z", angles=", ".join(f"{one:+g}" for one in sorted(angles)))
    own = angles.pop() if angles else None
    if len(pairs) == 1 and own is not None:
        turned, both = next(iter(pairs.items()))
        against = from_runs(*both, arcsec_to_rad(-own if turned else own))
        return _b0z(against.C0Y, against.u, Message.of("S-MODEL-SQUARE-KNOWN", own=fixed(own, signed=True)))
    if runs:
        said.append(Message.of("S-MODEL-HALF", name="B0Z", need=Message.of("S-EVAL-NEEDS-SQUARE")))
    return None


def _b0z(above_90_rad: float, u: float, how: Message) -> LocationError:
    return LocationError(
        name="B0Z",
        value=of_plane("XZ", above_90_rad).value_arcsec,
        u=float(rad_to_arcsec(u)),
        unit="arcsec",
        how=(how,),
    )


def _bar(name: str, runs: Sequence[Means], tilt: Tilt, said: list[Message]) -> LocationError | None:
    """Lean of C against Z by a bar in the table: the mean of two places half a turn apart, without what tilts it."""
    letter, _ = BARS[name]
    at = {one.of.turned_deg % 360.0: _upright(name, one, tilt) for one in runs if one.of.turned_deg is not None}
    for first, run in at.items():
        other = at.get((first + OPPOSITE_DEG) % 360.0)
        if other is not None:
            found = from_bar("C", {letter: (run, other)})
            how = Message.of("S-MODEL-BAR", lean=fixed(-found.artefact[letter], signed=True))
            return LocationError(
                name=name, value=found.values[f"E{name}"], u=found.U[f"E{name}"] / COVERAGE, unit="arcsec", how=(how,)
            )
    if runs:
        said.append(Message.of("S-MODEL-HALF", name=name, need=Message.of("S-EVAL-NEEDS-TABLE")))
    return None


def _upright(name: str, one: Means, tilt: Tilt) -> StraightnessRun:
    """The bar's surface without what X and C, where they stood, tilt the table: they are error motions of their own.

    A reading is the motion of Z against the bar, the surface its opposite.
    """
    places = {"X": one.of.stands.get("X"), "C": one.of.turned_deg}
    tilts = [tilt(f"E{name[0]}{letter}", place) for letter, place in places.items()]
    lean = BARS[name][1] * sum(value for value, _ in tilts)
    return _run(one, -1.0, lean, hypot(*(u for _, u in tilts)))


def _against_z(bar: LocationError, square: LocationError | None) -> LocationError:
    """B0C in the bed's frame: the bar shows how C leans against Z, and Z itself leans by B0Z."""
    leans, u = (square.value, square.u) if square is not None else (0.0, 0.0)
    how = bar.how if square is not None else (*bar.how, Message.of("S-MODEL-TO-Z"))
    return LocationError(name="B0C", value=leans + bar.value, u=hypot(u, bar.u), unit="arcsec", how=how)


def _centre(one: Means) -> LocationError:
    """Mean place of a ball whose zero was set by a gauge."""
    name = one.of.name
    found = from_ball("C", [(0.0, {name[0]: one.fitted()})])
    u = hypot(found.U[f"E{name}"] / COVERAGE, one.of.systematic)
    return LocationError(name=name, value=found.values[f"E{name}"], u=u, unit="um", how=(Message.of("S-MODEL-BALL"),))
