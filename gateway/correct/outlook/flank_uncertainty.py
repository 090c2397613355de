"""What may make a flank differ from its prediction, as independent patterns of one standard uncertainty (mm, rad)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um, um_to_mm
from gateway.correct.flank.flank_model import Places, command_effects, flank_model, places_of_grid
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.flank.noise import component_doubts, noise_patterns, shapes_over
from gateway.correct.plan.plan import AxisGrid, Plan, cross_specs, setup_unknowns
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, component_unit
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import ErrorParameter, linear_flank
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain
from gateway.model.components import FEWEST, leave_one_out_rows
from gateway.model.error_model import LOCATION_NAMES, ErrorModel, chain_of_errors, in_mm_rad
from gateway.sensitivity.outputs import measure_next

CLAMPING, DRIFT, INDEX, INFEED, SETUP = "clamping", "drift", "index", "infeed", "set-up values"
SIZE = "inspection size"


@dataclass(frozen=True, slots=True)
class ProcessUncertainty:
    """What acts beside the machine's errors between its measuring and the part that is judged.

    ``clamping_um``: how well a newly clamped blank sits on the table's mean axis (k = 2, each direction).
    ``drift_um_per_h``, ``drift_arcsec_per_h``: how fast the zeros of infeed and index wander; ``part_h``: hours that a
    part takes, inspection included, and so from the trial part to the next. ``infeed_um``, ``index_arcsec``: standard
    deviation of one approach from one side. ``setup_um``: standard uncertainty of x zero and dressing offset as the
    trial part tells them; ``size_um`` that of the inspection machine's probe, whose error makes x zero wrong by just as
    much and is never shown by the same machine. 0: a part is as large as that machine says.
    """

    clamping_um: float = 0.3
    drift_um_per_h: float = 0.3
    drift_arcsec_per_h: float = 0.5
    part_h: float = 0.25
    infeed_um: float = 0.1
    index_arcsec: float = 0.2
    setup_um: float = 0.05
    size_um: float = 0.0


@dataclass(frozen=True)
class FlankDoubts:
    """Patterns (G, 3, S) of A, B, G at the places, one standard uncertainty each, ``sources`` (S,) by name."""

    places: Places
    sources: tuple[str, ...]
    patterns: FloatArray

    def plus(self, other: FlankDoubts) -> FlankDoubts:
        """Both together."""
        patterns = np.concatenate([self.patterns, other.patterns], axis=-1)
        return FlankDoubts(self.places, (*self.sources, *other.sources), patterns)


def persistent_doubts(
    grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel, shop: ProcessUncertainty
) -> FlankDoubts:
    """What is the same in the trial part and the next: the errors' own doubts, and the growth of drift over a part.

    Errors: `next_setup.doubts` (covariance of each fit, what repetition does not show, spans of what nobody measured)
    and the structure between the targets that a fit does not follow (``residual_rms``): independent in every space for
    an error of the index axis, a constant for the infeed, a slope and a bow over the face for one of the stroke axis
    (`face_residual`).
    """
    return error_doubts(grinding, grid, plan, model).plus(_growth(grinding, grid, shop))


def error_doubts(grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel) -> FlankDoubts:
    """How the flank may be wrong by what is known of the errors alone, by error: the joint covariance of a run."""
    columns = doubts(model, grinding.chain, plan)
    found = column_doubts(grinding, grid, columns)
    for one in model.motions:
        if one.residual_rms > 0.0:
            found = found.plus(between_targets(grinding, grid, one))
    return found


def column_doubts(
    grinding: Grinding, grid: FlankGrid, columns: Sequence[tuple[ErrorParameter | str, float]]
) -> FlankDoubts:
    """Independent columns of one standard uncertainty each (mm, rad) as patterns of the flank, by error."""
    names = tuple(one if isinstance(one, str) else one.name for one, _ in columns)
    found, noise = _none(grid), noise_patterns(grinding, grid, columns).patterns
    return found if noise is None else found.plus(FlankDoubts(found.places, names, noise))


def part_specific_doubts(grinding: Grinding, grid: FlankGrid, shop: ProcessUncertainty) -> FlankDoubts:
    """What is another in every part: clamping, repeatability of infeed and index, and the set-up values' own doubt.

    The zero of the infeed also wanders from the trial part to the next, and the trial's scatter is in the set-up.
    """
    found = _none(grid)
    effects = command_effects(grinding, found.places)
    infeed, index = effects[grinding.infeed], effects[grinding.index]
    spaces = (found.places.k[:, None] == grid.ks).astype(np.float64)
    clamping = mounting_terms(grinding, found.places)[:, :, :2] * um_to_mm(shop.clamping_um / COVERAGE)
    setup = hypot(shop.setup_um, shop.infeed_um / grid.ks.size**0.5)
    offset = np.broadcast_to(np.array([0.0, 1.0, 0.0]), infeed.shape)
    parts = (
        (CLAMPING, clamping),
        (INFEED, infeed[:, :, None] * spaces[:, None, :] * um_to_mm(shop.infeed_um)),
        (INDEX, index[:, :, None] * spaces[:, None, :] * arcsec_to_rad(shop.index_arcsec)),
        (SETUP, np.stack([infeed * um_to_mm(setup), offset * um_to_mm(shop.setup_um)], axis=-1)),
        (DRIFT, infeed[:, :, None] * um_to_mm(shop.drift_um_per_h * shop.part_h)),
        (SIZE, _setup_response(grid, found.places)[:, :, None] * um_to_mm(shop.size_um)),
    )
    for name, patterns in parts:
        found = found.plus(FlankDoubts(found.places, (name,) * patterns.shape[-1], patterns))
    return found


def _setup_response(grid: FlankGrid, places: Places) -> FloatArray:
    """A, B, G (G, 3) that set-up values give the next part if all points touched are too high by 1."""
    section = grid.section
    design = np.stack([np.ravel(one) for one in (section.nx, section.ny, section.h)], axis=1)
    a, b, _ = np.linalg.lstsq(design, np.ones(design.shape[0]), rcond=None)[0]
    return np.broadcast_to(np.array([-a, -b, 0.0]), (places.k.size, 3))


def _none(grid: FlankGrid) -> FlankDoubts:
    places = places_of_grid(grid)
    return FlankDoubts(places, (), np.zeros((places.k.size, 3, 0)))


def _growth(grinding: Grinding, grid: FlankGrid, shop: ProcessUncertainty) -> FlankDoubts:
    """Zeros that wander evenly while the spaces are ground one after the other."""
    places = places_of_grid(grid)
    effects = command_effects(grinding, places)
    along = places.k - np.mean(grid.ks)
    ramp = along / max(float(np.ptp(grid.ks)), 1.0)
    sizes = um_to_mm(shop.drift_um_per_h * shop.part_h), arcsec_to_rad(shop.drift_arcsec_per_h * shop.part_h)
    axes = (grinding.infeed, grinding.index)
    patterns = [effects[axis] * ramp[:, None] * size for axis, size in zip(axes, sizes, strict=True)]
    return FlankDoubts(places, (DRIFT, DRIFT), np.stack(patterns, axis=-1))


def between_targets(grinding: Grinding, grid: FlankGrid, one: Component) -> FlankDoubts:
    """What one error's targets do not show of it, on the flank."""
    places = places_of_grid(grid)
    terms = np.moveaxis(linear_flank(grinding, grid, [one.name]).terms, 1, 2).reshape(places.k.size, 3)
    shapes = _shapes(grinding, grid, places, one) * in_mm_rad(component_unit(one.name, "mm"), 1.0)
    patterns = terms[:, :, None] * shapes[:, None, :]
    return FlankDoubts(places, (one.name,) * shapes.shape[1], patterns)


