"""The library: what its import costs, and each call against the functions that it is made of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from time import process_time

import numpy as np

import trueflank as tf
from benchmarks.report import Report, main, spent
from gateway.gear.first_order import bounded_first_order
from gateway.study.machine import grid_of, grinding_of
from gateway.study.relative_errors import relative_sweep

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
IMPORT = "from time import process_time as t; a = t(); import trueflank; print(t() - a)"


def imported() -> float:
    """Processor time of `import trueflank` in a process of its own, s."""
    told = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True)  # noqa: S603
    return float(told.stdout)


def measure(report: Report) -> None:
    """All figures of this file."""
    report.at_most("import trueflank: processor", min(imported() for _ in range(report.pick(5, 1))), 0.005, "s")
    gear = tf.Gear.load(EXAMPLES / "gears" / "rv-40e-like.toml")
    machine = tf.Machine(seed=7)
    grinding = grinding_of(gear.data, machine.data)
    grid = grid_of(gear.data, grinding.gear)
    floor = spent(lambda: bounded_first_order(grinding, grid.k, grid.theta, grid.z))
    report.say("flank to second order by the gateway's function", 1e3 * floor, "ms")
    report.at_most("tf.flank / that function", spent(lambda: tf.flank(machine, gear)) / floor, 3.0)
    floor = spent(lambda: relative_sweep(grinding))
    at = machine.positions(gear, np.arange(grid.gear.zc)[:, None], np.linspace(-5.0, 5.0, 21))
    report.at_most(
        "tf.Machine.relative / exact and first order together", spent(lambda: machine.relative(**at)) / floor, 1.0
    )
    stated = tf.Machine(seed=7, uncertainty={"linear_um": 0.5})
    begun = process_time()
    tf.flank(stated, gear)
    report.at_most("tf.flank with how the errors may be wrong", process_time() - begun, 1.0, "s")


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
