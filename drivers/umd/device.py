"""A laser's quadrature output through a uMD counter, as an instrument that streams the optical path."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from typing import Any

from drivers.clock import Clock
from drivers.errors import (
    DeadlineExceeded,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    catalogue,
)
from drivers.link import Feed, Link, Trace
from drivers.message import Message
from drivers.transport import hardware_of, open_transport
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor
from drivers.umd.codec import UmdCodec, UmdLines
from drivers.umd.counting import UmdCounting
from drivers.umd.settings import UmdSettings

# One round of uMD0's low-speed codes; after that the firmware version is not waited for any longer.
ROUND_LINES = 300
GARBAGE_S = 5.0
# Less than this without a line is a line that drips, not a wrong baud rate.
NOISE_BYTES = 200


class UmdCounter:
    """Driver "umd": one axis of a uMD0, uMD1 or uMD2 counter."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = UmdSettings.read(settings, name)
        self._feed = Feed(name)
        self._counting = UmdCounting(self._settings, name)
        self._link: Link[UmdLines, UmdLines] | None = None
        self._reader: asyncio.Task[None] | None = None
        self._known = asyncio.Event()
        self._failure: TrueflankError | None = None
        self._serial = url
        self._met: tuple[object, ...] | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """("displacement_mm",): optical path in mm, of vacuum unless `compensated_for` says otherwise.

        ("angle_arcsec",) where the settings name angular optics.
        """
        return self._settings.channels

    @property
    def compensated_for(self) -> CompensatedFor:
        """Nothing, unless the setting for a scaled quadrature output says otherwise."""
        return self._settings.compensation

    @property
    def notices(self) -> tuple[str, ...]:
        """What a counter cannot see."""
        texts = catalogue()
        codes = ["N-UMD-BEAM"] + (["N-UMD-HETERODYNE"] if self._counting.low_speed.axes == 0 else [])
        return tuple(texts[code]["what"] for code in codes)

    async def open(self, timeout_s: float) -> Identity:
        """Connect and wait until the counter has said its sample frequency and counts per cycle, twice.

        Raises what `open_transport` raises; DeadlineExceeded (E-UMD-SILENT); UnsupportedDevice (E-UMD-BAUD,
        E-UMD-CODES, E-UMD-AXIS; E-UMD-OTHER: not the counter that was met at the first opening).
        """
        await self.close()
        started = self._clock.now()
        wire = await open_transport(self._url, self._clock, timeout_s, baudrate=self._settings.baudrate)
        # A uMD has no number of its own: that of its USB chip, else the wire it hangs on, is all to know it by.
        self._serial = hardware_of(wire) or self._url
        self._begin(Link(self.name, wire, UmdCodec("client", join_late=True), self._clock, trace=self.trace))
        try:
            await self._wait_known(started + timeout_s)
            self._check_same()
        except BaseException:
            await self.close()
            raise
        return self._identity()

    def _begin(self, link: Link[UmdLines, UmdLines]) -> None:
        self._link = link
        self._feed = Feed(self.name)
        self._counting = UmdCounting(self._settings, self.name)
        self._known = asyncio.Event()
        self._failure = None
        follow = self._follow(link, self._counting, self._feed)
        self._reader = asyncio.get_running_loop().create_task(follow, name=f"reader of {self.name}")

    async def _follow(self, link: Link[UmdLines, UmdLines], counting: UmdCounting, feed: Feed) -> None:
        try:
            while True:
                for block in counting.take(await link.news()):
                    feed.publish(block)
                if not counting.missing and (counting.low_speed.firmware or counting.lines > ROUND_LINES):
                    self._known.set()
        except TrueflankError as error:
            self._failure = error
            feed.fail(error)
            self._known.set()

    async def _wait_known(self, until: float) -> None:
        # Noise alone is told early: nobody should wait out a long limit to hear of a wrong baud rate.
        for limit in (min(until, self._clock.now() + GARBAGE_S), until):
            with contextlib.suppress(DeadlineExceeded):
                async with self._clock.deadline(max(limit - self._clock.now(), 0.0), self.name):
                    await self._known.wait()
            if self._failure is not None:
                raise self._failure
            if self._known.is_set():
                return
            if self._garbage():
                break
        raise self._diagnosis()

    def _garbage(self) -> bool:
        return self._link is not None and self._link.received > 0 and not self._counting.lines

    def _diagnosis(self) -> TrueflankError:
        received = self._link.received if self._link is not None else 0
        if not received:
            return DeadlineExceeded("E-UMD-SILENT", self.name, url=self._url)
        if not self._counting.lines:
            return self._wrong_baud(received)
        codes = ", ".join(map(str, self._counting.missing))
        return UnsupportedDevice("E-UMD-CODES", self.name, codes=codes, lines=self._counting.lines)

    def _wrong_baud(self, received: int) -> UnsupportedDevice:
        baudrate = self._settings.baudrate
        return UnsupportedDevice("E-UMD-BAUD", self.name, received=received, baudrate=baudrate)

    def _check_same(self) -> None:
        """After a replug the same counter must answer: another one would count on with another scale."""
        counting = self._counting
        met = (self._serial, counting.sample_rate_hz, counting.counts_per_cycle, counting.low_speed.firmware)
        if self._met is None:
            self._met = met
        if met != self._met:
            found, before = (", ".join(map(str, which)) for which in (met, self._met))
            raise UnsupportedDevice("E-UMD-OTHER", self.name, found=found, before=before)

    def _identity(self) -> Identity:
        low = self._counting.low_speed
        kind = "heterodyne" if low.axes == 0 else "homodyne"
        model = f"uMD counter, {kind}, {self._counting.sample_rate_hz:g} Hz"
        return Identity(driver="umd", model=model, serial=self._serial, firmware=low.firmware, notes=self.notices)

    async def close(self) -> None:
        """Let go of the wire and end the stream; never raises."""
        reader, link, self._reader, self._link = self._reader, self._link, None, None
        if reader is not None:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)
        if link is not None:
            await link.close()
        self._feed.fail(self._closed())

    def _closed(self) -> TransportError:
        return TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED"))

    async def optics(self) -> Optics:
        """Unknown: a counter sees counts only."""
        return Optics()

    async def ambient(self) -> Ambient:
        """Readings of the counter's own sensors, aged in instrument time."""
        return self._counting.ambient()

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Samples from now on. Ends with TransportError (E-LINK-CLOSED, E-LINK-STALE, E-LINK-OVERFLOW),
        UnsupportedDevice (E-UMD-BAUD: only noise), RemoteProtocolError (E-UMD-CHANGED)."""
        link = self._link
        if link is None:
            raise self._closed()
        lines, received = self._counting.lines, link.received
        try:
            async with contextlib.aclosing(self._feed.follow(self._clock, self._settings.stale_s)) as feed:
                async for block in feed:
                    lines, received = self._counting.lines, link.received
                    yield block
        except TransportError as error:
            noise = link.received - received
            if error.code == "E-LINK-STALE" and noise >= NOISE_BYTES and self._counting.lines == lines:
                raise self._wrong_baud(noise) from error
            raise
