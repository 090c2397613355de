"""An instrument behind the bridge: streams samples, reads its environment, turns a calibrator."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from typing import Any

from drivers.bridge import records
from drivers.bridge.codec import BridgeCodec, Damaged, Message, Notification, Refusal, Reply, Request
from drivers.bridge.fields import Fields
from drivers.bridge.records import BridgeIdentity, BridgeSamples, CalibratorStatus
from drivers.bridge.refusals import exception_for
from drivers.bridge.settings import BridgeSettings
from drivers.bridge.stream import BridgeStream
from drivers.clock import Clock
from drivers.errors import (
    DeviceRefused,
    NotReferenced,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    catalogue,
)
from drivers.link import Feed, Link, Trace
from drivers.transport import open_transport
from drivers.types import Ambient, CompensatedFor, Identity, Optics, SampleBlock

BridgeLink = Link[Request, Message]


def _belongs(question: Request, answer: Message) -> bool:
    """An answer belongs by its id; a bridge that could not read our line refuses with no id."""
    if isinstance(answer, Refusal):
        return answer.id in (question.id, None)
    return isinstance(answer, Reply) and answer.id == question.id


class BridgeInstrument:
    """Driver "bridge": any instrument of docs/instrument-bridge.md; a rotary calibrator turns as well."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = BridgeSettings.read(settings, name)
        self._timeout_s = 5.0
        self._link: BridgeLink | None = None
        self._reader: asyncio.Task[None] | None = None
        self._feed = Feed(name)
        self._stream: BridgeStream | None = None
        self._who: BridgeIdentity | None = None
        self._battery_pct: float | None = None
        self._asked = 0

    @property
    def channels(self) -> tuple[str, ...]:
        """As the bridge names them, with units; empty before the first `open`."""
        return self._who.channels if self._who else ()

    @property
    def compensated_for(self) -> CompensatedFor:
        """As the bridge says; "nothing" before the first `open`."""
        return self._who.compensated_for if self._who else "nothing"

    @property
    def notices(self) -> tuple[str, ...]:
        """What the instrument cannot see, in the bridge's words, and a battery that runs low."""
        said = self._who.notices if self._who else ()
        low = self._battery_pct is not None and self._battery_pct < self._settings.battery_warn_pct
        return (*said, catalogue()["N-BRIDGE-BATTERY"]["what"]) if low else said

    async def open(self, timeout_s: float) -> Identity:
        """Connect and identify; the same limit then holds for every later request.

        Raises what `open_transport` raises; DeadlineExceeded; UnsupportedDevice (E-BRIDGE-VERSION);
        RemoteProtocolError (E-BRIDGE-FIELD, E-BRIDGE-LINE, E-LINK-STRAY).
        """
        await self.close()
        started = self._clock.now()
        self._timeout_s = timeout_s
        wire = await open_transport(self._url, self._clock, timeout_s, baudrate=self._settings.baudrate)
        self._begin(
            Link(
                self.name,
                wire,
                BridgeCodec("client"),
                self._clock,
                is_answer=lambda message: isinstance(message, Reply | Refusal),
                matches=_belongs,
                trace=self.trace,
            )
        )
        try:
            left_s = max(timeout_s - (self._clock.now() - started), 0.0)
            self._who = self._checked(await self._call(records.IDENTIFY, timeout_s=left_s))
        except BaseException:
            await self.close()
            raise
        who = self._who
        return Identity("bridge", f"{who.maker} {who.model}".strip(), who.serial, who.firmware, who.notices)

    def _checked(self, result: Any) -> BridgeIdentity:
        version = Fields(result, self.name).integer("protocol")
        if version != records.PROTOCOL:
            known = records.PROTOCOL
            raise UnsupportedDevice("E-BRIDGE-VERSION", self.name, found=version, known=known)
        return BridgeIdentity.read(result, self.name)

    def _begin(self, link: BridgeLink) -> None:
        self._link, self._who, self._stream, self._battery_pct = link, None, None, None
        self._feed = Feed(self.name)
        follow = self._follow(link, self._feed)
        self._reader = asyncio.get_running_loop().create_task(follow, name=f"reader of {self.name}")

    async def _follow(self, link: BridgeLink, feed: Feed) -> None:
        try:
            while True:
                self._hear(await link.news(), feed)
        except TrueflankError as error:
            link.fail(error)
            feed.fail(error)

    def _hear(self, message: Message, feed: Feed) -> None:
        if self._who is None:
            return  # left over from before the line was opened
        if isinstance(message, Damaged):
            raise RemoteProtocolError("E-BRIDGE-LINE", self.name, why=message.why, raw=repr(message.raw))
        if not isinstance(message, Notification) or message.method != records.SAMPLES:
            return
        samples = BridgeSamples.read(message.params, self._who.channels, self.name)
        block = self._stream.take(samples) if self._stream else None
        if block is not None:
            feed.publish(block)

    async def _call(
        self, method: str, params: Mapping[str, Any] | None = None, *, timeout_s: float | None = None
    ) -> Any:
        """Ask once and return the result; a refusal comes as the exception that says who must act."""
        if self._link is None:
            raise self._closed()
        self._asked += 1
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        answer = await self._link.exchange(Request(self._asked, method, params or {}), limit_s)
        if isinstance(answer, Reply):
            return answer.result
        if isinstance(answer, Refusal):
            raise exception_for(answer, method, self.name)
        raise RemoteProtocolError("E-BRIDGE-LINE", self.name, why="no answer", raw=repr(answer))

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
        return TransportError("E-LINK-CLOSED", self.name, why="this end is closed")

    async def optics(self) -> Optics:
        """What is in the beam; "unknown" where the instrument cannot tell."""
        result = await self._if_it_can(records.OPTICS)
        return Optics() if result is None else records.read_optics(result, self.name)

    async def ambient(self) -> Ambient:
        """Environment readings; empty where the instrument has no sensors."""
        result = await self._if_it_can(records.ENVIRONMENT)
        return Ambient() if result is None else records.read_environment(result, self.name)

    async def _if_it_can(self, method: str) -> Any:
        try:
            return await self._call(method)
        except DeviceRefused as error:
            if error.code == "E-BRIDGE-UNSUPPORTED":
                return None
            raise

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Start the stream and give samples from now on; stop it when the caller leaves.

        Raises DeviceRefused (E-BRIDGE-UNSUPPORTED, E-BRIDGE-BATTERY), NotReferenced at the start; ends with
        TransportError or RemoteProtocolError.
        """
        await self._check_ready()
        # What still comes of an older stream until the answer is here belongs to nobody.
        self._stream = None
        await self._call(records.START)
        stream = self._stream = BridgeStream(self.channels, self.name)
        try:
            async with contextlib.aclosing(self._feed.follow(self._clock, self._settings.stale_s)) as feed:
                async for block in feed:
                    yield block
        finally:
            if self._stream is stream:
                await self._stop()

    async def _stop(self) -> None:
        self._stream = None
        if self._link is not None and self._link.failure is None:
            with contextlib.suppress(TrueflankError):
                await self._call(records.STOP)

    async def _check_ready(self) -> None:
        if self._who is not None and not self._who.sample_rate_hz:
            said = "this instrument does not stream"
            raise DeviceRefused("E-BRIDGE-UNSUPPORTED", self.name, method=records.START, said=said)
        if self._who is None or self._who.kind != "rotary_calibrator":
            return
        status = CalibratorStatus.read(await self._call(records.STATUS), self.name)
        self._battery_pct = status.battery_pct
        if not status.referenced:
            raise NotReferenced("E-BRIDGE-REFERENCE", self.name, said="referenced is false")
        if status.battery_pct is not None and status.battery_pct < self._settings.battery_refuse_pct:
            raise DeviceRefused("E-BRIDGE-BATTERY", self.name, said=f"{status.battery_pct:g} % left")

    async def hold(self) -> None:
        """Stop following: the device keeps its own angle while the axis moves."""
        await self._calibrator(records.HOLD)

    async def track(self) -> None:
        """Follow the axis again by turning against it."""
        await self._calibrator(records.TRACK)

    async def turn(self, by_deg: float) -> None:
        """Turn the device alone by this angle of its own encoder, and hold."""
        await self._calibrator(records.TURN, {"by_deg": by_deg})

    async def _calibrator(self, method: str, params: Mapping[str, Any] | None = None) -> None:
        if self._who is not None and self._who.kind != "rotary_calibrator":
            said = f"it is a {self._who.kind}"
            raise DeviceRefused("E-BRIDGE-UNSUPPORTED", self.name, method=method, said=said)
        await self._call(method, params, timeout_s=self._settings.turn_timeout_s)
