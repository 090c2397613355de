"""Speed of the flank, as ratios measured in one run: `python benchmarks/flank.py [--plot FILE] [--quick]`."""

from __future__ import annotations

import argparse
import sys
import tracemalloc
from collections.abc import Callable
from time import perf_counter

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import root

from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import TOLERANCE, exact, prepare
from gateway.gear.first_order import first_order
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.linear import ErrorParameter, LinearFlank, linear_flank
from gateway.gear.ray import RayState, residual
from gateway.model.chain import Chain
from gateway.model.motion import Fourier, Polynomial
from gateway.model.preset import MOTION_NAMES, TWENTY_ONE, yk7350b

GEAR = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
DISTANCE = 160.0
VECTORS = 1000
MEGABYTE = 2.0**20


def say(text: str, value: float, limit: str = "") -> None:
    """One line of the report."""
    sys.stdout.write(f"{text:<66} {value:10.4g}  {limit}\n")
    sys.stdout.flush()


def best(work: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of some runs, s."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def machine(seed: int = 1) -> Chain:
    """18 functions of position and 3 location errors."""
    rng = np.random.default_rng(seed)
    errors: dict[str, Polynomial | Fourier | float] = {}
    for name in MOTION_NAMES:
        c = rng.uniform(-1.0, 1.0, 4) * (2e-5 if name[1] in "ABC" else 0.003)
        scale = 200.0 if name[2] == "X" else 20.0
        errors[name] = Fourier(c[0], tuple(c[1:3]), (c[3],)) if name[2] == "C" else Polynomial(tuple(c), 0.0, scale)
    return yk7350b({**errors, "B0Z": 2e-5, "A0C": -3e-5, "B0C": 4e-5})


def coefficients(count: int) -> list[ErrorParameter]:
    """Fourier coefficients of all 18 error motions, ``count`` in all."""
    pitch = {"X": 100.0, "Z": 20.0, "C": 2.0 * np.pi}
    orders = [(name, order) for order in range(count // 18 + 1) for name in MOTION_NAMES]
    return [ErrorParameter(name, Fourier(0.0, (0.0,) * o + (1.0,), (), pitch[name[2]])) for name, o in orders[:count]]


def linear(parameters: list[ErrorParameter], title: str, rms_limit: float, grid: FlankGrid) -> None:
    """First-order flank of many vectors against the plain product of the same blocks; RMS by Gram factor."""
    grinding = Grinding(yk7350b(), GEAR, DISTANCE)
    flank = linear_flank(grinding, grid, parameters)
    rng = np.random.default_rng(0)
    V = rng.normal(size=(len(parameters), VECTORS)) * 1e-3
    J, block = flank.jacobian(), flank.points // grid.shape[0]
    out = np.zeros((flank.points, VECTORS))

    def product() -> None:
        for first in range(0, flank.points, block):
            np.matmul(J[first : first + block], V, out=out[first : first + block])

    plain = best(product)
    say(f"{title}: product of {flank.points} points x {VECTORS} vectors, s", plain)
    say(f"{title}: flank into a given output / product", best(lambda: flank.deviations(V, out)) / plain, "<= 1.5")
    build: Callable[[], LinearFlank] = lambda: linear_flank(grinding, grid, parameters)  # noqa: E731
    say(f"{title}: with the Jacobian built inside / product", best(lambda: build().deviations(V, out)) / plain, "<= 2")
    form = flank.normal_form()
    form.rms(V)
    say(f"{title}: product / RMS by Gram factor", plain / best(lambda: form.rms(V), 30), f">= {rms_limit:g}")
    truth = np.sqrt(np.mean(out**2, axis=0))
    say(f"{title}: largest relative difference of the RMS", float(np.max(np.abs(form.rms(V) / truth - 1.0))), "<= 1e-9")


def one_by_one(grinding: Grinding, k: np.ndarray, theta: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The same residual and tolerance by scipy.optimize.root(hybr), point after point."""
    found = np.empty(k.size)
    for i in range(k.size):
        rays, start = prepare(grinding, k[i : i + 1], theta[i : i + 1], z[i : i + 1])

        def miss(u: np.ndarray, rays: object = rays, start: RayState = start) -> np.ndarray:
            state = RayState(u[0:1], u[1:2], u[2:3], start.low, start.high)
            return residual(rays, state)[:, 0]  # type: ignore[arg-type]

        answer = root(miss, [theta[i], 0.0, z[i]], method="hybr", options={"xtol": TOLERANCE})
        found[i] = answer.x[1]
    return found


def envelope(points: int, full: FlankGrid) -> None:
    """Exact flank: per point against hybr, and the memory of a whole gear."""
    grinding = Grinding(machine(), GEAR, DISTANCE)
    rng = np.random.default_rng(0)
    k = rng.integers(0, GEAR.zc, points).astype(float)
    theta, z = rng.uniform(-0.95, 0.95, points) * GEAR.half_pitch, rng.uniform(-5.0, 5.0, points)
    start = perf_counter()
    slow = one_by_one(grinding, k, theta, z)
    per_slow = (perf_counter() - start) / points
    say("exact: hybr, us per point", per_slow * 1e6)
    per_fast = best(lambda: exact(grinding, k, theta, z)) / points
    say(f"exact: hybr / ours on the same {points} scattered points", per_slow / per_fast, ">= 40")
    say("exact: largest difference of the two, mm", float(np.max(np.abs(slow - exact(grinding, k, theta, z)))), "1e-10")
    grid_time = best(lambda: exact(grinding, full.k, full.theta, full.z))
    count = int(np.prod(full.shape))
    say(f"exact: hybr / ours on a grid of {count} points", per_slow * count / grid_time, ">= 40")
    say(f"exact: {count} points, s", grid_time)
    tracemalloc.start()
    exact(grinding, full.k, full.theta, full.z)
    peak = tracemalloc.get_traced_memory()[1] / MEGABYTE
    tracemalloc.stop()
    say(f"exact: peak memory of {count} points, MiB", peak, "< 512")


def what_if() -> None:
    """Changing one error of the displayed flank, first order and exact."""
    shown = flank_grid(GEAR, profile=11, width=5)
    grinding = Grinding(machine(), GEAR, DISTANCE)
    changed = Grinding(grinding.chain.with_errors({"EYZ": 0.004}), GEAR, DISTANCE)
    say(
        "what-if of one error, exact, ms",
        1e3 * best(lambda: exact(changed, shown.k, shown.theta, shown.z)),
        "about 100",
    )
    say(
        "what-if of one error, first order, ms", 1e3 * best(lambda: first_order(changed, shown.k, shown.theta, shown.z))
    )


def growth(plot: str) -> None:
    """How the times grow with points and with errors; drawn into a file if one is named."""
    grinding = Grinding(machine(), GEAR, DISTANCE)
    sizes, exact_s, first_s = [], [], []
    for profile, width in ((2, 2), (5, 5), (11, 5), (18, 17), (36, 35)):
        grid = flank_grid(GEAR, profile=profile, width=width)
        sizes.append(int(np.prod(grid.shape)))
        exact_s.append(best(lambda grid=grid: exact(grinding, grid.k, grid.theta, grid.z), 2))
        first_s.append(best(lambda grid=grid: first_order(grinding, grid.k, grid.theta, grid.z), 2))
        say(f"growth: {sizes[-1]} points, exact s", exact_s[-1])
        say(f"growth: {sizes[-1]} points, first order s", first_s[-1])
    counts, linear_s = [21, 50, 100, 200], []
    grid, V = flank_grid(GEAR, profile=11, width=5), np.random.default_rng(0).normal(size=(200, VECTORS))
    for count in counts:
        flank = linear_flank(grinding, grid, coefficients(count))
        linear_s.append(best(lambda flank=flank, count=count: flank.deviations(V[:count])))
        say(f"growth: {count} parameters x {VECTORS} vectors, s", linear_s[-1])
    if plot:
        draw(plot, sizes, exact_s, first_s, counts, linear_s)


def draw(
    plot: str, sizes: list[int], exact_s: list[float], first_s: list[float], counts: list[int], linear_s: list[float]
) -> None:
    """Both growths in one figure."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(sizes, exact_s, "o-", label="exact")
    left.loglog(sizes, first_s, "s-", label="first order")
    left.set(xlabel="flank points", ylabel="s")
    left.legend()
    right.plot(counts, linear_s, "o-")
    right.set(xlabel="parameters", ylabel=f"s for {VECTORS} vectors")
    figure.savefig(plot)


def main() -> None:
    """Print every ratio with the limit it should keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", default="", help="draw the growth with points and errors into this file")
    parser.add_argument("--quick", action="store_true", help="200 points for hybr instead of 2000")
    options = parser.parse_args()
    full = flank_grid(GEAR, profile=36, width=35)
    linear([ErrorParameter(name) for name in TWENTY_ONE], "21 constants", 1000.0, full)
    linear(coefficients(200), "200 coefficients", 150.0, full)
    envelope(200 if options.quick else 2000, full)
    what_if()
    growth(options.plot)


if __name__ == "__main__":
    main()
