"""The release at the panel: it counts if given after command 1 of the session, and for a quarter of an hour.

A person and a PC share that quarter of an hour: it passes by their clock, not by that of a machine simulated faster.
"""

from __future__ import annotations

import math

from drivers.clock import Clock

COUNTS_S = 900.0


class PlcRelease:
    """A switch that a person turns; what counts is the turn from off to on while a session is open."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._session = 0
        self._given_s: float | None = None
        self.on = False
        self.was_given = False

    def begin(self, session: int) -> None:
        """A session begins, or ends (0): what was given before counts no more."""
        self._session, self._given_s, self.was_given = session, None, False

    def set(self, on: bool) -> None:
        """The switch at the panel."""
        if on and not self.on and self._session:
            self._given_s, self.was_given = self._clock.now(), True
        if not on:
            self._given_s = None
        self.on = on

    def give(self) -> None:
        """Off, and on again: a person gives it anew."""
        self.set(False)
        self.set(True)

    @property
    def stands(self) -> bool:
        """Given in this session and not taken back."""
        return self._given_s is not None

    @property
    def counts(self) -> bool:
        """Given in this session, not taken back, and not too long ago."""
        return self.left_s > 0

    @property
    def left_s(self) -> int:
        """Whole seconds that it counts for, 0 for none."""
        if self._given_s is None:
            return 0
        return max(0, math.ceil(self._given_s + COUNTS_S - self._clock.now()))
