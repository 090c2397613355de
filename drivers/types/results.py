"""A result file as a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.types.doubts import Doubt
from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import AxisUnit


@dataclass(frozen=True, slots=True)
class MeasuredSet:
    """A result file as a record: deviations (m, n, 2) with NaN where missing; last axis is + then -.

    ``targets`` shape (m,) in the axis unit, relative to the file's own zero (a vendor file has no machine
    datum); ``deviations`` in um or arcsec.
    """

    targets: FloatArray
    deviations: FloatArray
    axis_unit: AxisUnit
    ambient_start: Ambient = field(default_factory=Ambient)
    ambient_end: Ambient = field(default_factory=Ambient)
    compensated_for: CompensatedFor = "air+material"
    expansion_ppm_per_k: float | None = None
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
