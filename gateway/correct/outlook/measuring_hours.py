"""What set-ups would tell of a machine's errors and what that is worth to flank, drive or axis: for `plan_hours`.

Shapes. What the model of a run says of its own doubts (`doubts`): for a measured error the covariance of its fit and
what repetition does not show, for one that nobody measured its assumed span as first and second order over the travel
or two waves of the turn. An error that nobody measured also has shorter waves, by a size that falls with the square of
their order: without them two targets would do for any guide.

Designs. A set-up of E(k) reads at q the shapes of its own error, an angle times its lever where its line stands off
the functional one, and what is no error of the machine: its datum; an eccentric ball, which makes u cos q - v sin q of
EXC and u sin q + v cos q of EYC (a leaning bar so of EAC and EBC); the instrument's own smooth error. A square reads
slopes: tau on X, B0Z - tau on Z, plus its own angle, which changes its sign when the square is turned over. A bar on Z
reads lean + nu at 0 deg of C and lean - nu at 180 deg, nu its own lean; the lean of C against Z is B0C - B0Z with what
X and C, where they stand, tilt the table (A0C likewise).

Goals. Flank: A, B, G of each shape at every wheel place, less what x zero, dressing offset and C zero will take from an
inspected part; only what cross tables follow counts, for measuring the rest changes no table - unless a tolerance is to
be proved, which needs all of it. Drive: transmission error about the mean drive. Axis: its own positioning over its
table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, deg_to_rad, mm_to_um, rad_to_arcsec
from gateway.correct.flank.flank_model import flank_model
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.flank.noise import Shape
from gateway.correct.outlook.drive_outlook import transmission_rows
from gateway.correct.outlook.flank_uncertainty import (
    PROFILE,
    WHOLE_TURN,
    WIDTH,
    FlankDoubts,
    ToothSpec,
    between_targets,
    column_doubts,
    doubts,
)
from gateway.correct.outlook.prediction import less, rows_of, setup_effects, without_setup
from gateway.correct.plan.plan import AxisGrid, Plan, cross_specs, setup_unknowns
from gateway.domain.values import component_unit
from gateway.errors import ModelError
from gateway.evaluate.geometry.measurement import arms
from gateway.gear.first_order import ErrorParameter, flank_abg
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain
from gateway.model.error_model import ErrorModel, chain_of_errors, in_mm_rad
from gateway.model.motion import travel_of
from gateway.reducer.records import Reducer
from gateway.sensitivity.planning import Candidate, Choice, Knowledge

GoalName = Literal["flank", "drive", "axis"]
HIGHEST = {"linear": 8, "rotary": 8}
"""Of the shapes that an error nobody measured may have: order of a Legendre polynomial, waves of a turn."""
DATUM = {"um": 0.1, "arcsec": 1e-3}
"""How far a zero or an artefact may be off, mm or rad: more than any set-up leaves."""
ACROSS, TOP = 41, 2
WIDEST = (-1e6, 1e6)
SEEN = 1e-6
"""Of what the goal sees most: directions that it sees less are left out."""
SCATTER = 0.15
"""Standard deviation of one reading, um or arcsec: what a steady bench shows; the fit tells what it really was."""
ORIENTED = {"EXC": (("XY", 0, 1.0), ("XY", 1, -1.0)), "EYC": (("XY", 1, 1.0), ("XY", 0, 1.0))}
ORIENTED |= {"EAC": (("AB", 0, 1.0), ("AB", 1, -1.0)), "EBC": (("AB", 1, 1.0), ("AB", 0, 1.0))}
"""By error: what cos q and sin q are multiplied with, as (artefact, its coordinate, sign): `_artefact`."""
PAIRED = (("EXC", "EYC"), ("EAC", "EBC"))


@dataclass(frozen=True, slots=True)
class Way:
    """One way to measure a set-up: its targets (m,) in mm or deg, repetitions (each both ways), and its hours."""

    targets: FloatArray
    repetitions: int
    hours: float


@dataclass(frozen=True, slots=True)
class SetupReadings:
    """A set-up that may be measured. ``component`` may end in -R; ``letter`` is that of the axis that moves.

    ``systematic`` is the standard uncertainty that repetition does not show, ``scatter`` the standard deviation of one
    reading (um or arcsec); ``stands`` where other axes stand, by letter (mm or deg); ``own_angle``: whether that of the
    square is known. ``mount`` is one for set-ups that one mounting reads.
    """

    key: str
    component: str
    letter: str
    rotary: bool
    ways: tuple[Way, ...]
    offset_mm: tuple[float, float, float] | None = None
    systematic: float = 0.0
    scatter: float = SCATTER
    stands: Mapping[str, float] = field(default_factory=dict)
    own_angle: bool = False
    mount: str = ""

    @property
    def name(self) -> str:
        """The error without the mark of a turned artefact."""
        return self.component.removesuffix("-R")


@dataclass(frozen=True)
class HourGoal:
    """What counts: the flank of a work, its drive as well where ``drive`` is there, or an axis by its letter."""

    kind: GoalName
    tooth: ToothSpec | None = None
    drive: Reducer | None = None
    axis: str = ""

    @property
    def unit(self) -> str:
        """Of its u and tolerance."""
        angular = self.kind == "drive" or (self.kind == "axis" and self.axis in "ABC")
        return "arcsec" if angular else "um"


@dataclass(frozen=True)
class PlanningTask:
    """What is known, what may be measured, and which set-ups are tried together."""

    known: Knowledge
    candidates: tuple[Candidate, ...]
    bundles: tuple[tuple[str, ...], ...]


def planning_task(
    model: ErrorModel,
    setups: Sequence[SetupReadings],
    goal: HourGoal,
    grids: Sequence[AxisGrid],
    *,
    proof: bool = False,
) -> PlanningTask:
    """Goal, knowledge and set-ups as matrices. ``proof``: what no table follows counts as well.

    Raises ModelError (E-PLAN-GOAL) for a goal without its work, drive or axis, and what the gear's model raises.
    """
    height = goal.tooth.height_mm if goal.tooth is not None else 0.0
    chain = chain_of_errors(model, height_mm=height)
    plan = Plan(tuple(grids))
    columns = [*doubts(model, chain, plan), *_short_waves(model, chain, plan)]
    rows, nominal = _goal_rows(model, goal, chain, plan, columns, proof=proof)
    nuisances = _Nuisances(len(columns))
    groups: dict[str, list[SetupReadings]] = {}
    for one in setups:
        groups.setdefault(one.mount or one.key, []).append(one)
    made = [(key, _choices(columns, group, nuisances)) for key, group in groups.items()]
    width = len(columns) + nuisances.count
    wide = np.zeros((rows.shape[0], width))
    wide[:, : len(columns)] = rows
    candidates = tuple(Candidate(key, tuple(_filled(one, width) for one in choices)) for key, choices in made)
    return PlanningTask(Knowledge.before(wide, nominal), candidates, _bundles(groups))


def _bundles(groups: Mapping[str, Sequence[SetupReadings]]) -> tuple[tuple[str, ...], ...]:
    """All set-ups of one location, and those that read one artefact around C along two directions."""
    found: dict[str, list[str]] = {}
    for key, members in groups.items():
        for one in members:
            pair = next(("+".join(pair) for pair in PAIRED if one.name in pair), "")
            for label in filter(None, (one.name if one.name[1] == "0" else "", pair)):
                if key not in found.setdefault(label, []):
                    found[label].append(key)
    return tuple(tuple(keys) for keys in found.values() if len(keys) > 1)


# ---- shapes


def _short_waves(model: ErrorModel, chain: Chain, plan: Plan) -> list[tuple[ErrorParameter | str, float]]:
    """The shorter waves of errors that nobody measured, columns of one standard deviation, mm or rad."""
    travels = {one.axis: (one.minimum, one.maximum) for one in plan.grids}
    found: list[tuple[ErrorParameter | str, float]] = []
    for gap in model.unknown:
        if not gap.name.startswith("E"):
            continue
        axis, _ = chain.error_place(gap.name)
        turning = chain.axis(axis).kind == "revolute"
        if not turning and axis not in travels:
            continue
        size = in_mm_rad(component_unit(gap.name, "mm"), gap.u) / (4.0 if turning else 2.0) ** 0.5
        low, high = WHOLE_TURN if turning else travels[axis]
        for order in range(TOP + 1, HIGHEST["rotary" if turning else "linear"] + 1):
            for number in (2 * order - 1, 2 * order) if turning else (order,):
                shape = Shape(number, low, high, turning)
                found.append((ErrorParameter(gap.name, shape), size * (TOP / order) ** 2))
    return found


def _name(parameter: ErrorParameter | str) -> str:
    return parameter if isinstance(parameter, str) else parameter.source


def _values(parameter: ErrorParameter | str, at: FloatArray) -> FloatArray:
    """A shape at positions of its axis, mm or rad; beyond where a fit is known its last value, as a table holds it."""
    basis = None if isinstance(parameter, str) else parameter.basis
    if basis is None:
        return np.ones_like(at)
    low, high = travel_of(basis, *WIDEST)
    return np.asarray(basis(np.clip(at, low, high)))


# ---- designs


class _Nuisances:
    """Columns beyond the errors, given out by name as set-ups ask for them."""

    def __init__(self, first: int) -> None:
        self._first = first
        self._places: dict[str, int] = {}

    @property
    def count(self) -> int:
        return len(self._places)

    def place(self, name: str) -> int:
        return self._places.setdefault(name, self._first + len(self._places))


@dataclass
class _Design:
    """Rows of one way of a set-up: dense for the errors, by place for the nuisances; mm or rad."""

    errors: FloatArray
    nuisances: list[tuple[int, FloatArray]]
    u: FloatArray
    hours: float
    targets: int
    repetitions: int


def _choices(
    columns: Sequence[tuple[ErrorParameter | str, float]],
    group: Sequence[SetupReadings],
    nuisances: _Nuisances,
) -> list[_Design]:
    """Every way in which one mounting may be read; its set-ups have as many ways each."""
    found = []
    for n in range(len(group[0].ways)):
        parts = [_one_way(columns, one, one.ways[n], nuisances) for one in group]
        ends = np.cumsum([0, *(part.u.size for part in parts)])
        placed = []
        for part, first in zip(parts, ends, strict=False):
            for place, values in part.nuisances:
                column = np.zeros(int(ends[-1]))
                column[first : first + values.size] = values
                placed.append((place, column))
        found.append(
            _Design(
                np.concatenate([part.errors for part in parts]),
                placed,
                np.concatenate([part.u for part in parts]),
                group[0].ways[n].hours,
                parts[0].targets,
                parts[0].repetitions,
            )
        )
    return found


def _filled(made: _Design, width: int) -> Choice:
    design = np.zeros((made.u.size, width))
    design[:, : made.errors.shape[1]] = made.errors
    for place, values in made.nuisances:
        design[:, place] += values
    return Choice(design, made.u, made.hours, targets=made.targets, repetitions=made.repetitions)


def _one_way(
    columns: Sequence[tuple[ErrorParameter | str, float]],
    one: SetupReadings,
    way: Way,
    nuisances: _Nuisances,
) -> _Design:
    at = np.asarray(way.targets, dtype=np.float64)
    q = np.asarray(deg_to_rad(at)) if one.rotary else at
    unit = component_unit(one.name, "mm") if one.name[1] != "0" or one.name in ("X0C", "Y0C") else "um"
    size = in_mm_rad(unit, 1.0)
    u = np.full(at.size, size * one.scatter / (2.0 * way.repetitions) ** 0.5)
    if one.name[1] == "0":
        errors, beside = _location_rows(columns, one, q, nuisances)
    else:
        errors, beside = _motion_rows(columns, one, q, nuisances)
    beside += _own_error(one, q, size * one.systematic, nuisances)
    return _Design(errors, beside, u, way.hours, at.size, way.repetitions)


def _motion_rows(
    columns: Sequence[tuple[ErrorParameter | str, float]], one: SetupReadings, q: FloatArray, nuisances: _Nuisances
) -> tuple[FloatArray, list[tuple[int, FloatArray]]]:
    acts = {one.name: 1.0}
    if one.offset_mm is not None and one.name[1] in "XYZ":
        um = float(mm_to_um(arcsec_to_rad(1.0)))
        acts |= {name: lever / um for name, lever in arms(one.name[1], one.letter, one.offset_mm).items()}
    errors = np.zeros((q.size, len(columns)))
    for n, (parameter, size) in enumerate(columns):
        if _name(parameter) in acts:
            errors[:, n] = acts[_name(parameter)] * size * _values(parameter, q)
    far = DATUM[component_unit(one.name, "mm")]
    beside = [(nuisances.place(f"datum {one.key}"), np.full(q.size, far))]
    for wave, (artefact, part, sign) in zip((np.cos(q), np.sin(q)), ORIENTED.get(one.name, ()), strict=False):
        beside.append((nuisances.place(f"{artefact}{part}"), sign * far * wave))
    return errors, beside


def _location_rows(
    columns: Sequence[tuple[ErrorParameter | str, float]], one: SetupReadings, q: FloatArray, nuisances: _Nuisances
) -> tuple[FloatArray, list[tuple[int, FloatArray]]]:
    """Slopes over the travel about its middle; a ball of the centre shows nothing of the errors."""
    errors, along, far = np.zeros((q.size, len(columns))), q - q.mean(), DATUM["arcsec"]
    beside = [(nuisances.place(f"datum {one.key}"), np.full(q.size, DATUM["um"]))]
    shows: dict[str, tuple[float, float | None]] = {}
    if one.name == "B0Z":
        turned = one.component.endswith("-R")
        beside.append((nuisances.place(f"square {turned}"), (1.0 if one.letter == "X" else -1.0) * far * along))
        if one.letter == "Z":
            shows["B0Z"] = (1.0, None)
            if not one.own_angle:
                beside.append((nuisances.place("square-angle"), (-1.0 if turned else 1.0) * far * along))
    elif one.name in ("A0C", "B0C"):
        place = float(deg_to_rad(one.stands.get("C", 0.0)))
        beside.append((nuisances.place(f"bar {one.name}"), float(np.cos(place)) * far * along))
        about = one.name[0]
        shows = {one.name: (1.0, None), f"E{about}X": (1.0, one.stands.get("X", 0.0)), f"E{about}C": (1.0, place)}
        if one.name == "B0C":
            shows["B0Z"] = (-1.0, None)
    for n, (parameter, size) in enumerate(columns):
        sign, stands = shows.get(_name(parameter), (0.0, None))
        if sign:
            value = 1.0 if stands is None else float(_values(parameter, np.array([stands]))[0])
            errors[:, n] = sign * size * value * along
    return errors, beside


def _own_error(one: SetupReadings, q: FloatArray, size: float, nuisances: _Nuisances) -> list[tuple[int, FloatArray]]:
    """The instrument's own error, mm or rad: smooth over the travel or the turn as `doubts` takes it."""
    if size <= 0.0 or q.size < TOP:
        return []
    low, high = float(q.min()), float(q.max())
    shapes = [Shape(n, low, high, one.rotary) for n in ((1, 2, 3, 4) if one.rotary else (1, 2))]
    share = size / len(shapes) ** 0.5
    return [(nuisances.place(f"own {one.key} {n}"), share * shape(q)) for n, shape in enumerate(shapes)]


