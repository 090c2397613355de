"""Inspected discs from files of flank points, with the uncertainty of the inspection."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.units import rad_to_deg
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.correct.part.inspected import USUAL_CLAMPING_UM, inspection_patterns
from gateway.gear.measured_points import Heights
from gateway.study.inputs import gear_of
from gateway.workflow.tooth.pairing import DiscFile, disc_of_file
from trueflank.given import of_kind, path_given
from trueflank.tooth import Flank, Gear


def read_flank(
    path: str | Path,
    gear: Gear,
    *,
    heights: Heights = "lower-face",
    columns: Mapping[str, str | int | float] | None = None,
    clamping_um: float = USUAL_CLAMPING_UM,
) -> Flank:
    """An inspected disc from a file of flank points (mm): its flanks in um as they are fitted, with u of inspection.

    ``heights`` says what z counts from: "lower-face" or "middle". ``columns`` of a table whose heading does not say
    them, counted from 1: ``{"space": 1, "flank": 2, "x": 3, "y": 4, "z": 5}``; ``probe_u_um`` is the standard
    uncertainty of one touch. ``clamping_um``: how well the part sat on the inspection machine's axis (k = 2).
    `Flank.u` comes from the scatter of the points and that. Raises ConfigError (E-LIBRARY-KIND, E-INSPECT-FILE,
    E-IMPORT-COLUMNS), FileFormatError with line and reason, ModelError (E-INSPECT-...: another gear, spaces missing).
    """
    path_given(path, "read_flank")
    of_kind(gear, Gear, "read_flank")
    if heights not in ("lower-face", "middle"):
        raise ConfigError(
            "E-LIBRARY-KIND", "read_flank", call="tf.read_flank", wanted="a zero of the heights", given=repr(heights),
            how='"lower-face" or "middle"',
        )  # fmt: skip
    disc = gear_of(gear.data)
    found = disc_of_file(Path(path), disc, DiscFile(heights, columns, clamping_um))
    places, patterns = inspection_patterns(disc, found, clamping_um)
    return Flank(
        deviation=found.fitted.deviation_um,
        angle=np.asarray(rad_to_deg(found.fitted.theta_rad)),
        height=found.fitted.z_mm,
        rms=found.fitted.rms_um,
        largest=found.fitted.largest_um,
        rotation_arcsec=found.turned_arcsec,
        gear=gear.data,
        doubts=FlankDoubts(places, (f"inspection of {Path(path)}",) * patterns.shape[-1], patterns),
    )
