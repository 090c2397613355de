"""One conversation with one device: questions and answers in order, samples next to them, broken means broken.

A `Link` has one lock and the caller's deadline. An exchange that is interrupted, by time or cancel, leaves it broken
for good: no later answer can then belong to an earlier question. A `Feed` never makes the reader of a device wait: a
consumer that falls behind is ended with an error.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterable
from typing import Generic, Literal, Protocol, TypeVar

from drivers.clock import Clock
from drivers.errors import (
    DeadlineExceeded,
    DeviceRefused,
    LinkBroken,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
)
from drivers.message import Message
from drivers.transport import ByteTransport
from drivers.types.sensing import SampleBlock

__all__ = ["Codec", "Feed", "Link", "Trace"]

Out_contra = TypeVar("Out_contra", contravariant=True)
In_co = TypeVar("In_co", covariant=True)
Question = TypeVar("Question")
Received = TypeVar("Received")
Trace = Callable[[Literal["<", ">"], bytes], None]

READ_BYTES = 1 << 18


class Codec(Protocol[Out_contra, In_co]):
    """A dialect in one role: pure, bytes to messages and back."""

    def send(self, message: Out_contra, /) -> bytes:
        """Received to bytes; raises LocalProtocolError for what this role may not say."""
        ...

    def receive(self, data: bytes, /) -> Iterable[In_co]:
        """Any bytes to the messages they complete; never raises."""
        ...


def _nothing(_direction: Literal["<", ">"], _data: bytes) -> None:
    return None


class Link(Generic[Question, Received]):
    """A device's wire, owned: `exchange` asks and waits, `news` waits for what comes unasked.

    ``is_answer`` tells the answers among the messages; ``matches`` says whether an answer belongs to a
    question. ``trace`` is called with ">" and "<" and the bytes as they pass.
    """

    def __init__(
        self,
        name: str,
        transport: ByteTransport,
        codec: Codec[Question, Received],
        clock: Clock,
        *,
        is_answer: Callable[[Received], bool] = lambda _message: False,
        matches: Callable[[Question, Received], bool] = lambda _question, _answer: True,
        trace: Trace | None = None,
        backlog: int = 4096,
    ) -> None:
        self.name = name
        self._transport = transport
        self._codec = codec
        self._clock = clock
        self._is_answer = is_answer
        self._matches = matches
        self._trace = trace or _nothing
        self._received = 0
        self._backlog = backlog
        self._lock = asyncio.Lock()
        self._asked: Question | None = None
        self._answer: asyncio.Future[Received] | None = None
        self._unasked: deque[Received] = deque()
        self._changed = asyncio.Event()
        self._failure: TrueflankError | None = None
        self._reader = asyncio.get_running_loop().create_task(self._follow(), name=f"link to {name}")

    @property
    def received(self) -> int:
        """Bytes that have come, whatever they were."""
        return self._received

    @property
    def failure(self) -> TrueflankError | None:
        """Why the link is broken; None while it works."""
        return self._failure

    async def exchange(self, question: Question, timeout_s: float) -> Received:
        """Ask and return the answer. Whatever interrupts it (deadline, cancel, nonsense) breaks the link.

        Raises DeadlineExceeded, LinkBroken (E-LINK-BROKEN: a former exchange was interrupted),
        TransportError, RemoteProtocolError, LocalProtocolError (nothing was sent, nothing broken).
        """
        async with self._clock.deadline(timeout_s, self.name), self._lock:
            self._check()
            data = self._codec.send(question)
            try:
                return await self._ask(question, data)
            except BaseException as interruption:
                self._break(LinkBroken("E-LINK-BROKEN", self.name, why=type(interruption).__name__))
                raise

    async def _ask(self, question: Question, data: bytes) -> Received:
        answer: asyncio.Future[Received] = asyncio.get_running_loop().create_future()
        self._asked, self._answer = question, answer
        try:
            self._trace(">", data)
            await self._transport.write(data)
            return await answer
        finally:
            self._asked = self._answer = None

    async def news(self) -> Received:
        """Return the next message that came unasked; raises the link's failure once all are taken."""
        while not self._unasked:
            if self._failure is not None:
                raise self._failure
            self._changed.clear()
            await self._changed.wait()
        return self._unasked.popleft()

    def _check(self) -> None:
        if self._failure is not None:
            why = f"{self._failure.code} {self._failure.what}"
            raise LinkBroken("E-LINK-BROKEN", self.name, why=why) from self._failure

    def fail(self, error: TrueflankError) -> None:
        """Break the link for a reason that its user found, as nonsense among the news."""
        self._break(error)

    def _break(self, error: TrueflankError) -> None:
        if self._failure is None:
            self._failure = error
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(error)
        self._changed.set()

    async def _follow(self) -> None:
        try:
            while self._failure is None:
                data = await self._transport.read(READ_BYTES)
                self._received += len(data)
                self._trace("<", data)
                for message in self._codec.receive(data):
                    self._sort(message)
                # A wire that always has more must not keep those from their turn who work it off.
                await self._clock.sleep(0)
        except TrueflankError as error:
            self._break(error)
        finally:
            self._break(LinkBroken("E-LINK-BROKEN", self.name, why=Message.of("W-LINK-READER-ENDED")))

    def _sort(self, message: Received) -> None:
        if self._is_answer(message):
            self._deliver(message)
            return
        self._unasked.append(message)
        self._changed.set()
        if len(self._unasked) > self._backlog:
            raise TransportError("E-LINK-OVERFLOW", self.name, limit=f"{self._backlog} messages")

    def _deliver(self, message: Received) -> None:
        if self._asked is None or self._answer is None or self._answer.done():
            raise RemoteProtocolError("E-LINK-STRAY", self.name, answer=_short(message), question="(none)")
        if not self._matches(self._asked, message):
            question = _short(self._asked)
            raise RemoteProtocolError("E-LINK-STRAY", self.name, answer=_short(message), question=question)
        self._answer.set_result(message)

    async def close(self) -> None:
        """End the reader and close the wire; never raises, may be called twice."""
        self._break(TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED")))
        self._reader.cancel()
        await asyncio.gather(self._reader, return_exceptions=True)
        await self._transport.close()


def _short(message: object) -> str:
    text = repr(message)
    return text if len(text) <= 200 else text[:197] + "..."


# Sample blocks from a device's reader to the one consumer of the moment, bounded, from now on.


class _SubscriberQueue:
    """What waits for one consumer."""

    def __init__(self) -> None:
        self.blocks: deque[SampleBlock] = deque()
        self.samples = 0
        self.failure: TrueflankError | None = None
        self.changed = asyncio.Event()

    def end(self, error: TrueflankError) -> None:
        if self.failure is None:
            self.failure = error
        self.changed.set()


class Feed:
    """`publish` never waits; a consumer that falls `limit` samples behind is ended with an error.

    There is one seat: who sits down later takes it over, and the former consumer is told so.
    """

    def __init__(self, where: str, limit: int = 1_000_000) -> None:
        self._where = where
        self._limit = limit
        self._seat: _SubscriberQueue | None = None
        self._failure: TrueflankError | None = None

    def publish(self, block: SampleBlock) -> None:
        """Hand a block to the consumer, if there is one."""
        seat = self._seat
        if seat is None or seat.failure is not None:
            return
        seat.blocks.append(block)
        seat.samples += len(block)
        seat.changed.set()
        if seat.samples > self._limit:
            seat.end(TransportError("E-LINK-OVERFLOW", self._where, limit=f"{self._limit} samples"))

    def fail(self, error: TrueflankError) -> None:
        """End this and every later consumer with this error, after what already waits."""
        self._failure = error
        if self._seat is not None:
            self._seat.end(error)

    async def follow(self, clock: Clock, stale_s: float) -> AsyncGenerator[SampleBlock, None]:
        """Blocks from now on; ends with the feed's failure, or E-LINK-STALE after `stale_s` without one."""
        seat = self._sit()
        try:
            while True:
                while seat.blocks:
                    block = seat.blocks.popleft()
                    seat.samples -= len(block)
                    yield block
                if seat.failure is not None:
                    raise seat.failure
                await self._wait(seat, clock, stale_s)
        finally:
            if self._seat is seat:
                self._seat = None

    def _sit(self) -> _SubscriberQueue:
        seat = _SubscriberQueue()
        if self._seat is not None:
            self._seat.end(DeviceRefused("E-LINK-SEAT", self._where))
        if self._failure is not None:
            seat.end(self._failure)
        self._seat = seat
        return seat

    async def _wait(self, seat: _SubscriberQueue, clock: Clock, stale_s: float) -> None:
        seat.changed.clear()
        try:
            async with clock.deadline(stale_s, self._where):
                await seat.changed.wait()
        except DeadlineExceeded as error:
            raise TransportError("E-LINK-STALE", self._where, stale_s=stale_s) from error
