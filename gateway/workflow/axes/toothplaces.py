"""Where along an axis the work of the site is ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.types.values import FloatArray
from gateway.config import AxisSection, SiteFile
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.study.inputs import gear_of, load_gear

HEIGHTS = 25


def tooth_places(site: SiteFile, site_path: Path, axis: AxisSection) -> FloatArray:
    """Positions (n,) of an axis, mm or deg, at which the flank of the site's work is made; none without work.

    Raises ConfigError (E-STUDY-...), ModelError (E-GEAR-...) for a gear file that is none.
    """
    if site.work is None:
        return np.empty(0)
    file = load_gear(site_path.parent / site.work.gear)
    gear = gear_of(file)
    grinding = Grinding(
        chain_of_errors(ErrorModel(), height_mm=site.work.height_mm), gear, file.grinding.centre_distance_mm
    )
    heights = np.linspace(-0.5, 0.5, HEIGHTS) * gear.b
    commands = grinding.commands(np.arange(gear.zc)[:, None], heights[None, :])
    if axis.letter not in commands:
        return np.empty(0)
    places = np.unique(np.round(np.atleast_1d(commands[axis.letter]), 6))
    return np.asarray(np.rad2deg(places) % 360.0 if axis.kind == "rotary" else places)