# ---- goals


def _goal_rows(
    model: ErrorModel,
    goal: HourGoal,
    chain: Chain,
    plan: Plan,
    columns: Sequence[tuple[ErrorParameter | str, float]],
    *,
    proof: bool,
) -> tuple[FloatArray, FloatArray]:
    """Goal (R, p) by the shapes, um or arcsec, and what is known of it that stays (R,)."""
    if goal.kind == "axis":
        return _axis_rows(goal, chain, plan, columns)
    if goal.tooth is None or (goal.kind == "drive" and goal.drive is None):
        raise ModelError("E-PLAN-GOAL", "plan", goal=goal.kind)
    grinding = Grinding(chain, goal.tooth.gear, goal.tooth.centre_distance_mm)
    fine = goal.kind == "drive"
    grid = flank_grid(goal.tooth.gear, profile=2 * PROFILE + 1 if fine else PROFILE, width=WIDTH + 2 if fine else WIDTH)
    patterns = column_doubts(grinding, grid, columns)
    if goal.kind == "drive" and goal.drive is not None:
        right = without_setup(grinding, patterns)
        rows = transmission_rows(goal.drive, grinding, grid, right)
        return _short(rows / rows.shape[0] ** 0.5, np.zeros(rows.shape[0]))
    return _flank_rows(model, grinding, grid, plan, patterns, proof=proof)


