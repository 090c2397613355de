"""A flank as it would be with the set-up values right: constants of the infeed and of the dressing taken off; pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gateway.gear.cycloid import CycloidGear
from gateway.tooth import FlankMap


def set_right(flank: FlankMap, gear: CycloidGear) -> FlankMap:
    """The flank less what one move of the infeed, one of the dresser and one rotation can take, by least squares.

    A move of the infeed shows as n_x, one of the dressed profile as n_y, a rotation as h, alike in every space and at
    every height. What is left no set-up value can cure.
    """
    section = gear.section(flank.theta_rad)
    shape = flank.deviation_um.shape
    columns = [np.broadcast_to(one[None, :, None], shape).ravel() for one in (section.nx, section.ny, section.h)]
    design = np.stack(columns, axis=1)
    taken = design @ np.linalg.lstsq(design, flank.deviation_um.ravel(), rcond=None)[0]
    return replace(flank, deviation_um=flank.deviation_um - taken.reshape(shape))
