"""From measured files to figures and error motions: the functions of a run, for one file at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError, words
from drivers.local.names import shown
from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import AxisUnit, DeviationUnit, deviation_unit
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, FloatArray, component_unit
from gateway.evaluate.behaviour.doubts import accept_doubts, all_doubts, as_data, demand_settled
from gateway.evaluate.behaviour.doubts import describe_doubts as told_doubts
from gateway.evaluate.behaviour.positioning import Surroundings, describe_contributions, evaluate_positioning
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.standards.statistics import check_readings
from gateway.model.components import TURN_DEG, is_periodic, standard_uncertainty, value
from gateway.model.fit import SMALLEST_U
from gateway.model.waves import fit_means
from gateway.study.inputs import function_of
from trueflank.benches import DriveTest, EvaluatedDrive, evaluated_bench
from trueflank.frames import frame
from trueflank.given import (
    ASKS,
    axis_unit_of,
    motion_name,
    numbers_given,
    of_kind,
    path_given,
    real_given,
    units_fit,
    wholes_given,
)

AIR = ("air_degc", "pressure_hpa", "humidity_pct")
SHOWN = {"um": "µm", "arcsec": "arcsec"}


@dataclass(frozen=True, slots=True, repr=False)
class Measured:
    """Deviations (m, n, 2) in um or arcsec at targets (m,) in mm or deg: repetition, then approach + and -.

    Deviation = measured - target. NaN where a reading is missing. ``source`` is the file, ``warnings`` say what it
    leaves in doubt. ``name`` is the error's ISO 230-1 name where it is known: EBX is in arcsec over mm. Lists are taken
    too. ``material_degc`` and ``expansion_ppm_per_k`` of the scale as the file has them. ``doubts`` are records of what
    file and readings leave in doubt: a blocking one refuses `fit` until ``accepted`` has its code and a reason.
    ``stated`` is what the file says of itself, by machine, serial, operator, place, date, feed, dwell, overrun,
    instrument, instrument_serial, tables, warm_up, customer, order; ``conditions`` are its sensors at the start, and
    with ``_end`` at the end: air_degc, pressure_hpa, humidity_pct, material_degc. ``record`` is all that was read.
    Raises ModelError (E-EVAL-...) for readings that do not fit, ConfigError (E-LIBRARY-KIND, E-LIBRARY-NAME).
    """

    targets: FloatArray
    deviations: FloatArray
    axis_unit: AxisUnit
    source: str = ""
    warnings: tuple[str, ...] = ()
    name: str = ""
    doubts: tuple[Doubt, ...] = ()
    accepted: Mapping[str, str] = field(default_factory=dict)
    material_degc: float | None = None
    expansion_ppm_per_k: float | None = None
    record: MeasuredSet | None = None
    stated: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.axis_unit not in ("mm", "deg"):
            given = repr(self.axis_unit)
            raise ConfigError(
                "E-LIBRARY-KIND",
                "axis_unit",
                call="tf.Measured",
                wanted="an axis unit",
                given=given,
                how=Message.of("W-TABLE-MM-DEG"),
            )
        if self.name:
            units_fit(motion_name(self.name, "Measured"), self.axis_unit, self.unit, "Measured")
        for values in (self.targets, self.deviations):
            real_given(values, "tf.Measured")
        for key, values in zip(("targets", "deviations"), check_readings(self.targets, self.deviations), strict=True):
            object.__setattr__(self, key, values)
        places, counts = np.unique(self.targets, return_counts=True)
        if (counts > 1).any():
            given = f"target {places[np.argmax(counts > 1)]:g} {int(counts.max())} times"
            how = Message.of("W-LIB-REPETITIONS")
            raise ConfigError(
                "E-LIBRARY-KIND",
                "targets",
                call="tf.Measured",
                wanted=Message.of("W-LIB-EVERY-TARGET"),
                given=given,
                how=how,
            )
        object.__setattr__(self, "doubts", accept_doubts(all_doubts(self.as_set(), self.unit), self.accepted))

    def as_set(self) -> MeasuredSet:
        """The readings as the record that a run evaluates."""
        known = self.record or MeasuredSet(self.targets, self.deviations, self.axis_unit)
        ambient = known.ambient_start
        if self.material_degc != _mean(ambient.material_degc):
            ambient = replace(ambient, material_degc=() if self.material_degc is None else (self.material_degc,))
        return replace(
            known,
            targets=self.targets,
            deviations=self.deviations,
            axis_unit=self.axis_unit,
            ambient_start=ambient,
            expansion_ppm_per_k=self.expansion_ppm_per_k,
            warnings=tuple(map(Message.stored, self.warnings)),
            doubts=self.doubts,
        )

    @property
    def conditions(self) -> dict[str, float]:
        """What the file's sensors read, by name; only what they read."""
        if self.record is None:
            return {}
        ends = (("", self.record.ambient_start), ("_end", self.record.ambient_end))
        found = {f"{name}{end}": getattr(one, name) for end, one in ends for name in AIR}
        found |= {f"material_degc{end}": _mean(one.material_degc) for end, one in ends}
        return {name: value for name, value in found.items() if value is not None}

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the deviations: of the error's name, else um over mm and arcsec over deg."""
        return component_unit(self.name, self.axis_unit)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; a missing reading is None."""
        there = self.deviations.astype(object)
        there[~np.isfinite(self.deviations)] = None
        return {
            "targets": self.targets.tolist(),
            "deviations": there.tolist(),
            "axis_unit": self.axis_unit,
            "unit": self.unit,
            "name": self.name,
            "source": self.source,
            "warnings": list(self.warnings),
            "doubts": as_data(self.doubts),
            "stated": dict(self.stated),
            "conditions": self.conditions,
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

    def plot(self, after: Measured | None = None) -> Any:
        """Readings and the mean of each direction, um or arcsec over mm or deg; with ``after`` both on one scale.

        Returns a matplotlib figure. Raises ConfigError (E-LIBRARY-KIND, E-LIBRARY-UNIT).
        """
        from gateway.study.plots.charts import new_sheet, readings_sheet

        second = None
        if after is not None:
            of_kind(after, Measured, "Measured.plot")
            if (after.axis_unit, after.unit) != (self.axis_unit, self.unit):
                given = f"{after.unit} over {after.axis_unit}"
                wanted = f"{self.unit} over {self.axis_unit}"
                raise ConfigError("E-LIBRARY-UNIT", "plot", name=self.name or "the axis", wanted=wanted, given=given)
            second = (after.targets, after.deviations)
        label = (f"position  {self.axis_unit}", f"{self.name or 'deviation'}  {SHOWN[self.unit]}")
        first = (self.targets, self.deviations)
        title = self.source or "readings"
        return new_sheet((8.0, 3.8), lambda figure: readings_sheet(figure, label, first, second, title=title))

    def __repr__(self) -> str:
        m, n, _ = self.deviations.shape
        low, high = float(self.targets[0]), float(self.targets[-1])
        where = f" from {self.source}" if self.source else ""
        told = f"{self.name}: " if self.name else ""
        return f"Measured({told}{m} targets x {n} repetitions, {low:g} .. {high:g} {self.axis_unit}{where})"


def _mean(sensors: Sequence[float]) -> float | None:
    return sum(sensors) / len(sensors) if sensors else None


def read(
    path: str | Path,
    *,
    name: str = "",
    unit: str = "",
    columns: Mapping[str, str | int | float] | None = None,
    accepted: Mapping[str, str] | None = None,
) -> Measured:
    """A result file (.rtl, .rta, .pos) or table (.csv, .txt, .dat, .tsv, .xlsx): deviations in um or arcsec.

    Targets are in mm or deg as the file counts them. ``name`` is the error's ISO 230-1 name; a pitch over mm (EBX) or a
    run-out over deg needs it. ``unit`` of an .rta file's deviations, which it does not say: mrad, urad or arcsec.
    ``columns`` of a table whose heading does not say them, counted from 1: ``{"target": 1, "measured": 2}``.
    ``accepted`` are doubts that you answer for, reasons by code. Raises ConfigError (E-LIBRARY-COLUMNS, -WAYS, -RUNS,
    -READINGS, -SEVERAL and -SHEET: ``columns`` answers them), FileFormatError with line and reason.
    """
    from gateway.workflow.files.headers import is_future
    from gateway.workflow.files.reading import ReadOptions, read_file
    from gateway.workflow.files.statements import facts_of

    path_given(path, "read")
    axis = axis_unit_of(motion_name(name, "read")) if name else None
    mixed = axis is not None and component_unit(name, axis) != deviation_unit(axis)
    try:
        got = read_file(Path(path), ReadOptions(unit, columns=columns, mixed=mixed))
    except ConfigError as error:
        if error.code not in ASKS:
            raise
        fields: Mapping[str, Any] = error.fields
        raise ConfigError(ASKS[error.code], error.where, **fields) from error
    found = got.content
    if not isinstance(found, MeasuredSet):
        raise ConfigError("E-CLI-KIND", str(path), kind=type(found).__name__)
    # Angles over lengths come with the angles' unit alone, and a rotary file may hold pitch: the name says the rest.
    counted = axis if axis is not None and (mixed or got.driver == "rta") else found.axis_unit
    if name:
        units_fit(name, counted, deviation_unit(found.axis_unit), "read")
    stated = facts_of(Path(path).name, found.header).said
    today = _today()
    early = stated.get("date", "")
    later = (words("W-FACTS-TO-COME", date=shown(early), today=today.isoformat()),) if is_future(early, today) else ()
    return Measured(
        found.targets,
        found.deviations,
        counted,
        Path(path).name,
        warnings=(*later, *map(str, found.warnings)),
        name=name,
        doubts=found.doubts,
        accepted=accepted or {},
        material_degc=_mean(found.ambient_start.material_degc),
        expansion_ppm_per_k=found.expansion_ppm_per_k,
        record=found,
        stated=stated,
    )


def _today() -> date:
    return datetime.now(UTC).date()  # by name, so that a test can give another


@dataclass(frozen=True, slots=True, repr=False)
class Evaluated:
    """Figures by name (A, E, R, B, M ...) with expanded uncertainties ``U`` (k = 2), um or arcsec; None: not to be had.

    ``unit`` says which. ``contributions`` are what U contains (k = 2, by name); ``supposed`` says what had to be
    supposed for it. ``verdicts`` has a word for each limit. While a doubt of the readings blocks, each is "not
    decidable". ``stated`` is what the readings' file says of itself (machine, serial, date, ...).
    """

    standard: str
    unit: DeviationUnit
    values: dict[str, float | None]
    U: dict[str, float | None]
    notes: tuple[str, ...]
    contributions: dict[str, float] = field(default_factory=dict)
    supposed: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    verdicts: dict[str, str] = field(default_factory=dict)
    stated: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float | None:
        """One figure. Raises ConfigError (E-LIBRARY-KIND) that names those there are."""
        if not isinstance(name, str) or name not in self.values:
            how = f"one of {', '.join(self.values)}"
            raise ConfigError(
                "E-LIBRARY-KIND", "evaluate", call="tf.evaluate(...)[...]", wanted="a figure", given=repr(name), how=how
            )
        return self.values[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "standard": self.standard,
            "unit": self.unit,
            "values": dict(self.values),
            "U": dict(self.U),
            "contributions": dict(self.contributions),
            "supposed": list(self.supposed),
            "doubts": as_data(self.doubts),
            "verdicts": dict(self.verdicts),
            "stated": dict(self.stated),
            "notes": list(self.notes),
        }

    def to_pandas(self) -> Any:
        """One row a figure. Raises ConfigError (E-LIBRARY-PANDAS)."""
        names = list(self.values)
        return frame({"figure": names, "value": list(self.values.values()), "U": [self.U.get(name) for name in names]})

    def plot(self) -> Any:
        """Every figure as a bar with U (k = 2), um or arcsec; a matplotlib figure."""
        from gateway.study.plots.charts import bars_sheet, new_sheet

        there = {name: value for name, value in self.values.items() if value is not None}
        spread = [self.U.get(name) for name in there]
        source = " ".join(self.stated[key] for key in ("machine", "serial", "date") if self.stated.get(key))
        note = f"{source}   lines: U (k = 2)" if source else "lines: U (k = 2)"
        words = {"label": SHOWN[self.unit], "title": f"figures to {self.standard}", "note": note}
        names, values = list(there), list(there.values())
        return new_sheet((8.0, 3.6), lambda figure: bars_sheet(figure, names, values, spread, **words))

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value:.3f}" for name, value in self.values.items() if value is not None)
        return f"Evaluated({self.standard}: {told} {SHOWN[self.unit]})"


@overload
def evaluate(measured: DriveTest, *, limits: Mapping[str, float] | None = None) -> EvaluatedDrive:
    """Figures of a reducer's test bench in arcsec and Nm/arcmin."""


