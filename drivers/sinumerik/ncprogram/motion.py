"""Positions -> motion blocks: every stop approached from its own side, with overrun at each reversal.

Blocks are in machine coordinates (SUPA), exact stop fine (G60 G601), feed per minute (G94). A modulo rotary
axis turns with C=ACP() in the positive and C=ACN() in the negative direction; 0 and 360 are one place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal

from drivers.sinumerik.tablefile.grammar import position_text
from drivers.types.stops import Stop

_SAME = 1e-9


def number(value: float) -> str:
    """A position, feed or dwell for a block: six decimals at most."""
    return position_text(Decimal(repr(round(float(value), 6))))


@dataclass(frozen=True, slots=True)
class Motion:
    """How one axis is driven: its program letter, whether it turns endlessly, feed and overrun."""

    letter: str
    modulo: bool
    feed: float
    overrun: float = 0.0

    def to(self, position: float) -> str:
        """Go to a position from anywhere, a modulo axis by the shortest way."""
        return self._block(f"DC({self._turn(position)})" if self.modulo else number(position))

    def by(self, distance: float) -> str:
        """Go on by a distance."""
        return self._block(f"IC({number(distance)})")

    def led(self, lead: str, place: str, side: str) -> list[str]:
        """Go to the place that one variable holds, by way of that in another; ``side`` has the approach's sign."""
        if not self.modulo:
            return [self._block(lead), self._block(place)]
        if not self.overrun:
            return [self._block(f"DC({place})")]
        ways = [self._block(f"{word}({place})") for word in ("ACP", "ACN")]
        return [self._block(f"DC({lead})"), f"IF {side}>0", ways[0], "ELSE", ways[1], "ENDIF"]

    def toward(self, position: float, distance: float) -> list[str]:
        """Go to a position that lies ``distance`` (signed) ahead of where the axis stands."""
        if abs(distance) < _SAME:
            return []
        if not self.modulo:
            return [self._block(number(position))]
        if abs(distance) >= 360.0:
            return [self.by(distance)]
        return [self._block(f"{'ACP' if distance > 0 else 'ACN'}({self._turn(position)})")]

    def _block(self, word: str) -> str:
        return f"SUPA G1 {self.letter}={word} F={number(self.feed)}"

    def _turn(self, position: float) -> str:
        return number(round(position, 6) % 360.0)

    def legs(self, stops: Sequence[Stop]) -> Iterator[list[str]]:
        """The blocks that lead to each stop in turn, the first from anywhere."""
        before: Stop | None = None
        for stop in stops:
            yield self._first(stop) if before is None else self._next(before, stop)
            before = stop

    def _first(self, stop: Stop) -> list[str]:
        start = stop.target - stop.approach * self.overrun
        return [self.to(start), *self.toward(stop.target, stop.target - start)]

    def _next(self, before: Stop, stop: Stop) -> list[str]:
        distance = stop.target - before.target
        ahead = distance * stop.approach
        if abs(distance) < _SAME and stop.approach == before.approach:
            return []
        if ahead >= self.overrun or (ahead > _SAME and stop.approach == before.approach):
            return self.toward(stop.target, distance)
        start = stop.target - stop.approach * self.overrun
        lead = start - before.target
        back = [] if abs(lead) < _SAME else [self.by(lead) if self.modulo else self._block(number(start))]
        return [*back, *self.toward(stop.target, stop.target - start)]
