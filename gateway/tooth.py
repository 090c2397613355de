"""Frozen records of the tooth in a run: set-up values, parts ground, flanks inspected, what was predicted of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.units import DeviationUnit, arcsec_to_deg, arcsec_to_rad, mm_to_um, rad_to_arcsec, um_to_mm

FloatArray = NDArray[np.float64]


WORTH_ARCSEC = 0.1  # of transmission error: what costs less is not worth a set-up


@dataclass(frozen=True, slots=True)
class SetupValues:
    """What is set by hand and enters no table, added to the grinding program's places: um, arcsec, um.

    ``x`` and ``c`` move the work offsets of infeed and index, ``dressing`` the profile along the wheel's axis. Solvers
    and programs count in mm, rad and deg: what they need is read here and nowhere else.
    """

    x_um: float = 0.0
    c_arcsec: float = 0.0
    dressing_um: float = 0.0

    @classmethod
    def of(cls, *, x_mm: float = 0.0, c_rad: float = 0.0, dressing_mm: float = 0.0) -> SetupValues:
        """From what a solver found."""
        return cls(x_um=mm_to_um(x_mm), c_arcsec=rad_to_arcsec(c_rad), dressing_um=mm_to_um(dressing_mm))

    @property
    def x_mm(self) -> float:
        """Infeed."""
        return um_to_mm(self.x_um)

    @property
    def c_rad(self) -> float:
        """Index."""
        return arcsec_to_rad(self.c_arcsec)

    @property
    def c_deg(self) -> float:
        """Index."""
        return arcsec_to_deg(self.c_arcsec)

    @property
    def dressing_mm(self) -> float:
        """Profile along the wheel's axis."""
        return um_to_mm(self.dressing_um)

    def rounded(self) -> SetupValues:
        """To six decimals, which is how they are stored."""
        return SetupValues(round(self.x_um, 6), round(self.c_arcsec, 6), round(self.dressing_um, 6))

    def plus(self, other: SetupValues) -> SetupValues:
        """Both together."""
        x_um, dressing_um = self.x_um + other.x_um, self.dressing_um + other.dressing_um
        return SetupValues(x_um, self.c_arcsec + other.c_arcsec, dressing_um).rounded()

    def less(self, other: SetupValues) -> SetupValues:
        """The difference."""
        return self.plus(SetupValues(-other.x_um, -other.c_arcsec, -other.dressing_um))


@dataclass(frozen=True, slots=True)
class FlankMap:
    """Normal deviations (K, T, Z) in um, + surplus material, one rotation of the gear removed.

    ``theta_rad`` (T,) are profile angles of both flanks, ascending, ``z_mm`` (Z,) heights from the middle of the face;
    the K spaces are all of the gear, in order.
    """

    theta_rad: FloatArray
    z_mm: FloatArray
    deviation_um: FloatArray

    @property
    def rms_um(self) -> float:
        """RMS over all points."""
        return float(np.sqrt(np.mean(self.deviation_um**2)))

    @property
    def largest_um(self) -> float:
        """Largest deviation to either side."""
        return float(np.max(np.abs(self.deviation_um)))


@dataclass(frozen=True, slots=True)
class GroundPart:
    """One test part ground through the control: its name in the run, the set-up values, spaces, when, and at what.

    ``live`` are the digests of the tables that acted, by machine axis; ``material_degc`` where somebody measured it.
    """

    part: str
    setup: SetupValues
    spaces: int
    started_utc: str
    ended_utc: str
    live: Mapping[str, str] = field(default_factory=dict)
    material_degc: float | None = None


@dataclass(frozen=True, slots=True)
class BuilderCycle:
    """The builder's program that grinds the parts of a run in place of ours."""

    program: str


@dataclass(frozen=True, slots=True)
class InspectedFlank:
    """What an inspection tells of one part's flanks; points (N,) as measured, ``fitted`` as A, B, G at each place.

    ``k`` spaces, ``theta_rad`` profile angles, ``z_mm`` heights from the middle of the face, ``deviation_um`` normal
    deviations, + surplus; ``u_um`` is the standard uncertainty of one point. ``abg`` (G, 3) in um, um, arcsec at places
    ``place_k``, ``place_z_mm`` (G,), with standard uncertainties ``abg_u``. ``fitted`` is the flank these make on the
    judged grid. ``rms_u_um`` says how far the fitted flank may lie from the true one (RMS): probe and clamping.
    ``turned_arcsec`` is the one rotation that was removed from it. ``figures`` are profile, lead, pitch and runout by
    name in um.
    """

    part: str
    source: str
    serial: str
    k: FloatArray
    theta_rad: FloatArray
    z_mm: FloatArray
    deviation_um: FloatArray
    u_um: float
    place_k: FloatArray
    place_z_mm: FloatArray
    abg: FloatArray
    abg_u: FloatArray
    fitted: FlankMap
    rms_u_um: float
    figures: Mapping[str, float] = field(default_factory=dict)
    said: tuple[Message, ...] = ()
    measured_utc: str = ""
    turned_arcsec: float = 0.0