def _shapes(grinding: Grinding, grid: FlankGrid, places: Places, one: Component) -> FloatArray:
    """Values (G, S) of independent shapes, um or arcsec."""
    axis, _ = grinding.chain.error_place(one.name)
    if axis == grinding.index:
        return np.asarray(places.k[:, None] == grid.ks, dtype=np.float64) * one.residual_rms
    if axis != grinding.stroke:
        return np.full((places.k.size, 1), one.residual_rms)
    x = 2.0 * places.z / grid.gear.b
    shapes = np.stack([np.sqrt(3.0) * x, np.sqrt(5.0) * 0.5 * (3.0 * x**2 - 1.0)], axis=-1)
    middle = float(grinding.stroke_command(np.zeros(())))
    return np.asarray(shapes * slope_and_bow(one, grid.gear.b, middle))


# ---- What a partial plan leaves open: which error, measured next, would change the proposal for the tooth most.

# Flank RMS in um below which nobody needs to measure: half the noise of a gear inspection's probe.
THRESHOLD_UM = 0.1
PROFILE, WIDTH = 5, 3
WHOLE_TURN = (0.0, 360.0)
Doubt = tuple[ErrorParameter | str, float]
ALSO_SHOWN: Mapping[str, tuple[str, ...]] = {"B0C": ("B0Z",)}
"""Errors that need no measuring once another is known: these reach the flank by their difference alone."""


