"""First-order flank deviation e1 = A n_x + B n_y + G h, its second-order correction and its bound (mm, rad).

Twists are taken in the work and turned into the frame of the space, origin on the gear's axis. On a spur
flank only A = delta_x + z eps_y, B = delta_y - z eps_x and G = eps_z act; e > 0 is surplus material. k, theta and
z are arrays that broadcast together, e.g. (K, 1, 1), (T, 1) and (Z,) for a grid (`gateway.gear.flank.FlankGrid`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import ProfileSection
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model import transforms
from gateway.model.chain import MOTIONS, Influence, Positions, position

STEP = 1e-3  # mm of stroke, for the slope of e1 along the stroke
THETA_STEP = 1e-5  # rad, for the slope of the curvature
MARGIN = 1.5  # of the bound over the sum of the second-order terms
FLOOR = 1e-8  # mm, rounding and what is left at third order for tiny errors


@dataclass(frozen=True, slots=True)
class FirstOrder:
    """First-order deviation with what is known about its truth, all of the broadcast shape, mm.

    ``deviation`` is e1, ``second`` the second-order value e2, ``third`` adds to e2 what the change of the profile's
    curvature does; ``bound`` is a limit for |e1 - exact|.
    """

    deviation: FloatArray
    second: FloatArray
    third: FloatArray
    bound: FloatArray

    def good_enough(self, tolerance: float) -> bool:
        """True if no point can be wrong by more than ``tolerance`` (mm); else use the exact flank."""
        return bool(np.max(self.bound) <= tolerance)


def local_twist(grinding: Grinding, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """First-order relative twist (..., 6) in the frame of space k with the wheel at height z (mm)."""
    return to_space(grinding, k, grinding.twist(grinding.commands(k, z)))


def to_space(grinding: Grinding, k: ArrayLike, twist: FloatArray) -> FloatArray:
    """Work-frame twists (..., 6) turned into the frame of space k."""
    turn = transforms.rpy(0.0, 0.0, -grinding.gear.space_angle(k))
    parts = twist.reshape(*twist.shape[:-1], 2, 3)
    local = (turn[..., None, :, :] @ parts[..., None])[..., 0]
    return np.asarray(local.reshape(*local.shape[:-2], 6))


def abg(twist: FloatArray, z: ArrayLike) -> FloatArray:
    """A, B (mm) and G (rad), shape (..., 3), of space-frame twists (..., 6) acting at height z."""
    height = np.asarray(z, dtype=np.float64)
    dx, dy, ex, ey, ez = (twist[..., i] for i in (0, 1, 3, 4, 5))
    return np.stack(np.broadcast_arrays(dx + height * ey, dy - height * ex, ez), axis=-1)


def flank_abg(grinding: Grinding, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """A, B, G of the machine, shape (broadcast of k and z, 3); all that reaches a spur flank at first order."""
    return abg(local_twist(grinding, k, z), z)


def along_normal(section: ProfileSection, terms: FloatArray) -> FloatArray:
    """A n_x + B n_y + G h of (..., 3)."""
    return terms[..., 0] * section.nx + terms[..., 1] * section.ny + terms[..., 2] * section.h


def first_order(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FloatArray:
    """e1 (mm) of the machine's and the wheel's errors, broadcast shape of k, theta and z."""
    t = np.asarray(theta, dtype=np.float64)
    section = grinding.gear.section(t)
    return along_normal(section, flank_abg(grinding, k, z)) + grinding.dressing.first_order(section, t)


def stroke_slope(grinding: Grinding, section: ProfileSection, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """g = d e1 / d stroke with the point held (mm/mm)."""
    at = np.asarray(z, dtype=np.float64)
    above, below = (abg(local_twist(grinding, k, at + step), at) for step in (STEP, -STEP))
    return along_normal(section, (above - below) / (2.0 * STEP))


def bounded_first_order(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FirstOrder:
    """First order with its second-order correction and bound.

    e2 = d_n + d_t w_z - kappa d_t^2/2 - d_z (w_t + g) - R g^2/(2 n_x): d the exact displacement of the point,
    t = z x n, w the exact rotation; e3 = e2 + kappa' d_t^3/6. The bound is `MARGIN` times the sum of the
    second-order terms, each taken positive.
    """
    t = np.asarray(theta, dtype=np.float64)
    section = grinding.gear.section(t)
    e1 = along_normal(section, flank_abg(grinding, k, z)) + grinding.dressing.first_order(section, t)
    d, w = _displacement(grinding, section, k, np.asarray(z, dtype=np.float64))
    d = (d[0] - grinding.dressing.radius, d[1] + grinding.dressing.offset, d[2])
    dn, dt = d[0] * section.nx + d[1] * section.ny, d[1] * section.nx - d[0] * section.ny
    wt = w[1] * section.nx - w[0] * section.ny
    g = stroke_slope(grinding, section, k, z)
    profile = grinding.dressing.deviation(t - dt / section.speed)
    R = grinding.E - section.x
    terms = (
        dn + profile - e1,
        dt * w[2],
        -0.5 * section.curvature * dt**2,
        -d[2] * (wt + g),
        -0.5 * R * g**2 / section.nx,
    )
    second = e1 + sum(terms)
    third = second + _curvature_slope(grinding, t) / section.speed * dt**3 / 6.0
    bound = MARGIN * sum(np.abs(term) for term in terms) + FLOOR
    return FirstOrder(*np.broadcast_arrays(e1, second, third, bound))


def _curvature_slope(grinding: Grinding, theta: FloatArray) -> FloatArray:
    """d kappa / d theta by central difference."""
    above, below = (grinding.gear.section(theta + step).curvature for step in (THETA_STEP, -THETA_STEP))
    return np.asarray((above - below) / (2.0 * THETA_STEP))


def _displacement(
    grinding: Grinding, section: ProfileSection, k: ArrayLike, z: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """Exact displacement of the points by E_W = T_act inv(T_id) and its rotation vector, in the space's frame."""
    q = grinding.commands(k, z)
    E = grinding.actual(q) @ transforms.inverse(grinding.chain.ideal(q))
    turn = transforms.rpy(0.0, 0.0, -grinding.gear.space_angle(k))
    change = turn @ (E[..., :3, :3] - np.eye(3)) @ np.swapaxes(turn, -1, -2)
    shift = transforms.apply(turn, E[..., :3, 3])
    w = transforms.apply(turn, transforms.rotation_vector(E[..., :3, :3]))
    x, y = section.x, section.y
    d = [change[..., i, 0] * x + change[..., i, 1] * y + change[..., i, 2] * z + shift[..., i] for i in range(3)]
    return (d[0], d[1], d[2]), (w[..., 0], w[..., 1], w[..., 2])


