"""What a reducer of RV or plain cycloid type is made of: frozen records, units in the names, checked where they enter.

Frame: z along the axis of the ring, pin j at the angle 2 pi j / zp. Crank angle alpha, disc centre at
a (cos alpha, sin alpha), output angle psi = -alpha / zc for perfect parts, counter-clockwise positive. A disc's crank
phase is the angle of its eccentric against the first one's; its mark is the number m of the tooth position in which
it is built: its space 0 lies (2 pi m - phase) / zc from the carrier's mark. zc positions mesh, and which one is built
decides what two discs cancel.

Defaults are choices of this project and no maker's data; they are stated with each field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, pi
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import digits, fixed, words
from drivers.types.values import FloatArray
from drivers.units import deg_to_rad, mm_to_um, um_to_mm
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear

Datum = Literal["crank-holes", "bore", "best-fit"]
DATUMS: tuple[Datum, ...] = get_args(Datum)
InputHeld = Literal["sun", "crank"]
INPUTS: tuple[InputHeld, ...] = get_args(InputHeld)
MOST_DISCS = 3
CLOSED_UM = 1e-6  # a drive without any clearance is allowed, one with less is not
MESH_DEG = 1e-6  # how near to a tooth position a mark angle must be


@dataclass(frozen=True, slots=True)
class Pins:
    """The ring: ``number`` pins of ``radius_mm`` on a circle of ``circle_mm`` (radius).

    Errors by pin, um, none where empty: ``radius_um`` (+ thick), ``radial_um`` (+ outward), ``tangential_um``
    (+ counter-clockwise).
    """

    number: int
    circle_mm: float
    radius_mm: float
    radius_um: tuple[float, ...] = ()
    radial_um: tuple[float, ...] = ()
    tangential_um: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class DiscPlace:
    """One disc in the drive: phase of its eccentric (deg) and number of the tooth position in which it is built."""

    crank_phase_deg: float = 0.0
    mark: int = 0

    def mark_angle_deg(self, zc: int) -> float:
        """Where the disc's space 0 is against the carrier's mark, deg."""
        return (360.0 * self.mark - self.crank_phase_deg) / zc


@dataclass(frozen=True, slots=True)
class Cranks:
    """Crankshafts borne in the output: ``number`` of them on a circle of ``circle_mm`` (radius).

    ``stiffness_n_mm`` is one eccentric's bearing, crank bending and carrier in series (N/mm); inf is a rigid crank,
    which has neither play nor errors. ``clearance_um`` is the radial play of that bearing (needles: 2 to 5 um of
    diameter are usual; default 1). Errors by disc and crank, none where empty: ``eccentricity_um``, ``phase_arcsec``
    of the eccentric, ``hole_um`` (x, y) of the disc's hole against the output's, in the disc's frame.
    """

    number: int
    circle_mm: float
    stiffness_n_mm: float
    clearance_um: float = 1.0
    eccentricity_um: tuple[tuple[float, ...], ...] = ()
    phase_arcsec: tuple[tuple[float, ...], ...] = ()
    hole_um: tuple[tuple[tuple[float, float], ...], ...] = ()


@dataclass(frozen=True, slots=True)
class OutputPins:
    """A plain cycloid drive: one eccentric in the disc's bore, and output pins in holes larger by its eccentricity.

    Each output pin touches on one side: ``stiffness_n_mm`` there, ``clearance_um`` of radial play. The bearing on the
    eccentric has ``bearing_n_mm`` and ``bearing_um``. ``hole_um`` (x, y) by disc and pin, none where empty.
    """

    number: int
    circle_mm: float
    stiffness_n_mm: float
    clearance_um: float = 2.0
    bearing_n_mm: float = 2e5
    bearing_um: float = 1.0
    hole_um: tuple[tuple[tuple[float, float], ...], ...] = ()


@dataclass(frozen=True, slots=True)
class FirstStage:
    """The involute stage by its ratio (input turns per output turn, ring fixed) and the planets' angular error.

    ``error_arcsec`` is the amplitude of one wave per turn of the sun against the planets; it reaches the output
    divided by zp + z1/z2. A ratio of 0 means that there is none: the crank is the input.
    """

    ratio: float = 0.0
    error_arcsec: float = 0.0


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact of pin and flank. ``law`` "linear": ``stiffness_n_mm2`` (N per mm of width and mm of approach).

    "line": Palmgren's approach of a steel roller, 3.84e-5 F^0.9 / L^0.8 (mm, N), as in catalogues of roller bearings.
    Moduli (MPa) and Poisson's ratios of pin and disc give the contact pressure; ``limit_mpa`` is the largest one that
    the model answers for (4000 MPa is usual for line contact of hardened rollers at rest).
    """

    law: Literal["linear", "line"] = "linear"
    stiffness_n_mm2: float = 2e4
    moduli_mpa: tuple[float, float] = (206_000.0, 206_000.0)
    poisson: tuple[float, float] = (0.3, 0.3)
    limit_mpa: float = 4000.0

    @property
    def reduced_mpa(self) -> float:
        """The plane-strain modulus of both bodies, 1 / sum((1 - nu^2) / E)."""
        return 1.0 / sum((1.0 - nu**2) / E for E, nu in zip(self.moduli_mpa, self.poisson, strict=True))


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Standard uncertainties of what nobody measured, um (datum: of disc against crank holes in each direction).

    ``datum_um`` acts where the flank's datum is the bore or a best fit: 1 um of it is 9 arcsec for a disc of 64 mm.
    """

    pin_radius_um: float = 0.5
    pin_place_um: float = 1.5
    eccentricity_um: float = 1.0
    hole_um: float = 2.0
    datum_um: float = 2.0


@dataclass(frozen=True, slots=True)
class Reducer:
    """One drive. ``gear`` is the nominal disc with its modification; deviations count from it, + surplus material.

    ``rated_nm`` is the torque of the whole drive. ``datum`` says what the discs' deviations are measured from: asked
    for, never assumed. ``interference_um`` is how much surplus assembly may squeeze. ``input_held`` is what the
    measurement holds: the "sun" of the first stage, as on a customer's bench (without a first stage it is the crank),
    or the "crank", as where the planets are clamped to the housing; all figures are meant so. Raises ModelError
    E-REDUCER-...
    """

    name: str
    gear: CycloidGear
    pins: Pins
    discs: tuple[DiscPlace, ...]
    output: Cranks | OutputPins
    rated_nm: float
    datum: Datum | None = None
    contact: Contact = field(default_factory=Contact)
    first_stage: FirstStage = field(default_factory=FirstStage)
    tolerances: Tolerances = field(default_factory=Tolerances)
    interference_um: float = 3.0
    input_held: InputHeld = "sun"

    def __post_init__(self) -> None:
        _check_pins(self)
        _check_discs(self)
        _check_output(self)
        _check_contact(self)
        _check_input(self)
        if self.datum is not None and self.datum not in DATUMS:
            raise ModelError("E-REDUCER-DATUM", self.name, datum=self.datum, known=", ".join(DATUMS))
        clearance = float(np.min(self.clearance_um(np.linspace(0.0, pi, 181))))
        if clearance < -CLOSED_UM:
            raise ModelError("E-REDUCER-CLEARANCE", self.name, clearance=fixed(clearance, 2))

    @property
    def lever_mm(self) -> float:
        """The largest lever of a contact about the disc's centre, a zc."""
        return self.gear.a * self.gear.zc

    @property
    def sun_to_planet(self) -> float:
        """Teeth of the sun over those of a planet, z1/z2, by the ratio R = 1 + zp z2/z1; 0 without a first stage."""
        ratio = self.first_stage.ratio
        return self.gear.zp / (ratio - 1.0) if ratio else 0.0

    @property
    def followed(self) -> float:
        """What a held sun leaves of an output angle that the held crank would show, zc / (zp + z1/z2); else 1."""
        if not self.first_stage.ratio or self.input_held == "crank":
            return 1.0
        return self.gear.zc / (self.gear.zp + self.sun_to_planet)

    @property
    def rigid(self) -> bool:
        """Whether the output is rigid: the output angle is then the only freedom."""
        return isinstance(self.output, Cranks) and self.output.stiffness_n_mm == inf

    @property
    def mean_clearance_um(self) -> float:
        """Normal gap between perfect pins and nominal disc where the lever is largest (cos phi = K), um."""
        return float(self.clearance_um(np.arccos(self.gear.K)))

    def clearance_um(self, phi: ArrayLike) -> FloatArray:
        """Normal gap between perfect pins and nominal disc at angles phi = zc theta of the profile (n,), um.

        Equidistant modification and thin pins open it by their whole value, a shift by its part along the normal, a
        rotation modification by drot times the lever.
        """
        gear, K, angle = self.gear, self.gear.K, np.asarray(phi, dtype=np.float64)
        root = np.sqrt(1.0 + K * K - 2.0 * K * np.cos(angle))
        shift = (gear.drp - (self.pins.circle_mm - gear.rp)) * (1.0 - K * np.cos(angle)) / root
        turn = gear.drot * self.lever_mm * np.abs(np.sin(angle)) / root
        return mm_to_um(np.asarray(gear.drrp - (self.pins.radius_mm - gear.rrp) - shift + turn))

    def measured_from(self) -> Datum:
        """The datum of deviations. Raises ModelError E-REDUCER-DATUM where nobody has said it."""
        if self.datum is None:
            raise ModelError("E-REDUCER-DATUM", self.name, datum="none", known=", ".join(DATUMS))
        return self.datum

    def with_marks(self, marks: Sequence[int]) -> Reducer:
        """The same drive with its discs built in other tooth positions."""
        places = tuple(replace(d, mark=int(m)) for d, m in zip(self.discs, marks, strict=True))
        return replace(self, discs=places)


