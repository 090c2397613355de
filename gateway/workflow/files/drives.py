"""Records of a reducer's test bench from files to figures: what files and a person say of the drive, U, verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from drivers import registry
from drivers.errors import ConfigError
from drivers.message import Message, digits
from drivers.types.drives import STATEMENTS, DriveRecord
from gateway.errors import ModelError
from gateway.evaluate.behaviour.drive import (
    DriveFigures,
    RunningError,
    TestedDrive,
    TorqueLoop,
    evaluate_drive,
    expanded_uncertainty,
)
from gateway.evaluate.behaviour.order_causes import in_words
from gateway.evaluate.standards.conformity import Decision
from gateway.workflow.files.kind_records import Drawn, Figure, KindAnswer

KIND = "transmission"
STANDARD = "makers' definitions"
AGREE = 1e-6
LOWER = "torsional stiffness"
SENSES = {1: "forwards", -1: "backwards"}


@dataclass(frozen=True, slots=True)
class DriveQuestion:
    """What a person says of the drive; None: the files state it. Ratio is input turns per output turn, signed."""

    pins: int | None = None
    ratio: float | None = None
    rated_torque_nm: float | None = None
    output_encoder_U_arcsec: float | None = None
    columns: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class DriveAnswer:
    """The figures as any kind has them, and those they come from, for the picture."""

    answer: KindAnswer
    figures: DriveFigures

    def decided(self, limits: Mapping[str, float]) -> tuple[tuple[Decision, str], ...]:
        """As `KindAnswer.decided`; a lowest stiffness is no limit of this rule. Raises ModelError (E-DRIVE-LOWER)."""
        for name in limits:
            if LOWER.endswith(name):
                raise ModelError("E-DRIVE-LOWER", KIND, parameter=name)
        return self.answer.decided(limits)

    def as_data(self) -> dict[str, Any]:
        """For --json: as the other kinds, with orders and loop."""
        return self.answer.as_data() | {
            "orders": [
                {
                    "sense": SENSES[run.sense],
                    "order": one.order,
                    "amplitude": one.amplitude_arcsec,
                    "phase_deg": one.phase_deg,
                    "cause": in_words(one.causes),
                    "causes": [cause.as_data() for cause in one.causes],
                }
                for run in self.figures.running
                for one in run.orders
            ],
            "loop": None
            if self.figures.loop is None
            else {
                "torque_nm": self.figures.loop.torque_nm.tolist(),
                "twist_arcsec": self.figures.loop.twist_arcsec.tolist(),
            },
        }


def read_drive(path: Path, columns: Mapping[str, Any] | None = None) -> DriveRecord:
    """The record of a test bench. Raises FileFormatError, ConfigError (E-FILE-MAP)."""
    spec = registry.known("drive-file")["drive-csv"]
    record: DriveRecord = spec.load()(columns=columns).read(path)
    return record


def evaluate_drives(files: Sequence[tuple[str, DriveRecord]], asked: DriveQuestion) -> DriveAnswer:
    """The figures of records of one drive: a file may hold passes, a loop or both; files of one sense are repeats.

    Raises ModelError as `evaluate_drive`; ConfigError (E-DRIVE-UNKNOWN: neither files nor question state pins or
    ratio; E-DRIVE-DIFFERS: two of them differ).
    """
    drive = drive_of(files, asked)
    each = [evaluate_drive(record, drive, label) for label, record in files]
    runs = [run for one in each for run in one.running]
    running = tuple(_mean([run for run in runs if run.sense == sense]) for sense in (1, -1) if _any(runs, sense))
    loops = [one.loop for one in each if one.loop is not None]
    loop = _mean_loop(loops) if loops else None
    notes = tuple(dict.fromkeys(Message(code, fields) for one in each for code, fields in one.notes))
    notes += tuple(warning for _, record in files for warning in record.warnings)
    simulated = any("simulated" in record.header.get("Instrument", "") for _, record in files)
    found = DriveFigures(drive, running, loop)
    answer = KindAnswer(
        kind=KIND,
        standard=STANDARD,
        figures=_figures(found),
        curves=tuple(Drawn(SENSES[run.sense], *_in_ascending_order(run)) for run in running),
        axes=("output  deg", "transmission error  arcsec"),
        notes=(*notes, *((Message.of("S-RUN-SIMULATED"),) if simulated else ())),
        simulated=simulated,
    )
    return DriveAnswer(answer, found)


def drive_of(files: Sequence[tuple[str, DriveRecord]], asked: DriveQuestion) -> TestedDrive:
    """The drive that files and question agree about. Raises ConfigError (E-DRIVE-UNKNOWN, E-DRIVE-DIFFERS)."""
    found: dict[str, float] = {}
    for name, one in STATEMENTS.items():
        said = getattr(asked, name, None)
        stated = [(label, record.stated[name]) for label, record in files if name in record.stated]
        stated += [("what was typed", float(said))] if said is not None else []
        for label, value in stated[1:]:
            if abs(value - stated[0][1]) > AGREE * abs(stated[0][1]):
                first = f"{stated[0][1]:g}"
                raise ConfigError("E-DRIVE-DIFFERS", label, key=one.key, one=first, other=digits(value, 6))
        if stated:
            found[name] = stated[0][1]
    for name in ("pins", "ratio"):
        if name not in found:
            raise ConfigError("E-DRIVE-UNKNOWN", files[0][0] if files else KIND, key=STATEMENTS[name].key)
    whole = {name: int(value) for name, value in found.items() if STATEMENTS[name].whole}
    return TestedDrive(**{**found, **whole})  # type: ignore[arg-type]


def _any(runs: Sequence[RunningError], sense: int) -> bool:
    return any(run.sense == sense for run in runs)


def _mean(runs: Sequence[RunningError]) -> RunningError:
    """The first file's curve with the p-p of all as repeats."""
    return replace(runs[0], each=tuple(value for run in runs for value in run.each))


