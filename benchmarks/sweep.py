"""Cost of sweeps around the model, as ratios measured in one run: `python benchmarks/sweep.py [--quick] [--plot FILE]`.

Serial: the whole Morris screening against the bare model on the same points. Two workers: the screening through the
process pool against two bare processes that each do half of the points (pools are started beforehand in both).
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import Executor
from dataclasses import replace
from multiprocessing import get_context
from time import perf_counter
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from matplotlib.figure import Figure

from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import exact
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.motion import Fourier, Polynomial
from gateway.model.preset import TWENTY_ONE, yk7350b
from gateway.sensitivity.morris import trajectories
from gateway.sensitivity.outputs import OUTPUTS, FlankOutputs, equal_spans
from gateway.sensitivity.sweep import screen, sweep
from gateway.study.workers import workers

GEAR = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
GRINDING = Grinding(yk7350b(), GEAR, 160.0)
SEED = 1


def say(text: str, value: float, limit: str = "") -> None:
    """One line of the report."""
    sys.stdout.write(f"{text:<66} {value:10.4g}  {limit}\n")
    sys.stdout.flush()


def model(profile: int = 11, width: int = 5) -> FlankOutputs:
    """The exact flank of 39 spaces x 2 flanks x profile x width points."""
    return FlankOutputs(GRINDING, flank_grid(GEAR, profile=profile, width=width), equal_spans(TWENTY_ONE), "exact")


def timed(work: Any) -> float:
    """Seconds of one call."""
    start = perf_counter()
    work()
    return perf_counter() - start


def bare(connection: Any, made: FlankOutputs) -> None:
    """A bare process: waits for points, works them out, answers."""
    while (points := connection.recv()) is not None:
        connection.send(made(points))


def flank_only(made: FlankOutputs, points: np.ndarray) -> None:
    """The exact flanks of the points and nothing else."""
    grid, clean = made.grid, GRINDING.chain.without_errors()
    for one in points:
        errors = {span.name: float(span.size(x)) for span, x in zip(made.spans, one, strict=True)}
        exact(replace(GRINDING, chain=clean.with_errors(errors)), grid.k, grid.theta, grid.z)


def two_bare(made: FlankOutputs, points: np.ndarray) -> float:
    """Seconds for two processes with half of the points each, started and warmed beforehand."""
    context = get_context("spawn")
    pipes = [context.Pipe() for _ in range(2)]
    processes = [context.Process(target=bare, args=(theirs, made)) for _, theirs in pipes]
    for process in processes:
        process.start()
    halves = np.array_split(points, 2)

    def run(parts: list[np.ndarray]) -> None:
        for (ours, _), part in zip(pipes, parts, strict=True):
            ours.send(part)
        for ours, _ in pipes:
            ours.recv()

    run([points[:1], points[:1]])
    seconds = timed(lambda: run(halves))
    for (ours, _), process in zip(pipes, processes, strict=True):
        ours.send(None)
        process.join()
    return seconds


def two_workers(made: FlankOutputs, points: np.ndarray) -> float:
    """Seconds for the same points through the product's pool of two, started and warmed beforehand."""
    with workers(count=2) as pool:
        warm(pool, made, points)
        return timed(lambda: sweep(made, points, pool))


def warm(pool: Executor | None, made: FlankOutputs, points: np.ndarray) -> None:
    """Let every worker import and run once."""
    sweep(made, np.repeat(points[:1, :1], 4, axis=0), pool)


def morris(r: int, repeats: int) -> None:
    """Overhead of the screening, serial and with two workers."""
    made = model()
    points = trajectories(len(TWENTY_ONE), r, 4, SEED)
    flat = points.reshape(-1, points.shape[-1])
    serial, whole, processes, pool, flanks = [], [], [], [], []
    for _ in range(repeats):
        flanks.append(timed(lambda: flank_only(made, flat)))
        serial.append(timed(lambda: made(flat)))
        whole.append(timed(lambda: screen(made, TWENTY_ONE, OUTPUTS, r=r, seed=SEED)))
        processes.append(two_bare(made, flat))
        pool.append(two_workers(made, points))
    alone, both = min(serial), min(processes)
    say(f"Morris over the exact flank, {flat.shape[0]} runs of 4290 points: model, s", alone)
    say("overhead of the whole screening against the model, serial", min(whole) / alone - 1.0, "<= 0.20")
    say("overhead of the whole screening against the bare flank", min(whole) / min(flanks) - 1.0, "<= 0.20")
    say("speed-up of two bare processes", alone / both)
    say("speed-up of two workers against it", (alone / min(pool)) / (alone / both), ">= 0.85")


def correction() -> None:
    """How long the two layers take, with tables of 5 mm and 15 deg."""
    errors = {
        "EXZ": Polynomial((0.0, 0.002, 0.001), 0.0, 10.0),
        "EYC": Fourier(0.0, (0.0, 0.004)),
        "ECC": Fourier(0.0, (2e-5,), (1e-5,)),
    }
    machine = Grinding(yk7350b(errors, c_frame="fixed"), GEAR, 160.0)
    grids = (
        AxisGrid("X", -200.0, 0.0, 20.0),
        AxisGrid("Z", -10.0, 10.0, 5.0),
        AxisGrid("C", 0.0, 360.0, 15.0, 0.0, True),
    )
    grid = flank_grid(GEAR)
    say("both layers, least squares, 4290 points, s", timed(lambda: correct(machine, grid, Plan(grids))))
    say("both layers, minimax, 4290 points, s", timed(lambda: correct(machine, grid, Plan(grids, norm="max"))))


def growth(path: str) -> None:
    """Plot how one exact run grows with the number of points."""
    sizes, times = [], []
    for profile, width in ((3, 2), (5, 3), (11, 5), (15, 9), (21, 15)):
        made = model(profile, width)
        sizes.append(made.grid.k.size * made.grid.theta.size * made.grid.z.size)
        x = np.full((1, len(TWENTY_ONE)), 0.5)
        made(x)
        times.append(min(timed(lambda made=made, x=x: made(x)) for _ in range(3)))
    figure = Figure(figsize=(5.0, 3.5), dpi=150)
    panel = figure.subplots()
    panel.loglog(sizes, times, "o-")
    panel.set_xlabel("flank points")
    panel.set_ylabel("one run with all outputs  s")
    figure.savefig(path)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer trajectories, one repeat")
    parser.add_argument("--plot", default="", help="PNG of how one run grows")
    options = parser.parse_args()
    morris(4 if options.quick else 20, 1 if options.quick else 3)
    correction()
    if options.plot:
        growth(options.plot)


if __name__ == "__main__":
    main()
