"""Transmission: the loaded contact of a whole turn, and the first order of many machines against a plain product."""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.report import Report, main, spent
from drivers.types.values import FloatArray
from gateway.gear.first_order import linear_flank
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import crank_angles, transmission
from gateway.reducer.firstorder import MachineTransmission, transmission_map
from gateway.reducer.records import Reducer, for_gear, shipped
from gateway.tooth import FlankMap

CORE_S = 2.0
PRODUCT = 1.5


def part(drive: Reducer, seed: int, amplitude_um: float = 2.0) -> FlankMap:
    """A disc of shifts that change from space to space and over the width."""
    rng = np.random.default_rng(seed)
    grid = flank_grid(drive.gear)
    k, s = 2.0 * np.pi * grid.k / drive.gear.zc, grid.section
    A, B, lead = (amplitude_um * (rng.normal() * np.cos(k) + rng.normal() * np.sin(2.0 * k)) for _ in range(3))
    e = A * s.nx + B * s.ny + lead * s.nx * grid.z / drive.gear.b
    return FlankMap(grid.thetas, grid.zs, np.array(np.broadcast_to(e, grid.shape)))


def full(report: Report) -> None:
    """Equilibrium at 936 crank angles of 40 pins, two unlike discs and 11 slices; then all figures of the drive."""
    drive = shipped("RV-40E-like", "crank-holes")
    assembly = Assembly(drive, [part(drive, 1), part(drive, 2)])
    alpha: FloatArray = crank_angles(drive)[: report.pick(936, 24)]
    text = f"full model: {alpha.size} crank angles x 40 pins x 2 discs x {assembly.slices} slices, of a core"
    report.at_most(text, spent(lambda: assembly.solve(alpha, drive.rated_nm)), CORE_S, "s")
    if not report.smoke:
        both = [part(drive, 1), part(drive, 2)]
        report.say(
            "all figures of a drive: both senses, four torques", spent(lambda: transmission(drive, both), 1), "s"
        )


def first_order(report: Report) -> None:
    """Transmission error, peak to peak, of 1 000 machines by the 21 errors against the product of the same matrices."""
    drive = for_gear(shipped("cycloid-like", None).gear, "bore") if report.smoke else shipped("RV-40E-like", "bore")
    grid = flank_grid(drive.gear)
    grinding = Grinding(yk7350b(), drive.gear, 2.5 * drive.gear.rp)
    flank = linear_flank(grinding, grid, list(TWENTY_ONE))
    nominal = FlankMap(grid.thetas, grid.zs, np.zeros(grid.shape))
    found = transmission_map(drive, nominal, steps=24)
    ours = MachineTransmission(found.rows(flank.jacobian()), found.mean_arcsec)
    vectors = np.random.default_rng(0).normal(size=(len(TWENTY_ONE), report.pick(1000, 50))) * 1e-3
    out = np.empty((found.crank_rad.size, vectors.shape[1]))
    plain = spent(lambda: np.matmul(ours.matrix, vectors, out=out))
    shape = f"{out.shape[0]} angles x 21 errors x {vectors.shape[1]} machines"
    report.say(f"first order: product of {shape}", 1e3 * plain, "ms")
    report.at_most(
        "first order: curves into a given output / product", spent(lambda: ours.curves(vectors, out)) / plain, PRODUCT
    )
    report.say("first order: peak to peak alone / product", spent(lambda: ours.peak_to_peak_arcsec(vectors)) / plain)
    report.say("first order: the matrix itself", 1e3 * spent(lambda: found.rows(flank.jacobian())), "ms")


def measure(report: Report) -> None:
    """All figures of this file."""
    full(report)
    first_order(report)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
