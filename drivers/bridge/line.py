"""The conversation with one bridge: opening, who it is, one question at a time, and what it says unasked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from drivers.bridge import records
from drivers.bridge.codec import BridgeCodec, BridgeRefusal, Damaged, Message, Reply, Request
from drivers.bridge.fields import Fields
from drivers.bridge.records import BridgeIdentity
from drivers.bridge.refusals import exception_for
from drivers.bridge.settings import BridgeSettings
from drivers.clock import Clock
from drivers.errors import RemoteProtocolError, TransportError, TrueflankError, UnsupportedDevice
from drivers.link import Link, Trace
from drivers.transport import open_transport

BridgeLink = Link[Request, Message]


def _belongs(question: Request, answer: Message) -> bool:
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
        hear: Callable[[Message], None],
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
        return TransportError("E-LINK-CLOSED", self.name, why="this end is closed")
