"""What the words of one block do together: G groups, axis targets, feed, dwell and program stops."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from simulators.nck.machine.axis import COARSE, FINE
from simulators.nck.machine.core import Core
from simulators.nck.machine.data import INCH_MM
from simulators.nck.spec import AxisSpec, NckRefusal

POSITION_MODES = frozenset({"AC", "IC", "DC", "ACP", "ACN"})
_NO_EFFECT = frozenset({603})
_OFFSETS = frozenset({54, 55, 56, 57, *range(505, 600)})
_IN_MACHINE = frozenset({53, 153})
_LENGTH_ALONG = {17: "Z", 18: "Y", 19: "X"}
TRANSFORMATIONS = frozenset({"TRANSMIT", "TRACYL", "TRAANG"})
_FRAMES = frozenset({"TRANS", "ATRANS", "SCALE", "ASCALE", "MIRROR", "AMIRROR", "ROT", "AROT"})
# G functions of the control that this simulator does not do: refused, never passed over.
_NOT_HERE = frozenset({2, 3, 5, 33, 34, 35, 62, 63, 74, 75, 93, 96, 97, 110, 111, 112, 331, 332})
_SILENT_WORDS = frozenset(
    {"STOPRE", "SOFT", "BRISK", "FFWON", "FFWOF"}
    | {"COMPOF", "KONT", "NORM", "SBLON", "SBLOF", "DISPLON", "DISPLOF", "CFC", "CFTCP"}
)
_SAME_PLACE = 1e-9
WHEEL_RUNS = 700016


def is_silent(word: str) -> bool:
    """Words that are understood and change nothing here (no look-ahead to change)."""
    return word in _SILENT_WORDS


@dataclass(slots=True)
class Modal:
    """What stays in force from block to block.

    ``inch``: by G70/G71 (G700/G710 for the feed too), None the basic system. ``planned``: where blocks handed
    over will leave the axes, by index, in mm or deg; empty when the machine has done them all. ``diameter``: "ON", "90"
    or "". ``offset``: a settable frame acts. ``frame``: programmed shift and factor by axis. ``edge``: a tool edge's
    length acts, along the axis of ``plane``. ``side``: G41 or G42. ``turning``: feed per revolution.
    """

    rapid: bool = False
    absolute: bool = True
    exact: bool = True
    window: float = FINE
    feed: float | None = None
    inch: bool | None = None
    inch_feed: bool = False
    diameter: str = ""
    offset: bool = False
    frame: dict[int, tuple[float, float]] = field(default_factory=dict)
    transformation: str = ""
    plane: int = 17
    edge: bool = False
    side: int = 40
    turning: bool = False

    def take(self, g: int) -> bool:
        """A G function that stays in force; False for one that is none."""
        if g in (0, 1):
            self.rapid = g == 0
        elif g in (60, 64, 641, 642):
            self.exact = g == 60
        elif g in (90, 91):
            self.absolute = g == 90
        elif g in (601, 602):
            self.window = FINE if g == 601 else COARSE
        elif g in (70, 71, 700, 710):
            self.inch, self.inch_feed = g in (70, 700), g in (700, 710)
        else:
            return self._take_place(g)
        return True

    def _take_place(self, g: int) -> bool:
        if g in _LENGTH_ALONG:
            self.plane = g
        elif g in (40, 41, 42):
            self.side = g
        elif g in (94, 95):
            self.turning = g == 95
        elif g in _OFFSETS or g == 500:
            self.offset = g != 500
        else:
            return False
        return True

    planned: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BlockAction:
    """What a block leaves for the machine to do in time.

    ``targets``: axis index -> end point; ``rate`` units/min, None rapid; ``window``: wait until within it;
    ``ending``: "", M0, M1, M17 or M30; ``message``: what MSG shows.
    """

    targets: dict[int, float] = field(default_factory=dict)
    rate: float | None = None
    window: float | None = None
    dwell_s: float = 0.0
    ending: str = ""
    message: str | None = None


class BlockWords:
    """Collects the words of one block."""

    def __init__(self, core: Core, modal: Modal) -> None:
        self._core = core
        self._modal = modal
        self._targets: dict[int, tuple[str, float]] = {}
        self._feed: float | None = None
        self._dwell = False
        self._exact_once = False
        self._ending = ""
        self._in_machine = False
        self._framing = ""

    def word(self, name: str) -> bool:
        """A word that says how this block's or all later positions count; False for any other."""
        modal = self._modal
        if name == "SUPA":
            self._in_machine = True
        elif name in ("DIAMON", "DIAM90", "DIAMOF"):
            modal.diameter = {"DIAMON": "ON", "DIAM90": "90", "DIAMOF": ""}[name]
        elif name in TRANSFORMATIONS or name == "TRAFOOF":
            modal.transformation = "" if name == "TRAFOOF" else name
        elif name in _FRAMES:
            self._framing = name
        else:
            return False
        return True

    def address(self, letter: str, value: float) -> None:
        """A DIN word. Raises NckRefusal: 12470 (G), 12550 (unknown), 12160 (value)."""
        axis = self._core.axis_index(letter)
        if axis is not None:
            self.position(axis, "", value)
        elif letter == "G":
            self._g(value)
        elif letter == "F":
            self._feed = value
        elif letter == "M":
            self._m(value)
        elif letter == "D":
            self._modal.edge = value > 0
        elif letter not in "STH":
            raise NckRefusal(12550, f"name {letter}{value:g} not defined or option not available")

    def position(self, axis: int, mode: str, value: float) -> None:
        """An axis word. Raises NckRefusal 12110 when the axis stands twice in the block."""
        if axis in self._targets:
            raise NckRefusal(12110, f"axis {self._core.spec.axes[axis].name} programmed twice")
        self._targets[axis] = (mode, value)

    def end(self, ending: str) -> None:
        """A word that ends the program or subprogram."""
        self._ending = ending or self._ending

    def _g(self, value: float) -> None:
        if value == 4:
            self._dwell = True
        elif value == 9:
            self._exact_once = True
        elif value in _IN_MACHINE:
            self._in_machine = True
        elif value in _NOT_HERE:
            raise NckRefusal(12550, f"G{value:g} not defined or option not available")
        elif value not in _NO_EFFECT and not self._modal.take(int(value) if value == int(value) else -1):
            raise NckRefusal(12470, f"G function G{value:g} unknown")

    def _m(self, value: float) -> None:
        if value != int(value) or value < 0:
            raise NckRefusal(12160, f"M{value:g} lies beyond the value range")
        if value in (3, 4, 5):
            self._core.wheel_runs = value != 5
        name = {0: "M0", 1: "M1", 2: "M30", 30: "M30", 17: "M17"}.get(int(value), "")
        self._ending = name or self._ending

    def finish(self) -> BlockAction | None:
        """The block's deed.

        Raises NckRefusal: 10860, 14800 (feed), 10720 (travel), 10750 (G41 without tool), 14404 (an axis of a
        transformation), 16800..16830, 700016 (the dresser's axis).
        """
        if self._framing:
            self._frame()
            return BlockAction(ending=self._ending) if self._ending else None
        if self._dwell:
            return self._dwelling()
        if self._feed is not None:
            self._modal.feed = self._feed
        if not self._targets:
            return BlockAction(ending=self._ending) if self._ending else None
        self._possible()
        self._stands_still()
        targets = {index: self._end_point(index, *word) for index, word in self._targets.items()}
        for index, target in targets.items():
            self._core.check_travel(index, target)
        self._modal.planned.update(targets)
        rate = None if self._modal.rapid else self._checked_feed()
        exact = self._modal.exact or self._exact_once or self._modal.rapid or bool(self._ending)
        return BlockAction(targets, rate, window=self._modal.window if exact else None, ending=self._ending)

    def _possible(self) -> None:
        """What a program before may have left, under which a single axis does not go to its place."""
        if self._modal.transformation:
            raise NckRefusal(14404, f"{self._modal.transformation} is active: no machine axis is programmed so")
        if self._modal.side != 40:
            raise NckRefusal(10750, "tool radius compensation active without tool number")
        if self._modal.turning and not self._modal.rapid:
            raise NckRefusal(14800, "feed per revolution, and the spindle stands")

    def _stands_still(self) -> None:
        """The builder's own lock, with an alarm of the PLC: the dresser's axis does not move while the wheel runs."""
        names = [self._core.spec.axes[index].name for index in self._targets]
        if self._core.wheel_runs and self._core.spec.dresser in names:
            raise NckRefusal(WHEEL_RUNS, f"{self._core.spec.dresser} carries the dresser and the wheel runs")

    def _frame(self) -> None:
        """TRANS X5: no motion, but where zero is from now on; without axes every programmed frame goes."""
        frame, name = self._modal.frame, self._framing
        if name in ("ROT", "AROT") and self._targets:
            raise NckRefusal(12550, f"{name} not defined or option not available")
        if not name.startswith("A"):
            frame.clear()
        for index, (_, value) in self._targets.items():
            shift, factor = frame.get(index, (0.0, 1.0))
            inch = self._inch and not self._core.axes[index].spec.rotary
            if name.endswith("TRANS"):
                frame[index] = (shift + factor * value * (INCH_MM if inch else 1.0), factor)
            else:
                frame[index] = (shift, factor * (value if name.endswith("SCALE") else -1.0))

    @property
    def _inch(self) -> bool:
        return self._core.data.inch if self._modal.inch is None else self._modal.inch

    def _dwelling(self) -> BlockAction:
        if self._targets or self._feed is None:
            raise NckRefusal(12110, "G4 stands with F and without axes")
        if self._feed < 0.0:
            raise NckRefusal(12160, "dwell time below zero")
        return BlockAction(dwell_s=self._feed, ending=self._ending)

    def _checked_feed(self) -> float:
        feed = self._modal.feed
        if feed is None:
            raise NckRefusal(10860, "feedrate not programmed")
        if feed <= 0.0:
            raise NckRefusal(14800, "programmed path velocity smaller than or equal to zero")
        rotary = all(self._core.axes[index].spec.rotary for index in self._targets)
        inch = self._modal.inch if self._modal.inch_feed else self._core.data.inch
        return feed * INCH_MM if inch and not rotary else feed

    def _end_point(self, index: int, mode: str, value: float) -> float:
        axis = self._core.axes[index]
        here = self._modal.planned.get(index, axis.end_point)
        value = value * INCH_MM if self._inch and not axis.spec.rotary else value
        mode = mode or ("AC" if self._modal.absolute else "IC")
        value = self._counted(axis.spec, index, mode, value)
        if mode == "IC":
            return here + value
        if not axis.spec.modulo:
            if mode != "AC":
                number = {"DC": 16800, "ACP": 16810}.get(mode, 16820)
                raise NckRefusal(number, f"traverse instruction {mode} not allowed for {axis.spec.name}")
            return value
        return _modulo_end_point(here, mode, value, axis.spec.name)

    def _counted(self, spec: AxisSpec, index: int, mode: str, value: float) -> float:
        """Diameter, frames and tool length taken into a position or a distance; SUPA leaves frames out alone."""
        modal, rules = self._modal, self._core.spec
        across = spec.letter.upper() == rules.diameter_axis.upper()
        if across and (modal.diameter == "ON" or (modal.diameter == "90" and mode != "IC")):
            value /= 2.0
        shift, factor = (0.0, 1.0) if self._in_machine else modal.frame.get(index, (0.0, 1.0))
        if mode == "IC":
            return value * factor
        value = value * factor + shift
        if spec.rotary:
            return value % 360.0 if spec.modulo and shift else value
        if modal.offset and not self._in_machine:
            value += rules.zero_offset_mm
        along = modal.edge and spec.letter.upper() == _LENGTH_ALONG[modal.plane]
        return value + (rules.tool_length_mm if along else 0.0)


def _modulo_end_point(here: float, mode: str, value: float, name: str) -> float:
    """The unlimited-turn end point of a modulo axis; 0 and 360 are one target."""
    if mode != "AC" and not 0.0 <= value <= 360.0:
        raise NckRefusal(16830, f"incorrect position programmed for {name}")
    target, current = value % 360.0, here % 360.0
    away = (target - current) % 360.0
    if min(away, 360.0 - away) < _SAME_PLACE:
        return here
    if mode == "ACN" or (mode == "DC" and away > 180.0):
        away -= 360.0
    elif mode == "AC":
        away = target - current
    # The turn is counted apart, so that thousands of turns leave no rounding on the target.
    return target + 360.0 * math.floor((here + away - target) / 360.0 + 0.5)
