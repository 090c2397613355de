"""Whole pushes through the mailbox whose chunks of read-back are not what they say, each judged by the machine.

The PLC's program is honest but for what it puts into registers 200-299 at some of its read-backs; the check sum in
300-301 is made over the wrong values too. Frames and pictures of an earlier moment come with the sum they had then.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simulators.modbus import registers as r
from simulators.modbus.commands import READ_BACK
from tests.push.bench import Plan, Story, told
from tests.push.world import Scene, World

POINTS = 121
Values = list[int]
Lie = Callable[["Chunks", Values], Values]


def left_out(wire: Chunks, values: Values) -> Values:
    """The chunk after it is given in its place."""
    first, count = wire.span
    later = [first + count + place for place in range(count)]
    return [wire.memory[place] if place < len(wire.memory) else 0 for place in later]


def twice(wire: Chunks, values: Values) -> Values:
    """The chunk before it is given once more."""
    return [*wire.before, *[0] * len(values)][: len(values)]


def earlier(wire: Chunks, values: Values) -> Values:
    """What these points were when the push began."""
    first, count = wire.span
    return wire.memory[first : first + count]


def numbered(wire: Chunks, values: Values) -> Values:
    """Another number in one point."""
    place = wire.rng.randrange(len(values))
    return [*values[:place], values[place] + wire.rng.choice((-3000, -500, 500, 3000)), *values[place + 1 :]]


LIES: tuple[Lie, ...] = (left_out, twice, earlier, numbered)


@dataclass
class Chunks:
    """The PLC's read-backs: from the ``nth`` on, ``times`` of them lie. ``frame``: "" or what is replayed whole."""

    rng: random.Random
    lie: Lie | None
    nth: int
    times: int = 1
    frame: str = ""
    count: int = 0
    before: Values = field(default_factory=list)
    memory: Values = field(default_factory=list)
    span: tuple[int, int] = (0, 0)
    over: bool = False

    def begin(self, at: World) -> None:
        """From now on."""
        plc: Any = at.station.plc
        loading: Any = plc._commands._works[READ_BACK].__self__
        real, read = loading._put_read_back, plc.read
        points: Any = at.oracle._table.points
        self.memory = [round(value * 1e6) for value in points]
        kept: dict[int, list[int]] = {}

        def put(command: Any, values: Values) -> None:
            self.span = command[r.FIRST], command[r.COUNT]
            self.count += 1
            shown = self.lie(self, values) if self.lie is not None and self.due else values
            self.before = values
            real(command, shown)

        def replayed(address: int, count: int) -> Any:
            found = list(read(address, count))
            if address == {"read-back": r.READ_BACK, "picture": r.LIVE}.get(self.frame, -1):
                older = kept.setdefault(count, found)
                return older if self.due else found
            return found

        loading._put_read_back, plc.read = put, replayed

    @property
    def due(self) -> bool:
        """Whether this one lies."""
        return not self.over and self.nth <= self.count < self.nth + self.times

    def mend(self, _at: World) -> None:
        """Honest again."""
        self.over = True


def played(seed: int, folder: Path) -> tuple[Story, str]:
    """The push of a seed, judged, and what was done to it."""
    rng = random.Random(seed)
    scene = Scene(points=POINTS, cross=rng.random() < 0.4, old_on=rng.random() < 0.8)
    frame = rng.choice(("", "", "", "read-back", "picture"))
    lie = None if frame else rng.choice(LIES)
    wire = Chunks(rng, lie, rng.randrange(1, 26), rng.choice((1, 1, 1, 2, 6, 1000)), frame)
    folder.mkdir(parents=True)
    story = told(Plan(scene, first=wire.begin, mend=wire.mend, willing=False), folder)
    what = lie.__name__ if lie is not None else f"older {frame}"
    layer = "cross" if scene.cross else "axis"
    return story, f"seed {seed}: {layer}, {what} from read-back {wire.nth}, {wire.times} times: {story.outcome}"
