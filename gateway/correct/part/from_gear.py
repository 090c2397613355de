"""From an inspected gear back to the machine: A, B, G at each wheel place, table and set-up values, what is invisible.

e = A n_x + B n_y + G h at every measured point, one wheel place for each space and height. Least squares over the
profile's points of a place gives its A, B, G with their covariance from the probe's noise. Only these three and only
in the sums of the machine's errors that make them up can be told from a gear: the combinations are named (columns of
the flank's Jacobian that are multiples of each other), the rest is said to be invisible. What acted while the part
was ground is taken off: tables, set-up values. A clamped part turns about its own centre, so eccentricity and tilt of
the clamping are fitted with it as first harmonics of A and B and set apart: they change with the next clamping and go
into no table. What a constant may be is a set-up value's; the rest is solved for a known machine
(`solve.optimise`), with measured deviations instead of the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, fixed
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.flank_model import Places, places_of_points, table_terms
from gateway.correct.flank.mounting import WorkMounting, mounting_in, mounting_terms
from gateway.correct.flank.noise import FitNoise
from gateway.correct.flank.tables import Table
from gateway.correct.plan.plan import Plan, cross_specs, live_table, setup_unknowns
from gateway.correct.solve.optimise import Optimum, optimise
from gateway.errors import ModelError
from gateway.gear.first_order import LinearFlank, linear_flank
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import LOCATION_NAMES

SEEN = 1e-6  # of the largest eigenvalue at a place: what its points tell apart
SAME = 1e-7  # how exactly two errors must do the same to be one combination
NULL = 1e-9
FEWEST_SPACES = 5  # fewer cannot tell a harmonic of the turn
HARMONIC = 5e-4  # mm: a smaller first harmonic is no sign of a bad clamping


@dataclass(frozen=True)
class PlaceFit:
    """A, B (mm) and G (rad) at each wheel place (``k``, ``z``), (G, 3), with standard uncertainties; NaN if not seen.

    ``residual`` (N,) is what A, B, G leave of the deviations (mm): the wheel's profile, waviness, noise. ``u`` is the
    standard uncertainty of one point that was used.
    """

    k: FloatArray
    z: FloatArray
    abg: FloatArray
    abg_u: FloatArray
    residual: FloatArray
    u: float


def fit_places(places: Places, deviation: ArrayLike, u: float | None = None) -> PlaceFit:
    """Least squares at each place. ``u`` (mm) of one point; without it the scatter of the fit tells.

    Places whose points are too few for all three get the least-norm values and NaN for what they do not tell apart.
    Raises ModelError E-CORRECT-POINTS, E-CORRECT-BASIS if no place tells the three apart.
    """
    e = np.ravel(np.asarray(deviation, dtype=np.float64))
    if e.size != places.points or not np.all(np.isfinite(e)):
        raise ModelError("E-CORRECT-POINTS", "inspection", points=e.size)
    count = places.k.size
    grams, moments = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(grams, places.of, places.form[:, :, None] * places.form[:, None, :])
    np.add.at(moments, places.of, places.form * e[:, None])
    scale = np.sqrt(np.einsum("gii->gi", grams))
    values, vectors = np.linalg.eigh(grams / (scale[:, :, None] * scale[:, None, :]))
    seen = values > SEEN * values[:, -1:]
    whole = np.all(seen, axis=-1)
    if not np.any(whole):
        raise ModelError("E-CORRECT-BASIS", "inspection", points=e.size)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=seen)
    back = np.einsum("gij,gj,gkj->gik", vectors, inverse, vectors) / (scale[:, :, None] * scale[:, None, :])
    abg = np.einsum("gij,gj->gi", back, moments)
    residual = e - places.along_normal(abg)
    freedom = max(e.size - int(np.count_nonzero(seen)), 1)
    point = float(np.sqrt(residual @ residual / freedom)) if u is None else u
    spread = point * np.sqrt(np.maximum(np.einsum("gii->gi", back), 0.0))
    missing = np.where(whole[:, None], 0.0, np.nan)
    return PlaceFit(k=places.k, z=places.z, abg=abg + missing, abg_u=spread + missing, residual=residual, u=point)


@dataclass(frozen=True, slots=True)
class Combination:
    """Errors that do the same to the flank, each with its factor against the first: only the sum is seen."""

    members: tuple[tuple[str, float], ...]

    @property
    def words(self) -> str:
        """E.g. "EXX - EXZ"."""
        parts = []
        for i, (name, factor) in enumerate(self.members):
            size = "" if abs(abs(factor) - 1.0) < SAME * 10 else f"{abs(factor):.4g} "
            sign = "-" if factor < 0.0 else ("+" if i else "")
            parts.append(f"{sign} {size}{name}".strip() if i else f"{sign}{size}{name}")
        return " ".join(parts)


@dataclass(frozen=True, slots=True)
class Visible:
    """What a gear tells of the errors: combinations, how many independent ones there are, and what is invisible."""

    combinations: tuple[Combination, ...]
    rank: int
    invisible: tuple[str, ...]


def visible(flank: LinearFlank) -> Visible:
    """Combinations of the flank's parameters, one rotation of the gear not counted."""
    root = flank.figure_form.root
    size = np.linalg.norm(root, axis=0)
    here = size > NULL * float(np.max(size, initial=0.0))
    groups: list[list[int]] = []
    for i in np.flatnonzero(here):
        mate = next((group for group in groups if _same(root[:, group[0]], root[:, i])), None)
        if mate is None:
            groups.append([int(i)])
        else:
            mate.append(int(i))
    rank = int(np.linalg.matrix_rank(root[:, here] / size[here], tol=SAME)) if np.any(here) else 0
    names = flank.names
    found = tuple(Combination(tuple((names[i], _factor(root[:, g[0]], root[:, i])) for i in g)) for g in groups)
    return Visible(found, rank, tuple(name for name, seen in zip(names, here, strict=True) if not seen))


