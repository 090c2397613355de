"""What a partial plan leaves open: which error, measured next, would change the proposal for the tooth most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.units import mm_to_um
from gateway.correct.flank.flankmodel import flank_model
from gateway.correct.flank.noise import component_doubts, noise_patterns
from gateway.correct.flank.travel_shapes import shapes_over
from gateway.correct.plan.plan import AxisGrid, Plan, cross_specs, setup_unknowns
from gateway.domain.values import component_unit
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.linear import ErrorParameter
from gateway.model.chain import Chain
from gateway.model.known import ErrorModel, chain_of_errors, in_mm_rad
from gateway.model.preset import LOCATION_NAMES
from gateway.sensitivity.next import measure_next

# Flank RMS in um below which nobody needs to measure: half the noise of a gear inspection's probe.
THRESHOLD_UM = 0.1
PROFILE, WIDTH = 5, 3
WHOLE_TURN = (0.0, 360.0)
Doubt = tuple[ErrorParameter | str, float]
ALSO_SHOWN: Mapping[str, tuple[str, ...]] = {"B0C": ("B0Z",)}
"""Errors that need no measuring once another is known: these reach the flank by their difference alone."""


@dataclass(frozen=True, slots=True)
class Tooth:
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
        found += _shaped(one.name, model.systematic.get(one.name, 0.0), chain, travels)
    for gap in model.unknown:
        found += _shaped(gap.name, gap.u, chain, travels)
    located = [one for one in model.locations if one.name in LOCATION_NAMES]
    found += [(ErrorParameter(one.name), in_mm_rad(one.unit, one.u)) for one in located]
    shown = {other for one in located for other in ALSO_SHOWN.get(one.name, ())}
    return [(parameter, u) for parameter, u in found if u > 0.0 and _name(parameter) not in shown]


def _name(parameter: ErrorParameter | str) -> str:
    return parameter if isinstance(parameter, str) else parameter.name


def _shaped(name: str, u: float, chain: Chain, travels: dict[str, tuple[float, float]]) -> list[Doubt]:
    size = in_mm_rad(component_unit(name, "mm"), u)
    if not name.startswith("E"):
        return [(ErrorParameter(name), size)]
    axis, _ = chain.error_place(name)
    if axis not in travels and chain.axis(axis).kind == "prismatic":
        return [(ErrorParameter(name), size)]  # where it travels nobody knows: only a constant is the same anywhere
    shapes = shapes_over(chain, axis, travels.get(axis, WHOLE_TURN))
    return [(ErrorParameter(name, shape), size / len(shapes) ** 0.5) for shape in shapes]


def what_next(model: ErrorModel, tooth: Tooth, grids: Sequence[AxisGrid]) -> tuple[OpenDoubt, ...]:
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
