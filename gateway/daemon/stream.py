"""The live stream: what happens now, to every page that listens, and the picture of the run at work.

Each page has a bounded queue: the oldest frame goes first, passing ones (samples, conditions) before others, and the
page is told how many it lost. So a slow page never slows a run. Samples are sent as envelopes ten times a second.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, words
from drivers.message import Message, fields_as_data
from drivers.types.sensing import Ambient, SampleBlock
from drivers.types.values import FloatArray
from gateway.audience import Audience, kind_of
from gateway.errors import BusyError
from gateway.events import DisableMoves, StopDone, TargetsAdded, received
from gateway.live import Asked, LiveDeviation
from gateway.views import JobView, RunView

# The live stream: what happens now, to every page that listens; a slow page loses frames, is told so, slows nobody.

MOST_LISTENERS = 32
MOST_OF_ONE = 4
KEPT_FOR_OPERATORS = 2
LONGEST_QUEUE = 256
BEAT_S = 5.0
"""A cable that is cut ends no socket: a page that hears nothing for two of these shows what it has as stale."""
Tell = Callable[[str, Mapping[str, object]], None]


PASSING = frozenset({"reading", "ambient", "waiting", "stands"})
"""What the next one of its kind replaces: a slow page loses these first."""


class StreamListener:
    """One page: a bounded queue of frames; when it is full the oldest goes, passing ones first, and is counted.

    ``picture`` is asked for when frames were lost: a page that lost a word knows how everything is now.
    """

    def __init__(self, picture: Callable[[], str], most: int = LONGEST_QUEUE, who: str = "") -> None:
        self.who = who
        self._frames: deque[tuple[str, bool]] = deque()
        self._picture = picture
        self._most = most
        self._news = asyncio.Event()
        self.lost = 0
        self.over = False

    def put(self, frame: str, *, passing: bool = False) -> None:
        """One more frame; never waits."""
        if len(self._frames) >= self._most:
            del self._frames[next((at for at, (_frame, goes) in enumerate(self._frames) if goes), 0)]
            self.lost += 1
        self._frames.append((frame, passing))
        self._news.set()

    def end(self) -> None:
        """Nothing more comes."""
        self.over = True
        self._news.set()

    async def next(self, clock: Clock) -> str:
        """What there is to send now; "" ends. A beat where nothing comes.

        What was lost is told first, and everything as it is now last.
        """
        if not self._frames and not self.over:
            self._news.clear()
            try:
                async with clock.deadline(BEAT_S, "stream"):
                    await self._news.wait()
            except DeadlineExceeded:
                return frame_of("beat", {})
        told = [frame_of("lost", {"frames": self.lost})] if self.lost else []
        anew = [self._picture()] if self.lost else []
        self.lost = 0
        found = "".join((*told, *(frame for frame, _passing in self._frames), *anew))
        self._frames.clear()
        return found


def frame_of(kind: str, data: Mapping[str, object], number: int = 0) -> str:
    """A server-sent event: its number, kind and data as one line of JSON."""
    head = f"id: {number}\n" if number else ""
    return f"{head}event: {kind}\ndata: {json.dumps(data, default=str)}\n\n"


class Hub:
    """Everybody who listens to one site."""

    def __init__(self, clock: Clock, picture: Callable[[], Mapping[str, object]], also: Tell | None = None) -> None:
        """``picture`` is what a page gets first: everything as it is now; ``also`` hears every event, pages or not."""
        self._clock = clock
        self._picture = picture
        self._also = also
        self._listeners: dict[StreamListener, None] = {}  # in the order of joining
        self._number = 0
        self._over = False
        self.dropped = 0

    def tell(self, kind: str, data: Mapping[str, object]) -> None:
        """An event for all; returns at once. It carries the next number and the moment in UTC."""
        self._number += 1
        if self._also is not None:
            self._also(kind, data)
        if not self._listeners:
            return
        utc = self._clock.utc().isoformat(timespec="milliseconds")
        frame = frame_of(kind, {"utc": utc, **data}, self._number)
        for listener in self._listeners:
            before = listener.lost
            listener.put(frame, passing=kind in PASSING)
            self.dropped += listener.lost - before

    def hear(self, code: str, fields: Mapping[str, object]) -> None:
        """A word of the run at work, for all."""
        told = {"code": code, "fields": plain_fields(fields), "words": words(code, **fields)}
        event = received(code, fields)
        self.tell("said", {**told, "kind": kind_of(code).value, "event": type(event).__name__ if event else ""})

    @property
    def listening(self) -> int:
        """How many pages listen."""
        return len(self._listeners)

    def end(self) -> None:
        """Every stream ends; later ones end at once."""
        self._over = True
        for listener in self._listeners:
            listener.end()

    def join(self, who: str = "", *, operates: bool = True) -> StreamListener:
        """A new listener; of one person's more than `MOST_OF_ONE` the oldest ends.

        The last `KEPT_FOR_OPERATORS` places are for people who operate. Raises BusyError (E-WEB-STREAMS) where too many
        listen already.
        """
        own = [one for one in self._listeners if who and one.who == who]
        for one in own[: max(len(own) - MOST_OF_ONE + 1, 0)]:
            one.put(frame_of("replaced", {"most": MOST_OF_ONE}))
            one.end()
            del self._listeners[one]
        most = MOST_LISTENERS - (0 if operates else KEPT_FOR_OPERATORS)
        if len(self._listeners) >= most:
            raise BusyError("E-WEB-STREAMS", "stream", most=most)
        listener = StreamListener(self._now, who=who)
        self._listeners[listener] = None
        listener.put(self._now())
        if self._over:
            listener.end()
        return listener

    def _now(self) -> str:
        return frame_of("picture", self._picture(), self._number)

    async def stream(self, listener: StreamListener) -> AsyncIterator[str]:
        """What a listener is sent, until it leaves or the gateway ends."""
        try:
            while frame := await listener.next(self._clock):
                yield frame
        finally:
            self._listeners.pop(listener, None)


def plain_fields(fields: Mapping[str, object]) -> dict[str, object]:
    """Fields of a word as JSON takes them: messages within them as code and fields, anything unknown as text."""
    return fields_as_data(fields)


# Looks on at the run for the stream: samples as envelopes ten times a second, stops, and what is waited for.

EVERY_S = 0.1
MOST_ASKED = 200
MOST_KEPT = 20000
MOST_AIRS = 2000


@dataclass(slots=True)
class _SampleEnvelope:
    """What an instrument sent since the last frame: lowest, highest, newest of each channel (c,)."""

    low: FloatArray
    high: FloatArray
    last: FloatArray
    begin_s: float
    end_s: float
    count: int = 0
    bad: int = 0
    lost: int = 0

    def take(self, block: SampleBlock) -> None:
        self.low = np.minimum(self.low, block.values.min(axis=0))
        self.high = np.maximum(self.high, block.values.max(axis=0))
        self.last, self.end_s = block.values[-1], float(block.time_s[-1])
        self.count += len(block)
        self.bad += int(np.count_nonzero(~block.valid))
        self.lost += block.lost


@dataclass(slots=True)
class LiveObserver:
    """The onlooker of a daemon. ``tell`` passes an event on; what people ask to be taken again waits here.

    ``part`` counts the parts of a command (axes, set-ups), so that readings of one part stand together in a plot.
    ``airs`` are the readings of air and material since the command began, ``positions`` where axes stood last.
    """

    tell: Callable[[str, Mapping[str, object]], None]
    clock: Clock
    asked: dict[str, list[Asked]] = field(default_factory=dict)
    part: int = 0
    kept: list[dict[str, object]] = field(default_factory=list)
    air: Mapping[str, object] | None = None
    airs: deque[Mapping[str, object]] = field(default_factory=lambda: deque(maxlen=MOST_AIRS))
    positions: dict[str, float] = field(default_factory=dict)
    _since: dict[str, _SampleEnvelope] = field(default_factory=dict)
    _told_s: dict[str, float] = field(default_factory=dict)
    _samples: dict[str, int] = field(default_factory=dict)

    def said(self, code: str, fields: Mapping[str, object]) -> None:
        """Count the parts by what is said; more targets of one set-up begin none."""
        if kind_of(code) is Audience.STEP and not isinstance(received(code, fields), TargetsAdded):
            self.part += 1

    def begin(self) -> None:
        """Another command is at work: what the last one took, and what people asked of it, is over."""
        self.kept.clear()
        self.airs.clear()
        self.asked.clear()

    def samples(self, instrument: str, block: SampleBlock) -> None:
        """Gather; a frame goes out once a tenth of a second of the gateway's clock has passed since the last one."""
        if not len(block):
            return
        known = self._since.get(instrument)
        if known is None:
            first, begin = block.values[0], float(block.time_s[0])
            known = self._since[instrument] = _SampleEnvelope(first, high=first, last=first, begin_s=begin, end_s=begin)
        known.take(block)
        if self._is_due(instrument):
            self._flush(instrument, known, block.channels)

    def _is_due(self, key: str) -> bool:
        now = self.clock.now()
        if now - self._told_s.get(key, -EVERY_S) < EVERY_S:
            return False
        self._told_s[key] = now
        return True

    def _flush(self, instrument: str, seen: _SampleEnvelope, channels: tuple[str, ...]) -> None:
        del self._since[instrument]
        self._samples[instrument] = self._samples.get(instrument, 0) + seen.count
        self.tell(
            "reading",
            {
                "instrument": instrument,
                "channels": list(channels),
                "low": seen.low.tolist(),
                "high": seen.high.tolist(),
                "last": seen.last.tolist(),
                "begin_s": seen.begin_s,
                "end_s": seen.end_s,
                "count": seen.count,
                "sequence": self._samples[instrument],
                "signal": 1.0 - seen.bad / seen.count,
                "lost": seen.lost,
            },
        )

    def waiting(self, instrument: str, missing: Message, done_s: float, needed_s: float) -> None:
        """Which condition holds up the reading, ten times a second at most."""
        if self._is_due(f"waiting {instrument}"):
            done = max(min(done_s, needed_s), 0.0) if np.isfinite(done_s) else 0.0
            told = {"instrument": instrument, "missing": missing.as_data(), "done_s": round(done, 3)}
            self.tell("waiting", {**told, "needed_s": round(needed_s, 3)})

    def ambient(self, instrument: str, air: Ambient) -> None:
        """Air and material."""
        told = {"air_degc": air.air_degc, "pressure_hpa": air.pressure_hpa, "humidity_pct": air.humidity_pct}
        found = {"instrument": instrument, **told, "material_degc": list(air.material_degc), "age_s": air.age_s}
        self.air = {"utc": self.clock.utc().isoformat(timespec="milliseconds"), **found}
        self.airs.append(self.air)
        self.tell("ambient", found)

    def stands(self, positions: Mapping[str, float]) -> None:
        """Where axes stand; said where one of them stands elsewhere now."""
        now = {**self.positions, **{name: round(float(value), 4) for name, value in positions.items()}}
        if now != self.positions:
            self.positions = now
            self.tell("stands", {"positions": now})

    def taken(self, axis: str, stop: Asked, seen: LiveDeviation) -> None:
        """A reading of the plot."""
        target, repetition, approach = stop
        told: dict[str, object] = {"axis": axis, "target": target, "repetition": repetition, "approach": approach}
        told |= {"deviation": seen.value, "unit": seen.unit, "expanded": seen.expanded, "raw": seen.raw}
        told["part"] = self.part
        if len(self.kept) < MOST_KEPT:
            self.kept.append(told)
        self.tell("taken", told)

    def ask_again(self, axis: str, stop: Asked) -> bool:
        """A person wants a reading again; false where so many wait already."""
        wanted = self.asked.setdefault(axis, [])
        if len(wanted) >= MOST_ASKED:
            return False
        wanted.append(stop)
        return True

    def asked_again(self, axis: str) -> tuple[Asked, ...]:
        """What people asked for, told once."""
        return tuple(self.asked.pop(axis, ()))


