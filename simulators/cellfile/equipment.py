"""What stands on and beside the machine: work piece, wheel, clamping, inspection machine, instruments and set-ups."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from simulators.cellfile.curves import CellSection, Name, Terms


class Clamping(CellSection):
    """How well a part is clamped: each clamping draws its own place, normal about none, these sizes being k = 2.

    ``eccentric_um`` off the axis along x and along y, ``tilt_arcsec`` out of it about each, ``turned_arcsec`` about it
    (a blank's flanks are left and right of where they should be).
    """

    eccentric_um: float = Field(default=0.0, ge=0)
    tilt_arcsec: float = Field(default=0.0, ge=0)
    turned_arcsec: float = Field(default=0.0, ge=0)


class Gear(CellSection):
    """A cycloid disc in mm: pin circle, pin radius, eccentricity, pins, lobes, face width, modifications.

    ``drp`` and ``drrp`` change pin circle and pin radius, ``drot`` (rad) turns each flank by its own side.
    """

    rp: float = Field(gt=0)
    rrp: float = Field(gt=0)
    a: float = Field(gt=0)
    zp: int = Field(ge=4, le=1000)
    zc: int = Field(ge=3, le=1000)
    b: float = Field(default=10.0, gt=0)
    drp: float = 0.0
    drrp: float = 0.0
    drot: float = 0.0

    @model_validator(mode="after")
    def _lobed(self) -> Gear:
        if self.zp != self.zc + 1 or self.a * self.zp >= self.rp + self.drp:
            raise ValueError("zp must be zc + 1 and a * zp smaller than the pin circle")
        return self


class GrindingSection(CellSection):
    """How the part is ground: ``centre_distance_mm`` from gear axis to wheel axis, and where it sits.

    ``height_mm`` is the middle of the face width above the table's origin, ``stock_um`` what the blank has
    too much along each normal.
    """

    centre_distance_mm: float = Field(gt=0)
    height_mm: float = 0.0
    stock_um: float = Field(default=40.0, ge=0)


class Part(CellSection):
    """The work piece."""

    name: Name = "part"
    gear: Gear
    grinding: GrindingSection
    clamping: Clamping = Clamping()
    expansion_ppm_per_k: float = 11.5


class WheelWave(CellSection):
    """A wave of the dressed profile along each flank's length: so many ``waves`` from bottom to tip.

    ``left_um`` and ``right_um`` are the amplitudes on the flanks at y > 0 and y < 0, + = material left on the part.
    """

    waves: float = Field(gt=0, le=20)
    left_um: float = 0.0
    right_um: float = 0.0


class Wheel(CellSection):
    """The wheel's seat on its slide, and how its profile comes to its place along its axis.

    ``dresser`` is the letter of the axis that carries the form dresser: moving it while the wheel runs is an alarm.
    ``place`` is the R parameter (R200) from which the dressing program takes the profile's offset in mm for each
    blank, or the letter of an axis that carries the wheel along; or nothing is. ``offset_um`` is the seat's own in
    X, Y, Z; ``tilt_arcsec`` leans the wheel's axis about X and Z; ``radius_um`` is what it is too large. From space
    to space it loses ``wear_um`` of its radius, and its profile moves along its axis by ``wear_side_um`` where it
    wears on one side more than on the other. It is dressed anew for each blank, or for every ``dress_every``-th.

    A dressing takes ``dressing_depth_um`` off, and so much of the wear. ``form`` is what the dressed profile differs
    by, alike after each dressing. The diamond is smaller than its dresser believes by ``diamond_um``, and by
    ``diamond_wear_um`` more after each dressing: the wheel is too large by that along its normal. A correction that a
    person gives the dresser means a larger wheel where ``table_sign`` is 1, and its places count along the wheel's
    axis where ``table_axial`` is 1, else the other way.

    A cycle of the builder's roughs with a wheel of its own: ``rough_radius_um`` too large, of form ``rough_form``.
    """

    dresser: Literal["Y", ""] = "Y"
    place: str = Field(default="R200", pattern=r"^(?:R\d{1,3}|Y)?$")
    offset_um: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_arcsec: tuple[float, float] = (0.0, 0.0)
    radius_um: float = 0.0
    wear_um: float = 0.0
    wear_side_um: float = 0.0
    form: tuple[WheelWave, ...] = ()
    diamond_um: float = 0.0
    diamond_wear_um: float = Field(default=0.0, ge=0)
    dressing_depth_um: float = Field(default=20.0, ge=0)
    dress_every: int = Field(default=1, ge=1)
    table_sign: Literal[1, -1] = 1
    table_axial: Literal[1, -1] = 1
    rough_radius_um: float = Field(default=-8.0, le=0.0)
    rough_form: tuple[WheelWave, ...] = (WheelWave(waves=2.0, left_um=6.0, right_um=-5.0),)

    @property
    def roughing(self) -> Wheel:
        """The roughing wheel: it is never redressed and does not wear."""
        own = {"radius_um": self.rough_radius_um, "form": self.rough_form, "wear_um": 0.0, "wear_side_um": 0.0}
        return self.model_copy(update={**own, "diamond_um": 0.0, "diamond_wear_um": 0.0})

    @property
    def parameter(self) -> int | None:
        """Number of the R parameter that the dressing program reads."""
        return int(self.place[1:]) if self.place.startswith("R") else None

    @model_validator(mode="after")
    def _own_axis(self) -> Wheel:
        if self.place and self.place == self.dresser:
            raise ValueError("the axis that carries the dresser does not carry the wheel")
        return self


class InspectionMachine(CellSection):
    """A gear inspection machine behind a bridge: its own clamping, probe noise in um, and what it does wrong.

    ``wrong_part`` measures another part, ``wrong_spaces`` finds that many spaces more, ``glitches`` readings of
    one part are off by ``glitch_um``.
    """

    kind: Literal["gear"]
    name: Name
    serial: str = "GMM-0001"
    model: str = "gear inspection machine (simulated)"
    deviations: bool = Field(default=False, description="gives nominal points with deviations, not measured points")
    noise_um: float = Field(default=0.2, ge=0)
    clamping: Clamping = Clamping(eccentric_um=0.5, turned_arcsec=30.0)
    seconds_per_point: float = Field(default=0.05, ge=0)
    wrong_part: bool = False
    wrong_spaces: int = Field(default=0, ge=-1000, le=1000)
    glitches: int = Field(default=0, ge=0, le=10_000)
    glitch_um: float = 25.0
    settings: dict[str, Any] = Field(default_factory=dict)


# Instruments: what they are, how they err, and how each is mounted for a component.


class Outliers(CellSection):
    """Readings that are off for one whole stop: ``count`` of them in each ``every`` stops."""

    count: int = Field(default=0, ge=0, le=10_000)
    size: float = 0.0
    every: int = Field(default=0, ge=0, le=1_000_000, description="0: the stops of one run of the axis")


class Noise(CellSection):
    """Noise of an instrument in um or arcsec: per stop (what averaging cannot remove) and per sample."""

    stop: float = Field(default=0.0, ge=0)
    stop_s: float = Field(
        default=0.0,
        ge=0,
        le=86_400.0,
        description="seconds at rest after which the noise of the stop is another (air that moves); 0: one a stop",
    )
    sample: float = Field(default=0.0, ge=0)
    drift_per_h: float = 0.0
    outliers: Outliers = Outliers()

    @model_validator(mode="after")
    def _changing(self) -> Noise:
        if self.stop_s and not self.stop:
            raise ValueError("stop_s says how long the noise `stop` lasts: give stop too, or leave stop_s out")
        return self


class Laser(CellSection):
    """A laser on a uMD counter: quadrature counts of wavelength / 2 / counts_per_cycle."""

    kind: Literal["umd"]
    name: Name
    serial: str = "uMD2-0001"
    firmware: float = 1.26
    sample_hz: float = Field(default=1000.0, gt=0, le=1e6)
    counts_per_cycle: int = Field(default=16, gt=0, le=1_000_000)
    wavelength_nm: float = Field(default=632.990577, gt=0)
    sense: Literal["seed", 1, -1] = "seed"
    noise: Noise = Noise()
    settings: dict[str, Any] = Field(default_factory=dict)


class Calibrator(CellSection):
    """A self-turning rotary calibrator with its angular interferometer (XR20-W principle).

    ``own_error`` is the device encoder's error in arcsec over its own angle; ``retro_spacing_mm`` the S it
    was made with, ``spacing_error`` the relative error of the S it calculates with.
    """

    kind: Literal["bridge"]
    name: Name
    serial: str = "XR-0001"
    model: str = "XR20-W (simulated)"
    sample_hz: float = Field(default=100.0, gt=0, le=1e6)
    sense: Literal["seed", 1, -1] = "seed"
    own_error: Terms = ()
    retro_spacing_mm: float = Field(default=30.0, gt=0)
    spacing_error: float = 0.0
    range_deg: float = Field(default=10.0, gt=0)
    turn_deg_per_s: float = Field(default=25.0, gt=0)
    remainder_deg: float = Field(default=0.05, ge=0)
    noise: Noise = Noise()
    settings: dict[str, Any] = Field(default_factory=dict)


class Sensor(CellSection):
    """A straightness instrument (um across the path) or an angle instrument (arcsec), behind a bridge.

    ``own_error`` is that of its optics over the position of the axis, in um or arcsec; ``zero`` its greatest
    reading at the datum of a mounting, drawn anew for each; ``range`` the largest reading with light.

    ``probes`` are letters along or about which one head reads at once ("X", "Y", "Z" at a ball), each as a channel of
    its own and for the component of that letter; none: one channel for the component that is mounted.
    ``cross_talk`` adds to each probe so much of every other.
    """

    kind: Literal["straightness", "angle"]
    probes: tuple[Literal["X", "Y", "Z", "A", "B", "C"], ...] = ()
    cross_talk: float = 0.0
    name: Name
    serial: str = "ST-0001"
    model: str = "optics (simulated)"
    sample_hz: float = Field(default=50.0, gt=0, le=1e6)
    own_error: Terms = ()
    zero: float = Field(default=20.0, ge=0)
    range: float = Field(default=2500.0, gt=0)
    certified_u: float | None = Field(default=None, ge=0, description="U (k = 2) of its certificate, in its unit")
    noise: Noise = Noise()
    settings: dict[str, Any] = Field(default_factory=dict)


Instrument = Annotated[Laser | Calibrator | Sensor | InspectionMachine, Field(discriminator="kind")]
COMPONENT = r"^(?:E[XYZABC][XYZC]|[XYZABC]0[XZC])(?:-R)?$"


class Setup(CellSection):
    """How an instrument is mounted for one component of one axis.

    ``offset_mm`` is where the reflector's centre sits from the functional point of its carrier;
    ``misalign_mrad`` tilts the beam about two axes across it; ``dead_path_mm`` is the beam's length at
    ``datum`` (axis position); ``away`` is -1 when the beam gets shorter with + motion. A calibrator may
    sit ``eccentric_mm`` off the axis and ``tilt_mrad`` out of it; so may a ball or a test bar in the table.
    ``own_angle_arcsec`` is what a square has more than 90 deg; a component that ends in -R is measured with the
    square turned over about its Z arm. ``zero_um`` is the error of the gauge that sets a ball's zero. ``reversed``
    optics or indicators face the wrong way: everything across the travel and every angle is read with the other sign.
    ``plan`` are more keys of this set-up in the site file: targets, repetitions and the like.
    """

    component: str = Field(pattern=COMPONENT)
    axis: Literal["X", "Y", "Z", "C"]
    instrument: str
    optics: Literal["linear", "angular", "rotary", "straightness", "level", "square", "ball", "bar"]
    carrier: Literal["X", "Z", "C"] | None = None
    head: Literal["bed", "X", "Z"] = "bed"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    misalign_mrad: tuple[float, float] = (0.0, 0.0)
    dead_path_mm: float = Field(default=0.0, ge=0)
    datum: float = 0.0
    away: Literal[1, -1] = 1
    retro_spacing_mm: float = Field(default=30.0, gt=0)
    eccentric_mm: float = 0.0
    tilt_mrad: float = 0.0
    own_angle_arcsec: float = 0.0
    zero_um: float = 0.0
    reversed: bool = False
    plan: dict[str, Any] = Field(default_factory=dict)
