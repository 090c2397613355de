"""Samples of circular tests: a ballbar or grid encoder on two axes, in one sense or both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.message import Message
from drivers.types.values import FloatArray


@dataclass(frozen=True, slots=True)
class CircleRecord:
    """Samples (n,) in the order of the file: commanded angle in deg, outward radial deviation in um, sense +1 or -1.

    The angle counts from + of the plane's first axis towards + of its second; sense +1 is the way it grows.
    ``radius_mm`` and ``feed_mm_min`` are None where nobody stated them; ``plane`` is XY, YZ or ZX, "" unstated.
    ``calibrated``: the bar's length is known, so that the mean radius is a figure.
    """

    angle_deg: FloatArray
    radial_um: FloatArray
    sense: FloatArray
    radius_mm: float | None = None
    feed_mm_min: float | None = None
    plane: str = ""
    calibrated: bool = False
    pitch_mm: Mapping[str, float] = field(default_factory=dict)
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class MakersFigure:
    """One result figure as a maker's file has it: its name and type there, value and unit."""

    name: str
    kind: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class MakersFigures:
    """The results that a maker's program worked out; no samples, no evaluation of ours."""

    figures: tuple[MakersFigure, ...]
    plane: str = ""
    header: Mapping[str, str] = field(default_factory=dict)