# ---- The first-order flank as a linear map of many parameters: Jacobian, block evaluation, RMS by Gram factor (mm,
# rad).
#
# e1 at (k, theta, z) is a row of F(theta) = (n_x, n_y, h) times the A, B, G of (k, z): three numbers per wheel position
# carry the whole profile. So a column of the Jacobian, however many profile points there are, is three per (k, z).

FEW = 64  # parameters: below, one product with the Jacobian is faster than two with its factors
OFFSET, RADIUS = "dressing.offset", "dressing.radius"


@dataclass(frozen=True, slots=True)
class ErrorParameter:
    """One column: an error ("EXX", "B0Z"), an axis' command ("X") or a dressing value, times a basis function.

    ``basis`` takes the positions of the axes in ``over`` (own axis if empty), mm or rad; none means constant.
    """

    source: str
    basis: Callable[..., FloatArray] | None = None
    over: tuple[str, ...] = ()
    label: str = ""

    @property
    def name(self) -> str:
        """The label, or the source if there is none."""
        return self.label or self.source


@dataclass(frozen=True)
class LinearFlank:
    """e1 = J v over a grid. ``form`` (T, 3) is F; ``terms`` (K, 3, Z, P) the A, B, G of every parameter.

    Points are counted in C order of (K, T, Z).
    """

    grid: FlankGrid
    names: tuple[str, ...]
    form: FloatArray
    terms: FloatArray

    @property
    def points(self) -> int:
        """Number of flank points, K T Z."""
        return int(np.prod(self.grid.shape))

    def jacobian(self, spaces: slice = slice(None), out: FloatArray | None = None) -> FloatArray:
        """Rows of the Jacobian (points of those spaces, P), written into ``out`` if given."""
        terms = self.terms[spaces]
        _, T, Z = self.grid.shape
        P = terms.shape[-1]
        rows = np.empty((terms.shape[0] * T * Z, P)) if out is None else out
        np.matmul(self.form, terms.reshape(-1, 3, Z * P), out=rows.reshape(-1, T, Z * P))
        return rows

    def deviations(self, vectors: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """J v for vectors (P,) or (P, M): (points,) or (points, M), written into ``out`` (C order) if given."""
        wide = vectors.reshape(vectors.shape[0], -1)
        K, T, Z = self.grid.shape
        result = np.empty((self.points, wide.shape[1])) if out is None else out
        by_space = result.reshape(K, T * Z, -1)
        for k in range(K):
            if wide.shape[0] <= FEW:
                np.matmul(self.jacobian(slice(k, k + 1)), wide, out=by_space[k])
            else:
                np.matmul(self.form, (self.terms[k] @ wide).reshape(3, -1), out=by_space[k].reshape(T, -1))
        return result.reshape(self.points, *vectors.shape[1:])

    def normal_form(self, *, without_rotation: bool = False) -> RmsForm:
        """What is needed for the RMS of any vector, optionally after removing one rotation about the gear's axis."""
        root = np.asarray(np.linalg.qr(self.form, mode="r"))
        rows = np.ascontiguousarray(np.einsum("ic,kczp->kzip", root, self.terms))
        if without_rotation:
            lever = root[:, 2]
            share = np.einsum("i,kzip->p", lever, rows) / (rows.shape[0] * rows.shape[1] * float(lever @ lever))
            rows -= lever[:, None] * share
        factor = np.asarray(np.linalg.qr(rows.reshape(-1, rows.shape[-1]), mode="r"))
        return RmsForm(factor / np.sqrt(self.points))

    @cached_property
    def figure_form(self) -> RmsForm:
        """The RMS of the flank figure: one rotation removed."""
        return self.normal_form(without_rotation=True)


@dataclass(frozen=True, slots=True)
class RmsForm:
    """A triangular root of the Gram matrix J'J / N: RMS = |root v|, without the Gram matrix' loss of digits."""

    root: FloatArray

    @property
    def gram(self) -> FloatArray:
        """J'J / N, (P, P)."""
        return np.asarray(self.root.T @ self.root)

    def rms(self, vectors: FloatArray) -> FloatArray:
        """RMS (mm) of J v for vectors (P,) or (P, M): scalar array or (M,)."""
        image = self.root @ vectors
        return np.sqrt(np.einsum("i...,i...->...", image, image))


def linear_flank(grinding: Grinding, grid: FlankGrid, parameters: Sequence[ErrorParameter | str]) -> LinearFlank:
    """The linear map of those parameters on a grid; strings stand for constants.

    Raises ModelError E-CHAIN-ERROR-NAME for an unknown source.
    """
    wanted = [ErrorParameter(p) if isinstance(p, str) else p for p in parameters]
    k, z = grid.ks[:, None], grid.zs
    q = grinding.commands(k, z)
    influences = {influence.axis.name: influence for influence in grinding.chain.influences(q)}
    K, _, Z = grid.shape
    terms = np.empty((K, 3, Z, len(wanted)))
    known: dict[str, FloatArray] = {}
    for column, parameter in enumerate(wanted):
        source = parameter.source
        if source not in known:
            known[source] = np.broadcast_to(_source(grinding, influences, source, k, z), (K, Z, 3))
        weight = np.broadcast_to(_weight(grinding, parameter, q), (K, Z))
        terms[..., column] = np.moveaxis(known[source] * weight[..., None], -1, 1)
    section = grid.gear.section(grid.thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=-1)
    return LinearFlank(grid, tuple(p.name for p in wanted), form, terms)


def _source(
    grinding: Grinding, influences: dict[str, Influence], source: str, k: FloatArray, z: FloatArray
) -> FloatArray:
    """A, B, G per unit of a source, shape broadcastable to (K, Z, 3)."""
    if source in (OFFSET, RADIUS):
        return np.array([0.0, 1.0, 0.0] if source == OFFSET else [-1.0, 0.0, 0.0])
    if source in influences:
        twist = influences[source].command()
    else:
        axis, key, row = grinding.chain.error_column(source)
        influence = influences[axis]
        twist = (influence.motions if key in MOTIONS else influence.location)[..., row]
    return abg(to_space(grinding, k, twist), z)


def _weight(grinding: Grinding, parameter: ErrorParameter, q: Positions) -> FloatArray:
    if parameter.basis is None:
        return np.ones(())
    over = parameter.over or (_own_axis(grinding, parameter.source),)
    value = np.asarray(parameter.basis(*(position(q, name) for name in over)), dtype=np.float64)
    if not np.all(np.isfinite(value)):
        raise ModelError("E-CHAIN-MOTION", f"axis {over[0]}", motion=parameter.name, shape=value.shape, wanted="finite")
    return value


def _own_axis(grinding: Grinding, source: str) -> str:
    if any(axis.name == source for axis in grinding.chain.axes):
        return source
    return grinding.chain.error_place(source)[0]