@dataclass(frozen=True, slots=True)
class FlankPrediction:
    """The flank by the model: maps as it is, with axis tables alone, with everything; and how sure that is.

    ``floor_um`` is the RMS that the tables and set-up values leave at best on the fitted machine. ``u_um`` is the
    standard uncertainty of the flank: the root mean square over its points of how far it may lie from ``after``.
    ``u_point_um`` (K, T, Z) is that point by point; ``rms_um`` and ``rms_u_um`` mean and standard deviation of the RMS
    that is to be expected, by Monte Carlo. ``parts_um`` splits ``u_um`` by error (RMS each).
    """

    before: FlankMap
    with_own: FlankMap
    after: FlankMap
    floor_um: float
    u_um: float
    u_point_um: FloatArray
    rms_um: float
    rms_u_um: float
    parts_um: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CureRecord:
    """One error on the tooth: RMS alone in um, what cures it, and what is left by everything possible, um."""

    error: str
    rms_um: float
    by: str
    floor_um: float


@dataclass(frozen=True, slots=True)
class RankRecord:
    """One error's place in the Morris ranking of the flank RMS: mu* in um with its interval, and its rank's.

    ``sigma_um`` is the spread of its effects: large beside mu* where it acts through others; None in older records.
    """

    error: str
    mu_star_um: float
    low_um: float
    high_um: float
    rank: tuple[int, int]
    sigma_um: float | None = None


@dataclass(frozen=True, slots=True)
class AxisOutlook:
    """How an axis will deviate with every table acting, cross tables too, which spoil it on purpose for the tooth.

    ``deviation`` (m,) is expected at ``targets`` while the other axes stand, ``U`` its expanded uncertainty (k = 2),
    in um or arcsec; ``M`` its range, ``M_U`` of that, ``M_alone`` the range with the axis' own table alone.
    ``moved_by`` is how far the whole axis moves where another axis, by its name, goes through its table.
    """

    axis: str
    unit: DeviationUnit
    targets: FloatArray
    deviation: FloatArray
    U: FloatArray
    M: float
    M_U: float
    M_alone: float
    moved_by: Mapping[str, float]

    @property
    def spoilt(self) -> bool:
        """Whether a cross table over the axis itself changes its curve."""
        return self.M_alone != self.M


@dataclass(frozen=True, slots=True)
class GoalRow:
    """One way to correct a machine by its name, and what flank (RMS, um) and drive (arcsec) are then: full model."""

    name: str
    flank_um: float
    transmission_arcsec: float
    lost_motion_arcsec: float


@dataclass(frozen=True, slots=True)
class DriveLimit:
    """A limit of a drive's figure with its verdict: expected value, U (k = 2), limit, arcsec."""

    name: str
    value_arcsec: float
    U_arcsec: float
    limit_arcsec: float
    verdict: Literal["pass", "fail", "not decidable"]


@dataclass(frozen=True, slots=True)
class DriveDoubt:
    """What not knowing one error costs in the drive: transmission error p-p of one standard uncertainty, arcsec.

    First order; ``measured`` says whether the error was measured.
    """

    error: str
    cost_arcsec: float
    measured: bool


def next_for_drive(doubts: Sequence[DriveDoubt]) -> DriveDoubt | None:
    """The unmeasured error that costs most in the drive; None where none costs as much as `WORTH_ARCSEC`."""
    left = [one for one in doubts if not one.measured and one.cost_arcsec >= WORTH_ARCSEC]
    return left[0] if left else None


@dataclass(frozen=True, slots=True)
class DriveForecast:
    """A drive before any control is asked: figures as it is, with axis tables and with everything; full model."""

    reducer: str
    datum: str
    rows: tuple[GoalRow, ...]
    doubts: tuple[DriveDoubt, ...] = ()


@dataclass(frozen=True, slots=True)
class DriveProposal:
    """The drive that discs of the corrected machine will make, predicted and not tested; without friction.

    ``rows`` say what each goal costs in the other. Expected transmission error (p-p) and lost motion with standard
    uncertainty from that many trials; ``limits`` with their verdicts; ``doubts`` by error, the costliest first.
    """

    reducer: str
    datum: str
    goal: str
    rows: tuple[GoalRow, ...]
    transmission_arcsec: float
    transmission_u_arcsec: float
    lost_motion_arcsec: float
    lost_motion_u_arcsec: float
    trials: int
    limits: tuple[DriveLimit, ...] = ()
    doubts: tuple[DriveDoubt, ...] = ()


