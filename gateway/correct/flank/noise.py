"""What a correction is worth against its uncertainty: one that corrects less than it may be wrong is left alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from gateway.correct.flank.flank_model import FlankModel
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE
from gateway.gear.first_order import ErrorParameter, linear_flank
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain
from gateway.model.motion import motion_from

SMALL = 1e-12  # of the largest variance
RANK = 1e-8  # of a column: what is no direction of its own


@dataclass(frozen=True)
class FitNoise:
    """How the errors may be wrong: independent patterns (G, 3, S) of one standard uncertainty each (A, B, G at the
    places), and the standard uncertainty of a single point (mm) where deviations were measured point by point."""

    patterns: FloatArray | None = None
    point: float = 0.0

    @property
    def none(self) -> bool:
        """True if nothing is known of the uncertainty."""
        return self.point == 0.0 and (self.patterns is None or not self.patterns.size)

    def rows(self, model: FlankModel) -> FloatArray:
        """The patterns (R, S) in the model's coordinates."""
        if self.patterns is None or not self.patterns.size:
            return np.zeros((model.height, 0))
        return model.compressed(self.patterns)


@dataclass(frozen=True, slots=True)
class OmittedCorrection:
    """A table or set-up value that is not proposed: what it would gain and the uncertainty (k = 2) of that, mm RMS.

    ``idle``: it would hold single steps only and gain next to nothing.
    """

    name: str
    gain: float
    U: float
    idle: bool = False


def noise_patterns(
    grinding: Grinding, grid: FlankGrid, uncertain: Sequence[tuple[ErrorParameter | str, float]]
) -> FitNoise:
    """Noise of errors known to standard uncertainties (mm, rad), each independent of the others."""
    if not uncertain:
        return FitNoise()
    flank = linear_flank(grinding, grid, [parameter for parameter, _ in uncertain])
    K, _, Z = grid.shape
    terms = np.moveaxis(flank.terms, 1, 2).reshape(K * Z, 3, -1)
    return FitNoise(terms * np.array([u for _, u in uncertain]))


def component_doubts(components: Sequence[Component]) -> list[tuple[ErrorParameter | str, float]]:
    """How fitted components (named EXX, EYC, ...) may be wrong: independent shapes from the covariance of each fit."""
    found: list[tuple[ErrorParameter | str, float]] = []
    for component in components:
        variances, vectors = np.linalg.eigh(component.covariance)
        for variance, vector in zip(variances, vectors.T, strict=True):
            if variance > SMALL * float(np.max(variances, initial=0.0)) > 0.0:
                shape = motion_from(replace(component, coefficients=np.sqrt(variance) * vector))
                found.append((ErrorParameter(component.name, shape if callable(shape) else None), 1.0))
    return found


def significant_tables(model: FlankModel, noise: FitNoise) -> tuple[FlankModel, tuple[OmittedCorrection, ...]]:
    """The model without the blocks that would correct less than their uncertainty, the weakest taken out first.

    What a block adds to the others decides: a table to the other tables and all set-up values, a set-up value to the
    other set-up values alone. So a constant that both could take is the set-up value's, and a table is not judged by
    a doubt that a set-up value takes. Without any known uncertainty everything stays.
    """
    if noise.none:
        return model, ()
    short = _Short.of(model, noise)
    setup = [block.name for block in model.blocks if block.grid is None]
    tables = [block.name for block in model.blocks if block.grid is not None]
    omitted = (*_weak(short, tables), *_weak(short.without(*tables), setup))
    return model.without([one.name for one in omitted]), omitted


def _weak(short: _Short, names: Sequence[str]) -> tuple[OmittedCorrection, ...]:
    """Those of the names that are not worth it."""
    left, omitted = list(names), []
    while left:
        weakest = min((short.worth(name) for name in left), key=_ratio)
        if weakest.gain > weakest.U:
            break
        omitted.append(weakest)
        left.remove(weakest.name)
        short = short.without(weakest.name)
    return tuple(omitted)


