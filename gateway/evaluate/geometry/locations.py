"""From set-ups of square, bar and ball to location errors of the bed frame, with words on how each was got."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot

import numpy as np

from drivers.errors import words
from drivers.message import Message
from drivers.units import arcsec_to_rad, rad_to_arcsec, um_to_mm
from gateway.domain.values import COVERAGE
from gateway.errors import ModelError
from gateway.evaluate.geometry.axis_location import from_ball, from_bar
from gateway.evaluate.geometry.measurement import Means
from gateway.evaluate.geometry.squareness import from_runs, of_plane, reversed_square
from gateway.evaluate.geometry.straightness import StraightnessRun
from gateway.model.known import LocationError

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
        how = words("S-MODEL-SQUARE", own=f"{rad_to_arcsec(found.own):+.2f}")
        return _b0z(found.C0Y, found.u, how)
    angles = {one.of.own_angle_arcsec for one in runs if one.of.own_angle_arcsec is not None}
    if len(angles) > 1:  # of one square: two set-ups say two
        raise ModelError("E-MODEL-SQUARES", "B0Z", angles=", ".join(f"{one:+g}" for one in sorted(angles)))
    own = angles.pop() if angles else None
    if len(pairs) == 1 and own is not None:
        turned, both = next(iter(pairs.items()))
        against = from_runs(*both, arcsec_to_rad(-own if turned else own))
        return _b0z(against.C0Y, against.u, words("S-MODEL-SQUARE-KNOWN", own=f"{own:+.2f}"))
    if runs:
        said.append(Message.of("S-MODEL-HALF", name="B0Z", need="X and Z, and both again with the square turned over"))
    return None


def _b0z(above_90_rad: float, u: float, how: str) -> LocationError:
    return LocationError(
        name="B0Z", value=of_plane("XZ", above_90_rad).value_arcsec, u=float(rad_to_arcsec(u)), unit="arcsec", how=how
    )


def _bar(name: str, runs: Sequence[Means], tilt: Tilt, said: list[Message]) -> LocationError | None:
    """Lean of C against Z by a bar in the table: the mean of two places half a turn apart, without what tilts it."""
    letter, _ = BARS[name]
    at = {one.of.turned_deg % 360.0: _upright(name, one, tilt) for one in runs if one.of.turned_deg is not None}
    for first, run in at.items():
        other = at.get((first + OPPOSITE_DEG) % 360.0)
        if other is not None:
            found = from_bar("C", {letter: (run, other)})
            how = words("S-MODEL-BAR", lean=f"{-found.artefact[letter]:+.2f}")
            return LocationError(
                name=name, value=found.values[f"E{name}"], u=found.U[f"E{name}"] / COVERAGE, unit="arcsec", how=how
            )
    if runs:
        said.append(Message.of("S-MODEL-HALF", name=name, need="the table at 0 and at 180 deg"))
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
    to_z = words("S-MODEL-TO-Z")
    how = bar.how if square is not None else f"{bar.how} {to_z}"
    return LocationError(name="B0C", value=leans + bar.value, u=hypot(u, bar.u), unit="arcsec", how=how)


def _centre(one: Means) -> LocationError:
    """Mean place of a ball whose zero was set by a gauge."""
    name = one.of.name
    found = from_ball("C", [(0.0, {name[0]: one.fitted()})])
    u = hypot(found.U[f"E{name}"] / COVERAGE, one.of.systematic)
    return LocationError(name=name, value=found.values[f"E{name}"], u=u, unit="um", how=words("S-MODEL-BALL"))
