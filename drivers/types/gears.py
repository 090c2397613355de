"""Flank points and what a gear inspection machine is asked and says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.types.values import FloatArray


@dataclass(frozen=True, slots=True)
class GearInspection:
    """Measured flank points of one gear: positions, not a grid; each knows its space and flank.

    ``points_mm`` (n, 3): touched points x, y, z in the part frame, z along the gear's axis. ``space`` (n,) whole
    numbers; ``flank`` (n,): +1 the left flank of its space, -1 the right one. ``deviation_um`` (n,) along the
    normal, + surplus material, where the machine said it. ``probe_u_um`` standard uncertainty of one touch.
    """

    points_mm: FloatArray
    space: NDArray[np.int64]
    flank: NDArray[np.int64]
    deviation_um: FloatArray | None = None
    probe_u_um: float | None = None
    source: str = ""
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()

    def __len__(self) -> int:
        return int(self.points_mm.shape[0])


Flank = Literal["left", "right"]


GearTrace = Literal["profile", "lead", "pitch", "runout"]


@dataclass(frozen=True, slots=True)
class ClampedPart:
    """What is clamped on a gear inspection machine: ``part`` its number, ``clamping`` how, in the operator's words."""

    clamped: bool
    part: str = ""
    clamping: str = ""


@dataclass(frozen=True, slots=True)
class GearPlan:
    """What to measure of a gear with ``space_count`` spaces, numbered from 0 at +x towards +y.

    ``spaces`` are those whose ``flanks`` get a profile line (``profile_points`` at height ``profile_z_mm``) and a
    lead line (``lead_points`` over ``lead_z_mm``); no line where its points are 0. ``pitch`` touches both flanks of
    every space once, ``runout_ball_mm`` a ball of that diameter in every space (0: none).
    """

    space_count: int
    spaces: tuple[int, ...]
    flanks: tuple[Flank, ...] = ("left", "right")
    profile_points: int = 0
    profile_z_mm: float = 0.0
    lead_points: int = 0
    lead_z_mm: tuple[float, float] = (0.0, 0.0)
    pitch: bool = False
    runout_ball_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class InspectedGear:
    """What an inspection machine measured of one clamping: flank points, and balls in the spaces for the runout.

    ``trace`` (n,) names the line each point of ``inspection`` belongs to. ``balls_mm`` (m, 3) are ball centres in
    the part frame, ``ball_space`` (m,) their spaces. ``temperature_degc`` of the part, None where not measured.
    """

    inspection: GearInspection
    trace: tuple[GearTrace, ...]
    part: ClampedPart
    balls_mm: FloatArray
    ball_space: NDArray[np.int64]
    temperature_degc: float | None = None
    measured_utc: str = ""


class GearTraces(NamedTuple):
    """Traces whose points are known by their radius and height alone, with the deviation along the normal.

    ``radius_mm``, ``z_mm``, ``deviation_um`` (n,), + surplus; ``space`` and ``flank`` as in `GearInspection`.
    """

    radius_mm: FloatArray
    z_mm: FloatArray
    deviation_um: FloatArray
    space: NDArray[np.int64]
    flank: NDArray[np.int64]
    probe_u_um: float | None = None
    source: str = ""
    warnings: tuple[Message, ...] = ()