@overload
def evaluate(
    measured: Measured,
    standard: str | int = "2014",
    *,
    material_degc: float | None = None,
    expansion_ppm_per_k: float | None = None,
    equipment: Mapping[str, float] | None = None,
    limits: Mapping[str, float] | None = None,
    monte_carlo: bool = False,
    seed: int = 1,
) -> Evaluated:
    """Figures of a measured axis in um or arcsec."""


def evaluate(
    measured: Measured | DriveTest,
    standard: str | int = "2014",
    *,
    material_degc: float | None = None,
    expansion_ppm_per_k: float | None = None,
    equipment: Mapping[str, float] | None = None,
    limits: Mapping[str, float] | None = None,
    monte_carlo: bool = False,
    seed: int = 1,
) -> Evaluated | EvaluatedDrive:
    """Figures in um or arcsec to ISO 230-2 (edition 2014, 2006, 1997, 1988) or another standard by name.

    U (k = 2) as `trueflank evaluate` states it: with the scatter of the readings, and with what is known of the
    material (``material_degc``, ``expansion_ppm_per_k``; left out: of the file) and of the equipment (certificates, k
    = 2: um_per_m, kelvin, arcsec). ``limits`` by figure are decided. A record of a
    reducer's test bench (`tf.read_bench`) gives transmission error and torque loop; of the rest ``limits`` alone counts
    for it. Raises ConfigError (E-LIBRARY-KIND), and ModelError as `gateway.evaluate.standards.registry.evaluate_by`.
    """
    if isinstance(measured, DriveTest):
        return evaluated_bench(measured, limits)
    of_kind(measured, Measured, "evaluate")
    wholes_given("evaluate", seed=seed)
    figured = evaluate_positioning(
        measured.as_set(),
        str(standard),
        known=Surroundings(material_degc, expansion_ppm_per_k, equipment),
        limits=limits,
        seed=seed,
        monte_carlo=monte_carlo,
        unit=None if positions_its_axis(measured.name) else measured.unit,
        across=not positions_its_axis(measured.name),
    )
    found = figured.result
    supposed = (*(one.text for one in figured.supposed), str(describe_contributions(figured.contributions, found.unit)))
    return Evaluated(
        standard=found.standard.name,
        unit=found.unit,
        values=dict(found.values),
        U=dict(found.U),
        notes=(*map(str, found.flags), *told_doubts(figured.doubts), *measured.warnings),
        contributions=dict(figured.contributions),
        supposed=supposed,
        doubts=figured.doubts,
        verdicts={one.parameter: one.verdict for one in figured.verdicts},
        stated=dict(measured.stated),
    )


