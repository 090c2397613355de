"""What files of gear measuring machines hold: curves of involutes, plane contours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.types.values import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class GearCurve:
    """One profile or lead of an involute: ``deviation_um`` (n,), + surplus material, NaN where nothing was measured.

    ``along_mm`` (n,): roll length of a profile, height of a lead. ``judged_mm`` is the range that counts. ``tooth`` as
    the machine names it; ``flank`` +1 left, -1 right.
    """

    feature: Literal["profile", "lead"]
    tooth: str
    flank: int
    along_mm: FloatArray
    deviation_um: FloatArray
    judged_mm: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class GearCurves:
    """What a machine wrote of an involute gear: curves; pitch in um by flank, columns f_p, F_p, F_r (teeth, 3).

    ``width_mm`` is the face width that a lead's slope is stated over, 0 where it is the judged range. ``header`` keeps
    the words of the file by their number.
    """

    curves: tuple[GearCurve, ...]
    pitch_um: Mapping[int, FloatArray] = field(default_factory=dict)
    width_mm: float = 0.0
    source: str = ""
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GearContour:
    """Plane sections of a gear: ``points_mm`` (n, 3) as scanned, ``section`` (n,) counts the scans from 0.

    The gear's axis lies near the origin; neither its place nor its turn is known, nor which space a point belongs to.
    """

    points_mm: FloatArray
    section: NDArray[np.int64]
    source: str = ""
    warnings: tuple[Message, ...] = ()