@dataclass(frozen=True)
class FromGear:
    """What an inspected gear tells and proposes: the fit at the places, and the best tables and set-up values.

    ``mounting`` is how the work sat off its axis when it was ground or measured: it was taken off before. ``visible``
    are the combinations of constant errors that the gear shows; ``said`` puts that and what to mind in words.
    """

    fit: PlaceFit
    mounting: WorkMounting
    optimum: Optimum
    visible: Visible
    said: tuple[Message, ...]


def correct_from_gear(
    grinding: Grinding,
    points: tuple[ArrayLike, ArrayLike, ArrayLike],
    deviation: ArrayLike,
    plan: Plan,
    u: float | None = None,
    live: Sequence[CompensationTable] = (),
) -> FromGear:
    """Tables and set-up values from measured deviations (mm, + surplus) at points (k, theta, z).

    The gear was ground while the live tables acted, so the values found are to be added to them; the machine's own
    error model is not used. What corrects less than the measurement's uncertainty is not proposed. ``live`` are the
    cross tables that acted (sign convention, the chain's axis letters): what they do must not look like a mounting.
    """
    places = places_of_points(grinding.gear, *points)
    e = np.ravel(np.asarray(deviation, dtype=np.float64))
    fit = fit_places(places, e, u)
    mounting = _mounting(grinding, fit, plan, live)
    noise = plan.noise if not plan.noise.none else FitNoise(point=fit.u)
    chain = grinding.chain
    found = optimise(
        replace(grinding, chain=chain.without_errors()),
        places,
        cross_specs(chain, plan),
        setup_unknowns(chain, plan),
        norm=plan.norm,
        deviation=e - places.along_normal(mounting_terms(grinding, places) @ np.array(mounting.values)),
        noise=noise,
        indifference_rms=plan.indifference_rms,
    )
    seen = visible(linear_flank(grinding, flank_grid(grinding.gear, profile=5, width=3), _constants(grinding)))
    return FromGear(
        fit=fit,
        mounting=mounting,
        optimum=found,
        visible=seen,
        said=(*_describe_result(seen, found), *_sat(mounting), *_clamping_suspects(found, mounting)),
    )


def _mounting(grinding: Grinding, fit: PlaceFit, plan: Plan, live: Sequence[CompensationTable]) -> WorkMounting:
    """Eccentricity and tilt of the work in what the places tell, without what the tables that acted did."""
    here = np.all(np.isfinite(fit.abg), axis=1)
    k, z = fit.k[here], fit.z[here]
    if not plan.mounting or np.unique(k).size < FEWEST_SPACES:
        return WorkMounting()
    places = Places(k, z, np.empty((0, 3)), np.empty(0, dtype=np.intp))
    acted = (live_table(grinding.chain, out, over, live) for out, over in plan.cross)
    bare = fit.abg[here] - table_terms(grinding, places, [one for one in acted if one is not None])
    return mounting_in(grinding, places, bare).rounded(plan.resolution_mm, np.deg2rad(plan.resolution_deg))


def _constants(grinding: Grinding) -> tuple[str, ...]:
    """All error motions as constants, and the three location errors of a grinder where the chain has them."""
    names = grinding.chain.error_names()
    return tuple(name for name in names if name.startswith("E") or name in LOCATION_NAMES)


def _describe_result(seen: Visible, found: Optimum) -> tuple[Message, ...]:
    combinations = "; ".join(one.words for one in seen.combinations)
    said = [
        Message.of("S-CORRECT-VISIBLE", rank=seen.rank, combinations=combinations),
        Message.of("S-CORRECT-INVISIBLE", names=", ".join(seen.invisible)),
    ]
    for one in found.omitted:
        told = {"gain": fixed(mm_to_um(one.gain), 3), "U": fixed(mm_to_um(one.U), 3)}
        idle = Message.of("S-CORRECT-IDLE", name=one.name)
        said.append(idle if one.idle else Message.of("S-CORRECT-WITHIN-U", name=one.name, **told))
    return tuple(said)


def _sat(mounting: WorkMounting) -> tuple[Message, ...]:
    """Where the work sat, if that is worth telling."""
    size = float(np.hypot(mounting.x_mm, mounting.y_mm))
    if size < HARMONIC:
        return ()
    told = {name: fixed(value, signed=True) for name, value in zip("xy", mounting.eccentricity_um, strict=True)}
    return (Message.of("S-INSPECT-MOUNTING", size=fixed(mm_to_um(size)), **told),)


def _clamping_suspects(found: Optimum, mounting: WorkMounting) -> tuple[Message, ...]:
    """Tables that may hold what a bad clamping made, where that was not taken off before."""
    if mounting != WorkMounting():
        return ()
    turning = [one for one in found.tables if one.grid.period is not None and one.grid.out != one.grid.over]
    sizes = {one.grid.name: _first_harmonic(one) for one in turning}
    return tuple(
        Message.of("S-CORRECT-HARMONIC", name=name, amplitude=fixed(mm_to_um(size)))
        for name, size in sizes.items()
        if size > HARMONIC
    )


def _first_harmonic(table: Table) -> float:
    """Amplitude of the first harmonic of a table around the turn, in its unit."""
    free = table.grid.free
    return float(abs(2.0 * np.mean(table(free) * np.exp(1j * free))))


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.linalg.norm(b - a * _factor(a, b)) <= SAME * np.linalg.norm(b))


def _factor(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b) / float(a @ a)
