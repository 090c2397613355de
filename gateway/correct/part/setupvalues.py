"""Set-up values from an inspected trial part: what of its flanks is constant, and which values take it; pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.errors import words
from drivers.limits import SOLVED_STEP
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.flankmodel import command_effects
from gateway.correct.flank.wheel_places import places_of_points
from gateway.domain.values import COVERAGE
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import Grinding
from gateway.model.preset import yk7350b
from gateway.tooth import InspectedFlank, SetupValues

RESOLUTION_UM = float(mm_to_um(SOLVED_STEP))


@dataclass(frozen=True, slots=True)
class SetupFound:
    """Changes of the set-up values in whole steps, their standard uncertainties, and in words what was left alone."""

    setup: SetupValues
    u: SetupValues
    said: tuple[str, ...]


def setup_from_part(
    inspected: InspectedFlank, gear: CycloidGear, *, resolution_um: float = RESOLUTION_UM
) -> SetupFound:
    """What to add to the set-up values so that the next part shows no constant A and no constant B.

    The constants are those of the fitted flank by least squares over the judged grid, one rotation with them: C zero
    stays, a rotation is no figure. Corrections are added to commands: a part with surplus in the bottom of its spaces
    (A > 0) asks for more infeed. A value within its uncertainty (k = 2) or half a step stays as it is. ``u`` is that of
    the constants by the scatter of the points and the step. An eccentric clamping of the inspection makes no constant;
    a probe whose size is wrong makes one, is in ``Shop.size_um`` and nowhere here.
    """
    flank = inspected.fitted
    shape = flank.deviation_um.shape
    section = gear.section(flank.theta_rad)
    ways = (np.broadcast_to(one[None, :, None], shape).ravel() for one in (section.nx, section.ny, section.h))
    found = np.linalg.lstsq(np.stack(list(ways), axis=1), flank.deviation_um.ravel(), rcond=None)[0]
    effects = _effects(gear)
    u = _scatter(inspected, gear)[:2] / np.abs(effects)
    wanted = -found[:2] / effects
    steps = np.rint(wanted / resolution_um)
    kept = (np.abs(wanted) > COVERAGE * u) & (steps != 0.0)
    said = [
        words("S-SETUP-WITHIN-U", name=name, value=f"{value:+.2f}", U=f"{COVERAGE * one:.2f}")
        for name, value, one, keep in zip(("x zero", "dressing offset"), wanted, u, kept, strict=True)
        if not keep
    ]
    x, dressing = (float(round(one * resolution_um, 6)) for one in np.where(kept, steps, 0.0))
    whole = np.hypot(u, resolution_um / 12.0**0.5)
    return SetupFound(
        SetupValues(x_um=x, dressing_um=dressing),
        SetupValues(x_um=float(whole[0]), dressing_um=float(whole[1])),
        tuple(said),
    )


def _effects(gear: CycloidGear) -> FloatArray:
    """A per um of x zero, B per um of dressing offset: the same in every space and at every height."""
    grinding = Grinding(yk7350b(), gear, 2.0 * float(gear.limits().r_tip))
    one = places_of_points(gear, 0.0, 0.0, 0.0)
    return np.array([command_effects(grinding, one)[grinding.infeed][0, 0], 1.0])


def _scatter(inspected: InspectedFlank, gear: CycloidGear) -> FloatArray:
    """Standard uncertainties (3,) of constant A, B, G by the scatter of the points measured (um, um, um per mm)."""
    section = gear.section(inspected.theta_rad)
    form = np.stack([section.nx, section.ny, section.h], axis=1)
    inverse = np.linalg.pinv(form.T @ form, hermitian=True)
    return np.asarray(inspected.u_um * np.sqrt(np.maximum(np.diag(inverse), 0.0)))
