"""The state of the progress display: the step, the request to the operator, counts and the time that is left; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.audience import Audience, kind_of
from gateway.cli.output import text_of
from gateway.events import (
    ActingCheckStarted,
    ConnectionUnprotected,
    PartStarted,
    PushPhaseChanged,
    RunStarted,
    SignProofStarted,
    TableStateChanged,
    received,
)
from gateway.remaining import RemainingTime

APART = (ActingCheckStarted, PartStarted, RunStarted, SignProofStarted)
"""Steps that belong to none of a count of steps: it is over when one of them begins."""
COUNT_GUESS_S = 3.0
COUNTED = ("done", "total"), ("number", "total")


@dataclass(slots=True)
class ProgressCount:
    """How far something is, as it is ``said``; ``since`` and ``first`` are time (s) and number when it began.

    ``name`` tells one count from the next, ``last`` is when the number changed.
    """

    name: str
    done: int
    total: int
    since: float
    first: int
    last: float = 0.0
    said: str = ""

    def reached(self, done: int, said: str, now: float) -> None:
        """It is so far now."""
        if done != self.done:
            self.last = now
        self.done, self.said = done, said

    def left_s(self, now: float) -> float | None:
        """Seconds to go as the pace so far tells; None while it tells nothing.

        It runs down while one of them lasts, at most by what one takes.
        """
        made, took = self.done - self.first, self.last - self.since
        if made <= 0 or took < COUNT_GUESS_S:
            return None
        each = took / made
        return (self.total - self.done) * each - min(now - self.last, each)


@dataclass(slots=True)
class ProgressState:
    """The panel's state; `told` takes what is said, in s of any steady clock.

    ``open_road`` stays as long as the command works: what passes to the control is not protected. Where ``stages`` has
    pieces the time to go is reckoned over all of them, and no count tells a time of its own.
    """

    began: float
    step: str = ""
    within: str = ""
    tables: tuple[str, tuple[str, ...]] = ("", ())
    open_road: str = ""
    ask: str = ""
    asked: float = 0.0
    moves: tuple[str, ...] = ()
    counts: dict[str, ProgressCount] = field(default_factory=dict)
    stages: RemainingTime = field(default_factory=RemainingTime)

    def told(self, code: str, fields: Mapping[str, object], now: float) -> None:
        """Take one piece of progress."""
        self.stages.told(code, fields, now)
        kind, event = kind_of(code), received(code, fields)
        if isinstance(event, ConnectionUnprotected):
            self.open_road = text_of(code, **fields)
            return
        if kind is Audience.ASK:
            self._asked(text_of(code, **fields), now)
        elif kind is Audience.MOVE:
            # What is said after an ask belongs to the next one.
            self.moves, self.ask = (*(() if self.ask else self.moves), text_of(code, **fields)), ""
        elif kind is Audience.COUNT:
            self._counted(code, fields, now)
        elif kind is Audience.STEP:
            self._begun(code, fields, now, apart=isinstance(event, APART))
        elif isinstance(event, PushPhaseChanged):
            self._for_table(event)
        elif kind is Audience.DETAIL and not isinstance(event, TableStateChanged):  # its step says it already
            self.within = text_of(code, **fields)
        elif kind is not Audience.DETAIL:
            self._answered()

    def _for_table(self, event: PushPhaseChanged) -> None:
        """A step of one table of a batch stands in one line with the same step of the others."""
        before = self.tables
        names = (*(before[1] if before[0] == event.step else ()), event.axis)
        self.tables = event.step, tuple(dict.fromkeys(names))
        self.within = text_of(event.code, **{**event.told_fields, "axis": ", ".join(self.tables[1])})

    def _asked(self, ask: str, now: float) -> None:
        """What was said before another ask belongs to that one."""
        if self.ask and self.ask != ask:
            self.moves = ()
        self.ask, self.asked = ask, now

    def _answered(self) -> None:
        self.ask = self.within = ""
        self.moves = ()

    def _begun(self, code: str, fields: Mapping[str, object], now: float, *, apart: bool) -> None:
        """A step of so many stands above what happens in it."""
        self._answered()
        self.counts.pop("inner", None)
        if apart:
            self.counts.pop("outer", None)
        if "number" not in fields:
            self.step = text_of(code, **fields)
            return
        done, total = int(str(fields["number"])) - 1, int(str(fields["total"]))
        outer = self.counts.get("outer")
        if outer is None or outer.total != total or done <= outer.done:
            outer = self.counts["outer"] = ProgressCount(name="", done=done, total=total, since=now, first=done)
        outer.reached(done, text_of(code, **fields), now)

    def _counted(self, code: str, fields: Mapping[str, object], now: float) -> None:
        """Something counts, so whoever was asked has done it."""
        self._answered()
        name = f"{fields.get('axis', '')}{fields.get('part', '')} {fields.get('program', '')}".strip()
        done, total = (int(str(fields[key])) for key in (COUNTED[0] if "done" in fields else COUNTED[1]))
        inner = self.counts.get("inner")
        if inner is None or inner.name != name or done < inner.done:
            inner = self.counts["inner"] = ProgressCount(name=name, done=done, total=total, since=now, first=done)
        inner.total = total
        inner.reached(done, text_of(code, **fields), now)
        if done >= total:
            self.within = self.counts.pop("inner").said


def clock_text(seconds: float) -> str:
    """Minutes and seconds, hours before them where there are any."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
