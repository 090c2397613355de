"""A day at the machine before it begins: each piece of work with what it asks of a person, and its hours; pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from drivers.message import Message
from gateway.config import DayTimes
from gateway.remaining import Work

Stage = Literal["warm-up", "measure", "part", "sign proofs", "push", "measure again"]


@dataclass(frozen=True, slots=True)
class ToMount:
    """Optics to be mounted: for which error of which axis, from which instrument, and where other axes stand."""

    component: str
    axis: str
    instrument: str
    optics: str
    park: Mapping[str, float] = field(default_factory=dict)
    offset_mm: tuple[float, float, float] | None = None

    @property
    def words(self) -> str:
        """Optics and place for people: "straightness (laser) on X1, C1 at 90"."""
        parked = "".join(f", {name} at {place:g}" for name, place in sorted(self.park.items()))
        return f"{self.optics} ({self.instrument}) on {self.axis}{parked}"


@dataclass(frozen=True, slots=True)
class Asks:
    """What work asks of a person beyond a mounting and a clamping: starts and restarts, each by its cause.

    ``machine_s`` is what the machine itself takes meanwhile; ``programs`` are those whose stops are read, each with its
    stops and the part of ``machine_s`` that they take.
    """

    presses: tuple[str, ...] = ()
    resets: tuple[str, ...] = ()
    machine_s: float = 0.0
    programs: tuple[tuple[int, float], ...] = ()

    def plus(self, other: Asks) -> Asks:
        """Both, one after the other."""
        both = self.machine_s + other.machine_s
        programs = (*self.programs, *other.programs)
        return Asks((*self.presses, *other.presses), (*self.resets, *other.resets), both, programs)


def by_hand_s(times: DayTimes, mountings: int, blanks: int, presses: int, resets: int) -> float:
    """Seconds that people and restarts take for so many mountings, blanks on and off, starts and restarts."""
    handled = 60.0 * (times.mounting_min * mountings + times.clamping_min * 2 * blanks)
    return handled + presses * times.start_s + resets * times.restart_s


@dataclass(frozen=True, slots=True)
class Piece:
    """One piece of the day. ``clampings`` counts blanks clamped, each of which is taken off again."""

    stage: Stage
    name: str
    asks: Asks
    mounting: ToMount | None = None
    clampings: int = 0
    hand_s: float = 0.0

    def seconds(self, times: DayTimes) -> float:
        """All of it, by the site's figures."""
        counts = int(self.mounting is not None), self.clampings, len(self.asks.presses), len(self.asks.resets)
        return by_hand_s(times, *counts) + self.asks.machine_s + self.hand_s


@dataclass(frozen=True, slots=True)
class DayPlan:
    """All pieces in order, and the figures they are counted with.

    It supposes that no reading is taken again and that every table is proposed and none refused. ``unprotected`` says
    why others could read or change what passes to the control; "" where they cannot.
    """

    site: str
    command: str
    times: DayTimes
    pieces: tuple[Piece, ...]
    most_extra_h: float = 0.0
    unprotected: Message | str = ""

    @property
    def mountings(self) -> tuple[ToMount, ...]:
        """What is mounted, in order."""
        return tuple(piece.mounting for piece in self.pieces if piece.mounting is not None)

    @property
    def blanks(self) -> int:
        """Parts to be ground."""
        return sum(piece.clampings for piece in self.pieces)

    @property
    def presses(self) -> tuple[str, ...]:
        """Every start of a program by its cause, but those that confirm a mounting or a clamping."""
        return tuple(cause for piece in self.pieces for cause in piece.asks.presses)

    @property
    def resets(self) -> tuple[str, ...]:
        """Every restart of the control by its cause."""
        return tuple(cause for piece in self.pieces for cause in piece.asks.resets)

    @property
    def hours(self) -> float:
        """From the first step to the last."""
        return self.hours_of(self.pieces)

    def hours_of(self, pieces: Iterable[Piece]) -> float:
        """Hours of some of its pieces."""
        return sum(piece.seconds(self.times) for piece in pieces) / 3600.0

    def work(self) -> tuple[Work, ...]:
        """The pieces that something is said of when they begin: all but the warm-up, which is over by then."""
        told = (one for one in self.pieces if one.stage != "warm-up")
        return tuple(Work(one.stage, one.name, one.seconds(self.times), one.asks.programs) for one in told)

    def by_stage(self) -> dict[Stage, float]:
        """Hours of each stage, in the order in which they begin."""
        stages: Sequence[Stage] = tuple(dict.fromkeys(piece.stage for piece in self.pieces))
        return {stage: self.hours_of(piece for piece in self.pieces if piece.stage == stage) for stage in stages}

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        return {
            "site": self.site,
            "command": self.command,
            "unprotected": str(self.unprotected),
            "hours": round(self.hours, 3),
            "most_extra_hours": round(self.most_extra_h, 3),
            "hours_by_stage": {stage: round(hours, 3) for stage, hours in self.by_stage().items()},
            "mountings": len(self.mountings),
            "blanks": self.blanks,
            "presses": len(self.presses),
            "presses_by_cause": dict(Counter(self.presses)),
            "resets": len(self.resets),
            "resets_by_cause": dict(Counter(self.resets)),
            "pieces": [self._piece(piece) for piece in self.pieces],
            "times": self.times.model_dump(),
        }

    def _piece(self, piece: Piece) -> dict[str, Any]:
        mounts = piece.mounting
        told = None
        if mounts is not None:
            told = {name: getattr(mounts, name) for name in ("component", "axis", "instrument", "optics")}
            told |= {"park": dict(mounts.park), "offset_mm": mounts.offset_mm}
        return {
            "stage": piece.stage,
            "name": piece.name,
            "mounting": told,
            "clampings": piece.clampings,
            "presses": list(piece.asks.presses),
            "resets": list(piece.asks.resets),
            "minutes": round(piece.seconds(self.times) / 60.0, 2),
        }
