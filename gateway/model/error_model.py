"""The YK7350B form grinder and what is known of its errors: fitted motions, location errors, unmeasured spans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivers.message import Message
from drivers.units import DeviationUnit, arcsec_to_rad, um_to_mm
from gateway.domain.figures import Component
from gateway.domain.values import component_unit
from gateway.model.chain import LETTERS, Axis, Chain, FixedLink, Motion
from gateway.model.motion import motion_from

MOTION_NAMES = tuple(f"E{letter}{axis}" for axis in "XZC" for letter in LETTERS)
LOCATION_NAMES = ("B0Z", "A0C", "B0C")
TWENTY_ONE = (*MOTION_NAMES, *LOCATION_NAMES)


def yk7350b(
    errors: Mapping[str, Motion] | None = None,
    *,
    c_frame: Literal["moving", "fixed"] = "moving",
    x_direction: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Chain:
    """The machine of the paper: bed > X > C (work) and bed > Z (wheel, axis Y), T_WT = Rz(-c) trans(-x, 0, z).

    ``errors`` by ISO 230-1 name in mm and rad (`TWENTY_ONE` and every other location error); ``c_frame`` says
    in which frame the C errors were measured: "fixed" for artefact and spindle analysis. With ``x_direction``
    (-1, 0, 0) the X command counts the centre distance upward.
    """
    x = Axis("X", "prismatic", x_direction)
    c = Axis("C", "revolute", (0.0, 0.0, 1.0), err_frame=c_frame)
    z = Axis("Z", "prismatic", (0.0, 0.0, 1.0))
    return Chain((x, c), (z,)).with_errors(errors or {})


# ---- What is known of a machine's errors: fitted motions, location errors, and the unknown with their assumed span.


@dataclass(frozen=True, slots=True)
class LocationError:
    """A measured location error with its standard uncertainty, um or arcsec; ``how`` it was got."""

    name: str
    value: float
    u: float
    unit: DeviationUnit
    how: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class UnmeasuredError:
    """An error nobody measured: it lies within +/- ``span``, um or arcsec, anywhere with the same chance."""

    name: str
    span: float
    unit: DeviationUnit

    @property
    def u(self) -> float:
        """Standard uncertainty of the rectangle."""
        return self.span / 3.0**0.5


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """All that is known of a machine's errors.

    Motions are zero at their axis' reference and, straightness, without least-squares slope; those of a rotary axis
    are told in the machine's fixed frame, without mean and without what a set-up's eccentricity makes. Bed frame: X
    travels along X, Z has no A0Z. ``systematic`` is each measured error's standard uncertainty that repetition does
    not show (instrument, unremoved levers), um or arcsec. ``said`` tells conventions and what was left out.
    """

    motions: tuple[Component, ...] = ()
    locations: tuple[LocationError, ...] = ()
    unknown: tuple[UnmeasuredError, ...] = ()
    systematic: Mapping[str, float] = field(default_factory=dict)
    said: tuple[Message, ...] = ()

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of everything that was measured."""
        return (*(one.name for one in self.motions), *(one.name for one in self.locations))

    def motion(self, name: str) -> Component | None:
        """A fitted motion by its name."""
        return next((one for one in self.motions if one.name == name), None)


def in_mm_rad(unit: DeviationUnit, value: float) -> float:
    """A value in um or arcsec as mm or rad."""
    return um_to_mm(value) if unit == "um" else arcsec_to_rad(value)


def chain_of_errors(
    model: ErrorModel, *, height_mm: float = 0.0, c_frame: Literal["moving", "fixed"] = "fixed"
) -> Chain:
    """The form grinder with these errors, mm and rad; unknown ones are zero. The work stands ``height_mm`` up.

    Positions are the machine's own, so the levers of the height count. X0C and Y0C are no errors of the 21: they hold
    where the other axes stood, and the set-up's zeros take them.
    """
    errors: dict[str, Motion] = {one.name: motion_from(one) for one in model.motions if one.name in TWENTY_ONE}
    errors |= {one.name: in_mm_rad(one.unit, one.value) for one in model.locations if one.name in TWENTY_ONE}
    chain = yk7350b(errors, c_frame=c_frame)
    return Chain((*chain.work, FixedLink((0.0, 0.0, height_mm))), chain.tool) if height_mm else chain


def unmeasured_errors(
    measured: tuple[str, ...], spans: Mapping[str, float], *, linear_um: float, angular_arcsec: float
) -> tuple[UnmeasuredError, ...]:
    """The 21 less those measured, each with its span (or the usual one)."""
    found = []
    for name in TWENTY_ONE:
        unit = component_unit(name, "mm")
        usual = linear_um if unit == "um" else angular_arcsec
        if name not in measured:
            found.append(UnmeasuredError(name, spans.get(name, usual), unit))
    return tuple(found)
