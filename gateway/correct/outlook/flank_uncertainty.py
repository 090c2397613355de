"""What may make a flank another than predicted: independent patterns of one standard uncertainty each (mm, rad)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, um_to_mm
from gateway.correct.flank.flankmodel import command_effects
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.flank.wheel_places import Places, places_of_grid
from gateway.correct.outlook.face_residual import slope_and_bow
from gateway.correct.outlook.next_setup import doubts
from gateway.correct.plan.plan import Plan
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, component_unit
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.gear.linear import ErrorParameter, linear_flank
from gateway.model.known import ErrorModel, in_mm_rad

CLAMPING, DRIFT, INDEX, INFEED, SETUP = "clamping", "drift", "index", "infeed", "set-up values"
SIZE = "inspection size"


@dataclass(frozen=True, slots=True)
class Shop:
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


def lasting(grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel, shop: Shop) -> FlankDoubts:
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


def passing(grinding: Grinding, grid: FlankGrid, shop: Shop) -> FlankDoubts:
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
        (SIZE, _sized(grid, found.places)[:, :, None] * um_to_mm(shop.size_um)),
    )
    for name, patterns in parts:
        found = found.plus(FlankDoubts(found.places, (name,) * patterns.shape[-1], patterns))
    return found


def _sized(grid: FlankGrid, places: Places) -> FloatArray:
    """A, B, G (G, 3) that set-up values give the next part if all points touched are too high by 1."""
    section = grid.section
    design = np.stack([np.ravel(one) for one in (section.nx, section.ny, section.h)], axis=1)
    a, b, _ = np.linalg.lstsq(design, np.ones(design.shape[0]), rcond=None)[0]
    return np.broadcast_to(np.array([-a, -b, 0.0]), (places.k.size, 3))


def _none(grid: FlankGrid) -> FlankDoubts:
    places = places_of_grid(grid)
    return FlankDoubts(places, (), np.zeros((places.k.size, 3, 0)))


def _growth(grinding: Grinding, grid: FlankGrid, shop: Shop) -> FlankDoubts:
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