def place_at(mark_angle_deg: float, crank_phase_deg: float, zc: int) -> DiscPlace:
    """The disc whose space 0 is at ``mark_angle_deg`` from the carrier's mark. Raises ModelError E-REDUCER-MARK.

    Only zc angles mesh; another one is refused with the nearest that does.
    """
    m = (mark_angle_deg * zc + crank_phase_deg) / 360.0
    nearest = DiscPlace(crank_phase_deg, round(m) % zc)
    if abs(m - round(m)) * 360.0 / zc > MESH_DEG:
        near = (360.0 * round(m) - crank_phase_deg) / zc
        raise ModelError("E-REDUCER-MARK", "disc", angle=digits(mark_angle_deg, 6), nearest=digits(near, 6))
    return nearest


# Sizes as papers give them (no maker's drawings); crank circles, clearances and stiffness are choices, the last one so
# that the drive turns, its sun held, by about what catalogues say: 49, 108 and 980 Nm/arcmin as remembered.
_SHIPPED = {
    "RV-20E-like": ((52.0, 2.25, 0.9, 8.0), 0.004, (2, 28.0, 0.87e5), 167.0, 105.0),
    "RV-40E-like": ((64.0, 3.0, 1.3, 10.0), 0.005, (2, 36.0, 1.06e5), 412.0, 121.0),
    "RV-320E-like": ((114.5, 5.0, 2.2, 20.0), 0.008, (3, 66.0, 2.03e5), 3136.0, 141.0),
}
CRANK_N_MM2 = 1.15e4  # of eccentric bearing, crank and carrier per mm of disc width
SHIPPED = (*_SHIPPED, "cycloid-like")


