"""One conversation with the agent: questions in turn, refusals as our exceptions; a broken line is opened by a read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused, RemoteProtocolError, TransportError, UnsupportedDevice
from drivers.link import Link
from drivers.linuxcnc.codec import AgentAnswer, AgentAsk, AgentCodec
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.message import Message
from drivers.transport import open_transport

PROTOCOL = 1
LONGEST_TOKEN = 4096
_CLOSED = "E-LINK-CLOSED"
_UNSUPPORTED = ("E-LCNC-KINS", "E-LCNC-NO-FILE")


class AgentWire:
    """Asks one question at a time. A write goes over the line that is open and is never sent twice."""

    def __init__(self, url: str, settings: LinuxCncSettings, clock: Clock, where: str) -> None:
        self._url, self._settings, self._clock, self._where = url, settings, clock, where
        self._link: Link[AgentAsk, AgentAnswer] | None = None
        self._asked = 0

    def _token(self) -> str:
        try:
            with Path(self._settings.token_file).open(encoding="utf-8") as file:
                return file.read(LONGEST_TOKEN).strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError("E-LCNC-TOKEN-FILE", self._where, path=self._settings.token_file, why=error) from error

    async def open(self, timeout_s: float) -> None:
        """A fresh line to an agent of this protocol; once more where a life of the kernel ended just then.

        Raises what `open_transport` raises, ConfigError (E-LCNC-TOKEN-FILE), UnsupportedDevice (E-LCNC-PROTOCOL).
        """
        try:
            await self._opened(timeout_s)
        except TransportError as error:
            if error.code != _CLOSED:
                raise
            await self._opened(timeout_s)

    async def _opened(self, timeout_s: float) -> None:
        await self.close()
        token = self._token()
        wire = await open_transport(self._url, self._clock, timeout_s)
        self._link = Link(
            self._where,
            wire,
            AgentCodec(token),
            self._clock,
            is_answer=lambda _message: True,
            matches=lambda ask, answer: answer.id in (None, ask.id),
        )
        try:
            said = await self._asked_once("hello")
            if said["agent"] != PROTOCOL:
                raise UnsupportedDevice("E-LCNC-PROTOCOL", self._where, found=said["agent"], known=PROTOCOL)
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Let go of the line. Never raises."""
        link, self._link = self._link, None
        if link is not None:
            await link.close()

    async def read(self, do: str, **told: Any) -> Any:
        """Ask for something that changes nothing; where the line is broken, or breaks now, over a fresh one."""
        if self._link is not None and self._link.failure is None:
            try:
                return await self._asked_once(do, **told)
            except TransportError as error:
                if error.code != _CLOSED:
                    raise
        await self.open(self._settings.reply_s)
        return await self._asked_once(do, **told)

    async def write(self, do: str, **told: Any) -> Any:
        """Ask once; a line that broke while nothing was asked is made anew before, for nothing of this was sent yet.

        Raises DeadlineExceeded (outcome unknown), TransportError, DeviceRefused (E-LCNC-...).
        """
        if self._link is not None and self._link.failure is not None:
            await self.open(self._settings.reply_s)
        return await self._asked_once(do, **told)

    async def _asked_once(self, do: str, **told: Any) -> Any:
        if self._link is None:
            raise TransportError("E-LINK-CLOSED", self._where, why=Message.of("W-LINK-CLOSED"))
        self._asked += 1
        answer = await self._link.exchange(AgentAsk(self._asked, do, told), self._settings.reply_s)
        if answer.code:
            raise self._refused(answer)
        return answer.value

    def _refused(self, answer: AgentAnswer) -> Exception:
        fields = {key: value for key, value in answer.fields.items() if key != "where"}
        if answer.code == "E-LCNC-ANSWER":
            return RemoteProtocolError(answer.code, self._where, **fields)
        if answer.code == "E-LCNC-DOWN":
            return TransportError(answer.code, self._where, retryable=True, **fields)
        kind = UnsupportedDevice if answer.code in _UNSUPPORTED else DeviceRefused
        return kind(answer.code, self._where, **fields)
