"""Backlash compensation of one axis: how far the encoder leads by direction, and how it gets there.

MD32450 x MD32452 at once on reversal (spread where it is more than MD36500 in one cycle), MD32456 slowly and
half in each direction while the PLC asks for it. Source: K3 p. 234; texts of MD32450 to MD32457, MD36500.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simulators.nck.machine.motion import LaggedPath


@dataclass(frozen=True, slots=True)
class TakeUp:
    """Backlash data of an axis: the encoder's lead after + and - travel, and how fast it gets there.

    Up to ``step`` at once, more at ``rate`` per s; ``dynamic`` that much more in the direction of travel, at
    ``dynamic_rate`` per s.
    """

    plus: float = 0.0
    minus: float = 0.0
    step: float = math.inf
    rate: float = math.inf
    dynamic: float = 0.0
    dynamic_rate: float = math.inf

    def at_once(self, direction: int) -> float:
        """The lead without the dynamic part."""
        return self.plus if direction > 0 else self.minus

    def whole(self, direction: int) -> float:
        """The lead when all is taken up."""
        return self.at_once(direction) + self.dynamic * direction


class ReversalLead:
    """The lead over time; ``path`` is its demand and the response of the drive."""

    def __init__(self, lag_s: float, start_s: float) -> None:
        self.path = LaggedPath(lag_s, start_s, 0.0)
        self.dynamic_on = False
        self._direction = 1
        self._steady = 0.0

    def take_up(self, sign: int, how: TakeUp, time_s: float) -> None:
        """The drive turns that way at a time; sign 0: its backlash data changed."""
        self._direction = sign or self._direction
        goal = how.whole(self._direction)
        if self.path.final()[1] == goal:
            return
        if self.path.final()[0] > time_s:
            self.path.halt(time_s)
        jump = how.at_once(self._direction) - self._steady
        self._steady += jump
        here = self.path.demand(time_s)
        if abs(jump) > how.step:
            self._ramp(time_s, here, goal, how.rate)
        elif how.dynamic != 0.0 or abs(goal - here - jump) > 0.0:
            self._ramp(time_s, here + jump, goal, how.dynamic_rate)
        else:
            self.path.add(time_s, goal)

    def _ramp(self, time_s: float, here: float, goal: float, rate: float) -> None:
        seconds = abs(goal - here) / rate
        if seconds > 0.0:
            self.path.add(time_s, here, math.copysign(rate, goal - here))
        self.path.add(time_s + seconds, goal)

    def forget_plans(self, how: TakeUp, now_s: float) -> None:
        """Drop reversals planned for later."""
        self.path.halt(now_s)
        value = self.path.demand(now_s)
        self._direction = 1 if abs(value - how.whole(1)) <= abs(value - how.whole(-1)) else -1
        self._steady = how.at_once(self._direction)

    def forget_direction(self) -> None:
        """Power on without MD32454 bit 0: as if the last travel had been positive."""
        self._direction = 1
