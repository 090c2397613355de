"""By what each error of the machine can be cured, and what it then leaves on the tooth (mm, rad).

Cures are judged on the first-order flank with tables as fine as the grid: a real table does no better. Families:
set-up values (x zero, c zero, dressing offset), tables of one axis over another, products of two tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import OFFSET, ErrorParameter, LinearFlank, linear_flank
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding

NULL = 1e-9  # of the largest column: what counts as no effect on the flank
SAME = 1e-9  # relative, for the rank
WHOLE = 1e-6  # of an error's RMS: what is left when it is cured entirely


@dataclass(frozen=True, slots=True)
class TangentialCure:
    """What rotating the work does against a tangential error B: ``dc_per_B`` rad/mm added to C per mm of B.

    The residual n_y - dc_per_B h has the relative size ``eta`` (RMS against n_y) and reaches ``largest`` per mm of B.
    """

    dc_per_B: float
    eta: float
    largest: float


def tangential_cure(gear: CycloidGear, thetas: ArrayLike) -> TangentialCure:
    """The best C correction of a constant B n_y over profile points: alpha = <n_y, h> / <h, h>."""
    s = gear.section(thetas)
    alpha = float(np.vdot(s.ny, s.h) / np.vdot(s.h, s.h))
    rest = s.ny - alpha * s.h
    return TangentialCure(alpha, float(np.linalg.norm(rest) / np.linalg.norm(s.ny)), float(np.max(np.abs(rest))))


@dataclass(frozen=True, slots=True)
class Observability:
    """How many combinations of the parameters the flank shows, and which parameters it does not show at all."""

    rank: int
    null: tuple[str, ...]


def observability(flank: LinearFlank) -> Observability:
    """Rank and null parameters of the flank's Jacobian (columns made comparable first)."""
    root = flank.normal_form().root
    size = np.linalg.norm(root, axis=0)
    seen = size > NULL * np.max(size, initial=0.0)
    null = tuple(name for name, visible in zip(flank.names, seen, strict=True) if not visible)
    if not np.any(seen):
        return Observability(0, null)
    values = np.linalg.svd(root[:, seen] / size[seen], compute_uv=False)
    return Observability(int(np.count_nonzero(values > SAME * values[0])), null)


@dataclass(frozen=True, slots=True)
class Cure:
    """One error's standing: RMS on the flank, RMS left by each family of cures, and the simplest that does (mm).

    ``by`` is "none needed" without effect, "mechanical only" if no family leaves less than the asked share; ``floor``
    is left when everything possible is done.
    """

    error: str
    rms: float
    left: Mapping[str, float]
    by: str
    floor: float


def families(grinding: Grinding, grid: FlankGrid) -> dict[str, tuple[ErrorParameter, ...]]:
    """Families of cures in order of effort; each is the span of its parameters, tables as fine as the grid."""
    x, z, c = grinding.infeed, grinding.stroke, grinding.index
    at = grinding.commands(grid.ks, 0.0)[c], grinding.commands(0.0, grid.zs)[z]
    over = {c: _indicators(c, at[0]), z: _indicators(z, at[1])}
    found: dict[str, tuple[ErrorParameter, ...]] = {
        f"{x} zero": (ErrorParameter(x),),
        f"{c} zero": (ErrorParameter(c),),
        "dressing offset": (ErrorParameter(OFFSET),),
    }
    if grinding.chain.axis(c).err_frame == "moving":
        found["mounting"] = tuple(ErrorParameter(f"E{letter}{c}") for letter in "XYAB")
    setup = tuple(one for group in found.values() for one in group)
    found["set-up values"] = setup
    for out, over_axis in ((x, z), (x, c), (c, c), (c, z)):
        found[f"{out}({over_axis})"] = tuple(ErrorParameter(out, one.basis, (over_axis,)) for one in over[over_axis])
    for over_axis in (z, c):
        found[f"{x}({over_axis}), {c}({over_axis})"] = (*found[f"{x}({over_axis})"], *found[f"{c}({over_axis})"])
    sums = (*found[f"{x}({z}), {c}({z})"], *found[f"{x}({c}), {c}({c})"])
    found["tables + set-up values"] = (*setup, *sums)
    for out in (x, c):
        found[f"{out}({z})*({c})"] = tuple(_product(out, a, b) for a in over[z] for b in over[c])
    return found


