"""Ranking and correction: Morris screening against the bare model, its sampler against SALib, growth."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from multiprocessing import get_context
from time import perf_counter
from typing import Any

import numpy as np
from SALib.analyze import morris as salib_analysis
from SALib.sample import morris as salib_sample

from benchmarks.report import Report, main, slope, spent
from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import exact
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, Polynomial
from gateway.sensitivity.outputs import OUTPUTS, FlankOutputs, equal_spans
from gateway.sensitivity.screening import elementary_effects, run_sweep, screen, trajectories
from gateway.study.workers import workers

GEAR = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
GRINDING = Grinding(yk7350b(), GEAR, 160.0)
SEED = 1
QUIET = 0.5  # load before two workers: with less of it nothing else takes a core


def flank_only(made: FlankOutputs, points: np.ndarray) -> None:
    """The exact flanks of the points and nothing else."""
    grid, clean = made.grid, GRINDING.chain.without_errors()
    for one in points:
        errors = {span.name: float(span.size(x)) for span, x in zip(made.spans, one, strict=True)}
        exact(replace(GRINDING, chain=clean.with_errors(errors)), grid.k, grid.theta, grid.z)


def morris(report: Report) -> None:
    """What the screening adds to the model that it calls."""
    grid = flank_grid(GEAR, profile=3, width=2) if report.smoke else flank_grid(GEAR, profile=11, width=5)
    made = FlankOutputs(GRINDING, grid, equal_spans(TWENTY_ONE), "exact")
    r = report.pick(5, 1)
    points = trajectories(len(TWENTY_ONE), r, 4, SEED)
    flat = points.reshape(-1, points.shape[-1])
    repeats = report.pick(2, 1)
    alone = spent(lambda: flank_only(made, flat), repeats)
    whole = spent(lambda: screen(made, TWENTY_ONE, OUTPUTS, r=r, seed=SEED), repeats)
    report.say(f"Morris: {flat.shape[0]} bare exact flanks of {np.prod(grid.shape)} points", alone, "s")
    report.at_most("Morris: the whole screening / the bare flanks", whole / alone, 1.25)
    if not report.smoke:
        pools(report, made, points)


def pools(report: Report, made: FlankOutputs, points: np.ndarray) -> None:
    """Two workers of the product against two bare processes, by the wall.

    What else the computer does counts here alone, so that the limit holds where these processes are all that works.
    """
    ratios, quiet = [], os.getloadavg()[0] <= QUIET
    for _ in range(2):
        bare_s = two_bare(made, points.reshape(-1, points.shape[-1]))
        with workers(count=2) as pool:
            run_sweep(made, np.repeat(points[:1, :1], 4, axis=0), pool)  # every worker imports and runs once
            begun = perf_counter()
            run_sweep(made, points, pool)
            ratios.append((perf_counter() - begun) / bare_s)
    text = "Morris: two workers / two bare processes, wall time"
    if quiet:
        report.at_most(text, min(ratios), 1.2)
    else:
        report.say(f"{text}, judged on a quiet computer alone", min(ratios))


def bare(connection: Any, made: FlankOutputs) -> None:
    """A bare process: waits for points, works them out, answers."""
    while (points := connection.recv()) is not None:
        connection.send(made(points))


def two_bare(made: FlankOutputs, points: np.ndarray) -> float:
    """Seconds for two processes with half of the points each, started and warmed beforehand."""
    context = get_context("spawn")
    pipes = [context.Pipe() for _ in range(2)]
    processes = [context.Process(target=bare, args=(theirs, made)) for _, theirs in pipes]
    for process in processes:
        process.start()

    def run(parts: list[np.ndarray]) -> None:
        for (ours, _), part in zip(pipes, parts, strict=True):
            ours.send(part)
        for ours, _ in pipes:
            ours.recv()

    run([points[:1], points[:1]])
    begun = perf_counter()
    run(np.array_split(points, 2))
    seconds = perf_counter() - begun
    for (ours, _), process in zip(pipes, processes, strict=True):
        ours.send(None)
        process.join()
    return seconds


def sampling(report: Report) -> None:
    """Trajectories and effects of many inputs against SALib, and how they grow with the inputs."""
    small = report.pick(100, 20)
    problem = {"num_vars": small, "names": [f"x{i}" for i in range(small)], "bounds": [[0.0, 1.0]] * small}
    weights = np.linspace(1.0, 2.0, small)

    def theirs() -> np.ndarray:
        X = salib_sample.sample(problem, 10, num_levels=4, seed=SEED)
        found = salib_analysis.analyze(problem, X, X @ weights, num_levels=4, num_resamples=2)
        return np.asarray(found["mu_star"])

    def ours(d: int = small) -> np.ndarray:
        points = trajectories(d, 10, 4, SEED)
        return np.abs(elementary_effects(points, points @ np.linspace(1.0, 2.0, d))).mean(axis=0)

    report.at_most("sampler: largest difference of mu* to SALib", float(np.max(np.abs(theirs() - ours()))), 1e-9)
    report.at_most(f"sampler: ours / SALib, {small} inputs", spent(ours) / spent(theirs, 1), 0.2)
    sizes = [25.0, 50.0] if report.smoke else [250.0, 500.0, 1000.0]
    times = [spent(lambda size=size: ours(int(size))) for size in sizes]
    report.at_most(f"sampler: {sizes[-1]:.0f} inputs, 10 trajectories", times[-1], 0.5, "s")
    report.at_most("growth: slope with the inputs (the points alone grow with the square)", slope(sizes, times), 2.2)


def correction(report: Report) -> None:
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
    grid = flank_grid(GEAR, profile=3, width=2) if report.smoke else flank_grid(GEAR)
    flank = spent(lambda: exact(machine, grid.k, grid.theta, grid.z))
    for title, norm in (("least squares", "rms"), ("minimax", "max")):
        took = spent(lambda norm=norm: correct(machine, grid, Plan(grids, norm=norm)), 1)
        report.say(f"correction: both layers, {title}, {np.prod(grid.shape)} points", took, "s")
        report.at_most(f"correction: {title} / one exact flank", took / flank, 40.0 if norm == "rms" else 250.0)


def measure(report: Report) -> None:
    """All figures of this file."""
    morris(report)
    sampling(report)
    correction(report)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
