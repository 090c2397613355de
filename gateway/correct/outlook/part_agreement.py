"""A part that was ground before anything is written, against the flank that the fitted errors foretell for it; pure.

Both flanks lie on the judged grid and are compared point by point, as the verdict compares a part with its prediction:
the RMS of their difference over its standard uncertainty. Before that everything is taken off which a part has and the
model has not, by least squares: x zero, dressing offset, one rotation, eccentricity and tilt of its clampings. What is
left is doubted by the errors, the shop and the scatter of the inspection.

Which single error explains a difference is told by generalised least squares over the first-order patterns of all 21:
d = c p, where p is what an error does to the flank by the model. c = -2 is a reversed sign, -1 an error that the part
does not have, others another size. Of the first harmonics of a rotary axis' radial (or tilting) pair those that turn
with it are taken off as the set-up's eccentricity: with one reading of the pair reversed it is the others that were
taken off. So a reversed one of a pair leaves them open. The doubts' covariance weighs: what the doubts could make as
well explains little. An error that leaves most of the difference on the flank does not explain it: a pit in the face is
no error of the machine, and the part is inspected again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.flank_model import FlankModel, Places, command_effects, places_of_grid
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.outlook.flank_uncertainty import (
    FlankDoubts,
    ProcessUncertainty,
    part_specific_doubts,
    persistent_doubts,
)
from gateway.correct.outlook.prediction import flank_map, less, rows_of
from gateway.correct.outlook.ranking import errors_of
from gateway.correct.plan.plan import Plan
from gateway.gear.first_order import ErrorParameter, linear_flank
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import with_corrected_setup
from gateway.model.error_model import ErrorModel
from gateway.model.motion import Fourier
from gateway.tooth import Explanation, FlankAgreement, FlankMap, InspectedFlank

LEAST_UM = 0.05  # of scatter: what first order, heights between the measured ones and rounding leave
PLACE = 3  # values fitted at each place: A, B, G
MOST = 4.0  # times an error: a difference that large is no error measured wrong
FREE = 4.0  # chi-square that a factor of its own must be better by than a reversed or an absent error
APART = 9.0  # chi-square by which two explanations are told apart
LIKELY = 16.0  # chi-square that an explanation must be better by than none: by chance in one of 20 000 honest machines
LEFT = 0.7  # of the difference (RMS): what leaves more explains less than half of its power, as of a pit in the face
SMALL_UM = 0.01  # of a pattern (RMS): what shows less on a flank explains nothing
REVERSED, ABSENT = -2.0, -1.0
ABOUT = 0.7  # of a factor: levers that were taken off with a reversed angle make it another than -2
RANK = 1e-8
PAIRS = (("EXC", "EYC"), ("EAC", "EBC"))
How = Literal["reversed", "absent", "factor"]
SIMPLE: tuple[How, ...] = ("reversed", "absent", "factor")
Weighed = tuple[float, Explanation]
"""Chi-square that an explanation leaves, and the explanation."""


def compare_part(
    grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel, shop: ProcessUncertainty, part: InspectedFlank
) -> FlankAgreement:
    """Whether a part ground on this machine, with the tables that acted while it was measured, is as the model says.

    ``part`` was fitted on ``grid``.
    """
    places = places_of_grid(grid)
    own = _own_ways(grinding, places)
    doubt = less(
        persistent_doubts(grinding, grid, plan=plan, model=model, shop=shop).plus(
            part_specific_doubts(grinding, grid, shop)
        ),
        own,
    )
    seen = _FlankExplainer.of(doubt, own, _scatter(part))
    ground, modelled = (
        seen.rows(flank)
        for flank in (with_corrected_setup(part.fitted, grid.gear, part.turned_arcsec), flank_map(grinding, grid))
    )
    rest = ground - modelled
    errors = [one.parameter for one in errors_of(grinding, plan, model)]
    shapes = _patterns(grinding, grid, errors, own)
    turning = {names: _patterns(grinding, grid, _first_harmonics(names), own) for names in PAIRS}
    found = seen.explained(rest, shapes, model.measured, {name: turning[pair] for pair in PAIRS for name in pair})
    sizes = (seen.rms(one) for one in (rest, ground, modelled))
    missed, of_part, of_model = sizes
    return FlankAgreement(part.part, missed, seen.u_um, part_um=of_part, model_um=of_model, explanations=found)


def _first_harmonics(names: tuple[str, ...]) -> list[ErrorParameter]:
    """Both phases of each error's first harmonic."""
    phases = {"cos": Fourier(0.0, (1.0,), (0.0,)), "sin": Fourier(0.0, (0.0,), (1.0,))}
    return [ErrorParameter(name, shape, label=f"{name} {key}") for name in names for key, shape in phases.items()]


def _own_ways(grinding: Grinding, places: Places) -> list[FloatArray]:
    """A, B, G (G, 3) of all that belongs to one part and not to the machine."""
    infeed = command_effects(grinding, places)[grinding.infeed]
    offset, turn = (np.broadcast_to(np.eye(3)[row], infeed.shape) for row in (1, 2))
    mounted = mounting_terms(grinding, places)
    return [infeed, offset, turn, *np.moveaxis(mounted, -1, 0)]


def _scatter(part: InspectedFlank) -> float:
    """Standard uncertainty (RMS, um) of the fitted flank by the scatter of the points; its clamping is fitted out."""
    points = part.k.size
    if not points:
        return part.rms_u_um
    return float(np.hypot(part.u_um * (PLACE * part.place_k.size / points) ** 0.5, LEAST_UM))


