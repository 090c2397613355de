"""The one door to the library of MQTT: a connection that publishes, with its errors mapped."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt

from drivers.clock import Clock
from drivers.errors import ConfigError, LinkBroken
from drivers.local.ownfiles import read_own
from gateway.config import MqttSection
from gateway.mqtt.publishing import Publish

ANSWER_S = 10.0
ALIVE_S = 30
# What the library and its own library tell of a connection that broke is told by our own words already.
_QUIET = logging.getLogger("trueflank.mqtt.library")
_QUIET.setLevel(logging.CRITICAL)


@asynccontextmanager
async def connected(
    section: MqttSection, beside: Path, name: str, *, will: tuple[str, bytes], clock: Clock
) -> AsyncIterator[Publish]:
    """A connection as ``name``, once each; ``will`` is what the server says for us when we are gone.

    Files are relative to ``beside``. Raises ConfigError (E-MQTT-FILE), LinkBroken (E-MQTT-AWAY), DeadlineExceeded.
    """
    where = f"{section.host}:{section.port}"
    await _reached(section, where, clock)
    tls = None if section.ca is None else aiomqtt.TLSParameters(ca_certs=str(beside / section.ca))
    try:
        client = _Quietly(
            section.host,
            section.port,
            identifier=name,
            username=section.user or None,
            password=_password(section, beside),
            will=aiomqtt.Will(*will, qos=1, retain=True),
            tls_params=tls,
            timeout=ANSWER_S,
            keepalive=ALIVE_S,
            logger=_QUIET,
        )
    except (OSError, ValueError) as error:
        raise ConfigError("E-MQTT-FILE", where, why=str(error)) from error

    try:
        client.look()
        await client.__aenter__()
    except (aiomqtt.MqttError, OSError) as error:
        raise LinkBroken("E-MQTT-AWAY", where, why=str(error)) from error
    client.look()
    gone = asyncio.create_task(_gone(client))

    async def publish(topic: str, payload: bytes, *, stays: bool) -> None:
        try:
            await _unless(gone, client.publish(topic, payload, qos=1, retain=stays))
        except (aiomqtt.MqttError, OSError) as error:
            raise LinkBroken("E-MQTT-AWAY", where, why=str(error)) from error

    try:
        yield publish
    finally:
        gone.cancel()
        with contextlib.suppress(aiomqtt.MqttError, OSError):  # it was gone before
            await client.__aexit__(None, None, None)
        await asyncio.gather(gone, return_exceptions=True)


class _Quietly(aiomqtt.Client):
    """The library's client without its two complaints about a connection that breaks.

    Both touch what is the library's own: with a version that has it otherwise the complaints are back, nothing else.
    """

    def look(self) -> None:
        """Why a connection ended stays in a future that may be thrown away unread, of which asyncio complains.

        A new one is made while it connects, so this is called before and after.
        """
        ended: asyncio.Future[None] | None = getattr(self, "_disconnected", None)
        if ended is not None:
            ended.add_done_callback(lambda known: known.cancelled() or known.exception())

    def _on_socket_register_write(self, client: Any, _userdata: Any, sock: Any) -> None:
        """Ask for the moment to write, unless the socket was closed since: its number may be another's by then."""

        def write() -> None:
            try:
                client.loop_write()
            except (OSError, ValueError) as error:
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def begin() -> None:
            if sock.fileno() > -1:
                self._loop.add_writer(sock.fileno(), write)

        self._loop.call_soon_threadsafe(begin)


async def _gone(client: aiomqtt.Client) -> None:
    """Ends with MqttError when the connection does. Nothing was subscribed to, so no message comes."""
    async for _message in client.messages:
        pass


async def _unless(gone: asyncio.Task[None], sending: Coroutine[Any, Any, None]) -> None:
    """Wait for the confirmation, or for the end of the connection: the library alone would wait for its time-out."""
    sent = asyncio.ensure_future(sending)
    try:
        await asyncio.wait((sent, gone), return_when=asyncio.FIRST_COMPLETED)
        await (sent if sent.done() else gone)
    finally:
        sent.cancel()
        await asyncio.gather(sent, return_exceptions=True)


async def _reached(section: MqttSection, where: str, clock: Clock) -> None:
    """The library waits for a connection in a thread, which holds up the end of the program: look before."""
    try:
        async with clock.deadline(ANSWER_S, where):
            _reader, writer = await asyncio.open_connection(section.host, section.port)
            writer.close()
    except OSError as error:
        raise LinkBroken("E-MQTT-AWAY", where, why=error.strerror or str(error)) from error


def _password(section: MqttSection, beside: Path) -> str | None:
    if section.password_env:
        return os.environ.get(section.password_env, "")
    if section.password_file is None:
        return None
    try:
        return read_own(beside / section.password_file).decode("utf-8").strip("\r\n")
    except (OSError, ValueError) as error:
        raise ConfigError("E-MQTT-FILE", str(section.password_file), why=type(error).__name__) from error
