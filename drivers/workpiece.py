"""A test part ground through the control: its plan, where its axes go, and what is refused before anything is sent."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from drivers.errors import ConfigError

MOST_X_MM, MOST_C_DEG, MOST_DRESSING_MM = 0.2, 0.05, 0.2
CLEAR_MM = 6.0
INDEX_OVERRUN_DEG = 5.0
DRESSER_OVERRUN_MM = 2.0
# What a wheel's start may be made of: spindle speeds, M and H functions, but none that ends or stops a program.
_WHEEL_WORD = re.compile(r"(?:S(?:\d=)?\d{1,5}|[MH](?:\d=)?(?!0*(?:0|1|2|17|30)$)\d{1,4})")


@dataclass(frozen=True, slots=True)
class GrindAxis:
    """One axis of a grind: ``name`` as in MD10000, ``letter`` in programs, measuring system.

    ``travel`` (low, high) in mm or deg; None where nobody told it, or where the axis turns endlessly.
    """

    name: str
    letter: str
    travel: tuple[float, float] | None = None
    encoder: int = 0


@dataclass(frozen=True, slots=True)
class GrindPlan:
    """A disc ground space by space, in machine coordinates (mm, deg); every axis comes from one side only.

    At X = -``centre_distance_mm`` + ``x_mm`` the wheel is at full depth, and X rises into the cut. The middle of the
    face stands at Z = ``height_mm``; space k at C = ``c_deg`` + ``index_sense`` 360 k / ``spaces``; the dresser at
    ``dressing_mm``. ``overrun_mm`` is how far Z goes beyond the face, ``retract_mm`` how far X goes back from
    -``centre_distance_mm``. Each of ``rough_mm`` is a stroke that much short of full depth; one stroke at full depth
    and ``spark_out`` more follow. Feeds in mm/min and deg/min; ``dwell_s`` passes after indexing.
    ``x_mm``, ``c_deg`` and ``dressing_mm`` are set-up values: they travel as R parameters. ``wheel_on`` and
    ``wheel_off`` are M, S and H words; empty where the operator minds wheel and coolant.
    """

    name: str
    part: str
    infeed: GrindAxis
    stroke: GrindAxis
    index: GrindAxis
    dresser: GrindAxis | None
    spaces: int
    centre_distance_mm: float
    height_mm: float
    face_mm: float
    x_mm: float = 0.0
    c_deg: float = 0.0
    dressing_mm: float = 0.0
    index_sense: Literal[1, -1] = -1
    overrun_mm: float = 8.0
    retract_mm: float = 10.0
    rough_mm: tuple[float, ...] = (0.05, 0.02)
    spark_out: int = 1
    infeed_feed: float = 100.0
    stroke_feed: float = 3000.0
    index_feed: float = 1800.0
    positioning_feed: float = 3000.0
    dwell_s: float = 0.3
    wheel_on: str = ""
    wheel_off: str = ""
    save_tables: bool = True

    @property
    def retracted_mm(self) -> float:
        """X with the wheel clear."""
        return -self.centre_distance_mm - self.retract_mm

    @property
    def ends_mm(self) -> tuple[float, float]:
        """Z below and above the face with the wheel clear."""
        reach = 0.5 * self.face_mm + self.overrun_mm
        return self.height_mm - reach, self.height_mm + reach

    @property
    def strokes(self) -> tuple[float, ...]:
        """How far short of full depth each stroke through a space is, in order."""
        return (*self.rough_mm, *(0.0 for _ in range(1 + self.spark_out)))

    @property
    def axes(self) -> tuple[GrindAxis, ...]:
        """All axes that move."""
        dresser = () if self.dresser is None else (self.dresser,)
        return (self.infeed, self.stroke, self.index, *dresser)

    @property
    def compensated(self) -> tuple[GrindAxis, ...]:
        """The axes whose tables shape the part."""
        return self.infeed, self.stroke, self.index

    @property
    def seconds(self) -> float:
        """About how long the machine grinds, without people: moves at their feeds, dwell, settling."""
        low, high = self.ends_mm
        moves = len(self.strokes) + (len(self.strokes) % 2)
        each = 60.0 * (moves * (high - low) / self.stroke_feed + 2.0 * self.retract_mm / self.positioning_feed)
        turn = 60.0 * 360.0 / self.spaces / self.index_feed
        small = 60.0 * (self.strokes[0] / self.infeed_feed)
        return self.spaces * (each + turn + small + self.dwell_s + 0.3 * (len(self.strokes) + 4))

    def places(self) -> Iterator[tuple[GrindAxis, float]]:
        """The outermost places each axis is sent to."""
        yield self.infeed, self.retracted_mm
        yield self.infeed, -self.centre_distance_mm + self.x_mm
        for end in self.ends_mm:
            yield self.stroke, end
        yield self.index, self.c_deg - self.index_sense * INDEX_OVERRUN_DEG
        yield self.index, self.c_deg + self.index_sense * 360.0 * (self.spaces - 1) / self.spaces
        if self.dresser is not None:
            yield self.dresser, self.dressing_mm - DRESSER_OVERRUN_MM
            yield self.dresser, self.dressing_mm


def check_plan(plan: GrindPlan) -> None:
    """Refuse what would drive the wheel deeper than a set-up value may, beyond a travel, or not clear of the work.

    Raises ConfigError: E-GRIND-VALUE (key, value, low, high), E-GRIND-DRESSER, E-GRIND-TRAVEL, E-GRIND-WHEEL.
    """
    for key, value, low, high in _limits(plan):
        if not (isfinite(value) and low <= value <= high):
            raise ConfigError("E-GRIND-VALUE", plan.name, key=key, value=value, low=low, high=high)
    if plan.dresser is None and plan.dressing_mm != 0.0:
        raise ConfigError("E-GRIND-DRESSER", plan.name, value=plan.dressing_mm)
    for axis, place in plan.places():
        low, high = axis.travel or (place, place)
        if not low <= place <= high:
            raise ConfigError("E-GRIND-TRAVEL", plan.name, axis=axis.name, place=round(place, 6), low=low, high=high)
    for words in (plan.wheel_on, plan.wheel_off):
        if not all(_WHEEL_WORD.fullmatch(word) for word in words.split()):
            raise ConfigError("E-GRIND-WHEEL", plan.name, words=words)


def _limits(plan: GrindPlan) -> Iterator[tuple[str, float, float, float]]:
    yield "x_mm", plan.x_mm, -MOST_X_MM, MOST_X_MM
    yield "c_deg", plan.c_deg, -MOST_C_DEG, MOST_C_DEG
    yield "dressing_mm", plan.dressing_mm, -MOST_DRESSING_MM, MOST_DRESSING_MM
    yield "spaces", plan.spaces, 3, 1000
    yield "centre_distance_mm", plan.centre_distance_mm, 1.0, 5000.0
    yield "height_mm", plan.height_mm, -5000.0, 5000.0
    yield "face_mm", plan.face_mm, 0.1, 1000.0
    yield "overrun_mm", plan.overrun_mm, CLEAR_MM + 0.5, 200.0
    yield "retract_mm", plan.retract_mm, 1.0, 500.0
    last = 0.5
    for depth in plan.rough_mm:
        yield "rough_mm", depth, 0.001, last
        last = depth
    yield "spark_out", plan.spark_out, 0, 20
    yield "infeed_feed", plan.infeed_feed, 1.0, 2000.0
    yield "stroke_feed", plan.stroke_feed, 50.0, 20000.0
    yield "index_feed", plan.index_feed, 10.0, 36000.0
    yield "positioning_feed", plan.positioning_feed, 10.0, 20000.0
    yield "dwell_s", plan.dwell_s, 0.0, 10.0
