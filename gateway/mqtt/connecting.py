"""The one door to the library of MQTT: a connection that publishes, with its errors mapped."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Protocol

import aiomqtt

from drivers.clock import Clock
from drivers.errors import ConfigError, LinkBroken
from drivers.local.ownfiles import read_own
from gateway.config import MqttSection

ANSWER_S = 10.0
ALIVE_S = 30


class Publish(Protocol):
    """Publish one message; returns when the server has confirmed it. Raises LinkBroken (E-MQTT-AWAY)."""

    def __call__(self, topic: str, payload: bytes, *, stays: bool) -> Awaitable[None]: ...


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
        client = aiomqtt.Client(
            section.host,
            section.port,
            identifier=name,
            username=section.user or None,
            password=_password(section, beside),
            will=aiomqtt.Will(*will, qos=1, retain=True),
            tls_params=tls,
            timeout=ANSWER_S,
            keepalive=ALIVE_S,
        )
    except (OSError, ValueError) as error:
        raise ConfigError("E-MQTT-FILE", where, why=str(error)) from error

    async def publish(topic: str, payload: bytes, *, stays: bool) -> None:
        try:
            await client.publish(topic, payload, qos=1, retain=stays)
        except (aiomqtt.MqttError, OSError) as error:
            raise LinkBroken("E-MQTT-AWAY", where, why=str(error)) from error

    try:
        await client.__aenter__()
    except (aiomqtt.MqttError, OSError) as error:
        raise LinkBroken("E-MQTT-AWAY", where, why=str(error)) from error
    try:
        yield publish
    finally:
        with contextlib.suppress(aiomqtt.MqttError, OSError):  # it was gone before
            await client.__aexit__(None, None, None)


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
