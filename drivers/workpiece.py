"""A test part ground through the control: its plan, where its axes go, and what is refused before anything is sent."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Literal

from drivers.errors import ConfigError

MOST_X_MM, MOST_C_DEG, MOST_DRESSING_MM = 0.2, 0.05, 0.2
MOST_STOCK_MM, MOST_AIR_CUT_FEED = 20.0, 500.0
CLEAR_MM = 6.0
APPROACH_MM = 0.5
"""How far outside the stock the positioning feed ends: more than any set-up value moves the infeed."""
FACE_CLEAR_MM = 0.5
INDEX_OVERRUN_DEG = 5.0
WHEEL_OVERRUN_MM = 2.0
# What a wheel's start may be made of: spindle speeds, M and H functions, but none that ends or stops a program.
_WHEEL_WORD = re.compile(r"(?:S(?:\d=)?\d{1,5}|[MH](?:\d=)?(?!0*(?:0|1|2|17|30)$)\d{1,4})")
_M_WORD = re.compile(r"M(?:(\d)=)?(\d{1,4})")


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

    At X = -``centre_distance_mm`` + ``x_mm`` the wheel is at full depth, and X rises into the cut. The middle of
    the face stands at Z = ``height_mm``; space k at C = ``c_deg`` + ``index_sense`` 360 k / ``spaces``.
    ``overrun_mm`` is how far Z goes beyond the face, ``retract_mm`` how far X goes back from
    -``centre_distance_mm``. Each of ``rough_mm`` is a stroke that much short of full depth; one stroke at full
    depth and ``spark_out`` more follow. Feeds in mm/min and deg/min; ``dwell_s`` passes after indexing.
    ``wheel_on`` and ``wheel_off`` are M, S and H words; empty where the operator minds wheel and coolant.

    ``root_mm`` and ``tip_mm`` are the radii of the finished gear, ``stock_mm`` what a blank may have too much,
    along X. The first approach to a space ends outside that stock at ``positioning_feed`` and goes on at
    ``air_cut_feed``.

    ``x_mm``, ``c_deg`` and ``dressing_mm`` are set-up values: they travel as R parameters. ``dressing_mm`` is where
    the profile sits along the wheel's axis. Either ``wheel`` moves the wheel there, to ``wheel_mm`` +
    ``dressing_mm`` before it is started, or the dressing program takes it from the R parameter ``wheel_offset``.
    Where a plan has neither, nothing moves along the wheel's axis. ``dresser`` carries the dresser and never moves.
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
    root_mm: float
    tip_mm: float
    stock_mm: float
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
    air_cut_feed: float = 200.0
    dwell_s: float = 0.3
    wheel_on: str = ""
    wheel_off: str = ""
    wheel: GrindAxis | None = None
    wheel_mm: float = 0.0
    wheel_offset: int | None = None
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
    def approach_mm(self) -> float:
        """How far short of full depth the positioning feed ends: outside the stock, and before the first stroke."""
        return max(self.stock_mm, *self.strokes) + APPROACH_MM

    @property
    def places_wheel(self) -> bool:
        """Whether anything places the wheel along its axis."""
        return self.wheel is not None or self.wheel_offset is not None

    @property
    def axes(self) -> tuple[GrindAxis, ...]:
        """All axes that move."""
        wheel = () if self.wheel is None else (self.wheel,)
        return (self.infeed, self.stroke, self.index, *wheel)

    @property
    def named(self) -> tuple[GrindAxis, ...]:
        """All axes that a grind needs in their places: those that move, and the dresser's, which stays where it is."""
        return self.axes if self.dresser is None else (*self.axes, self.dresser)

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
        air = (self.approach_mm - self.strokes[0]) / self.air_cut_feed
        small = 60.0 * (self.strokes[0] / self.infeed_feed + air)
        return self.spaces * (each + turn + small + self.dwell_s + 0.3 * (len(self.strokes) + 4))

    def places(self) -> Iterator[tuple[GrindAxis, float]]:
        """The outermost places each axis is sent to."""
        yield self.infeed, self.retracted_mm
        yield self.infeed, -self.centre_distance_mm + self.x_mm
        for end in self.ends_mm:
            yield self.stroke, end
        yield self.index, self.c_deg - self.index_sense * INDEX_OVERRUN_DEG
        yield self.index, self.c_deg + self.index_sense * 360.0 * (self.spaces - 1) / self.spaces
        if self.wheel is not None:
            yield self.wheel, self.wheel_mm + self.dressing_mm - WHEEL_OVERRUN_MM
            yield self.wheel, self.wheel_mm + self.dressing_mm


