"""Material of an invented closing run: errors, three parts ground and inspected, both layers pushed, judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.message import Message
from drivers.types.tables import CompensationTable
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.correct.outlook.flank_uncertainty import OpenDoubt
from gateway.domain.figures import Component
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.domain.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.process_drift import set_right
from gateway.model.error_model import MOTION_NAMES, ErrorModel, LocationError, UnmeasuredError
from gateway.report import PartMaterial, ReportMaterial, TableMaterial, ToothMaterial
from gateway.tooth import (
    CureRecord,
    FlankMap,
    FlankPrediction,
    GroundPart,
    InspectedFlank,
    RankRecord,
    SetupValues,
    ToothProposal,
    ToothVerdict,
)
from tests.unit.report import synthetic

GEAR = CycloidGear(rp=90.0, rrp=7.0, a=4.0, zp=12, zc=11, b=15.0)
GRID = flank_grid(GEAR, profile=5, width=3)


def flank_of(A: FloatArray, B: FloatArray, G: FloatArray, grid: FlankGrid = GRID) -> FlankMap:
    """A and B (K, Z) in um, G (K, Z) in arcsec as a flank, one rotation taken out."""
    s = grid.section
    parts = A[:, None, :] * s.nx + B[:, None, :] * s.ny + arcsec_to_rad(1.0) * mm_to_um(1.0) * G[:, None, :] * s.h
    h = np.broadcast_to(s.h, parts.shape)
    return FlankMap(grid.thetas, grid.zs, parts - h * float(np.sum(h * parts) / np.sum(h**2)))


def _places() -> tuple[FloatArray, FloatArray]:
    turn = 2.0 * np.pi * GRID.ks / GRID.ks.size
    return turn[:, None], GRID.zs[None, :]


def _machine(x_zero: float, dressing: float) -> FlankMap:
    turn, z = _places()
    A = x_zero + 2.4 * np.sin(turn + 0.5) + 1.1 * np.cos(2 * turn) - 0.22 * z + 0.02 * z**2
    B = dressing + 1.4 * np.cos(turn) + 0.08 * z + 0.02 * z * np.sin(turn)
    G = 7.0 * np.sin(turn) + 3.0 * np.cos(3 * turn) + 0.5 * z
    return flank_of(A + 0.0 * z, B, G)


def _left(size: float, seed: int) -> FlankMap:
    rng = np.random.default_rng(seed)
    turn, z = _places()
    noise = rng.normal(0.0, 0.06, (3, GRID.ks.size, GRID.zs.size))
    B = size * np.cos(turn) + 0.3 * size * z / 5.0
    return flank_of(noise[0], B + noise[1], 2.0 * noise[2])


def inspected(part: str, flank: FlankMap) -> InspectedFlank:
    """An inspection of a flank, its points those of the flank."""
    K, _, Z = flank.deviation_um.shape
    k, t, z = (one.ravel() for one in np.meshgrid(GRID.ks, flank.theta_rad, flank.z_mm, indexing="ij"))
    G = np.zeros((K * Z, 3))
    names = ("F_alpha", "f_Halpha", "F_beta", "f_p", "F_p", "F_r")
    sizes = (1.9, 1.1, 1.2, 0.8, 3.1, 2.6)
    rms = flank.rms_um
    return InspectedFlank(
        part, "gear inspection machine P 26", "P26-118", k, t, z, flank.deviation_um.ravel(), 0.2,
        np.repeat(GRID.ks, Z), np.tile(flank.z_mm, K), G, G, flank, 0.08,
        {name: size * rms for name, size in zip(names, sizes, strict=True)},
        (Message.stored("How far this inspection clamped off centre cannot be told from the part's eccentricity."),),
        "2026-03-02T14:10:00+00:00",
    )  # fmt: skip


def part(name: str, setup: SetupValues, flank: FlankMap, hour: int) -> PartMaterial:
    """A part ground and inspected."""
    moments = f"2026-03-02T{hour:02}:00:00+00:00", f"2026-03-02T{hour:02}:38:00+00:00"
    return PartMaterial(
        name, GroundPart(name, setup, GRID.ks.size, *moments, {"X1": "ab" * 32}, 21.4), inspected(name, flank)
    )


def motion(name: str, seed: int) -> Component:
    """A smooth motion of the right size and unit."""
    rng = np.random.default_rng(seed)
    if name.endswith("C"):
        parameters: dict[str, object] = {"period": 360.0, "orders": [1, 2, 3]}
        c = np.concatenate([[0.0], rng.normal(0, 2.0, 6) / np.repeat([1, 2, 3], 2)])
        return Component(name, "C1", "deg", "fourier", (0.0, 360.0), c, np.eye(7) * 0.02, parameters, 0.11)
    parameters = {"centre": -160.0 if name.endswith("X") else 0.0, "scale": 80.0, "degree": 3}
    domain = (-240.0, 0.0) if name.endswith("X") else (-60.0, 60.0)
    c = np.concatenate([[0.0], rng.normal(0, 2.0, 3)])
    return Component(name, f"{name[2]}1", "mm", "polynomial", domain, c, np.eye(4) * 0.01, parameters, 0.08)


BAR = (Message.stored("tilt of Z measured against a bar at two positions half a turn apart"),)


def errors() -> ErrorModel:
    """18 motions less one that was only assumed, and three location errors."""
    known = [name for name in MOTION_NAMES if name != "EAZ"]
    return ErrorModel(
        tuple(motion(name, i) for i, name in enumerate(known)),
        (
            LocationError(
                "B0Z",
                6.2,
                0.4,
                "arcsec",
                (Message.stored("both slopes were measured against one square, and again with the square reversed"),),
            ),
            LocationError(
                "A0C",
                -3.1,
                0.5,
                "arcsec",
                BAR,
            ),
            LocationError(
                "B0C",
                2.2,
                0.5,
                "arcsec",
                BAR,
            ),
        ),
        (UnmeasuredError("EAZ", 5.0, "arcsec"),),
        dict.fromkeys(known, 0.15),
        (Message.of("S-MODEL-SLOPE", name="EYX", slope="+1.80"),),
    )


CURES = {
    "EXX": (1.21, "X zero", 0.0), "EYX": (0.84, "dressing offset", 0.0), "EZX": (0.0, "none needed", 0.0),
    "EAX": (0.11, "mechanical only", 0.06), "EBX": (0.62, "X(Z)", 0.0), "ECX": (0.9, "C zero", 0.01),
    "EXZ": (0.7, "X(Z)", 0.0), "EYZ": (0.33, "mechanical only", 0.17), "EZZ": (0.0, "none needed", 0.0),
    "EAZ": (0.09, "C(Z) in part", 0.04), "EBZ": (0.13, "X(Z)", 0.0), "ECZ": (0.41, "C(Z)", 0.02),
    "EXC": (1.75, "X(C)", 0.0), "EYC": (1.32, "C(C) in part", 0.61), "EZC": (0.0, "none needed", 0.0),
    "EAC": (0.21, "mechanical only", 0.19), "EBC": (0.24, "X(Z)*(C)", 0.24), "ECC": (2.38, "EEC", 0.0),
    "B0Z": (0.5, "X(Z)", 0.0), "A0C": (0.29, "C(Z) in part", 0.14), "B0C": (0.18, "X(Z)", 0.0),
}  # fmt: skip


def proposal() -> ToothProposal:
    """Before, with EEC, after; every error's cure and rank."""
    turn, z = _places()
    before, after = _machine(4.0, 1.5), _left(0.12, 5)
    A = 4.0 + 2.4 * np.sin(turn + 0.5) + 1.1 * np.cos(2 * turn) - 0.22 * z
    eec = flank_of(A, 1.5 + 1.4 * np.cos(turn) + 0.08 * z, 0.4 * np.sin(turn) + 0.5 * z)
    order = sorted(CURES, key=lambda name: -CURES[name][0])
    ranks = [
        RankRecord(name, CURES[name][0], 0.8 * CURES[name][0], 1.25 * CURES[name][0], (max(1, i), min(21, i + 2)))
        for i, name in enumerate(order)
    ]
    prediction = FlankPrediction(
        before, eec, after, 0.06, 0.16, np.full(before.deviation_um.shape, 0.16), 0.21, 0.04, {"EYC": 0.1}
    )
    return ToothProposal(
        SetupValues(-4.0, 0.0, -1.5), prediction,
        tuple(CureRecord(name, rms, by, floor) for name, (rms, by, floor) in CURES.items()), tuple(ranks), 0.46,
        (0.0, 0.0), (0.0, 0.0), (Message.stored("Z(Z) is not seen by the flank: the axis decided it."),),
    )  # fmt: skip


