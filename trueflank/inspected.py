"""Inspected discs from files of flank points, with the uncertainty of the inspection, and their deviations by cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.units import rad_to_deg
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.correct.part.inspected import USUAL_CLAMPING_UM, inspection_patterns
from gateway.domain.grinding_process import Separation
from gateway.domain.values import FloatArray
from gateway.gear.measured_points import Heights
from gateway.process.separation import separate as separate_parts
from gateway.process.wheel import LIMIT_UM, WheelCorrection, wheel_correction
from gateway.process.wheel_form import ProcessPart
from gateway.study.dresser import separation_data
from gateway.study.inputs import GearFile, gear_of
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
    _zero_given(heights, "read_flank")
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


@dataclass(frozen=True, slots=True, repr=False)
class Separated:
    """Causes of the deviations of inspected discs: RMS in um with standard uncertainty, and the wheel's form.

    ``angle`` (deg), ``form`` and ``u`` (um) are what the wheel leaves on every flank, + = surplus material.
    """

    found: Separation
    gear: GearFile

    @property
    def shares(self) -> Mapping[str, tuple[float, float]]:
        """RMS and u by cause, um: wheel, dresser, set-up, axes, clamping, wear, rest."""
        return {one.name: (one.rms_um, one.u_um) for one in self.found.shares}

    @property
    def angle(self) -> FloatArray:
        """Profile angles of the form, deg; the left flank is > 0."""
        return np.rad2deg(self.found.form.theta_rad)

    @property
    def form(self) -> FloatArray:
        """The wheel's form on the flank, um."""
        return np.asarray(self.found.form.deviation_um)

    @property
    def u(self) -> FloatArray:
        """Its standard uncertainty, um."""
        return np.asarray(self.found.form.u_um)

    def correction(self, diamond_mm: float, *, limit_um: float = LIMIT_UM) -> WheelCorrection:
        """Points of the wheel's axial section and what to change along its normal (um, + = a larger wheel).

        ``diamond_mm`` is the radius of the dresser's diamond. Raises ModelError (E-WHEEL-...).
        """
        distance = self.gear.grinding.centre_distance_mm
        return wheel_correction(gear_of(self.gear), distance, self.found, diamond_mm=diamond_mm, limit_um=limit_um)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names."""
        return separation_data(self.found)

    def plot(self) -> Any:
        """Shares as bars with their u, and the wheel's form with its uncertainty (k = 2), um; a matplotlib figure."""
        from gateway.study.dresser import separation_sheet
        from gateway.study.plots.charts import new_sheet

        return new_sheet((11.0, 4.4), lambda figure: separation_sheet(figure, self.found))

    def __repr__(self) -> str:
        largest = max(self.found.shares, key=lambda one: one.rms_um)
        total = self.found.total_um
        return f"Separated({total:.2f} um, {largest.name} {largest.rms_um:.2f} um)"


def separate(
    files: str | Path | Sequence[str | Path], gear: Gear, *, order: Sequence[int] | None = None,
    heights: Heights = "lower-face", columns: Mapping[str, str | int | float] | None = None,
    clamping_um: float = USUAL_CLAMPING_UM,
) -> Separated:  # fmt: skip
    """The causes of the deviations of discs from files of flank points (mm), all ground after one dressing.

    ``order`` are the spaces in the order of grinding; without it wear is not separated. The other arguments are those
    of `read_flank`. Raises what that raises, ModelError (E-PROCESS-...).
    """
    of_kind(gear, Gear, "separate")
    paths = [files] if isinstance(files, str) or hasattr(files, "__fspath__") else list(files)
    for path in paths:
        path_given(path, "separate")
    _zero_given(heights, "separate")
    disc, how = gear_of(gear.data), DiscFile(heights, columns, clamping_um)
    parts = [
        ProcessPart.of(disc_of_file(Path(path), disc, how), order=order, clamping_um=clamping_um) for path in paths
    ]
    return Separated(separate_parts(disc, parts), gear.data)


def _zero_given(heights: str, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) for a zero of the heights that is none."""
    if heights not in ("lower-face", "middle"):
        raise ConfigError(
            "E-LIBRARY-KIND", call, call=f"tf.{call}", wanted=Message.of("W-LIB-ZERO"), given=repr(heights),
            how=Message.of("W-LIB-FACE"),
        )  # fmt: skip