def _patterns(
    grinding: Grinding, grid: FlankGrid, errors: Sequence[ErrorParameter], own: list[FloatArray]
) -> dict[str, FloatArray]:
    """What each error does to the flank, in rows (R,), um, without what belongs to the part."""
    places = places_of_grid(grid)
    terms = np.moveaxis(linear_flank(grinding, grid, errors).terms, 1, 2).reshape(places.k.size, 3, len(errors))
    names = tuple(one.name for one in errors)
    rows = np.asarray(mm_to_um(rows_of(less(FlankDoubts(places, names, terms), own))))
    return dict(zip(names, rows.T, strict=True))


@dataclass(frozen=True)
class _FlankExplainer:
    """Flanks in rows (R,) whose sum of squares is that of the points, um, without ``own``; what doubts each row."""

    plain: FlankModel
    own: FloatArray
    doubts: FloatArray
    scatter: float

    @classmethod
    def of(cls, doubt: FlankDoubts, own: list[FloatArray], scatter_um: float) -> _FlankExplainer:
        places = doubt.places
        plain = FlankModel(places, np.zeros((places.k.size, 3)), np.zeros(places.points), (), turning=False)
        rows = plain.compressed(np.stack(own, axis=-1))
        basis = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))[0]
        return cls(plain, basis, np.asarray(mm_to_um(rows_of(doubt))), scatter_um)

    @property
    def u_um(self) -> float:
        """Standard uncertainty (RMS) of a difference."""
        return float(np.hypot(np.sqrt(np.sum(self.doubts**2) / self.plain.places.points), self.scatter))

    def rows(self, flank: FlankMap) -> FloatArray:
        """A flank (K, T, Z) without what belongs to the part."""
        found = self.plain.compressed(np.zeros_like(self.plain.base), flank.deviation_um.ravel())
        return np.asarray(found - self.own @ (self.own.T @ found))

    def explained(
        self,
        rest: FloatArray,
        shapes: Mapping[str, FloatArray],
        measured: Collection[str],
        turning: Mapping[str, Mapping[str, FloatArray]],
    ) -> tuple[Explanation, ...]:
        """The best explanations of a difference (R,), the best one first and those that are as good.

        ``shapes`` are the errors' patterns, ``turning`` what a reversed one leaves open beside, both in rows.
        """
        variance = self.scatter**2 * self.plain.places.points / rest.size
        root = np.asarray(np.linalg.cholesky(self.doubts @ self.doubts.T + variance * np.eye(rest.size)))
        every: list[Weighed] = []
        for name, shape in shapes.items():
            if self.rms(shape) >= SMALL_UM:
                every += self._try_sizes(rest, name, shape, root=root, known=name in measured)
            if self.rms(shape) >= SMALL_UM and name in turning and name in measured:
                every.append(self._try_reversed(rest, name, shape, root=root, beside=turning[name]))
        every = [pair for pair in every if pair[1].left_um <= LEFT * self.rms(rest)]
        nothing = float(np.sum(_whitened(root, rest) ** 2))
        best = min((chi for chi, _ in every), default=nothing)
        if best > nothing - LIKELY:
            return ()
        good = sorted((pair for pair in every if pair[0] <= best + APART), key=lambda pair: pair[0])
        names = dict.fromkeys(one.error for _, one in good)
        return tuple(_simplest_explanation([one for _, one in good if one.error == name]) for name in names)

    def _try_sizes(
        self, rest: FloatArray, name: str, shape: FloatArray, *, root: FloatArray, known: bool
    ) -> Iterator[Weighed]:
        """An error of another size; one that was measured (``known``) also reversed, and absent."""
        heavy = _whitened(root, shape)
        u = float(heavy @ heavy) ** -0.5
        free = float(np.clip(_whitened(root, rest) @ heavy * u**2, -MOST, MOST))
        turned = abs(free - REVERSED) <= ABOUT
        factors: list[tuple[How, float]] = [("reversed" if turned else "factor", free)]
        factors += [("reversed", REVERSED), ("absent", ABSENT)] if known else []
        for how, factor in factors:
            left = rest - factor * shape
            chi = float(np.sum(_whitened(root, left) ** 2)) + (FREE if factor == free else 0.0)
            yield chi, Explanation(name, how, factor=factor, u=u, left_um=self.rms(left))

    def _try_reversed(
        self, rest: FloatArray, name: str, shape: FloatArray, *, root: FloatArray, beside: Mapping[str, FloatArray]
    ) -> Weighed:
        """A reversed one of a pair, with the pair's first harmonics as they fit best."""
        ways = np.stack(list(beside.values()), axis=1)
        left = rest - REVERSED * shape
        left = left - ways @ np.linalg.lstsq(_whitened(root, ways), _whitened(root, left), rcond=RANK)[0]
        heavy = _whitened(root, shape)
        u = float(heavy @ heavy) ** -0.5
        chi = float(np.sum(_whitened(root, left) ** 2)) + FREE
        return chi, Explanation(name, "reversed", factor=REVERSED, u=u, left_um=self.rms(left))

    def rms(self, rows: FloatArray) -> float:
        """RMS of a flank in rows."""
        return float(np.sqrt(rows @ rows / self.plain.places.points))


def _simplest_explanation(same: Sequence[Explanation]) -> Explanation:
    """Of explanations by one error that are as good the one that asks least of it."""
    return next((one for how in SIMPLE for one in same if one.how == how), same[0])


def _whitened(root: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows that the doubts make with a standard uncertainty of one, each independent of the others."""
    return np.asarray(scipy.linalg.solve_triangular(root, rows, lower=True))
