"""The parts of a reducer as they are: ring of pins, discs with their real flanks, cranks, first stage (mm, rad, N).

A point of a plane is a complex number. Frames: the housing's, with the ring's axis in its zero; the output's, turned by
its angle; a disc's, with its zero in the middle of its crank holes, whose x axis points where the output's does when
nothing errs. A disc's teeth are turned in it by its mark angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from drivers.errors import ConfigError
from simulators.cellfile import Gear
from simulators.grinding import CycloidDisc, WorkPiece

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
UM = 1e-3
POINTS = 384
MESHES = 0.02
"""How far, in pitches, a disc's mark may be from a place in which its teeth meet the pins."""


@dataclass(frozen=True, slots=True)
class Flanks:
    """Normal deviations of a disc (K, T, Z) in um, + surplus, at profile angles ``t_rad`` (T,) ascending.

    Z slices of equal width share the face. ``t_rad`` counts from the bottom of each space, the tips are +-pi/zc.
    """

    t_rad: FloatArray
    deviation_um: FloatArray

    @staticmethod
    def nominal(gear: Gear) -> Flanks:
        """A disc without any error, one slice."""
        return Flanks(np.asarray([-0.5, 0.5]) * np.pi / gear.zc, np.zeros((gear.zc, 2, 1)))

    @staticmethod
    def ground(work: WorkPiece, profile: int = 61, slices: int = 3) -> Flanks:
        """The true flanks of a part that the simulated grinder ground, in its own frame: nobody inspected them."""
        t = work.lobes.even(profile, 0.999)
        z = ((np.arange(slices) + 0.5) / slices - 0.5) * work.spec.gear.b
        return Flanks(t, work.surplus_um(np.arange(float(work.spec.gear.zc)), t, z))


@dataclass(frozen=True, slots=True)
class Disc:
    """One disc: ``phase_rad`` of its eccentrics, ``mark_rad`` where its first space points in its frame, its flanks."""

    flanks: Flanks
    phase_rad: float = 0.0
    mark_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Ring:
    """Pins: centres (zp,) in the housing and radii (zp,), mm."""

    centres: ComplexArray
    radii: FloatArray

    @staticmethod
    def of(gear: Gear, radius_um: ArrayLike = 0.0, place_um: ArrayLike = 0.0, grown_um: float = 0.0) -> Ring:
        """The gear's ring; pins too thick by ``radius_um``, off by ``place_um`` (radial + i along the circle).

        ``grown_um`` is what the ring's radius is larger, by its temperature. Errors are one number or (zp,).
        """
        turn = np.exp(2j * np.pi * np.arange(gear.zp) / gear.zp)
        place = np.asarray(place_um, dtype=np.complex128) + grown_um
        thick = np.broadcast_to(np.asarray(radius_um, dtype=np.float64), gear.zp)
        return Ring((gear.rp + place * UM) * turn, gear.rrp + thick * UM)


@dataclass(frozen=True, slots=True)
class CrankSet:
    """I crankshafts at a radius in the output, an eccentric for each of D discs.

    ``eccentricity_um`` (I, D) is what each is too large, ``phase_arcsec`` (I, D) what it leads. ``seat_um`` (I,)
    complex is where the output's seat is off, ``hole_um`` (I, D) complex the disc's hole, both in their own frame.
    ``clearance_um`` is how far an eccentric moves in its hole until it touches, ``stiffness_n_mm`` of the bearing.
    Rigid and without play where the stiffness is None.
    """

    radius_mm: float
    eccentricity_um: FloatArray
    phase_arcsec: FloatArray
    seat_um: ComplexArray
    hole_um: ComplexArray
    stiffness_n_mm: float | None = None
    clearance_um: float = 0.0

    @staticmethod
    def perfect(
        count: int, discs: int, radius_mm: float, stiffness_n_mm: float | None = None, clearance_um: float = 0.0
    ) -> CrankSet:
        """Cranks without error."""
        zero, seats = np.zeros((count, discs)), np.zeros(count, dtype=np.complex128)
        return CrankSet(
            radius_mm=radius_mm,
            eccentricity_um=zero,
            phase_arcsec=zero,
            seat_um=seats,
            hole_um=zero.astype(np.complex128),
            stiffness_n_mm=stiffness_n_mm,
            clearance_um=clearance_um,
        )

    @property
    def count(self) -> int:
        """How many."""
        return len(self.seat_um)


@dataclass(frozen=True, slots=True)
class FirstStage:
    """Sun and planets: teeth, and how far the planets' angle in the output is off, in arcsec, turn by turn of the sun.

    ``once_arcsec`` comes once a turn of the sun against the output, ``mesh_arcsec`` with each of its teeth.
    """

    sun_teeth: int
    planet_teeth: int
    once_arcsec: float = 0.0
    mesh_arcsec: float = 0.0


@dataclass(frozen=True, slots=True)
class Contact:
    """Pin on flank: force = stiffness x width x depth ** exponent (N, mm); exponent 1 is a linear spring."""

    n_mm_per_mm: float = 2e4
    exponent: float = 1.0


