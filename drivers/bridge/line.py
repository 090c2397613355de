"""The conversation with one bridge: opening, identity, one question at a time, notifications, refusals."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from drivers.bridge import records
from drivers.bridge.codec import BridgeCodec, BridgeMessage, BridgeRefusal, Damaged, Reply, Request
from drivers.bridge.records import (
    BATTERY_LOW,
    BEAM_OBSTRUCTED,
    BUSY,
    INVALID_PARAMS,
    INVALID_REQUEST,
    METHOD_NOT_FOUND,
    NOT_REFERENCED,
    PARSE_ERROR,
    UNSUPPORTED,
    BridgeIdentity,
    Fields,
)
from drivers.bridge.settings import BridgeSettings
from drivers.clock import Clock
from drivers.errors import (
    BeamObstructed,
    DeviceRefused,
    LocalProtocolError,
    NotReferenced,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
)
from drivers.link import Link, Trace
from drivers.message import Message
from drivers.transport import open_transport

# What a bridge's refusals mean: each error code to the exception that says who must act.

CANNOT = (UNSUPPORTED, METHOD_NOT_FOUND)
OUR_FAULT = (PARSE_ERROR, INVALID_REQUEST, INVALID_PARAMS)


def exception_for(refusal: BridgeRefusal, method: str, where: str) -> TrueflankError:
    """The exception for a refusal of `method`, with the bridge's own sentence in its fields."""
    said = refusal.message
    if refusal.code in CANNOT:
        return DeviceRefused("E-BRIDGE-UNSUPPORTED", where, method=method, said=said)
    if refusal.code in OUR_FAULT:
        return LocalProtocolError("E-BRIDGE-REJECTED", where, method=method, said=said, number=refusal.code)
    if refusal.code == BEAM_OBSTRUCTED:
        return BeamObstructed("E-BRIDGE-BEAM", where, method=method, said=said)
    if refusal.code == NOT_REFERENCED:
        return NotReferenced("E-BRIDGE-REFERENCE", where, said=said)
    if refusal.code == BUSY:
        return DeviceRefused("E-BRIDGE-BUSY", where, said=said)
    if refusal.code == BATTERY_LOW:
        return DeviceRefused("E-BRIDGE-BATTERY", where, said=said)
    return DeviceRefused("E-BRIDGE-REFUSED", where, method=method, said=said, number=refusal.code)


# The line.

BridgeLink = Link[Request, BridgeMessage]


def _belongs(question: Request, answer: BridgeMessage) -> bool:
    """An answer belongs by its id; a bridge that could not read our line refuses with no id."""
    if isinstance(answer, BridgeRefusal):
        return answer.id in (question.id, None)
    return isinstance(answer, Reply) and answer.id == question.id


class BridgeLine:
    """``hear`` gets every message that is no answer once the bridge is known; ``lost`` why the line ended."""

    def __init__(
        self,
        name: str,
        url: str,
        settings: BridgeSettings,
        clock: Clock,
        hear: Callable[[BridgeMessage], None],
        lost: Callable[[TrueflankError], None],
    ) -> None:
        self.name = name
        self.trace: Trace | None = None
        self.who: BridgeIdentity | None = None
        self._url = url
        self._settings = settings
        self._clock = clock
        self._hear = hear
        self._lost = lost
        self._timeout_s = 5.0
        self._link: BridgeLink | None = None
        self._reader: asyncio.Task[None] | None = None
        self._met: tuple[str, str, str, str] | None = None
        self._asked = 0

    @property
    def works(self) -> bool:
        """Open and not broken."""
        return self._link is not None and self._link.failure is None

    async def open(self, timeout_s: float) -> BridgeIdentity:
        """Connect and identify; the same limit then holds for every later request.

        Raises what `open_transport` raises; DeadlineExceeded; UnsupportedDevice (E-BRIDGE-VERSION; E-BRIDGE-OTHER:
        not the instrument that was met at the first opening); RemoteProtocolError (E-BRIDGE-FIELD,
        E-BRIDGE-LINE, E-LINK-STRAY).
        """
        await self._let_go()
        started = self._clock.now()
        self._timeout_s = timeout_s
        wire = await open_transport(self._url, self._clock, timeout_s, baudrate=self._settings.baudrate)
        link: BridgeLink = Link(
            self.name,
            wire,
            BridgeCodec("client", echo=self._settings.echo),
            self._clock,
            is_answer=lambda message: isinstance(message, Reply | BridgeRefusal),
            matches=_belongs,
            trace=self.trace,
        )
        self._link, self.who = link, None
        self._reader = asyncio.get_running_loop().create_task(self._follow(link), name=f"reader of {self.name}")
        try:
            left_s = max(timeout_s - (self._clock.now() - started), 0.0)
            self.who = self._checked(await self.call(records.IDENTIFY, timeout_s=left_s))
        except BaseException:
            await self.close()
            raise
        return self.who

    def _checked(self, result: Any) -> BridgeIdentity:
        version = Fields(result, self.name).integer("protocol")
        if version != records.PROTOCOL:
            known = records.PROTOCOL
            raise UnsupportedDevice("E-BRIDGE-VERSION", self.name, found=version, known=known)
        who = BridgeIdentity.read(result, self.name)
        met = (who.kind, who.maker, who.model, who.serial)
        if self._met not in (None, met):
            found, before = " ".join(met), " ".join(self._met or ())
            raise UnsupportedDevice("E-BRIDGE-OTHER", self.name, found=found, before=before)
        self._met = met
        return who

    async def _follow(self, link: BridgeLink) -> None:
        try:
            while True:
                message = await link.news()
                if self.who is not None:  # else left over from before the line was opened
                    self._hear(message)
        except TrueflankError as error:
            link.fail(error)
            self._lost(error)

    def damaged(self, message: Damaged) -> RemoteProtocolError:
        """The error for what cannot be read."""
        return RemoteProtocolError("E-BRIDGE-LINE", self.name, why=message.why, raw=repr(message.raw))

    async def call(
        self, method: str, params: Mapping[str, Any] | None = None, *, timeout_s: float | None = None
    ) -> Any:
        """Ask once and return the result; a refusal comes as the exception that says who must act."""
        if self._link is None:
            raise self.closed()
        self._asked += 1
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        answer = await self._link.exchange(Request(self._asked, method, params or {}), limit_s)
        if isinstance(answer, Reply):
            return answer.result
        if isinstance(answer, BridgeRefusal):
            raise exception_for(answer, method, self.name)
        raise RemoteProtocolError("E-BRIDGE-LINE", self.name, why="no answer", raw=repr(answer))

    async def close(self) -> None:
        """Let go of the wire; never raises."""
        await self._let_go()
        self._lost(self.closed())

    async def _let_go(self) -> None:
        reader, link, self._reader, self._link = self._reader, self._link, None, None
        if reader is not None:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)
        if link is not None:
            await link.close()

    def closed(self) -> TransportError:
        """The error of whoever asks a line that is not open."""
        return TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED"))
