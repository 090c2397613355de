"""What a machine's flank keeps when everything possible is done, and why (mm, rad).

At every wheel place the deviation is e = A n_x + B n_y + G h: A from the infeed, G from the index, B from what moves
the wheel along its own axis. A grinder with X, Z and C can make any A and G at any place, but no B: there is the
floor. It is told in steps, each by unlimited least squares on the same model: the machine as it is; set-up values and
mounting alone (constants, first harmonics); tables with a node at every place that occurs, since a real table does no
better; any correction at all, that is A and G free at each place. Part of B looks like G: a tangential shift of the
profile is nearly a rotation. Least squares over the profile gives the rotation per B (alpha) and the share of B that
then stays (eta): the odd rest that no command can take. Columns are scaled to one before they are solved, and
directions below SAME of the largest are none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um, rad_to_arcsec
from gateway.correct.flank.compensability import tangential_cure
from gateway.correct.flank.flank_model import FlankModel, SetupUnknown, UnknownsBlock, flank_model
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.flank.tables import TableGrid
from gateway.correct.solve.constraints import nearest
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding

SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Floor:
    """RMS (mm, one rotation removed) step by step: as it is, set-up values and mounting, tables, any products.

    ``products`` is the floor of the machine: the odd part of B, which no axis of an X-Z-C grinder can make.
    ``alpha_arcsec_per_um`` is what C gives for a tangential error B, ``eta`` the share of B that then stays.
    ``tangential`` is the RMS of B(z, c) n_y without its mean, before any C correction.
    """

    before: float
    setup: float
    tables: float
    products: float
    alpha_arcsec_per_um: float
    eta: float
    tangential: float


def floor(grinding: Grinding, grid: FlankGrid, *, dressing: bool = True, mounting: bool = True) -> Floor:
    """The floor of a machine (first order; relevant floors are far below where second order counts)."""
    x, z, c = grinding.infeed, grinding.stroke, grinding.index
    setup = [SetupUnknown(x), SetupUnknown(c), *([SetupUnknown("")] if dressing else [])]
    over_z = np.unique(np.round(grinding.commands(0.0, grid.zs)[z], 9))
    over_c = np.unique(np.round(grinding.commands(grid.ks, 0.0)[c], 12))
    tables = [TableGrid(out, over, nodes) for out in (x, c) for over, nodes in ((z, over_z), (c, over_c))]
    before = flank_model(grinding, grid).rms(np.zeros(0))
    whole = flank_model(grinding, grid, tables, setup)
    if mounting:
        whole = replace(whole, blocks=(*whole.blocks, *_mounting_blocks(grinding, whole)))
    cure = tangential_cure(grid.gear, grid.thetas)
    return Floor(
        before=before,
        setup=_residual_rms(whole.without([one.name for one in tables])),
        tables=_residual_rms(whole),
        products=_any_product(whole),
        alpha_arcsec_per_um=rad_to_arcsec(cure.dc_per_B) / mm_to_um(1.0),
        eta=cure.eta,
        tangential=_tangential(whole),
    )


def _residual_rms(model: FlankModel) -> float:
    """RMS that the best values leave."""
    rows = model.rows
    size = np.linalg.norm(rows, axis=0)
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > SAME * float(np.max(size, initial=0.0)))
    x = nearest(rows * scale, model.right, np.zeros(model.size)) * scale
    return model.rms(x)


def _mounting_blocks(grinding: Grinding, model: FlankModel) -> list[UnknownsBlock]:
    terms = mounting_terms(grinding, model.places)
    names = ("eccentricity x", "eccentricity y", "tilt a", "tilt b")
    one = np.ones((model.places.k.size, 1))
    return [UnknownsBlock(name, None, terms[:, :, i], one) for i, name in enumerate(names)]


def _any_product(model: FlankModel) -> float:
    """RMS with A and G free at every place: B keeps what G and the set-up values cannot take over."""
    e = model.start()
    rest = e - _correctable_part(model, e)
    ways = [model.places.along_normal(block.effect) for block in model.blocks if block.grid is None]
    columns = np.stack([way - _correctable_part(model, way) for way in ways], axis=-1)
    before = np.array([float(np.linalg.norm(way)) for way in ways])
    size = np.linalg.norm(columns, axis=0)
    used = columns[:, size > SAME * before] / size[size > SAME * before]
    if used.shape[1]:
        rest = rest - used @ np.linalg.lstsq(used, rest, rcond=SAME)[0]
    return float(np.sqrt(np.mean(rest**2)))


def _correctable_part(model: FlankModel, e: FloatArray) -> FloatArray:
    """The part of e that A n_x + G h can make, place by place."""
    places, form = model.places, model.places.form[:, [0, 2]]
    grams, moments = np.zeros((places.k.size, 2, 2)), np.zeros((places.k.size, 2))
    np.add.at(grams, places.of, form[:, :, None] * form[:, None, :])
    np.add.at(moments, places.of, form * e[:, None])
    values = np.einsum("gij,gj->gi", np.linalg.pinv(grams, hermitian=True), moments)
    return np.asarray(np.einsum("ni,ni->n", form, values[places.of]))


def _tangential(model: FlankModel) -> float:
    B = model.base[:, 1]
    only = np.zeros_like(model.base)
    only[:, 1] = B - np.mean(B)
    return float(np.sqrt(np.mean(model.places.along_normal(only) ** 2)))