def propagated_rms(model: FlankModel, noise: FitNoise) -> float:
    """RMS (mm) that the errors' uncertainty puts on the flank through the corrections."""
    basis = _basis(model.rows)
    square = float(np.sum((basis.T @ noise.rows(model)) ** 2)) + noise.point**2 * basis.shape[1]
    return float(np.sqrt(square / model.places.points))


@dataclass(frozen=True)
class _Short:
    """Columns of each block, the errors and their doubts in as few rows as carry them."""

    columns: dict[str, FloatArray]
    right: FloatArray
    doubts: FloatArray
    point: float
    points: int

    @staticmethod
    def of(model: FlankModel, noise: FitNoise) -> _Short:
        doubts = noise.rows(model)
        whole = np.concatenate([model.rows, doubts, model.right[:, None]], axis=1)
        short = np.asarray(np.linalg.qr(whole, mode="r"))
        width = model.size
        columns = {name: short[:, span] for name, span in model.spans.items()}
        return _Short(columns, short[:, -1], short[:, width:-1], noise.point, model.places.points)

    def without(self, *names: str) -> _Short:
        return replace(self, columns={key: value for key, value in self.columns.items() if key not in names})

    def worth(self, name: str) -> OmittedCorrection:
        """What a block adds to all the others."""
        others = [value for key, value in self.columns.items() if key != name]
        rest = _basis(np.concatenate(others, axis=1) if others else np.zeros((self.right.size, 0)))
        whole = self.columns[name]
        basis = _basis(whole - rest @ (rest.T @ whole), np.linalg.norm(whole, axis=0))
        gain = float(np.sum((basis.T @ self.right) ** 2))
        doubt = float(np.sum((basis.T @ self.doubts) ** 2)) + self.point**2 * basis.shape[1]
        return OmittedCorrection(
            name, float(np.sqrt(gain / self.points)), COVERAGE * float(np.sqrt(doubt / self.points))
        )


def _ratio(one: OmittedCorrection) -> float:
    return one.gain / one.U if one.U > 0.0 else (np.inf if one.gain > 0.0 else 0.0)


def _basis(columns: FloatArray, sizes: FloatArray | None = None) -> FloatArray:
    """Orthonormal basis of columns, each first divided by its size so that mm and rad count alike."""
    sizes = np.linalg.norm(columns, axis=0) if sizes is None else sizes
    used = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not used.shape[1]:
        return np.zeros((columns.shape[0], 0))
    u, s, _ = np.linalg.svd(used, full_matrices=False)
    return np.asarray(u[:, s > RANK])


# ---- Smooth shapes by which an error motion may be wrong: Legendre polynomials over a travel, harmonics of a turn.


@dataclass(frozen=True, slots=True)
class Shape:
    """A smooth shape of RMS 1: a Legendre polynomial over a travel, or a harmonic of the turn."""

    order: int
    low: float
    high: float
    turning: bool

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        if self.turning:
            wave = np.cos if self.order % 2 else np.sin
            return np.asarray(np.sqrt(2.0) * wave(((self.order + 1) // 2) * q))
        x = np.clip((2.0 * q - self.low - self.high) / (self.high - self.low), -1.0, 1.0)
        one = np.zeros(self.order + 1)
        one[self.order] = 1.0
        return np.asarray(np.sqrt(2.0 * self.order + 1.0) * np.polynomial.legendre.legval(x, one))


def shapes_over(chain: Chain, axis: str, travel: tuple[float, float]) -> list[Shape]:
    """First and second order over a travel (mm), or two harmonics around the turn."""
    if chain.axis(axis).kind == "revolute":
        return [Shape(order, 0.0, 0.0, turning=True) for order in (1, 2, 3, 4)]
    return [Shape(order, *travel, turning=False) for order in (1, 2)]
