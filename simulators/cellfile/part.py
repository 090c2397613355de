"""What a cell file says of the work piece, the wheel, the clamping and the gear inspection machine."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from simulators.cellfile.terms import CellSection, Name


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


class Wheel(CellSection):
    """The wheel's seat on its slide, and how its profile comes to its place along its axis.

    ``dresser`` is the letter of the axis that carries the form dresser: moving it while the wheel runs is an alarm.
    ``place`` is the R parameter (R200) from which the dressing program takes the profile's offset in mm for each
    blank, or the letter of an axis that carries the wheel along; or nothing is. ``offset_um`` is the seat's own in
    X, Y, Z; ``tilt_arcsec`` leans the wheel's axis about X and Z; ``radius_um`` is what it is too large. From space
    to space it loses ``wear_um`` of its radius, and its profile moves along its axis by ``wear_side_um`` where it
    wears on one side more than on the other. It is dressed anew for each blank.
    """

    dresser: Literal["Y", ""] = "Y"
    place: str = Field(default="R200", pattern=r"^(?:R\d{1,3}|Y)?$")
    offset_um: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_arcsec: tuple[float, float] = (0.0, 0.0)
    radius_um: float = 0.0
    wear_um: float = 0.0
    wear_side_um: float = 0.0

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