def positions_its_axis(name: str) -> bool:
    """Whether an error motion is along or about its own axis (EXX, ECC); without a name it is."""
    return not name or name[1] == name[2]


@dataclass(frozen=True, slots=True, repr=False)
class ErrorMotion:
    """A fitted error motion, um or arcsec over mm or deg; call it with positions of any shape.

    One measured around a whole turn repeats; any other is known over ``range`` alone, and elsewhere raises ModelError
    (E-MODEL-RANGE). Angles a whole turn apart are one place. ``doubts`` are those of the readings it was fitted to.
    """

    component: Component
    doubts: tuple[Doubt, ...] = ()
    stated: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Its ISO 230-1 name."""
        return self.component.name

    @property
    def unit(self) -> DeviationUnit:
        """Unit of its values."""
        return self.component.unit

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position (mm or deg) that was measured."""
        return self.component.domain

    @property
    def periodic(self) -> bool:
        """Whether the motion repeats after a turn, so that it is known everywhere."""
        return is_periodic(self.component)

    def __call__(self, positions: ArrayLike) -> FloatArray:
        """Values at positions (mm or deg). Raises ConfigError (E-LIBRARY-KIND) for what is no number, E-MODEL-RANGE."""
        return value(self.component, numbers_given(positions, self.component.axis_unit, self.name))

    def u(self, positions: ArrayLike) -> FloatArray:
        """Standard uncertainty of the fit at positions, from the scatter of the readings. Raises as a call."""
        return standard_uncertainty(self.component, numbers_given(positions, self.component.axis_unit, self.name))

    def points(self, count: int = 51) -> tuple[FloatArray, FloatArray]:
        """Equally spaced positions over the measured range, or the whole turn, and the values there, each (count,)."""
        low, high = self.component.domain
        at = np.linspace(low, low + TURN_DEG if self.periodic else high, count)
        return at, self(at)

    def function(self) -> dict[str, Any]:
        """The motion as an error file has it: a broken line, 100 points to its shortest wave, known over its range."""
        return function_of(self.component)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (n, n) of the fit's coefficients, in the squared unit of its values (um or arcsec)."""
        return np.asarray(self.component.covariance)

    def plot(self) -> Any:
        """The curve with U (k = 2) of the fit, um or arcsec over mm or deg; a matplotlib figure."""
        from gateway.study.plots.charts import MotionCurve, curve_sheet, new_sheet

        at, values = self.points(361)
        one = self.component
        curve = MotionCurve(
            name=one.name, axis=one.axis, unit=one.unit, axis_unit=one.axis_unit, at=at, values=values,
            U=COVERAGE * self.u(at),
        )  # fmt: skip
        return new_sheet((7.5, 3.4), lambda figure: curve_sheet(figure, curve))

    def to_dict(self) -> dict[str, Any]:
        """Plain data: basis, coefficients and the curve at 51 positions."""
        at, values = self.points()
        return {
            "name": self.name,
            "unit": self.unit,
            "basis": self.component.basis,
            "coefficients": self.component.coefficients.tolist(),
            "range": list(self.range),
            "periodic": self.periodic,
            "doubts": as_data(self.doubts),
            "stated": dict(self.stated),
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
    measured: Measured, name: str = "", *, kind: Literal["linear", "rotary", ""] = "", modulo: bool = False
) -> ErrorMotion:
    """The curve of a measured axis, um or arcsec over mm or deg, as a run fits it: the mean of both directions.

    Means are robust against drift between runs and readings out of line; a target read in one direction alone counts
    half the usual reversal off.
    Its order is chosen by the data. ``name`` is the error's ISO 230-1 name, that of the readings where they have one;
    ``kind`` "linear" for a rotary axis measured over a part of a turn; ``modulo`` for one that turns endlessly.
    Raises ConfigError (E-LIBRARY-KIND, E-LIBRARY-NAME, E-LIBRARY-UNIT), InDoubt (E-DOUBT-OPEN: a doubt of the readings
    that nobody accepted), ModelError, NotIdentifiable (E-MODEL-POINTS).
    """
    of_kind(measured, Measured, "fit")
    name = motion_name(name or measured.name, "fit")
    units_fit(name, measured.axis_unit, measured.unit, "fit")
    demand_settled(measured.doubts, measured.source or name)
    at, x = measured.targets, measured.deviations
    found = robust_means(at, x)
    u = np.where(np.isfinite(found.u), np.maximum(found.u, SMALLEST_U), SMALLEST_U)
    turns = measured.axis_unit == "deg"
    if kind not in ("", "linear", "rotary") or (kind == "rotary" and not turns):
        raise ConfigError(
            "E-LIBRARY-KIND", name, call="tf.fit", wanted=Message.of("W-LIB-AXIS-KIND"), given=repr(kind),
            how=Message.of("W-LIB-LINEAR-ROTARY"),
        )  # fmt: skip
    chosen: Literal["linear", "rotary"] = kind or ("rotary" if turns else "linear")
    fitted = fit_means(
        at, found.mean, u, name=name, axis=name[-1:], axis_unit=measured.axis_unit, kind=chosen, modulo=modulo
    )
    doubts = accept_doubts(all_doubts(measured.as_set(), measured.unit, modulo=modulo), measured.accepted)
    return ErrorMotion(fitted, doubts, dict(measured.stated))


def report(run: str | Path, store: str | Path = "runs") -> Path:
    """Write a stored run's report again; the path of its HTML page. ``run`` is a folder, an id or "latest".

    Lengths in the report are in mm, deviations in um or arcsec. Raises ConfigError (E-LIBRARY-KIND), StoreError.
    """
    path_given(run, "report")
    path_given(store, "report")
    from gateway.errors import StoreError
    from gateway.store import Store
    from gateway.workflow.results.report import write_report

    try:
        folder = Store(Path(store)).open(run)
    except StoreError as error:
        if error.code not in ("E-STORE-EMPTY", "E-STORE-RUN") or error.fields.get("matches"):
            raise
        wanted, given = Message.of("W-LIB-RUN"), Message.of("W-LIB-NO-RUN", run=str(run), store=str(store))
        how = Message.of("W-LIB-RUN-FOLDER")
        raise ConfigError("E-LIBRARY-KIND", "report", call="tf.report", wanted=wanted, given=given, how=how) from error
    return Path(write_report(folder).html)
