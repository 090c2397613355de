"""What every question needs: the open session, what the site wants, and what was learnt on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from drivers.checks import Wanted, WantedAxis
from drivers.clock import Clock
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.settings import UaSettings


@dataclass(slots=True)
class Bedside:
    """What the questions need; ``rights``, ``version`` and ``configuration`` are learnt on the way: None at first."""

    session: UaSession
    reader: MachineReader
    settings: UaSettings
    wanted: Wanted
    clock: Clock
    timeout_s: float
    where: str
    rights: frozenset[str] | None = None
    version: tuple[int, int] | None = None
    configuration: Configuration | None = None
    memories: list[tuple[WantedAxis, Memory]] = field(default_factory=list)

    async def value(self, path: str) -> Any:
        """A value, None when it cannot be read."""
        (found,) = await self.session.read([path], self.timeout_s)
        return None if found.status else found.value

    async def datum(self, name: str) -> Any:
        """A machine datum by its NC name, None when it cannot be read."""
        names = self.configuration.places if self.configuration else ()
        path = nodes.to_path(name, names, self.settings.channel)
        return None if path is None else await self.value(path)