def check_plan(plan: GrindPlan) -> None:
    """Refuse what would drive the wheel deeper than a set-up value may, beyond a travel, or not clear of the work.

    Raises ConfigError: E-GRIND-VALUE (key, value, low, high), E-GRIND-PLACE (an offset, nothing to place the wheel),
    E-GRIND-DRESSER (the dresser's axis would move), E-GRIND-STOCK (key, value, least), E-GRIND-TRAVEL, E-GRIND-WHEEL,
    E-GRIND-WHEEL-ON (key, on, off: what starts the wheel is not stopped).
    """
    for key, value, low, high in _limits(plan):
        if not (isfinite(value) and low <= value <= high):
            raise ConfigError("E-GRIND-VALUE", plan.name, key=key, value=value, low=low, high=high)
    if not plan.places_wheel and plan.dressing_mm != 0.0:
        raise ConfigError("E-GRIND-PLACE", plan.name, value=plan.dressing_mm)
    if plan.dresser is not None:
        for axis in plan.axes:
            if axis.name == plan.dresser.name or axis.letter == plan.dresser.letter:
                raise ConfigError("E-GRIND-DRESSER", plan.name, axis=axis.name, dresser=plan.dresser.name)
    for axis, place in plan.places():
        low, high = axis.travel or (place, place)
        if not low <= place <= high:
            raise ConfigError("E-GRIND-TRAVEL", plan.name, axis=axis.name, place=round(place, 6), low=low, high=high)
    _check_stock(plan)
    for words in (plan.wheel_on, plan.wheel_off):
        if not all(_WHEEL_WORD.fullmatch(word) for word in words.split()):
            raise ConfigError("E-GRIND-WHEEL", plan.name, words=words)
    if not _stops(plan.wheel_on, plan.wheel_off):
        raise ConfigError("E-GRIND-WHEEL-ON", plan.name, key="wheel_off", on=plan.wheel_on, off=plan.wheel_off)


def _stops(on: str, off: str) -> bool:
    """Whether the words that stop the wheel can do so: a person takes the part out after them.

    M5 stops each spindle that M3 or M4 starts; an M or H function of the machine's builder is taken as it is. Without
    its address a word is for the master spindle, whose number only the control knows.
    """
    started, stopped = _spindles(on, (3, 4)), _spindles(off, (5,))
    if _spindles(off, (3, 4)) or (on.split() and not off.split()):
        return False
    return all(one in stopped or "" in stopped or (not one and stopped) for one in started)


def _spindles(words: str, functions: tuple[int, ...]) -> set[str]:
    """The spindles that these M functions are for, by number; "" for the master spindle."""
    found = (_M_WORD.fullmatch(word) for word in words.split())
    return {one[1] or "" for one in found if one is not None and int(one[2]) in functions}


def _check_stock(plan: GrindPlan) -> None:
    """The wheel passes a blank with all its stock: drawn back, and beyond the face while it is fed in.

    Beyond the face the wheel still reaches over it: at a depth d in the stock by sqrt(2 R d - d^2), R its radius.
    Raises ConfigError (E-GRIND-STOCK).
    """
    depth = max(plan.stock_mm - plan.strokes[0] + max(plan.x_mm, 0.0), 0.0)
    radius = plan.centre_distance_mm - plan.root_mm
    reach = sqrt(max(2.0 * radius * depth - depth**2, 0.0))
    for key, value, least in (
        ("retract_mm", plan.retract_mm, plan.tip_mm - plan.root_mm + plan.stock_mm + APPROACH_MM),
        ("overrun_mm", plan.overrun_mm, reach + FACE_CLEAR_MM),
    ):
        if value < least:
            stock, needed = round(plan.stock_mm, 3), round(least + 0.005, 2)
            raise ConfigError("E-GRIND-STOCK", plan.name, stock=stock, key=key, value=value, least=needed)


def _limits(plan: GrindPlan) -> Iterator[tuple[str, float, float, float]]:
    yield "x_mm", plan.x_mm, -MOST_X_MM, MOST_X_MM
    yield "c_deg", plan.c_deg, -MOST_C_DEG, MOST_C_DEG
    yield "dressing_mm", plan.dressing_mm, -MOST_DRESSING_MM, MOST_DRESSING_MM
    yield "spaces", plan.spaces, 3, 1000
    yield "centre_distance_mm", plan.centre_distance_mm, 1.0, 5000.0
    yield "height_mm", plan.height_mm, -5000.0, 5000.0
    yield "face_mm", plan.face_mm, 0.1, 1000.0
    yield "root_mm", plan.root_mm, 1.0, plan.centre_distance_mm - 1.0
    yield "tip_mm", plan.tip_mm, plan.root_mm, plan.centre_distance_mm
    yield "stock_mm", plan.stock_mm, 0.0, MOST_STOCK_MM
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
    yield "air_cut_feed", plan.air_cut_feed, 1.0, MOST_AIR_CUT_FEED
    yield "wheel_mm", plan.wheel_mm, -5000.0, 5000.0
    yield "wheel_offset", plan.wheel_offset or 0, 0, 32535
    yield "dwell_s", plan.dwell_s, 0.0, 10.0