def shipped(name: str, datum: Datum | None) -> Reducer:
    """A shipped drive by name: two discs at 180 deg on cranks, or "cycloid-like": one disc, output pins.

    Raises ModelError E-REDUCER-NAME for a name that is none of `SHIPPED`.
    """
    if name == "cycloid-like":
        gear = CycloidGear(rp=42.5, rrp=2.5, a=1.3, zp=18, zc=17, b=6.35, drrp=0.005)
        pins = Pins(18, 42.5, 2.5)
        output = OutputPins(number=6, circle_mm=22.0, stiffness_n_mm=1e5)
        return Reducer(name=name, gear=gear, pins=pins, discs=(DiscPlace(),), output=output, rated_nm=17.6, datum=datum)
    if name not in _SHIPPED:
        raise ModelError("E-REDUCER-NAME", "reducer", name=name, known=", ".join(SHIPPED))
    (rp, rrp, a, b), gap, crank, rated, ratio = _SHIPPED[name]
    gear = CycloidGear(rp=rp, rrp=rrp, a=a, zp=40, zc=39, b=b, drrp=gap)
    return Reducer(
        name=name,
        gear=gear,
        pins=Pins(40, rp, rrp),
        discs=(DiscPlace(0.0, 0), DiscPlace(180.0, 1)),
        output=Cranks(*crank),
        rated_nm=rated,
        datum=datum,
        first_stage=FirstStage(ratio),
    )