# The picture of the command at work: what it does, what a person is asked for and what will move then; pure.

MOST_MOVES = 40


def new_run_view(job: JobView) -> RunView:
    """The picture of a command that has not said anything yet."""
    return RunView(
        run_id="",
        stage="",
        axis="",
        done=0,
        total=0,
        words=None,
        started_utc=job.started_utc,
        kind=job.kind,
        who=job.who,
    )


def updated_run(run: RunView, code: str, fields: Mapping[str, object]) -> RunView:
    """The picture of a run after one more word of it; fields it does not name stay as they were."""
    said = replace(
        run,
        words=Message(code, fields),
        axis=str(fields.get("axis", run.axis)),
        ask=_requested_action(run, code, fields),
        moves=_announced_moves(run, code, fields),
    )
    event = received(code, fields)
    done, total = (_as_count(event.done), _as_count(event.total)) if isinstance(event, StopDone) else (0, 0)
    return replace(said, stage=str(fields.get("program", run.stage)), done=done, total=total)


def _requested_action(run: RunView, code: str, fields: Mapping[str, object]) -> Mapping[str, object] | None:
    """What a person must do now: details leave it standing, whatever else is said means that it was done."""
    kind = kind_of(code)
    if kind is Audience.ASK:
        return _as_said(code, fields)
    return run.ask if kind is Audience.DETAIL else None


def _announced_moves(run: RunView, code: str, fields: Mapping[str, object]) -> tuple[Mapping[str, object], ...]:
    """What will move when a person does what is asked; what is said after an ask belongs to the next one."""
    kind = kind_of(code)
    if kind is Audience.MOVE or isinstance(received(code, fields), DisableMoves):
        return (*(() if run.ask else run.moves), _as_said(code, fields))[-MOST_MOVES:]
    return run.moves if kind in (Audience.ASK, Audience.DETAIL) else ()


def _as_said(code: str, fields: Mapping[str, object]) -> Mapping[str, object]:
    event = received(code, fields)
    told = {"code": code, "fields": plain_fields(fields), "words": words(code, **fields)}
    return {**told, "event": type(event).__name__ if event else ""}


def _as_count(value: object) -> int:
    return value if isinstance(value, int) else 0
