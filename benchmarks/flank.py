"""Flank and chain: exact flank, first order, poses, and how they grow with the points."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable

import numpy as np
from scipy.optimize import root

from benchmarks import compiled
from benchmarks.report import Report, main, slope, spent
from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import TOLERANCE, exact, prepare
from gateway.gear.first_order import ErrorParameter, LinearFlank, first_order, linear_flank
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.wheel_passage import RayState, residual
from gateway.model.chain import Chain
from gateway.model.error_model import MOTION_NAMES, TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, Polynomial

GEAR = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
DISTANCE = 160.0
MEGABYTE = 2.0**20


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


def linear(report: Report, parameters: list[ErrorParameter], title: str, rms_limit: float, grid: FlankGrid) -> None:
    """First-order flank of many vectors against the plain product of the same blocks; RMS by Gram factor."""
    grinding = Grinding(yk7350b(), GEAR, DISTANCE)
    flank = linear_flank(grinding, grid, parameters)
    vectors = report.pick(1000, 50)
    V = np.random.default_rng(0).normal(size=(len(parameters), vectors)) * 1e-3
    J, block = flank.jacobian(), flank.points // grid.shape[0]
    out = np.zeros((flank.points, vectors))

    def product() -> None:
        for first in range(0, flank.points, block):
            np.matmul(J[first : first + block], V, out=out[first : first + block])

    plain = spent(product)
    form = flank.normal_form()
    form.rms(V)
    report.say(f"{title}: product of {flank.points} points x {vectors} vectors", plain, "s")
    report.at_most(
        f"{title}: flank into a given output / product", spent(lambda: flank.deviations(V, out)) / plain, 1.15
    )
    build: Callable[[], LinearFlank] = lambda: linear_flank(grinding, grid, parameters)  # noqa: E731
    report.at_most(
        f"{title}: with the Jacobian built inside / product", spent(lambda: build().deviations(V, out)) / plain, 2.0
    )
    report.at_least(f"{title}: product / RMS by Gram factor", plain / spent(lambda: form.rms(V)), rms_limit)
    truth = np.sqrt(np.mean(out**2, axis=0))
    worst = float(np.max(np.abs(form.rms(V) / truth - 1.0)))
    report.at_most(f"{title}: largest relative difference of that RMS", worst, 1e-9)


def plain_numpy(values: dict[str, np.ndarray], q: dict[str, np.ndarray]) -> np.ndarray:
    """The same pose by batched 4 x 4 products as anybody would write them, the error values (N,) given."""
    count = q["X"].size

    def error(axis: str) -> np.ndarray:
        dx, dy, dz, a, b, c = (values[f"E{letter}{axis}"] for letter in "XYZABC")
        T = np.zeros((count, 4, 4))
        sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
        T[:, 0] = np.stack([cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, dx], -1)
        T[:, 1] = np.stack([sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa, dy], -1)
        T[:, 2] = np.stack([-sb, cb * sa, cb * ca, dz], -1)
        T[:, 3, 3] = 1.0
        return T

    def moved(x: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
        T = np.zeros((count, 4, 4))
        T[:] = np.eye(4)
        T[:, 0, 3], T[:, 2, 3] = x, z
        return T

    c, s = np.cos(q["C"]), np.sin(q["C"])
    turned = np.zeros((count, 4, 4))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1] = c, -s, s, c
    turned[:, 2, 2] = turned[:, 3, 3] = 1.0
    work = moved(q["X"], 0.0) @ error("X") @ turned @ error("C")
    back = np.zeros_like(work)
    back[:, :3, :3] = np.swapaxes(work[:, :3, :3], 1, 2)
    back[:, :3, 3] = -(back[:, :3, :3] @ work[:, :3, 3:])[..., 0]
    back[:, 3, 3] = 1.0
    return np.asarray(back @ moved(0.0, q["Z"]) @ error("Z"))


def poses(report: Report) -> None:
    """The actual pose of the wheel in the work against plain batched 4 x 4 products."""
    curves = {name: Polynomial((1e-5, 2e-5, -1e-5), 0.0, 50.0) for name in MOTION_NAMES}
    chain, rng, count = yk7350b(curves), np.random.default_rng(3), report.pick(100_000, 2_000)
    ranges = {"X": (-200.0, 0.0), "Z": (-10.0, 10.0), "C": (0.0, 2.0 * np.pi)}
    q = {name: rng.uniform(*span, count) for name, span in ranges.items()}

    def floor() -> np.ndarray:
        return plain_numpy({name: curve(q[name[2]]) for name, curve in curves.items()}, q)

    worst = float(np.max(np.abs(floor() - chain.actual(q))))
    report.at_most("chain: largest difference to plain batched products", worst, 1e-9, "mm")
    plain = spent(floor)
    report.say(f"chain: plain batched 4 x 4 products at {count} positions", plain, "s")
    report.at_most("chain: actual pose / plain batched products", spent(lambda: chain.actual(q)) / plain, 1.5)


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


def envelope(report: Report, full: FlankGrid) -> None:
    """Exact flank against a general solver, and the memory of a whole gear."""
    grinding, points = Grinding(machine(), GEAR, DISTANCE), report.pick(500, 5)
    rng = np.random.default_rng(0)
    k = rng.integers(0, GEAR.zc, points).astype(float)
    theta, z = rng.uniform(-0.95, 0.95, points) * GEAR.half_pitch, rng.uniform(-5.0, 5.0, points)
    slow = one_by_one(grinding, k, theta, z)
    per_slow = spent(lambda: one_by_one(grinding, k, theta, z), 1) / points
    report.say("exact: scipy.optimize.root(hybr), a point", 1e6 * per_slow, "us")
    per_fast = spent(lambda: exact(grinding, k, theta, z)) / points
    report.at_least(f"exact: hybr / ours on the same {points} scattered points", per_slow / per_fast, 40.0)
    worst = float(np.max(np.abs(slow - exact(grinding, k, theta, z))))
    report.at_most("exact: largest difference of the two", worst, 1e-9, "mm")
    count = int(np.prod(full.shape))
    report.say(f"exact: {count} points", spent(lambda: exact(grinding, full.k, full.theta, full.z)), "s")
    tracemalloc.start()
    exact(grinding, full.k, full.theta, full.z)
    peak = tracemalloc.get_traced_memory()[1] / MEGABYTE
    tracemalloc.stop()
    report.at_most(f"exact: peak memory of {count} points", peak, 64.0, "MiB")


def fused(report: Report, grid: FlankGrid) -> None:
    """Exact flank of constant errors against a compiled loop of the same steps without checks."""
    if compiled.library() is None:
        report.leave_out("exact: ours / a compiled loop", "no C compiler here")
        return
    rng = np.random.default_rng(5)
    errors = {
        name: float(rng.normal() * (2e-5 if name[1] in "ABC" or name[0] in "ABC" else 0.003)) for name in TWENTY_ONE
    }
    grinding = Grinding(yk7350b(errors), GEAR, DISTANCE)
    theta, z = (part.ravel() for part in np.broadcast_arrays(grid.theta, grid.z))
    theta, z = np.array(theta), np.array(z)
    data = np.array([GEAR.pin_circle, GEAR.pin, GEAR.K, GEAR.a, float(GEAR.zp)])

    def loop() -> np.ndarray:
        rows = []
        for k in range(GEAR.zc):
            q = grinding.commands(k, 0.0)
            zero = grinding.actual(q)
            one = grinding.actual({**q, grinding.stroke: q[grinding.stroke] + grinding.stroke_sense})
            angle = float(GEAR.space_angle(k))
            rows.append(compiled.flank(zero[:3], (one - zero)[:3], data, DISTANCE, angle, theta, z))
        return np.stack(rows)

    ours: Callable[[], np.ndarray] = lambda: exact(grinding, np.arange(GEAR.zc)[:, None], theta, z)  # noqa: E731
    worst = float(np.max(np.abs(loop() - ours())))
    report.at_most("exact: largest difference to a compiled loop, 21 constants", worst, 1e-9, "mm")
    report.at_most(f"exact: ours / compiled loop, {GEAR.zc * theta.size} points", spent(ours) / spent(loop), 6.0)


def what_if(report: Report) -> None:
    """Changing one error of the displayed flank, first order and exact."""
    shown = flank_grid(GEAR, profile=11, width=5)
    grinding = Grinding(machine(), GEAR, DISTANCE)
    changed = Grinding(grinding.chain.with_errors({"EYZ": 0.004}), GEAR, DISTANCE)
    report.say("what-if of one error, exact", 1e3 * spent(lambda: exact(changed, shown.k, shown.theta, shown.z)), "ms")
    first = 1e3 * spent(lambda: first_order(changed, shown.k, shown.theta, shown.z))
    report.say("what-if of one error, first order", first, "ms")


def growth(report: Report) -> None:
    """How the times grow with the points, on log scales."""
    grinding = Grinding(machine(), GEAR, DISTANCE)
    sizes: list[float] = []
    exact_s: list[float] = []
    first_s: list[float] = []
    for profile, width in ((5, 3), (11, 5)) if report.smoke else ((11, 5), (36, 35), (114, 112)):
        grid = flank_grid(GEAR, profile=profile, width=width)
        sizes.append(float(np.prod(grid.shape)))
        exact_s.append(spent(lambda grid=grid: exact(grinding, grid.k, grid.theta, grid.z), 2))
        first_s.append(spent(lambda grid=grid: first_order(grinding, grid.k, grid.theta, grid.z), 2))
        report.say(f"growth: {sizes[-1]:.0f} points, exact", exact_s[-1], "s")
        report.say(f"growth: {sizes[-1]:.0f} points, first order", first_s[-1], "s")
    report.at_most(f"growth: slope up to {sizes[-1]:.0f} points, exact", slope(sizes, exact_s), 1.15)
    report.at_most(f"growth: slope up to {sizes[-1]:.0f} points, first order", slope(sizes, first_s), 1.15)


def measure(report: Report) -> None:
    """All figures of this file."""
    grid = flank_grid(GEAR, profile=5, width=3) if report.smoke else flank_grid(GEAR, profile=36, width=35)
    linear(report, [ErrorParameter(name) for name in TWENTY_ONE], "21 constants", 1000.0, grid)
    linear(report, coefficients(200), "200 coefficients", 150.0, grid)
    poses(report)
    envelope(report, grid)
    fused(report, grid)
    what_if(report)
    growth(report)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
