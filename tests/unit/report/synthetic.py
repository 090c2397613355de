"""Material of an invented run: three axes, measured, corrected and measured again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.message import Message
from drivers.types.identity import Identity, MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit, deviation_unit
from gateway.domain.captures import Capture, Corrections
from gateway.domain.equipment import SenseProof
from gateway.domain.figures import Component, Evaluation
from gateway.domain.outcomes import AxisVerdict, PushRecord
from gateway.domain.proposals import TableChange
from gateway.domain.values import FloatArray
from gateway.report import AxisMaterial, FileUsed, InstrumentNote, ReportMaterial

MACHINE = MachineIdentity("YK7350B-0042", "107.60.05", ("X1", "Z1", "C1", "Y1"))
AIR = Ambient(20.14, 1009.3, 48.0, (20.31, 20.28))
LATER = Ambient(20.41, 1009.1, 47.5, (20.55, 20.52))


def evaluation(targets: FloatArray, readings: FloatArray, unit: str) -> Evaluation:
    """ISO 230-2 written out again, short, for readings (m, n, 2)."""
    mean, s = readings.mean(axis=1), readings.std(axis=1, ddof=1)
    up, down, s_up, s_down = mean[:, 0], mean[:, 1], s[:, 0], s[:, 1]
    b, middle = up - down, (up + down) / 2
    r = np.max([2 * s_up + 2 * s_down + abs(b), 4 * s_up, 4 * s_down], axis=0)
    high = np.max([up + 2 * s_up, down + 2 * s_down])
    low = np.min([up - 2 * s_up, down - 2 * s_down])
    return Evaluation(
        standard="ISO 230-2:2014", unit=unit, targets=targets, mean_up=up, mean_down=down, s_up=s_up,
        s_down=s_down, B_i=b, R_i=r, B=float(abs(b).max()), B_mean=float(b.mean()),
        M=float(np.ptp(middle)), E=float(np.ptp(mean)), E_up=float(np.ptp(up)), E_down=float(np.ptp(down)),
        R=float(r.max()), R_up=float(4 * s_up.max()), R_down=float(4 * s_down.max()), A=float(high - low),
        A_up=float(np.ptp(up)), A_down=float(np.ptp(down)),
        U={"E": 0.42, "R": 0.31, "B": 0.22, "A": 0.55, "M": 0.40},
    )  # fmt: skip


def capture(axis: str, unit: AxisUnit, targets: FloatArray, readings: FloatArray, when: str) -> Capture:
    details = {"air_index_ppm": 271.3812, "expansion_ppm_per_k": 11.5, "dead_path_mm": 120.0}
    return Capture(
        axis=axis, component=f"E{axis[0]}{axis[0]}", axis_unit=unit, targets=targets, deviations=readings,
        reading_u=0.07, ambient_start=AIR, ambient_end=LATER,
        corrections=Corrections(
            Message.stored("Edlen 1994"), Message.stored("to 20 degC"), Message.stored("applied"), details=details,
        ), live=None,
        sense=SenseProof("laser", axis, -1, 0.99987, (9.9987, 9.9986)), suspects=((2, 1, 0),),
        started_utc=f"2026-03-02T{when}:00:00+00:00", ended_utc=f"2026-03-02T{when}:41:00+00:00",
    )  # fmt: skip


def axis_material(axis: str, unit: AxisUnit, seed: int = 7) -> AxisMaterial:
    """One axis that became better."""
    rotary = unit == "deg"
    rng = np.random.default_rng(seed)
    targets = np.linspace(0, 345, 24) if rotary else np.linspace(0, 400, 21)
    curve = _curve(targets, rotary)
    old, new = (_readings(rng, part) for part in (curve, curve * 0.03 + rng.normal(0, 0.12, targets.size)))
    first, second = (evaluation(targets, part, deviation_unit(unit)) for part in (old, new))
    return AxisMaterial(
        axis=axis, letter=axis[0], unit=unit, capture_before=capture(axis, unit, targets, old, "09"),
        capture_after=capture(axis, unit, targets, new, "11"), before=first, after=second,
        components=(_component(axis, unit),), change=change(axis, unit, targets),
        push=PushRecord(
            4711, axis, "committed",
            tuple(map(Message.stored, (
                "backup", "backup re-read", "disabled", "written", "read back equal", "enabled", "referenced",
                "effect proven at 3 positions", "saved",
            ))),
            f"runs/2026-03-02-01/{axis}/backup.spf",
            ((40.0, 1.2, 1.2), (200.0, -3.4, -3.4), (320.0, 5.1, 5.101)),
        ),
        sign_proof=SignProof(MACHINE, "axis", axis, 1.003, 0.011, 1, "2026-03-02T08:40:00+00:00"),
        sense_proof=SenseProof("laser", axis, -1, 0.99987, (9.9987,)),
        verdict=AxisVerdict(
            axis, first.unit, first, second, improved=True, within_prediction=True,
            words=(Message.stored(f"M from {first.M:.1f} to {second.M:.1f} {first.unit}, as predicted."),),
        ),
        findings=(Message.stored("order 36 is above what 24 targets can see"),) if rotary else (),
    )  # fmt: skip


def _curve(targets: FloatArray, rotary: bool) -> FloatArray:
    if rotary:
        angle = np.radians(targets)
        return 16 * np.sin(angle + 0.4) + 5 * np.sin(2 * angle) + 3 * np.cos(3 * angle) + 1.5 * np.sin(6 * angle)
    return 0.03 * targets + 2.4 * np.sin(targets / 60.0) - 4


def _readings(rng: np.random.Generator, curve: FloatArray) -> FloatArray:
    both = np.stack([curve + 0.3, curve - 0.3], axis=-1)[:, None, :]
    return both + rng.normal(0, 0.22, (curve.size, 5, 2))


def _component(axis: str, unit: AxisUnit) -> Component:
    return Component(f"E{axis[0]}{axis[0]}", axis, unit, "fourier", (0.0, 360.0), np.arange(13.0), np.eye(13), {}, 0.11)


def change(axis: str, unit: AxisUnit, targets: FloatArray) -> TableChange:
    rotary = unit == "deg"
    step, top = (5.0, 360.0) if rotary else (20.0, 400.0)
    points = np.arange(0, top + step / 2, step)
    values = _curve(points, rotary)
    values = values - values[0]
    old = CompensationTable("axis", axis, axis, 0.0, top, step, tuple((0.2 * values).tolist()), rotary, 0, unit, unit)
    new = replace(old, deviations=tuple(np.round(values, 3).tolist()))
    return TableChange(
        axis, old, new, True, "ab" * 32, targets, np.zeros(targets.size), np.full(targets.size, 0.45)
    )  # fmt: skip


def material() -> ReportMaterial:
    """The whole run."""
    return ReportMaterial(
        site="hall-3-grinder", machine=MACHINE, run_id="2026-03-02-01", outcome="better",
        axes=(axis_material("X1", "mm"), axis_material("Z1", "mm", 8), axis_material("C1", "deg", 9)),
        started_utc="2026-03-02T08:31:00+00:00", ended_utc="2026-03-02T12:04:00+00:00",
        software="trueflank 0.1.0",
        instruments=(
            InstrumentNote("laser", Identity("umd", "uMD1", "U-17", "4.20"), ("cannot see a beam break",)),
            InstrumentNote("calibrator", Identity("bridge", "rotary calibrator", "RC-3")),
        ),
        files=(FileUsed("site.toml", "0f" * 32, "site file"),),
        hashes={"capture X1 before": "1a" * 32, "proposal": "2b" * 32},
        findings=("The room warmed by 0.27 K during the run.",),
    )  # fmt: skip
