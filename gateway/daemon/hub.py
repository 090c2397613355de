"""The live stream: what happens now, to every page that listens; a slow page loses frames, is told so, slows nobody."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, words
from drivers.message import fields_as_data
from gateway.audience import kind_of
from gateway.errors import BusyError
from gateway.events import received

MOST_LISTENERS = 32
MOST_OF_ONE = 4
KEPT_FOR_OPERATORS = 2
LONGEST_QUEUE = 256
BEAT_S = 5.0
"""A cable that is cut ends no socket: a page that hears nothing for two of these shows what it has as stale."""
Tell = Callable[[str, Mapping[str, object]], None]


PASSING = frozenset({"reading", "ambient", "waiting"})
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