def cures(
    grinding: Grinding,
    grid: FlankGrid,
    errors: Sequence[ErrorParameter | str],
    *,
    share: float = 0.1,
    figure: bool = False,
) -> tuple[Cure, ...]:
    """Standing of each error (a parameter of one unit; give bases to say how it varies), in the order given.

    A family cures if at most ``share`` of the error's RMS is left. With ``figure`` the sizes are those of the flank
    figure, one rotation of the gear taken out; what cures is judged with the rotation all the same.
    """
    if not 0.0 < share < 1.0:
        raise ModelError("E-CORRECT-SHARE", "compensability", share=share)
    groups = families(grinding, grid)
    columns = [*errors, *(one for group in groups.values() for one in group)]
    flank = linear_flank(grinding, grid, columns)
    names = [one if isinstance(one, str) else one.name for one in errors]
    spans = {name: len(group) for name, group in groups.items()}
    judged = _judge_cures(flank.normal_form().root, names, spans, share)
    if not figure:
        return judged
    sized = _judge_cures(flank.normal_form(without_rotation=True).root, names, spans, share)
    return tuple(replace(one, by=other.by) for one, other in zip(sized, judged, strict=True))


def _judge_cures(root: FloatArray, names: Sequence[str], spans: Mapping[str, int], share: float) -> tuple[Cure, ...]:
    """Cures by a root whose first columns are the errors', then those of each family."""
    wanted = root[:, : len(names)]
    left, first = {}, len(names)
    for name, count in spans.items():
        left[name] = _residual_norms(root[:, first : first + count], wanted)
        first += count
    floor = _residual_norms(root[:, len(names) :], wanted)
    size = np.linalg.norm(wanted, axis=0)
    null = size <= NULL * np.max(np.linalg.norm(root, axis=0))
    return tuple(
        _cure(name, float(size[i]), {family: float(rest[i]) for family, rest in left.items()}, share, float(floor[i]))
        if not null[i]
        else Cure(error=name, rms=0.0, left=dict.fromkeys(left, 0.0), by="none needed", floor=0.0)
        for i, name in enumerate(names)
    )


def _cure(name: str, size: float, left: Mapping[str, float], share: float, floor: float) -> Cure:
    whole = [family for family, rest in left.items() if rest <= WHOLE * size]
    good = [family for family, rest in left.items() if rest <= share * size]
    return Cure(error=name, rms=size, left=left, by=[*whole, *good, "mechanical only"][0], floor=floor)


def _residual_norms(span: FloatArray, columns: FloatArray) -> FloatArray:
    """Norm of the part of each column that a span cannot make."""
    size = np.linalg.norm(span, axis=0)
    used = size > 0.0
    if not np.any(used):
        return np.asarray(np.linalg.norm(columns, axis=0))
    basis, values, _ = np.linalg.svd(span[:, used] / size[used], full_matrices=False)
    basis = basis[:, values > SAME * values[0]]
    return np.asarray(np.linalg.norm(columns - basis @ (basis.T @ columns), axis=0))


def _indicators(axis: str, nodes: FloatArray) -> list[ErrorParameter]:
    """A free value at each position of an axis."""

    def one(node: float) -> ErrorParameter:
        return ErrorParameter(axis, lambda q: _near(q, node), (axis,))

    return [one(float(node)) for node in nodes]


def _near(q: FloatArray, node: float) -> FloatArray:
    here: NDArray[np.bool_] = np.isclose(q, node, rtol=0.0, atol=1e-9)
    return here.astype(np.float64)


def _product(out: str, a: ErrorParameter, b: ErrorParameter) -> ErrorParameter:
    def basis(qa: FloatArray, qb: FloatArray) -> FloatArray:
        first, second = a.basis, b.basis
        return np.asarray((first(qa) if first else 1.0) * (second(qb) if second else 1.0))

    return ErrorParameter(out, basis, (a.over[0], b.over[0]))
