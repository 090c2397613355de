"""What an evaluation of measured files asks and answers, whatever its kind."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.message import Message
from drivers.types.results import MeasuredSet
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.behaviour.repetitions import mean_of_both
from gateway.evaluate.standards.conformity import Decision, decide

MANY = range(1, 33)


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    """A measured set and what people call it."""

    label: str
    measured: MeasuredSet


@dataclass(frozen=True, slots=True)
class KindQuestion:
    """What the files cannot say: machine axis, which angle, plane of a squareness, harmonics, sensors' distance.

    ``artefact_arcsec`` is the square's own angle less 90 deg; ``distance_mm`` between two sensors of a tilt;
    ``offset_mm`` of a point from what an instrument with six channels measured. ``senses`` say which way the readings
    count: of a squareness one of `COUNTINGS` a file, of a parallelism "same" or "opposite".
    """

    axis: str = ""
    angle: str = ""
    plane: str = "XY"
    orders: tuple[int, ...] = ()
    artefact_arcsec: float = 0.0
    distance_mm: float = 0.0
    motion: str = "radial"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    senses: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure with its expanded uncertainty (k = 2), None where nothing is known of it."""

    name: str
    value: float
    unit: str
    U: float | None = None


@dataclass(frozen=True, slots=True)
class Drawn:
    """A curve of the picture: ``y`` (m,) over ``x`` (m,)."""

    label: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True, slots=True)
class KindAnswer:
    """Figures, curves on one scale, and notes; ``standard`` says where the formulas come from.

    ``fitted``: the figures are slopes, so each curve is drawn with its line. ``simulated``: a double took part.
    """

    kind: str
    standard: str
    figures: tuple[Figure, ...]
    curves: tuple[Drawn, ...]
    axes: tuple[str, str]
    polar: bool = False
    notes: tuple[Message, ...] = ()
    simulated: bool = False
    fitted: bool = False

    def decided(self, limits: Mapping[str, float]) -> tuple[tuple[Decision, str], ...]:
        """Verdict and unit of each figure that a limit names: whole, or by its last word, then in every file.

        Raises ModelError (E-EVAL-LIMIT-NAME, E-EVAL-LIMIT).
        """
        figures = {one.name: one for one in reversed(self.figures)}
        found = []
        for asked, limit in limits.items():
            named = [one for name, one in reversed(figures.items()) if name == asked or name.endswith(f" {asked}")]
            if not named:
                known = ", ".join(one.name for one in self.figures)
                raise ModelError("E-EVAL-LIMIT-NAME", self.kind, parameter=asked, known=known)
            found += [(decide(one.name, one.value, one.U, limit), one.unit) for one in named]
        return tuple(found)

    def as_data(self) -> dict[str, Any]:
        """For --json; what is not known is null."""
        return {
            "kind": self.kind,
            "standard": self.standard,
            "figures": [
                {"name": one.name, "value": one.value, "U": _is_known(one.U), "unit": one.unit} for one in self.figures
            ],
            "curves": [{"label": one.label, "x": one.x.tolist(), "y": one.y.tolist()} for one in self.curves],
            "notes": list(map(str, self.notes)),
            "simulated": self.simulated,
        }


def _is_known(U: float | None) -> float | None:
    return U if U is not None and np.isfinite(U) else None


def count_of(kind: str, files: tuple[MeasuredFile, ...], wanted: str | Message, counts: Container[int] = MANY) -> None:
    """Raises ModelError (E-KIND-FILES) for another count of files than the kind needs."""
    if len(files) not in counts:
        raise ModelError("E-KIND-FILES", kind, found=len(files), wanted=wanted)


def unit_of(kind: str, files: tuple[MeasuredFile, ...], unit: str) -> None:
    """Raises ModelError (E-KIND-UNIT) where a file's deviations are not in the unit (um or arcsec)."""
    for one in files:
        found = "um" if one.measured.axis_unit == "mm" else "arcsec"
        if found != unit:
            raise ModelError("E-KIND-UNIT", one.label, kind=kind, found=found, wanted=unit)


def means(measured: MeasuredSet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Targets (k,), mean of both directions (k,) and its standard uncertainty; empty targets are left out.

    A target read in one direction alone makes no kink (`mean_of_both`).

    The uncertainty is the pooled scatter of the readings about the mean of their own direction; NaN without repeats.
    """
    readings = measured.deviations.reshape(measured.deviations.shape[0], -1)
    there = np.isfinite(readings).any(axis=1)
    at = measured.targets[there]
    kept = measured.deviations[there]
    counts = np.isfinite(kept).sum(axis=1)
    sums = np.where(np.isfinite(kept), kept, 0.0).sum(axis=1)
    way = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)
    mean = mean_of_both(way[:, 0], way[:, 1])
    residual = kept - way[:, None, :]
    free = float(np.maximum(counts - 1, 0).sum())
    if free == 0.0:
        return at, mean, np.full(at.size, np.nan)
    scatter = float(np.sqrt(np.nansum(residual**2) / free))
    return at, mean, scatter / np.sqrt(counts.sum(axis=1))
