"""From measured files to figures and error motions: the functions of a run, for one file at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError
from drivers.types.results import MeasuredSet
from drivers.units import AxisUnit, DeviationUnit, deviation_unit
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.evaluate.standards.readings import checked, counts, means, standard_deviations
from gateway.evaluate.standards.registry import evaluate_by
from gateway.model.components import standard_uncertainty, value
from gateway.model.means import fit_means
from trueflank.frames import frame

SHOWN = {"um": "µm", "arcsec": "arcsec"}


@dataclass(frozen=True, slots=True, repr=False)
class Measured:
    """Deviations (m, n, 2) in um or arcsec at targets (m,) in mm or deg: repetition, then approach + and -.

    NaN where a reading is missing. ``source`` is the file; ``warnings`` say what it leaves in doubt.
    """

    targets: FloatArray
    deviations: FloatArray
    axis_unit: AxisUnit
    source: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the deviations: um over mm, arcsec over deg."""
        return deviation_unit(self.axis_unit)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; a missing reading is None."""
        there = self.deviations.astype(object)
        there[~np.isfinite(self.deviations)] = None
        return {
            "targets": self.targets.tolist(),
            "deviations": there.tolist(),
            "axis_unit": self.axis_unit,
            "unit": self.unit,
            "source": self.source,
            "warnings": list(self.warnings),
        }

    def to_pandas(self) -> Any:
        """One row a reading: target, approach, repetition, deviation. Raises ConfigError (E-LIBRARY-PANDAS)."""
        at, turn, way = np.nonzero(np.isfinite(self.deviations))
        return frame(
            {
                f"target_{self.axis_unit}": self.targets[at],
                "approach": np.where(way == 0, "+", "-"),
                "repetition": turn + 1,
                f"deviation_{self.unit}": self.deviations[at, turn, way],
            }
        )

    def __repr__(self) -> str:
        m, n, _ = self.deviations.shape
        low, high = float(self.targets[0]), float(self.targets[-1])
        where = f" from {self.source}" if self.source else ""
        return f"Measured({m} targets x {n} repetitions, {low:g} .. {high:g} {self.axis_unit}{where})"


def read(path: str | Path, *, unit: str = "") -> Measured:
    """A result file (.rtl, .rta, .pos, .csv) with its positions as the file counts them.

    ``unit`` of an .rta file's deviations, which it does not say: mrad, urad or arcsec. Raises ConfigError,
    FileFormatError with line and reason.
    """
    from gateway.workflow.files.importing import How, read_file

    found = read_file(Path(path), How(unit)).content
    if not isinstance(found, MeasuredSet):
        raise ConfigError("E-CLI-KIND", str(path), kind=type(found).__name__)
    return Measured(found.targets, found.deviations, found.axis_unit, Path(path).name, warnings=tuple(found.warnings))


@dataclass(frozen=True, slots=True, repr=False)
class Evaluated:
    """Figures by name (A, E, R, B, M ...) with expanded uncertainties ``U`` (k = 2), um or arcsec; None: not to be had.

    U holds the scatter of the readings; what is unknown of the instrument is not in a file.
    """

    standard: str
    unit: DeviationUnit
    values: dict[str, float | None]
    U: dict[str, float | None]
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> float | None:
        return self.values[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "standard": self.standard,
            "unit": self.unit,
            "values": dict(self.values),
            "U": dict(self.U),
            "notes": list(self.notes),
        }

    def to_pandas(self) -> Any:
        """One row a figure. Raises ConfigError (E-LIBRARY-PANDAS)."""
        names = list(self.values)
        return frame({"figure": names, "value": list(self.values.values()), "U": [self.U.get(name) for name in names]})

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value:.3f}" for name, value in self.values.items() if value is not None)
        return f"Evaluated({self.standard}: {told} {SHOWN[self.unit]})"


def evaluate(measured: Measured, standard: str = "2014", *, monte_carlo: bool = False, seed: int = 1) -> Evaluated:
    """Figures to ISO 230-2 (edition 2014, 2006, 1997, 1988) or another standard by name; U by law or by Monte Carlo.

    Raises ModelError as `gateway.evaluate.standards.registry.evaluate_by`.
    """
    found = evaluate_by(
        standard, measured.targets, measured.deviations, measured.unit, seed=seed, monte_carlo=monte_carlo
    )
    return Evaluated(
        standard=found.standard.name,
        unit=found.unit,
        values=dict(found.values),
        U=dict(found.U),
        notes=(*found.flags, *measured.warnings),
    )


@dataclass(frozen=True, slots=True, repr=False)
class ErrorMotion:
    """A fitted error motion, um or arcsec over mm or deg; call it with positions of any shape."""

    component: Component

    @property
    def name(self) -> str:
        """Its ISO 230-1 name."""
        return self.component.name

    @property
    def unit(self) -> DeviationUnit:
        """Unit of its values."""
        return self.component.unit

    def __call__(self, positions: ArrayLike) -> FloatArray:
        """Values at positions (mm or deg)."""
        return value(self.component, positions)

    def u(self, positions: ArrayLike) -> FloatArray:
        """Standard uncertainty of the fit at positions, from the scatter of the readings."""
        return standard_uncertainty(self.component, positions)

    def points(self, count: int = 51) -> tuple[FloatArray, FloatArray]:
        """Equally spaced positions over the measured range and the values there, each (count,)."""
        at = np.linspace(*self.component.domain, count)
        return at, self(at)

    def to_dict(self) -> dict[str, Any]:
        """Plain data: basis, coefficients and the curve at 51 positions."""
        at, values = self.points()
        return {
            "name": self.name,
            "unit": self.unit,
            "basis": self.component.basis,
            "coefficients": self.component.coefficients.tolist(),
            "positions": at.tolist(),
            "values": values.tolist(),
        }

    def to_pandas(self) -> Any:
        """Position, value and standard uncertainty. Raises ConfigError (E-LIBRARY-PANDAS)."""
        at, values = self.points()
        return frame({f"position_{self.component.axis_unit}": at, f"{self.name}_{self.unit}": values, "u": self.u(at)})

    def __repr__(self) -> str:
        _, values = self.points()
        return f"ErrorMotion({self.name}: {self.component.basis}, range {np.ptp(values):.3f} {SHOWN[self.unit]})"


def fit(
    measured: Measured, name: str, *, kind: Literal["linear", "rotary", ""] = "", modulo: bool = False
) -> ErrorMotion:
    """The curve of a measured axis, as a run fits it: the mean of both directions, order chosen by the data.

    ``name`` is the error's ISO 230-1 name; ``modulo`` for an axis that turns endlessly. Raises ModelError,
    NotIdentifiable (E-MODEL-POINTS).
    """
    at, x = checked(measured.targets, measured.deviations)
    way, s, n = means(x), standard_deviations(x), counts(x)
    both = np.nanmean(way, axis=1)
    scatter = float(np.sqrt(np.nanmean(s**2))) if np.isfinite(s).any() else 0.0
    u = np.maximum(scatter / np.sqrt(np.maximum(n.sum(axis=1), 1)), 1e-3)
    chosen: Literal["linear", "rotary"] = kind or ("rotary" if measured.axis_unit == "deg" else "linear")
    return ErrorMotion(
        fit_means(at, both, u, name=name, axis=name[-1:], axis_unit=measured.axis_unit, kind=chosen, modulo=modulo)
    )


def report(run: str | Path, store: str | Path = "runs") -> Path:
    """Write a stored run's report again; the path of its HTML page. ``run`` is a folder, an id or "latest"."""
    from gateway.store import Store
    from gateway.workflow.results.reporting import write_report

    return Path(write_report(Store(Path(store)).open(run)).html)