@dataclass(frozen=True, slots=True)
class ToothProposal:
    """What a run proposes for the tooth beside the tables: set-up values, and what everything together will do.

    ``eccentricity_um`` (x, y) and ``tilt_arcsec`` (a, b) say how the work should be moved on its table, where that
    would help. ``b_left`` is the share of B that nothing can cure on this gear. ``axes`` are how the
    axes will deviate with everything acting. ``background`` are those of ``said`` that ask nothing of anybody.
    ``drive`` where the site has a goal for the gear.
    """

    setup: SetupValues
    prediction: FlankPrediction
    cures: tuple[CureRecord, ...] = ()
    ranking: tuple[RankRecord, ...] = ()
    b_left: float = 0.0
    eccentricity_um: tuple[float, float] = (0.0, 0.0)
    tilt_arcsec: tuple[float, float] = (0.0, 0.0)
    said: tuple[Message, ...] = ()
    axes: tuple[AxisOutlook, ...] = ()
    background: tuple[Message, ...] = ()
    drive: DriveProposal | None = None


@dataclass(frozen=True, slots=True)
class Explanation:
    """One error of the model that alone explains how a part differs: ``factor`` times what it does to the flank.

    ``how``: "reversed" is its sign (factor -2), "absent" an error the part does not have (-1), "factor" another size,
    known to ``u``. ``left_um`` is the RMS of the difference that it leaves.
    """

    error: str
    how: Literal["reversed", "absent", "factor"]
    factor: float
    u: float
    left_um: float


@dataclass(frozen=True, slots=True)
class FlankAgreement:
    """A part inspected before anything was written against the flank by the model, RMS in um of what a part shares.

    ``missed_um`` is the difference, ``u_um`` its standard uncertainty, ``part_um`` and ``model_um`` both flanks.
    ``explanations`` are the single errors that explain the difference best, the best one first; more than one where
    they cannot be told apart, none where none explains it.
    """

    part: str
    missed_um: float
    u_um: float
    part_um: float
    model_um: float
    explanations: tuple[Explanation, ...] = ()

    @property
    def ratio(self) -> float:
        """The difference in standard uncertainties."""
        return self.missed_um / self.u_um

    @property
    def outcome(self) -> Literal["agrees", "look", "apart"]:
        """Beyond 3 u no table is proposed; beyond 2 u, or where a reversed sign is likely, somebody looks again."""
        if self.ratio > 3.0:
            return "apart"
        reversed_ = any(one.how == "reversed" for one in self.explanations)
        return "look" if self.ratio > 2.0 or reversed_ else "agrees"


@dataclass(frozen=True, slots=True)
class GearProposal:
    """What an inspected part alone asks for beside the tables: set-up values to add, and what the flank will be then.

    ``before`` is the part as inspected, ``after`` with the tables and set-up values proposed and the work centred;
    ``u_um`` how far the flank may lie from it (RMS). ``eccentricity_um`` (x, y) and ``tilt_arcsec`` (a, b) are how
    the work sat off its axis, where it was ground or measured: taken off, for it changes at each clamping.
    """

    part: str
    setup: SetupValues
    before: FlankMap
    after: FlankMap
    u_um: float
    eccentricity_um: tuple[float, float] = (0.0, 0.0)
    tilt_arcsec: tuple[float, float] = (0.0, 0.0)
    said: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class ToothVerdict:
    """The flank before and after, in um: as ground, and before with its set-up values put right, which is the fair one.

    ``within_prediction`` says whether the flank after lies where it was predicted, within its uncertainty (k = 2).
    ``before_anew_um`` is the flank before as ground anew with its set-up values right, without the curvature of how far
    off it was ground either: ``change_um`` counts from there, with U (k = 2) of the change. ``clear`` figures are
    without what an eccentric clamping can make. The trial part's are None where there was none. ``taken_back`` says of
    each table that the run put back what acted before, because the flank became worse.
    """

    before_um: float
    before_set_right_um: float
    after_um: float
    predicted_um: float
    u_um: float
    within_prediction: bool
    outcome: Literal["better", "unchanged", "worse", "not-pushed"]
    words: tuple[Message, ...]
    before_anew_um: float | None = None
    change_um: float | None = None
    change_U_um: float | None = None
    before_clear_um: float | None = None
    after_clear_um: float | None = None
    clear_U_um: float | None = None
    trial_um: float | None = None
    trial_clear_um: float | None = None
    taken_back: tuple[Message, ...] = ()
