"""What a control behind OPC UA tells of itself for a site file: axes, soft limits, encoders, room for tables; reads."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from drivers.checks import ControlAxis, ControlFacts
from drivers.clock import Clock
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.secrets import secrets_of
from drivers.sinumerik.opcua.settings import UaSettings

LIMITS = ("$MA_POS_LIMIT_MINUS", "$MA_POS_LIMIT_PLUS")
"""MD36100 and MD36110, the first soft limits."""
# A limit beyond this is the control's way to say that there is none.
FARTHEST = 1e6


class UaSurvey:
    """Settings as the controller's; every question is a read."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._settings = UaSettings.read(settings, name)
        self._session = UaSession(url, clock, name)

    async def survey(self, timeout_s: float) -> ControlFacts:
        """Log in, read, log out. Raises ConfigError, TransportError, DeviceError, ProtocolError as the login does."""
        secrets = await asyncio.to_thread(secrets_of, self._settings, self.name)
        await self._session.open(secrets, timeout_s)
        try:
            reader = MachineReader(self._session, self._settings, self.name)
            reader.timeout_s = timeout_s
            return await self._read(reader)
        finally:
            await self._session.close()

    async def _read(self, reader: MachineReader) -> ControlFacts:
        configuration = await reader.configuration()
        machine = await reader.identity(configuration.names)
        axes = [await self._axis(reader, configuration, name) for name in configuration.names]
        return ControlFacts(machine.serial, machine.version, machine.unit_system, tuple(axes), identity=machine.facts)

    async def _axis(self, reader: MachineReader, configuration: Configuration, name: str) -> ControlAxis:
        rotary = configuration.is_rotary(name)
        encoders = await reader.encoders(configuration, name)
        acting = encoders.acting[0] if len(encoders.acting) == 1 else None
        low, high = [await reader.figure(f"{limit}[{name}]", configuration) for limit in LIMITS]
        known = low is not None and high is not None and -FARTHEST < low < high < FARTHEST
        return ControlAxis(
            name=name,
            unit="deg" if rotary else "mm",
            modulo=configuration.is_modulo(name, rotary=rotary),
            travel=(low, high) if known and low is not None and high is not None else None,
            encoder=acting,
            points=encoders.reserved[acting] if acting is not None else None,
        )
