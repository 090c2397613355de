"""Where a day's work stands among all its stages, and how long all that is left takes; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

from gateway.events import (
    ActingCheckStarted,
    AxisMeasurementStarted,
    Event,
    PartStarted,
    RunStarted,
    SetupStarted,
    SignProofStarted,
    TransactionSelected,
    TrialTablesLoaded,
    received,
)

AGAIN = "measure again"
FIRST_GUESS_S = 3.0
SIGNS, TRIALS, TRIALS_OUT, PUSH = "sign proofs", "trial tables", "tables of before", "push"


@dataclass(frozen=True, slots=True)
class Work:
    """One piece of a day: its stage, what it is called there, and how long it takes by the forecast, s."""

    stage: str
    name: str
    seconds: float


@dataclass(slots=True)
class Stages:
    """The pieces of a day in order and the one that is under way; `told` takes what is said, in s of any steady clock.

    Progress that names no later piece changes nothing: what is done again, or was not foreseen, belongs to the piece
    under way. ``run`` is the run's folder.
    """

    pieces: Sequence[Work]
    run: str = ""
    _at: int = -1
    _since: float = 0.0
    _took: float = 0.0
    _foreseen: float = 0.0
    _loading: bool = field(default=False)

    def told(self, code: str, fields: Mapping[str, object], now: float) -> None:
        """Take one piece of progress."""
        event = received(code, fields)
        if isinstance(event, RunStarted):
            self.run = event.folder
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
        """Seconds to the end of the last stage, as the pace of the pieces done tells; None while it tells nothing."""
        if self._at < 0 or self._took < FIRST_GUESS_S or self._foreseen <= 0.0:
            return None
        pace = self._took / self._foreseen
        here = max(self.pieces[self._at].seconds * pace - (now - self._since), 0.0)
        return here + pace * sum(one.seconds for one in self.pieces[self._at + 1 :])

    def _begin(self, at: int, now: float) -> None:
        if self._at >= 0:
            self._took += now - self._since
            self._foreseen += self.pieces[self._at].seconds
        self._at, self._since = at, now

    def _meant(self, event: Event | None) -> int | None:
        """The later piece that begins with what happened; None where none does."""
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

    def _next(self, stage: str, name: str) -> int | None:
        ahead = range(self._at + 1, len(self.pieces))
        return next((n for n in ahead if (self.pieces[n].stage, self.pieces[n].name) == (stage, name)), None)

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