def _flank_rows(
    model: ErrorModel, grinding: Grinding, grid: FlankGrid, plan: Plan, patterns: FlankDoubts, *, proof: bool
) -> tuple[FloatArray, FloatArray]:
    places = patterns.places
    tables = flank_model(
        grinding, grid, [spec.grid for spec in cross_specs(grinding.chain, plan)], setup_unknowns(grinding.chain, plan)
    )
    unseen = [between_targets(grinding, grid, one) for one in model.motions if one.residual_rms > 0.0]
    base = flank_abg(grinding, places.k, places.z)
    known = FlankDoubts(places, ("known",), np.broadcast_to(base, (places.k.size, 3))[:, :, None])
    every = patterns
    for one in (known, *unseen):
        every = every.plus(one)
    # An eccentric or tilted work is set right by hand, and what turns with C alike is by convention no error of C.
    mounting = np.moveaxis(mounting_terms(grinding, places), -1, 0)
    every = less(every, [*setup_effects(grinding, places), *mounting])
    rows = np.asarray(mm_to_um(rows_of(every))) / places.points**0.5
    followed = _basis(tables.rows)
    left = rows - followed @ (followed.T @ rows)
    count = patterns.patterns.shape[-1]
    # What lies between targets stays whatever is measured: it is known to be there, by its size alone.
    stays = float(np.sum(rows[:, count + 1 :] ** 2)) ** 0.5
    wanted = rows[:, :count] if proof else followed @ (followed.T @ rows[:, :count])
    nominal = np.append(left[:, count], stays)
    return _short(np.vstack([wanted, np.zeros((1, count))]), nominal)