@dataclass(frozen=True, slots=True)
class ToothSpec:
    """The work: its gear, centre distance and height of its middle above the table's zero, mm."""

    gear: CycloidGear
    centre_distance_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True)
class OpenDoubt:
    """One error's doubt: what it may change in the proposal and what no proposal follows, um RMS of the flank.

    ``share`` is its part of all that the proposal may be wrong by; ``measured`` says whether it was measured.
    """

    name: str
    change_um: float
    beyond_um: float
    share: float
    measured: bool


def doubts(model: ErrorModel, chain: Chain, plan: Plan) -> list[Doubt]:
    """How each error may be wrong, in columns of one standard uncertainty (mm or rad) that are independent.

    Measured: the fit's covariance and the systematic part as smooth shapes; unknown: the assumed span as smooth
    shapes over the whole travel, so that a short face sees little of a linear axis' own. B0Z is left out once a bar
    has shown B0C: they reach the flank by their difference only, which it shows.
    """
    # Of an axis without a table, the travel is where its errors were measured.
    travels = {one.name[2]: one.domain for one in model.motions if one.name.startswith("E")}
    travels |= {one.axis: (one.minimum, one.maximum) for one in plan.grids}
    found = component_doubts([one for one in model.motions if one.name in chain.error_names()])
    for one in model.motions:
        found += _shape_doubts(one.name, model.systematic.get(one.name, 0.0), chain, travels)
    for gap in model.unknown:
        found += _shape_doubts(gap.name, gap.u, chain, travels)
    located = [one for one in model.locations if one.name in LOCATION_NAMES]
    found += [(ErrorParameter(one.name), in_mm_rad(one.unit, one.u)) for one in located]
    shown = {other for one in located for other in ALSO_SHOWN.get(one.name, ())}
    return [(parameter, u) for parameter, u in found if u > 0.0 and _name(parameter) not in shown]


def _name(parameter: ErrorParameter | str) -> str:
    return parameter if isinstance(parameter, str) else parameter.name


def _shape_doubts(name: str, u: float, chain: Chain, travels: dict[str, tuple[float, float]]) -> list[Doubt]:
    size = in_mm_rad(component_unit(name, "mm"), u)
    if not name.startswith("E"):
        return [(ErrorParameter(name), size)]
    axis, _ = chain.error_place(name)
    if axis not in travels and chain.axis(axis).kind == "prismatic":
        return [(ErrorParameter(name), size)]  # where it travels nobody knows: only a constant is the same anywhere
    shapes = shapes_over(chain, axis, travels.get(axis, WHOLE_TURN))
    return [(ErrorParameter(name, shape), size / len(shapes) ** 0.5) for shape in shapes]