def for_gear(gear: CycloidGear, datum: Datum | None, *, rated_nm: float | None = None, name: str = "") -> Reducer:
    """A drive of two discs for any gear, its defaults scaled from the 40E-like drive.

    Crank circle 0.56 rp, crank stiffness by width, torque by radius squared and width. A gear without modification
    gets pins thinner by rp / 12 800, for parts without clearance cannot be assembled.
    """
    size, width = gear.rp / 64.0, gear.b / 10.0
    plain = gear.drp == gear.drrp == gear.drot == 0.0
    thin = gear.rp / 12_800.0 if plain else 0.0
    torque = 412.0 * size**2 * width if rated_nm is None else rated_nm
    return Reducer(
        name=name or words("W-REDUCER-NAME", zc=gear.zc),
        gear=gear,
        pins=Pins(gear.zp, gear.rp, gear.rrp - thin),
        discs=(DiscPlace(0.0, 0), DiscPlace(180.0, 1)),
        output=Cranks(2, 0.56 * gear.rp, CRANK_N_MM2 * gear.b),
        rated_nm=torque,
        datum=datum,
    )


def told(drive: Reducer, given: Mapping[str, object]) -> Reducer:
    """A drive on cranks with what a file gives instead, by flat names: marks, crank_phases_deg, pin_circle_mm,
    pin_radius_mm, cranks, crank_circle_mm, crank_stiffness_n_mm, crank_clearance_um, contact_n_mm2, interference_um.

    Raises ModelError E-REDUCER-... for what cannot be built.
    """
    parts = {
        "pins": {"circle_mm": "pin_circle_mm", "radius_mm": "pin_radius_mm"},
        "output": {
            "number": "cranks",
            "circle_mm": "crank_circle_mm",
            "stiffness_n_mm": "crank_stiffness_n_mm",
            "clearance_um": "crank_clearance_um",
        },
        "contact": {"stiffness_n_mm2": "contact_n_mm2"},
    }
    changed: dict[str, object] = {
        part: replace(getattr(drive, part), **{own: given[name] for own, name in names.items() if name in given})
        for part, names in parts.items()
    }
    phases = given.get("crank_phases_deg", tuple(place.crank_phase_deg for place in drive.discs))
    marks = given.get("marks", tuple(range(len(phases))))  # type: ignore[arg-type]
    if len(marks) != len(phases):  # type: ignore[arg-type]
        wanted = len(phases)  # type: ignore[arg-type]
        raise ModelError("E-REDUCER-COUNT", drive.name, key="marks", given=len(marks), wanted=wanted)  # type: ignore[arg-type]
    changed["discs"] = tuple(DiscPlace(p, m) for p, m in zip(phases, marks, strict=True))  # type: ignore[call-overload]
    if "interference_um" in given:
        changed["interference_um"] = given["interference_um"]
    return replace(drive, **changed)  # type: ignore[arg-type]


def _check_pins(drive: Reducer) -> None:
    pins, gear = drive.pins, drive.gear
    if pins.number != gear.zp:
        raise ModelError("E-REDUCER-PINS", drive.name, pins=pins.number, zp=gear.zp, zc=gear.zc)
    for key in ("circle_mm", "radius_mm"):
        _positive(drive, f"pins.{key}", getattr(pins, key))
    for key in ("radius_um", "radial_um", "tangential_um"):
        _many(drive, f"pins.{key}", getattr(pins, key), pins.number)
    if pins.radius_mm >= pins.circle_mm * 0.99 * pi / pins.number:
        raise ModelError("E-REDUCER-VALUE", drive.name, key="pins.radius_mm", value=pins.radius_mm)