@dataclass(frozen=True, slots=True)
class Reducer:
    """Everything that turns. ``stage`` None: the input turns the cranks themselves, counted in the housing."""

    gear: Gear
    ring: Ring
    discs: tuple[Disc, ...]
    cranks: CrankSet
    contact: Contact = Contact()
    stage: FirstStage | None = None

    def __post_init__(self) -> None:
        """Raises ConfigError (E-BENCH-DISC) for a disc that cannot mesh or whose flanks are of another gear."""
        pitch = 2.0 * np.pi / self.gear.zc
        for number, disc in enumerate(self.discs, 1):
            off = (disc.mark_rad + disc.phase_rad / self.gear.zc) / pitch
            if abs(off - round(off)) > MESHES:
                self._refuse(number, f"its mark is {off - round(off):+.3f} pitches from a place where its teeth fit")
            if disc.flanks.deviation_um.shape[:2] != (self.gear.zc, len(disc.flanks.t_rad)):
                self._refuse(number, f"its flanks have {disc.flanks.deviation_um.shape} points")
            if not np.isfinite(disc.flanks.deviation_um).all():
                self._refuse(number, "a deviation of its flanks is no number")
        if self.cranks.eccentricity_um.shape != (self.cranks.count, len(self.discs)):
            self._refuse(
                len(self.discs), f"the cranks have eccentrics for {self.cranks.eccentricity_um.shape[1]} discs"
            )

    @staticmethod
    def _refuse(number: int, why: str) -> None:
        raise ConfigError("E-BENCH-DISC", "bench", disc=number, why=why)

    @property
    def ratio(self) -> float:
        """Turns of the input in one of the output; negative where they turn against each other."""
        if self.stage is None:
            return -float(self.gear.zc)
        return 1.0 + self.gear.zp * self.stage.planet_teeth / self.stage.sun_teeth

    @property
    def lever_mm(self) -> float:
        """Radius of the disc's rolling circle: the largest lever of a pin's force."""
        return self.gear.a * self.gear.zc


def marks(gear: Gear, phase_rad: float) -> FloatArray:
    """Every mark angle (zc,) with which a disc on eccentrics of this phase fits the pins, rad in 0 .. 2 pi."""
    return np.mod((2.0 * np.pi * np.arange(gear.zc) - phase_rad) / gear.zc, 2.0 * np.pi)


@dataclass(frozen=True, slots=True)
class RealCurve:
    """A disc's real outline, slice by slice, as points (Z, zc * each) in its teeth's frame, round and closed.

    ``hollow`` is how many points on either side of a space's bottom the nominal outline is concave.
    """

    points: ComplexArray
    half: float
    each: int
    t_rad: FloatArray
    hollow: int

    @staticmethod
    def of(gear: Gear, flanks: Flanks, each: int = POINTS) -> RealCurve:
        """``each`` points of a space in equal steps of length; the deviation is smooth between profile points.

        It goes on over each tip from the last profile point of a space to the first one of the next.
        """
        lobes = CycloidDisc(gear)
        t = lobes.even(2 * each + 1, 1.0)[1::2]
        pitch = 2.0 * lobes.half
        spaces = pitch * np.arange(-1, gear.zc + 1)
        nodes = (spaces[:, None] + flanks.t_rad).ravel()
        values = np.concatenate((flanks.deviation_um[-1:], flanks.deviation_um, flanks.deviation_um[:1]))
        smooth = scipy.interpolate.Akima1DInterpolator(nodes, values.reshape(len(nodes), -1), axis=0, method="makima")
        surplus = smooth((spaces[1:-1, None] + t).ravel()) * UM
        point, normal = lobes.profile(t)
        turn = np.exp(1j * spaces[1:-1])
        nominal, outward = ((turn[:, None] * one).ravel() for one in (point, normal))
        hollow = np.flatnonzero(np.diff(np.unwrap(np.angle(normal))) < 0.0)
        across = int(hollow[-1] - hollow[0]) if len(hollow) else 0
        real = (nominal[:, None] + surplus * outward[:, None]).T.copy()
        return RealCurve(points=real, half=lobes.half, each=each, t_rad=t, hollow=across // 2)

    def near(self, angle: FloatArray) -> NDArray[np.int64]:
        """Number of the point whose profile angle is next to an angle about the disc's axis (the pin circle's)."""
        space = np.rint(angle / (2.0 * self.half))
        place = np.searchsorted(self.t_rad, angle - space * 2.0 * self.half)
        return np.asarray(space * self.each + np.clip(place, 0, self.each - 1), dtype=np.int64) % self.points.shape[1]


def have_equal_discs(gear: Gear, flanks: Sequence[Flanks], places: Sequence[int] | None = None) -> tuple[Disc, ...]:
    """Discs on eccentrics spread evenly over a turn; ``places`` chooses each mark among `marks` (None: the first)."""
    phases = 2.0 * np.pi * np.arange(len(flanks)) / len(flanks)
    chosen = places or [0] * len(flanks)
    return tuple(
        Disc(one, float(phase), float(marks(gear, float(phase))[place]))
        for one, phase, place in zip(flanks, phases, chosen, strict=True)
    )