def _basis(columns: FloatArray) -> FloatArray:
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(u[:, s > 1e-10 * np.max(s, initial=0.0)])


def _short(rows: FloatArray, nominal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same square in as few rows as carry it."""
    _, s, right = np.linalg.svd(np.column_stack([rows, nominal]), full_matrices=False)
    kept = s > SEEN * np.max(s, initial=0.0)
    whole = s[kept, None] * right[kept]
    return whole[:, :-1], whole[:, -1]


def _axis_rows(
    goal: HourGoal, chain: Chain, plan: Plan, columns: Sequence[tuple[ErrorParameter | str, float]]
) -> tuple[FloatArray, FloatArray]:
    """An axis' own positioning at places over its table; where its zero lies is nobody's error."""
    if not plan.has(goal.axis):
        raise ModelError("E-PLAN-GOAL", "plan", goal=f"axis {goal.axis}")
    grid, turning = plan.grid(goal.axis), chain.axis(goal.axis).kind == "revolute"
    at = np.linspace(grid.minimum, grid.maximum, ACROSS)
    q = np.asarray(deg_to_rad(at)) if turning else at
    rows = np.zeros((ACROSS, len(columns)))
    scale = rad_to_arcsec(1.0) if turning else mm_to_um(1.0)
    for n, (parameter, size) in enumerate(columns):
        if _name(parameter) == f"E{goal.axis}{goal.axis}":
            rows[:, n] = scale * size * _values(parameter, q)
    rows -= rows.mean(axis=0)
    return _short(rows / ACROSS**0.5, np.zeros(ACROSS))
