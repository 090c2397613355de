"""Records of a reducer's test bench: read with what is known of the reducer, evaluated as the command does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.types.drives import DriveRecord
from gateway.domain.values import FloatArray
from gateway.evaluate.behaviour.drive import DriveFigures
from gateway.workflow.files.drives import DriveQuestion, evaluate_drives, read_drive
from gateway.workflow.run.stages import SAID
from trueflank.frames import frame
from trueflank.given import path_given


@dataclass(frozen=True, slots=True, repr=False)
class DriveTest:
    """One record of a test bench: angles in deg, torque in Nm, temperature in degC; and what is said of the reducer."""

    record: DriveRecord
    source: str
    question: DriveQuestion = field(default_factory=DriveQuestion)

    @property
    def input_deg(self) -> FloatArray:
        """Input's angle (n,), deg."""
        return self.record.input_deg

    @property
    def output_deg(self) -> FloatArray:
        """Output's angle (n,), deg."""
        return self.record.output_deg

    @property
    def torque_nm(self) -> FloatArray | None:
        """Torque on the output (n,), Nm; None where no column held it."""
        return self.record.torque_nm

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names; no torque where none was read."""
        found = {"source": self.source, "input_deg": self.input_deg.tolist(), "output_deg": self.output_deg.tolist()}
        return found if self.torque_nm is None else {**found, "torque_nm": self.torque_nm.tolist()}

    def to_pandas(self) -> Any:
        """One row a reading. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame({key: value for key, value in self.to_dict().items() if key != "source"})

    def plot(self) -> Any:
        """Angles in deg and torque in Nm in the order of the readings; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.drives import readings_of_bench

        return new_sheet((9.0, 5.0), lambda figure: readings_of_bench(figure, self.record, self.source))

    def __repr__(self) -> str:
        return f"DriveTest({self.source}: {len(self.record.lines)} readings)"


@dataclass(frozen=True, slots=True, repr=False)
class EvaluatedDrive:
    """Figures by name with ``units`` (arcsec, Nm/arcmin) and ``U`` (k = 2; None: not known), orders, a word per limit.

    ``orders`` are rows of sense, order per turn of the output, amplitude in arcsec, phase in deg, cause. ``found`` are
    the curves (deg, arcsec) and the torque loop (Nm, arcsec) that they come from.
    """

    values: dict[str, float]
    U: dict[str, float | None]
    units: dict[str, str]
    orders: tuple[dict[str, Any], ...]
    notes: tuple[str, ...]
    verdicts: dict[str, str] = field(default_factory=dict)
    found: DriveFigures | None = None

    def __getitem__(self, name: str) -> float:
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
            "values": dict(self.values),
            "U": dict(self.U),
            "units": dict(self.units),
            "orders": [dict(one) for one in self.orders],
            "notes": list(self.notes),
            "verdicts": dict(self.verdicts),
        }

    def to_pandas(self) -> Any:
        """One row a figure. Raises ConfigError (E-LIBRARY-PANDAS)."""
        names = list(self.values)
        return frame(
            {
                "figure": names,
                "value": list(self.values.values()),
                "U": [self.U[name] for name in names],
                "unit": [self.units[name] for name in names],
            }
        )

    def plot(self) -> Any:
        """Transmission error over a turn, its orders, the torque loop; arcsec, Nm; a matplotlib figure.

        Raises ConfigError (E-LIBRARY-KIND) where the curves are not there.
        """
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.drives import bench_sheet

        found = self.found
        if found is None:
            raise ConfigError(
                "E-LIBRARY-KIND", "plot", call="tf.EvaluatedDrive.plot", wanted=Message.of("W-LIB-CURVES"),
                given="figures alone", how="tf.evaluate(tf.read_bench(path))",
            )  # fmt: skip
        rows = (2 if found.running else 0) + (1 if found.loop is not None else 0)
        verdicts = "".join(f"; {name}: {word}" for name, word in self.verdicts.items())
        simulated = SAID in self.notes
        return new_sheet(
            (9.0, 1.0 + 2.3 * rows), lambda figure: bench_sheet(figure, found, verdicts, simulated=simulated)
        )

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value:.2f} {self.units[name]}" for name, value in self.values.items())
        return f"EvaluatedDrive({told})"


def read_bench(
    path: str | Path,
    *,
    pins: int | None = None,
    ratio: float | None = None,
    rated_torque_nm: float | None = None,
    encoder_U_arcsec: float | None = None,
    columns: Mapping[str, str | int] | None = None,
) -> DriveTest:
    """A record of a reducer's test bench (CSV): angles in deg, torque in Nm, whatever units its headings name.

    What the file does not state of the reducer is said here: ``ratio`` is input turns per output turn, negative where
    they turn against each other; ``encoder_U_arcsec`` of the output encoder, k = 2. ``columns`` from 1, with units:
    ``{"input": 2, "input_unit": "deg"}``. Raises FileFormatError with line and reason, ConfigError (E-FILE-MAP).
    """
    path_given(path, "read_bench")
    question = DriveQuestion(
        pins=pins,
        ratio=ratio,
        rated_torque_nm=rated_torque_nm,
        output_encoder_U_arcsec=encoder_U_arcsec,
        columns=columns,
    )
    return DriveTest(read_drive(Path(path), columns), Path(path).name, question)


def evaluated_bench(test: DriveTest, limits: Mapping[str, float] | None = None) -> EvaluatedDrive:
    """What `tf.evaluate` makes of a record: figures in arcsec and Nm/arcmin, as `trueflank evaluate` states them."""
    found = evaluate_drives([(test.source, test.record)], test.question)
    figures = found.answer.figures
    return EvaluatedDrive(
        values={one.name: one.value for one in figures},
        U={one.name: one.U for one in figures},
        units={one.name: one.unit for one in figures},
        orders=tuple(found.as_data()["orders"]),
        notes=tuple(map(str, found.answer.notes)),
        verdicts={one.parameter: one.verdict for one, _ in found.decided(limits or {})},
        found=found.figures,
    )