def what_next(model: ErrorModel, tooth: ToothSpec, grids: Sequence[AxisGrid]) -> tuple[OpenDoubt, ...]:
    """Every error of the model by what its doubt changes in the proposal, the most important first.

    ``grids`` are the controller's, by axis letter. Raises what the gear and its correction raise.
    """
    chain = chain_of_errors(model, height_mm=tooth.height_mm)
    grinding = Grinding(chain, tooth.gear, tooth.centre_distance_mm)
    grid = flank_grid(tooth.gear, profile=PROFILE, width=WIDTH)
    plan = Plan(tuple(grids))
    columns = doubts(model, chain, plan)
    noise = noise_patterns(grinding, grid, columns)
    tables = flank_model(grinding, grid, [spec.grid for spec in cross_specs(chain, plan)], setup_unknowns(chain, plan))
    names = [_name(parameter) for parameter, _ in columns]
    ranked = measure_next(names, noise.rows(tables), tables.rows, tables.places.points)
    return tuple(
        OpenDoubt(
            name=one.name,
            change_um=float(mm_to_um(one.change)),
            beyond_um=float(mm_to_um(one.beyond)),
            share=one.share,
            measured=one.name in model.measured,
        )
        for one in ranked
    )


# ---- What an error does between its targets, where no fit follows it: how much it may slope and bow over a face.
#
# A curve through all targets shows it by itself: each target misses the curve through all others. That counts in
# full: structure too short for the targets and a guide worn at the face look alike there. What is worn far from the
# face counts no more than usual misses do.

MAD_TO_SIGMA = 1.4826
# Mean target distances beside a face from which a hollow that targets see still reaches it, and how many standard
# deviations of the usual misses a target further away may miss by.
BESIDE, USUAL = 2.0, 4.0


def slope_and_bow(one: Component, face_mm: float, middle: float | None = None) -> tuple[float, float]:
    """RMS over a face of the slope and of the bow that an error of a linear axis may have beside its fit, um or arcsec.

    Half of what lies between the targets each; a smooth fit leaves what its targets scatter about it
    (``residual_rms``). Where a working window lies around the face's ``middle`` (in the axis' unit), its targets tell
    and no others.
    """
    here = near(one, face_mm, middle)
    unseen = one.residual_rms
    if here is not None:
        unseen = _scatter_between(one, here, None if middle is None else window_around_face(one, face_mm, middle))
    return unseen / 2.0**0.5, unseen / 2.0**0.5


def nodes_of(one: Component) -> FloatArray:
    """Places that a curve goes through; none of a smooth fit."""
    return np.asarray(one.parameters.get("nodes", ()) if one.basis == "cubic" else (), dtype=np.float64)


def near(one: Component, face_mm: float, middle: float | None) -> slice | None:
    """The nodes that tell of a face: those over it and one beside it where they are enough, else all; None if few."""
    nodes = nodes_of(one)
    if nodes.size < FEWEST:
        return None
    if middle is None:
        return slice(0, nodes.size)
    first = max(int(np.searchsorted(nodes, middle - face_mm / 2.0)) - 1, 0)
    last = min(int(np.searchsorted(nodes, middle + face_mm / 2.0, side="right")) + 1, nodes.size)
    return slice(first, last) if last - first >= FEWEST else slice(0, nodes.size)


def window_around_face(one: Component, face_mm: float, middle: float) -> tuple[float, float]:
    """From where to where targets see what reaches the face."""
    beside = face_mm / 2.0 + BESIDE * float(np.mean(np.diff(nodes_of(one))))
    return middle - beside, middle + beside


def _scatter_between(one: Component, here: slice, reaching: tuple[float, float] | None) -> float:
    """RMS of what would scatter independently at the inner targets as much as these miss the curve through the others.

    A fault of a guide at one place beyond what is ``reaching`` the face counts no more there than usual misses do.
    """
    nodes = nodes_of(one)
    rows, at = leave_one_out_rows(nodes)[here.start : here.stop - 2], nodes[here][1:-1]
    rows /= np.sum(rows**2, axis=1, keepdims=True) ** 0.5
    missed, doubt = rows @ one.coefficients, np.einsum("ij,jk,ik->i", rows, one.covariance, rows)
    if reaching is not None:
        most = USUAL * MAD_TO_SIGMA * float(np.median(np.abs(missed)))
        far = (at < reaching[0]) | (at > reaching[1])
        missed = np.where(far, np.clip(missed, -most, most), missed)
    return float(np.sqrt(max(float(np.mean(missed**2 - doubt)), 0.0)))
