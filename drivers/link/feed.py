"""Sample blocks from a device's reader to the one consumer of the moment, bounded, from now on."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError, TrueflankError
from drivers.types.sensing import SampleBlock


class _Seat:
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
        self._seat: _Seat | None = None
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

    def _sit(self) -> _Seat:
        seat = _Seat()
        if self._seat is not None:
            self._seat.end(DeviceRefused("E-LINK-SEAT", self._where))
        if self._failure is not None:
            seat.end(self._failure)
        self._seat = seat
        return seat

    async def _wait(self, seat: _Seat, clock: Clock, stale_s: float) -> None:
        seat.changed.clear()
        try:
            async with clock.deadline(stale_s, self._where):
                await seat.changed.wait()
        except DeadlineExceeded as error:
            raise TransportError("E-LINK-STALE", self._where, stale_s=stale_s) from error
