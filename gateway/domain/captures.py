"""Deviations as captured, with all that was done to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.sensing import Ambient
from drivers.types.tables import LiveSet
from drivers.units import AxisUnit, DeviationUnit
from gateway.domain.equipment import SenseProof
from gateway.domain.values import FloatArray, component_unit


@dataclass(frozen=True, slots=True)
class CorrectionRecord:
    """One step done to readings: by whom, in which words, with which coefficients; ``undone`` takes it back."""

    step: str
    by: str
    words: Message
    coefficients: Mapping[str, float] = field(default_factory=dict)
    undone: bool = False


_NOT_DONE = Message.stored("none")
"""What an older version stored for a step that was not done."""


@dataclass(frozen=True, slots=True)
class Corrections:
    """What was applied to raw readings, by whom, with which coefficients; applied once, refused twice.

    Each of the first four says how that step was done, None where it was not; ``chain`` has every step in the order
    in which it was done.
    """

    air: Message | None = None
    expansion: Message | None = None
    dead_path: Message | None = None
    drift: Message | None = None
    details: Mapping[str, float] = field(default_factory=dict)
    chain: tuple[CorrectionRecord, ...] = ()

    def __post_init__(self) -> None:
        for name in ("air", "expansion", "dead_path", "drift"):
            if getattr(self, name) == _NOT_DONE:
                object.__setattr__(self, name, None)


@dataclass(frozen=True, slots=True)
class Between:
    """Check stops between the targets: places ``targets`` (k,), ``deviations`` (k, n, 2) as in a `Capture`.

    They are held against the fitted curve and never fitted themselves.
    """

    targets: FloatArray
    deviations: FloatArray


@dataclass(frozen=True, slots=True)
class Conditions:
    """Under which conditions a capture was made, as far as they are known.

    ``feed`` in mm/min or deg/min, ``overrun`` in mm or deg. ``stated`` are uncertainties from certificates (k = 2) by
    key: um_per_m, arcsec, kelvin. ``compensation`` names the tables that acted, "-" for none, "" where unknown.
    ``stands`` is where the site's axes stood before the axis began to move, by letter, mm or deg.
    """

    feed: float | None = None
    overrun: float | None = None
    dwell_s: float | None = None
    warm_up: str = ""
    operator: str = ""
    compensation: str = ""
    stated: Mapping[str, float] = field(default_factory=dict)
    stands: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Capture:
    """Deviations of one axis as captured, corrected, in um or arcsec.

    ``targets`` (m,) machine coordinates in the axis unit. ``deviations`` (m, n, 2): target, repetition,
    approach + then -, NaN where missing. ``reading_u`` is the standard uncertainty of one averaged reading
    as seen in its own window. ``suspects`` lists (target, repetition, approach index) out of line.
    ``live`` is what compensated the axis while it was measured. ``unsteady_u`` is the standard uncertainty that
    drift and jumps leave in the targets' means; ``drift_per_h`` how fast the zero wandered, 0 where that is not clear.
    ``line_mm`` is where the reflector stood beside the line that counts, its lever taken off; None: they hold for the
    line that was measured. ``lever_u`` is the standard uncertainty that unknown angles leave at each place.
    ``rest_u`` is the standard deviation of ``rest_count`` readings with the axis at rest: the instrument's own.
    """

    axis: str
    component: str
    axis_unit: AxisUnit
    targets: FloatArray
    deviations: FloatArray
    reading_u: float
    ambient_start: Ambient
    ambient_end: Ambient
    corrections: Corrections
    live: LiveSet | None
    sense: SenseProof | None
    suspects: tuple[tuple[int, int, int], ...] = ()
    source: str = "live"
    started_utc: str = ""
    ended_utc: str = ""
    notes: tuple[Message, ...] = ()
    cycle: Literal["standard", "pendulum", "pilgrim"] = "standard"
    between: Between | None = None
    unsteady_u: float = 0.0
    line_mm: tuple[float, float, float] | None = None
    lever_u: float = 0.0
    drift_per_h: float = 0.0
    rest_u: float = 0.0
    rest_count: int = 0
    conditions: Conditions | None = None
    doubts: tuple[Doubt, ...] = ()

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the deviations."""
        return component_unit(self.component, self.axis_unit)