def cross_table(out: str, over: str, index: int) -> TableMaterial:
    """A CEC table as pushed."""
    rotary = over == "C"
    at = np.arange(0.0, 361.0, 15.0) if rotary else np.arange(-10.0, 10.1, 2.5)
    values = 3.0 * np.sin(np.radians(at)) if rotary else 0.3 * at
    unit, inside = ("deg" if out == "C" else "mm"), ("deg" if rotary else "mm")
    grid = (float(at[0]), float(at[-1]), float(at[1] - at[0]))
    old = CompensationTable("cross", f"{over}1", f"{out}1", *grid, (0.0,) * at.size, rotary, index, inside, unit)
    new = replace(old, deviations=tuple(np.round(values, 3).tolist()))
    change = TableChange(f"{out}1", old, new, False, "cd" * 32, at, np.zeros(at.size), np.full(at.size, 0.4))
    return TableMaterial(change, PushRecord(4712, f"{out}1", "committed", (Message.stored("written"),), "backup.spf"))


def tooth() -> ToothMaterial:
    """Everything of the tooth."""
    ground, after = _machine(4.0, 1.5), _left(0.13, 9)
    fair = set_right(ground, GEAR)
    first, second = SetupValues(), SetupValues(-4.0, 0.0, -1.5)
    eec = tuple(TableMaterial(one.change, one.push) for one in synthetic.material().axes if one.change is not None)
    cec = (cross_table("X", "Z", 0), cross_table("X", "C", 1), cross_table("C", "Z", 2), cross_table("C", "C", 3))
    return ToothMaterial(
        errors(), proposal(),
        ToothVerdict(
            ground.rms_um, fair.rms_um, after.rms_um, 0.21, 0.16, within_prediction=True, outcome="better",
            words=(Message.stored(f"The flank got better: RMS {fair.rms_um:.2f} um became {after.rms_um:.2f} um."),),
        ),
        (
            part("before", first, ground, 8),
            part("trial", second, _left(0.3, 8), 12),
            part("after", SetupValues(-4.2, 0.0, -1.4), after, 14),
        ),
        (*eec, *cec), gear=GEAR, gear_name="11-lobe disc",
        letters={"X1": "X", "Z1": "Z", "C1": "C"},
    )  # fmt: skip


def material() -> ReportMaterial:
    """The whole closing run."""
    return replace(synthetic.material(), tooth=tooth())


def measured() -> ReportMaterial:
    """A run that measured the errors and no more, with what to measure next."""
    opened = (OpenDoubt("EAZ", 0.31, 0.12, 0.7, measured=False), OpenDoubt("EYC", 0.11, 0.2, 0.2, measured=True))
    advice = (Message.stored("Measure EAZ-Z1 next: EAZ may change the proposal by 0.31 um."),)
    only = ToothMaterial(errors(), open=opened, advice=advice)
    return replace(synthetic.material(), axes=(), outcome="measured", tooth=only, findings=())


def part_alone() -> ReportMaterial:
    """A run that inspected one part and no more."""
    only = ToothMaterial(parts=(PartMaterial("customer 7", None, inspected("customer 7", _machine(1.0, 0.3))),))
    return replace(synthetic.material(), axes=(), outcome="inspected", tooth=only, findings=())
