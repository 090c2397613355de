"""Product tables: corrections f(z) g(c) against errors that no sum of one-axis tables can reach (mm, rad).

Only for machines on which multiplication of tables was proved. The errors z EBC(c) and z EAC(c) are of
this kind: additive tables reduce them by nothing beyond their means. The flank is linear in f with g held and in g
with f held. The start is the leading singular vector of the correction wanted over all pairs of nodes, the best
product for places that fill the grid; then f and g are solved for in turn by least squares of minimum norm
(alternating least squares). Each half round lowers the RMS, so it converges; f is kept at size one, and it ends when
f stands still. Both factors are made equal in size, so that the resolution is used best; one is rounded, the other
solved for again and rounded. A product that gains less than WORTH of the RMS is not proposed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from gateway.correct.flank.flank_model import FlankModel, command_effects, flank_model, with_acting
from gateway.correct.flank.tables import Product, Table, TableGrid
from gateway.correct.plan.plan import Plan, table_spec
from gateway.correct.solve.constraints import nearest
from gateway.errors import ModelError
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding

ROUNDS = 40
SETTLED = 1e-9
WORTH = 0.02  # of the RMS: a product that gains less is not proposed


@dataclass(frozen=True)
class ProductResult:
    """A product table and the RMS (mm) of the flank without and with it."""

    product: Product
    before: float
    after: float


def best_product(
    grinding: Grinding, model: FlankModel, first: TableGrid, second: TableGrid, *, proved: bool, step: float = 0.0
) -> ProductResult | None:
    """The product first(.) second(.) that lowers the model's RMS most; None if it gains too little.

    Alternating least squares from the leading pattern of the wanted correction; ``step`` is the resolution of both
    factors (their unit), rounded with the other re-optimised. Raises ModelError E-CORRECT-UNPROVED without proof.
    """
    if not proved:
        raise ModelError("E-CORRECT-UNPROVED", first.out)
    places, out = model.places, first.out
    effect = command_effects(grinding, places)[out]
    q = grinding.commands(places.k, places.z)
    left, right = (grid.weights(np.broadcast_to(q[grid.over], places.k.shape)) for grid in (first, second))
    plain = replace(model, blocks=())
    before = plain.rms(np.zeros(0))
    f, g = _alternating_fit(plain, effect, left, right)
    if not (np.any(f) and np.any(g)):
        return None
    f, g = _balance_factors(f, g)
    if step > 0.0:
        f = np.rint(f / step) * step
        g = np.rint(_factor(plain, effect, left @ f, right) / step) * step
    product = Product(Table.of(first, f), Table.of(second, g))
    after = with_acting(plain, grinding, [product]).rms(np.zeros(0))
    return ProductResult(product, before, after) if after < (1.0 - WORTH) * before else None


def product_layer(grinding: Grinding, grid: FlankGrid, plan: Plan, *, proved: bool) -> tuple[ProductResult, ...]:
    """Products over stroke and index that still help a machine on which everything else acts, one per output axis.

    Each is judged with those before it acting. Raises ModelError E-CORRECT-UNPROVED without proof.
    """
    model = flank_model(grinding, grid)
    found: list[ProductResult] = []
    for out in (grinding.infeed, grinding.index):
        first, second = (table_spec(grinding.chain, plan, out, axis) for axis in (grinding.stroke, grinding.index))
        one = best_product(grinding, model, first.grid, second.grid, proved=proved, step=first.resolution)
        if one is not None:
            found.append(one)
            model = with_acting(model, grinding, [one.product])
    return tuple(found)


def _alternating_fit(
    model: FlankModel, effect: FloatArray, left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    g = _leading_factor(model, effect, left, right)
    f = np.zeros(left.shape[1])
    for _ in range(ROUNDS):
        f_new = _factor(model, effect, right @ g, left)
        size = float(np.max(np.abs(f_new), initial=0.0))
        if size == 0.0:
            return np.zeros_like(f), np.zeros_like(g)
        f_new = f_new / size
        g = _factor(model, effect, left @ f_new, right)
        if np.max(np.abs(f_new - f)) < SETTLED:
            break
        f = f_new
    return f_new, g


def _leading_factor(model: FlankModel, effect: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    """Second factor of the leading term of the wanted correction over all pairs of nodes."""
    pairs = np.einsum("gi,gj->gij", left, right).reshape(left.shape[0], -1)
    wanted = _solve(model, effect, pairs).reshape(left.shape[1], right.shape[1])
    return np.asarray(np.linalg.svd(wanted)[2][0])


def _factor(model: FlankModel, effect: FloatArray, other: FloatArray, share: FloatArray) -> FloatArray:
    return _solve(model, effect, other[:, None] * share)


def _solve(model: FlankModel, effect: FloatArray, share: FloatArray) -> FloatArray:
    """Least-squares values of unknowns whose correction at the places is ``share`` (G, m)."""
    columns = model.compressed(effect[:, :, None] * share[:, None, :])
    return nearest(columns, model.right, np.zeros(share.shape[1]))


def _balance_factors(f: FloatArray, g: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Both factors of the same size: the resolution of the controller is used best."""
    a, b = float(np.max(np.abs(f))), float(np.max(np.abs(g)))
    even = np.sqrt(b / a)
    return f * even, g / even