def _check_discs(drive: Reducer) -> None:
    if not 1 <= len(drive.discs) <= MOST_DISCS:
        raise ModelError("E-REDUCER-DISCS", drive.name, discs=len(drive.discs), most=MOST_DISCS)
    for place in drive.discs:
        if not isfinite(place.crank_phase_deg) or place.mark != int(place.mark):
            raise ModelError("E-REDUCER-VALUE", drive.name, key="discs", value=place)


def _check_output(drive: Reducer) -> None:
    out, discs = drive.output, len(drive.discs)
    if out.number < 1 or (isinstance(out, OutputPins) and out.number < 2) or out.number != int(out.number):
        raise ModelError("E-REDUCER-VALUE", drive.name, key="output.number", value=out.number)
    _positive(drive, "output.circle_mm", out.circle_mm)
    _positive(drive, "output.clearance_um", out.clearance_um, zero=True)
    if isinstance(out, OutputPins):
        for key in ("stiffness_n_mm", "bearing_n_mm"):
            _positive(drive, f"output.{key}", getattr(out, key))
        _positive(drive, "output.bearing_um", out.bearing_um, zero=True)
    elif not out.stiffness_n_mm > 0.0:
        raise ModelError("E-REDUCER-VALUE", drive.name, key="output.stiffness_n_mm", value=out.stiffness_n_mm)
    errors = [out.hole_um] + ([out.eccentricity_um, out.phase_arcsec] if isinstance(out, Cranks) else [])
    for rows in errors:
        _many(drive, "output errors", rows, discs)
        for row in rows:
            _many(drive, "output errors", row, out.number)
    if drive.rigid and any(errors):
        raise ModelError("E-REDUCER-RIGID", drive.name)


def _check_contact(drive: Reducer) -> None:
    contact = drive.contact
    if contact.law not in ("linear", "line"):
        raise ModelError("E-REDUCER-VALUE", drive.name, key="contact.law", value=contact.law)
    for key in ("stiffness_n_mm2", "limit_mpa"):
        _positive(drive, f"contact.{key}", getattr(contact, key))
    for modulus in contact.moduli_mpa:
        _positive(drive, "contact.moduli_mpa", modulus)
    _positive(drive, "rated_nm", drive.rated_nm)
    _positive(drive, "interference_um", drive.interference_um, zero=True)


def _check_input(drive: Reducer) -> None:
    ratio = drive.first_stage.ratio
    if not isfinite(ratio) or (ratio != 0.0 and ratio <= 1.0):
        raise ModelError("E-REDUCER-VALUE", drive.name, key="first_stage.ratio", value=ratio)
    if drive.input_held not in INPUTS:
        raise ModelError("E-REDUCER-VALUE", drive.name, key="input_held", value=drive.input_held)


def _positive(drive: Reducer, key: str, value: float, *, zero: bool = False) -> None:
    if not isfinite(value) or value < 0.0 or (value == 0.0 and not zero):
        raise ModelError("E-REDUCER-VALUE", drive.name, key=key, value=value)


def _many(drive: Reducer, key: str, values: Sequence[object], count: int) -> None:
    numbers = [v for v in values if isinstance(v, float | int)]
    if len(values) not in (0, count) or not all(isfinite(v) for v in numbers):
        raise ModelError("E-REDUCER-COUNT", drive.name, key=key, given=len(values), wanted=count)


def phase_rad(place: DiscPlace) -> float:
    """The crank phase of a disc, rad."""
    return deg_to_rad(place.crank_phase_deg)


def eccentricity_mm(drive: Reducer, disc: int, crank: int) -> float:
    """The eccentricity of one eccentric with its error, mm."""
    out = drive.output
    error = out.eccentricity_um[disc][crank] if isinstance(out, Cranks) and out.eccentricity_um else 0.0
    return drive.gear.a + um_to_mm(error)
