"""The remaining time of a command: where it is among its pieces, and about how long all that is left takes; pure.

A command is foreseen as pieces of work (`gateway.workflow.forecast`): an axis or set-up, a part, a push. Each is
split into the stops that are read and the rest (mounting, starts, grinding, programs without stops), because the two
go at different paces: stops take what this machine and these settings take, the rest what people take.

    left = sum over programs of stops left x seconds per stop + rest left

Seconds per stop are those of this axis as seen in this command, T_axis = (time between stops) / (stops). An axis that
has not been measured yet takes its foreseen seconds times the pace of those that have: p = sum(seen) / sum(foreseen).
The rest takes its foreseen seconds times the pace of the rest so far (of little it is that of the stops), and of a
piece under way only what has not passed yet. A program whose number of stops is not the next one foreseen is an added
round: its stops count while it is at work. Targets that were added to an axis are measured again after the push: they
are added to that piece as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

from drivers.message import words
from gateway.events import (
    ActingCheckStarted,
    AxisMeasurementStarted,
    Event,
    PartStarted,
    RunStarted,
    SetupStarted,
    SignProofStarted,
    StopDone,
    TargetsAdded,
    TransactionSelected,
    TrialTablesLoaded,
    received,
)

AGAIN = "measure again"
FIRST_GUESS_S = 3.0
TELLING_S = 60.0
"""What is foreseen beside the stops tells a pace from so many seconds on: less of it is looks and answers."""
HELD_S = 120.0
"""So many foreseen seconds of mountings and programs weigh as much as the pace of the stops."""
SIGNS, TRIALS, TRIALS_OUT, PUSH = "sign proofs", "trial tables", words("S-WORK-TABLES-BEFORE"), "push"
NEW_TARGETS = "TFMORE"
"""The programs that visit targets which readings asked for, with about as many known ones; others visit known ones."""


@dataclass(frozen=True, slots=True)
class Work:
    """One piece of a command: its stage, what it is called there, and how long it takes by the forecast, s.

    ``programs`` are those whose stops are read, each with its stops and the part of ``seconds`` that these take.
    """

    stage: str
    name: str
    seconds: float
    programs: tuple[tuple[int, float], ...] = ()

    @property
    def rest_s(self) -> float:
        """What is foreseen beside the stops."""
        return max(self.seconds - sum(seconds for _, seconds in self.programs), 0.0)

    @property
    def axis(self) -> str:
        """The axis of a measurement: set-ups are called ERROR-AXIS with what else tells them apart."""
        return self.name.split("-")[1] if "-" in self.name else self.name


@dataclass(slots=True)
class Program:
    """A program whose stops are counted: which, how far, and when its last stop was done."""

    axis: str
    name: str
    total: int
    done: int
    last_s: float
    foreseen_s: float | None


@dataclass(slots=True)
class _Pace:
    """Seconds seen, over how many stops, and what the forecast gave for them."""

    seen_s: float = 0.0
    stops: int = 0
    foreseen_s: float = 0.0

    @property
    def per_stop_s(self) -> float | None:
        return self.seen_s / self.stops if self.stops else None


@dataclass(slots=True)
class RemainingTime:
    """The pieces of a command in order and the one under way; `told` takes what is said, in s of any steady clock.

    Without pieces only the stops of the program at work are known. Progress that names no piece still to come belongs
    to the one under way. ``run`` is the run's folder.
    """

    pieces: Sequence[Work] = ()
    run: str = ""
    _at: int = -1
    _since: float = 0.0
    _begun: set[int] = field(default_factory=set)
    _loading: bool = False
    _program: Program | None = None
    _todo: list[tuple[int, float]] = field(default_factory=list)
    _coming_s: float = 0.0
    _stops_s: float = 0.0
    _paces: dict[str, _Pace] = field(default_factory=dict)
    _rest: _Pace = field(default_factory=_Pace)
    _added: dict[str, int] = field(default_factory=dict)

    def told(self, code: str, fields: Mapping[str, object], now: float) -> None:
        """Take one piece of progress."""
        event = received(code, fields)
        if isinstance(event, RunStarted):
            self.run = event.folder
        elif isinstance(event, StopDone):
            self._stopped(event, now)
        elif isinstance(event, TargetsAdded):
            self._coming_s = 60.0 * float(event.minutes or 0.0)
        found = self._meant(event)
        if found is not None:
            self._begin(found, now)

    @property
    def number(self) -> int:
        """Which stage is under way, counted from 1; 0 before the first."""
        return 0 if self._at < 0 else sum(1 for _ in groupby(one.stage for one in self.pieces[: self._at + 1]))

    @property
    def total(self) -> int:
        """How many stages there are, one that comes twice counted twice."""
        return sum(1 for _ in groupby(one.stage for one in self.pieces))

    @property
    def said(self) -> str:
        """Stage and piece under way, in the words of the day's table; "" before the first."""
        if self._at < 0:
            return ""
        piece = self.pieces[self._at]
        return f"{piece.stage}: {piece.name}"

    def left_s(self, now: float) -> float | None:
        """Seconds to the end; None while what was seen tells nothing."""
        if not self._knows():
            return None
        here = self._here_s(now)
        if not self.pieces:
            return here
        return here + sum(self._whole_s(self.pieces[n]) for n in self._to_come())

    def program_left_s(self, now: float) -> float | None:
        """Seconds to the end of the program whose stops are counted; None without one, or while nothing is known."""
        at = self._program
        per_stop = None if at is None else self._per_stop(at.axis, at.foreseen_s)
        if at is None or per_stop is None:
            return None
        passed = min(now - at.last_s, per_stop) if at.done < at.total else 0.0
        return max((at.total - at.done) * per_stop - passed, 0.0)

    def _knows(self) -> bool:
        seen = sum(one.seen_s for one in self._paces.values()) + self._rest.seen_s
        return seen >= FIRST_GUESS_S

    def _pace(self) -> float | None:
        """Seen seconds of stops for each that was foreseen."""
        foreseen = [one for one in self._paces.values() if one.foreseen_s]
        total = sum(one.foreseen_s for one in foreseen)
        return sum(one.seen_s for one in foreseen) / total if total else None

    def _rest_pace(self) -> float:
        """As the rest went so far, held by the pace of the stops until enough of it was seen."""
        if not self._paces and self._rest.foreseen_s:
            return self._rest.seen_s / self._rest.foreseen_s
        held = (self._pace() or 1.0) * HELD_S
        return (self._rest.seen_s + held) / (self._rest.foreseen_s + HELD_S)

    def _per_stop(self, axis: str, foreseen_s: float | None) -> float | None:
        own = self._paces.get(axis)
        if own is not None and own.per_stop_s is not None:
            return own.per_stop_s
        return None if foreseen_s is None else foreseen_s * (self._pace() or self._rest_pace())

    def _stops_left_s(self, axis: str, programs: Sequence[tuple[int, float]]) -> float:
        each = ((stops, self._per_stop(axis, seconds / stops) or 0.0) for stops, seconds in programs if stops)
        return sum(stops * per_stop for stops, per_stop in each)

    def _whole_s(self, piece: Work) -> float:
        """A piece that has not begun."""
        more = self._added.get(piece.axis, 0) if piece.stage == AGAIN else 0
        per_stop = self._per_stop(piece.axis, None) or 0.0
        return self._stops_left_s(piece.axis, piece.programs) + more * per_stop + piece.rest_s * self._rest_pace()

    def _here_s(self, now: float) -> float:
        """What is left of the piece under way."""
        left = (self.program_left_s(now) or 0.0) + self._coming_s * (self._pace() or 1.0)
        if self._at < 0:
            return left
        piece = self.pieces[self._at]
        left += self._stops_left_s(piece.axis, self._todo)
        passed = now - self._since - self._stops_s
        return left + max(piece.rest_s * self._rest_pace() - passed, 0.0)

    def _stopped(self, event: StopDone, now: float) -> None:
        at = self._program
        if at is None or (at.axis, at.name) != (event.axis, event.program) or event.done <= at.done:
            self._program = self._new_program(event, now)
            return
        pace = self._paces.setdefault(event.axis, _Pace())
        stops, took = event.done - at.done, now - at.last_s
        pace.seen_s += took
        pace.stops += stops
        pace.foreseen_s += stops * (at.foreseen_s or 0.0)
        self._stops_s += took
        at.done, at.total, at.last_s = event.done, event.total, now

    def _new_program(self, event: StopDone, now: float) -> Program:
        """A program begins: the next of those foreseen with so many stops, or an added round."""
        each = next((n for n, (stops, _) in enumerate(self._todo) if stops == event.total), None)
        known = self._paces.get(event.axis)
        foreseen = known.foreseen_s / known.stops if known is not None and known.stops else None
        if each is not None:
            stops, seconds = self._todo[each]
            foreseen = seconds / stops
            del self._todo[: each + 1]
        else:
            self._coming_s = 0.0
            if event.program.startswith(NEW_TARGETS):
                self._added[event.axis] = self._added.get(event.axis, 0) + event.total // 2
        return Program(
            axis=event.axis, name=event.program, total=event.total, done=event.done, last_s=now, foreseen_s=foreseen
        )

    def _begin(self, at: int, now: float) -> None:
        if self._at >= 0 and self.pieces[self._at].rest_s >= TELLING_S:
            self._rest.seen_s += max(now - self._since - self._stops_s, 0.0)
            self._rest.foreseen_s += self.pieces[self._at].rest_s
        self._at, self._since, self._stops_s = at, now, 0.0
        self._begun |= {at}
        self._program, self._coming_s = None, 0.0
        self._todo = list(self.pieces[at].programs)

    def _meant(self, event: Event | None) -> int | None:
        """The piece still to come that begins with what happened; None where none does."""
        match event:
            case SetupStarted():
                return self._next("measure", event.setup)
            case AxisMeasurementStarted():
                return self._next("measure" if event.phase == "before" else AGAIN, event.axis)
            case ActingCheckStarted():
                return self._next(AGAIN, event.axis)
            case PartStarted():
                return self._next("part", event.part)
            case SignProofStarted():
                return self._next(SIGNS, event.axis)
            case TrialTablesLoaded():
                self._loading = True
                return self._next(SIGNS, TRIALS)
            case TransactionSelected():
                return self._transaction()
            case _:
                return None

    def _to_come(self) -> list[int]:
        """Pieces that have not begun, of the stage under way and of later ones: those of one stage may come in another
        order than foreseen."""
        first = max(self._at, 0)
        while first > 0 and self.pieces[first - 1].stage == self.pieces[self._at].stage:
            first -= 1
        return [n for n in range(first, len(self.pieces)) if n not in self._begun]

    def _next(self, stage: str, name: str) -> int | None:
        """The first piece of this name that is still to come."""
        return next((n for n in self._to_come() if (self.pieces[n].stage, self.pieces[n].name) == (stage, name)), None)

    def _transaction(self) -> int | None:
        """The next transaction of tables; the first load of the trial tables belongs to the piece that began before."""
        if self._loading:
            self._loading = False
            return None
        for n in range(self._at + 1, len(self.pieces)):
            if self.pieces[n].stage == PUSH or self.pieces[n].name in (TRIALS, TRIALS_OUT):
                return n
            if self.pieces[n].stage == "part":
                return None
        return None