def _mean_loop(loops: Sequence[TorqueLoop]) -> TorqueLoop:
    first = loops[0]
    if len(loops) == 1:
        return first
    stiff = [one.stiffness for one in loops if one.stiffness is not None]
    return replace(
        first,
        lost_motion=float(np.mean([one.lost_motion for one in loops])),
        backlash=float(np.mean([one.backlash for one in loops])),
        stiffness=float(np.mean(stiff)) if stiff else None,
        each=tuple(value for one in loops for value in one.each),
    )


def _in_ascending_order(run: RunningError) -> tuple[Any, Any]:
    order = np.argsort(run.angle_deg)
    return run.angle_deg[order], run.error_arcsec[order]


def _figures(found: DriveFigures) -> tuple[Figure, ...]:
    """Everything with U; the worse sense first, then each."""
    U = found.drive.U_reading
    figures: list[Figure] = []
    two = sqrt(2.0)
    if found.running:
        worst = max(found.running, key=lambda run: run.peak_to_peak)
        figures.append(
            Figure("transmission error", worst.peak_to_peak, "arcsec", expanded_uncertainty(two, U, worst.each))
        )
        loud = max(found.running, key=lambda run: run.rms)
        figures.append(Figure("transmission error RMS", loud.rms, "arcsec", expanded_uncertainty(1.0, U, ())))
    for run in found.running:
        name = SENSES[run.sense]
        figures.append(Figure(f"{name} p-p", run.peak_to_peak, "arcsec", expanded_uncertainty(two, U, run.each)))
        figures.append(Figure(f"{name} RMS", run.rms, "arcsec", expanded_uncertainty(1.0, U, ())))
    if found.loop is not None:
        loop = found.loop
        figures.append(Figure("lost motion", loop.lost_motion, "arcsec", expanded_uncertainty(two, U, loop.each)))
        figures.append(Figure("backlash", loop.backlash, "arcsec", expanded_uncertainty(two, U, ())))
        if loop.stiffness is not None:
            share = None if U is None else two * U / loop.stiffness_span_arcsec
            U_stiff = None if share is None else share * loop.stiffness
            figures.append(Figure(LOWER, loop.stiffness, "Nm/arcmin", U_stiff))
    return tuple(figures)
