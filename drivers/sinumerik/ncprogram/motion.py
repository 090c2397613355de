"""Positions -> motion blocks: every stop approached from its own side, with overrun at each reversal.

Blocks are in machine coordinates (SUPA), exact stop fine (G60 G601), feed per minute (G94). A modulo rotary
axis turns with C=ACP() in the positive and C=ACN() in the negative direction; 0 and 360 are one place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from enum import IntEnum

from drivers.sinumerik.tablefile.grammar import position_text
from drivers.types.stops import Stop

_SAME = 1e-9


def number(value: float) -> str:
    """A position, feed or dwell for a block: six decimals at most."""
    return position_text(Decimal(repr(round(float(value), 6))))


class Way(IntEnum):
    """How a stop is reached: not at all, straight on, back to its own side first, or by a distance alone."""

    STAYS = 0
    STRAIGHT = 1
    LED = 2
    STEP = 3


@dataclass(frozen=True, slots=True)
class Motion:
    """How one axis is driven: its program letter, whether it turns endlessly, feed and overrun."""

    letter: str
    modulo: bool
    feed: float
    overrun: float = 0.0

    def to(self, position: float) -> str:
        """Go to a position from anywhere, a modulo axis by the shortest way."""
        place = self.place(position)
        return self.block(f"DC({place})" if self.modulo else place)

    def by(self, distance: float) -> str:
        """Go on by a distance."""
        return self.block(f"IC({number(distance)})")

    def led(self, lead: str, place: str, side: str) -> list[str]:
        """Go to the place that one variable holds, by way of that in another; ``side`` has the approach's sign."""
        if not self.modulo:
            return [self.block(lead), self.block(place)]
        if not self.overrun:
            return [self.block(f"DC({place})")]
        ways = [self.block(f"{word}({place})") for word in ("ACP", "ACN")]
        return [self.block(f"DC({lead})"), f"IF {side}>0", ways[0], "ELSE", ways[1], "ENDIF"]

    def block(self, word: str) -> str:
        """The move to a place as it is written: -5.0, DC(90.0), or a variable that holds it."""
        return f"SUPA G1 {self.letter}={word} F={number(self.feed)}"

    def place(self, position: float) -> str:
        """A place as its block names it; 0 to 360 where the axis turns endlessly."""
        return number(round(position, 6) % 360.0) if self.modulo else number(position)

    def begin(self, stop: Stop) -> str:
        """From anywhere to where the first stop is approached from."""
        return self.to(stop.target - stop.approach * self.overrun)

    def ways(self, stops: Sequence[Stop]) -> Iterator[tuple[Way, float]]:
        """How each stop is reached from the one before, the first from where `begin` leads.

        With `Way.LED` and `Way.STEP` goes where to, or how far: a place, or a distance of an endless axis.
        """
        before: Stop | None = None
        for stop in stops:
            yield self._ahead(stop.approach * self.overrun) if before is None else self._next(before, stop)
            before = stop

    def legs(self, stops: Sequence[Stop]) -> Iterator[list[str]]:
        """The blocks that lead to each stop in turn, the first from anywhere."""
        for place, (stop, (way, lead)) in enumerate(zip(stops, self.ways(stops), strict=True)):
            first = [] if place else [self.begin(stop)]
            yield first + self._leg(stop, way, lead)

    def _leg(self, stop: Stop, way: Way, lead: float) -> list[str]:
        led = [self.by(lead) if self.modulo else self.block(number(lead))] if way in (Way.LED, Way.STEP) else []
        if way in (Way.STAYS, Way.STEP):
            return led
        if self.modulo and way is Way.LED and self.overrun >= 360.0:
            return [*led, self.by(stop.approach * self.overrun)]
        place = self.place(stop.target)
        word = "ACP" if stop.approach > 0 else "ACN"
        return [*led, self.block(f"{word}({place})" if self.modulo else place)]

    def _ahead(self, distance: float) -> tuple[Way, float]:
        """To a target that lies ``distance`` ahead of where the axis stands, in the sense of its approach."""
        if abs(distance) < _SAME:
            return Way.STAYS, 0.0
        if self.modulo and abs(distance) >= 360.0:
            return Way.STEP, distance
        return Way.STRAIGHT, 0.0

    def _next(self, before: Stop, stop: Stop) -> tuple[Way, float]:
        distance = stop.target - before.target
        ahead = distance * stop.approach
        if abs(distance) < _SAME and stop.approach == before.approach:
            return Way.STAYS, 0.0
        if ahead >= self.overrun or (ahead > _SAME and stop.approach == before.approach):
            return self._ahead(distance)
        start = stop.target - stop.approach * self.overrun
        lead = start - before.target
        if abs(lead) < _SAME:
            return self._ahead(stop.target - start)
        if self.overrun < _SAME:
            return (Way.STEP, lead) if self.modulo else (Way.STRAIGHT, 0.0)
        return Way.LED, lead if self.modulo else start
