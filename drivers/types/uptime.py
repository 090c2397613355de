"""How long a computer has been on: a count that no setting of its calendar moves."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Uptime:
    """Seconds since the start of a computer, its sleep included, and which start that was.

    ``boot`` is "" where the system names no start: then nothing is known, and the calendar alone tells an age.
    """

    boot: str = ""
    seconds: float = 0.0

    def since(self, earlier: Uptime) -> float | None:
        """Seconds from an earlier moment of the same start; None where it was another start, or is not known."""
        return self.seconds - earlier.seconds if self.boot and self.boot == earlier.boot else None
