"""Captures of single errors -> what is known of the machine: angles first, levers, then lengths, then locations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from drivers.message import Message
from drivers.units import rad_to_arcsec, um_to_mm
from gateway.domain.figures import Component
from gateway.domain.values import component_unit
from gateway.errors import ModelError
from gateway.evaluate.geometry.lever import Lever, said_beyond
from gateway.evaluate.geometry.locations import locations
from gateway.evaluate.geometry.measurement import Means, Measurement, means_of
from gateway.evaluate.geometry.straightness import straightness
from gateway.model.components import KnownRange, at_datum, near_value, value
from gateway.model.conventions import first_harmonic, in_phase, without_line, without_mean
from gateway.model.known import ErrorModel, unmeasured

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
    for name, one in _centred(angles, work).items():
        work.take(name, one)
    lengths = {name: work.off_lever(one) for name, one in motions.items() if name not in angles}
    for name, one in _centred(lengths, work).items():
        work.take(name, one)
    located, said = locations([one for one in means if not one.of.is_motion], work.tilt)
    known = (*work.motions, *(one.name for one in located))
    unknown = unmeasured(known, spans, linear_um=linear_um, angular_arcsec=angular_arcsec)
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
            self.said.append(Message.of("S-MODEL-SLOPE", name=name, slope=f"{told:+.2f}"))
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
        ends = {"low": f"{known.low:g}", "high": f"{known.high:g}", "unit": found.axis_unit}
        self.said.append(
            Message.of("S-MODEL-DATUM", name=found.name, reference=f"{reference:g}", nearest=f"{nearest:g}", **ends)
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
            self.said.append(Message.of("S-MODEL-LEVER", name=name, angle=key, u=f"{share:.2f}"))
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
            ends = {"low": f"{known.low:g}", "high": f"{known.high:g}", "unit": motion.axis_unit}
            self.said.append(Message.of("S-MODEL-OUTSIDE", name=name, position=f"{place:g}", **ends))
            return 0.0, self._spans.get(name, self._usual["arcsec"]) / 3.0**0.5
        self.said += said_beyond(motion, at)
        return float(found[0]), float(u[0])


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
            work.said.append(Message.of(code, name=one.of.name, size=f"{size:.2f}", unit=unit))
    return out
