"""Random machines for the gear tests, and a slow independent way to the exact flank."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from drivers.types.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import Grinding
from gateway.model import transforms
from gateway.model.chain import Chain
from gateway.model.error_model import MOTION_NAMES, TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, Polynomial

TEN_MILLIDEGREES = np.deg2rad(0.01)
RV40E = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
RV20E = CycloidGear(52.0, 2.25, 0.9, 40, 39, 8.0)
RV320E = CycloidGear(114.5, 5.0, 2.2, 40, 39, 20.0)
DISC = CycloidGear(90.0, 7.0, 4.0, 12, 11, 15.0)
GEARS = (RV40E, RV20E, RV320E, DISC)


def is_angle(name: str) -> bool:
    """Whether an error is an angle: EAX, B0Z."""
    return name[1] in "ABC" if name.startswith("E") else name[0] in "ABC"


def random_constants(rng: np.random.Generator, scale: float = 1.0) -> dict[str, float]:
    """All 21, up to 5 um and 0.01 deg times ``scale``."""
    size = {name: (TEN_MILLIDEGREES if is_angle(name) else 0.005) * scale for name in TWENTY_ONE}
    return {name: float(rng.uniform(-1.0, 1.0)) * size[name] for name in TWENTY_ONE}


def random_functions(rng: np.random.Generator) -> Chain:
    """18 functions of position and 3 location errors."""
    errors: dict[str, object] = {}
    for name in MOTION_NAMES:
        size = 2e-5 if is_angle(name) else 0.003
        c = rng.uniform(-size, size, 4)
        if name[2] == "C":
            errors[name] = Fourier(float(c[0]), tuple(c[1:3]), (float(c[3]),))
        else:
            errors[name] = Polynomial(tuple(c), 0.0, 200.0 if name[2] == "X" else 20.0)
    location = {name: float(rng.uniform(-5e-5, 5e-5)) for name in ("B0Z", "A0C", "B0C")}
    return yk7350b({**errors, **location}, c_frame="fixed" if rng.random() < 0.5 else "moving")


Commands = Mapping[str, FloatArray]


def slow_exact(
    grinding: Grinding, k: float, theta: float, z: float, moved: Callable[[Commands], Commands] = dict
) -> float:
    """Least over the stroke of the distance at which the normal enters the wheel body, by root and line search.

    ``moved`` is what a control makes of the commands.
    """
    gear = grinding.gear
    nominal = gear.space(theta, k)
    r0, n0 = np.array([nominal.x, nominal.y, z]), np.array([nominal.nx, nominal.ny, 0.0])

    def radius(y: float) -> float:
        """The wheel's radius where its axial coordinate is y."""

        def miss(t: float) -> float:
            return float(grinding.dressing.section(gear, np.asarray(t)).y) - y

        t = brentq(miss, -1.2 * gear.half_pitch, 1.2 * gear.half_pitch, xtol=1e-15, rtol=1e-14)
        return grinding.E - float(grinding.dressing.section(gear, np.asarray(t)).x)

    def entry(s: float) -> float:
        back = transforms.inverse(grinding.chain.actual(moved(grinding.commands(k, s))))

        def outside(e: float) -> float:
            p = transforms.move(back, r0 + e * n0)
            return float(np.hypot(p[0], p[2])) - radius(float(p[1]))

        return float(brentq(outside, -0.1, 0.1, xtol=1e-15, rtol=1e-14))

    grid = np.linspace(z - 3.0, z + 3.0, 25)
    best = int(np.argmin([entry(float(s)) for s in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(entry, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
    return float(found.fun)


def spread(gear: CycloidGear, count: int) -> FloatArray:
    """Profile angles over 95 % of a space."""
    return np.linspace(-0.95, 0.95, count) * gear.half_pitch
