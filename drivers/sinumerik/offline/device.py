"""The 840D without a wire, as a Controller: the road by OPC UA over a session that is carried."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.leftover import NOTHING, LeftOver
from drivers.sinumerik.offline.folder import StepFolder
from drivers.sinumerik.offline.report import ReportAsked
from drivers.sinumerik.offline.session import CarriedSession
from drivers.sinumerik.offline.settings import OfflineSettings
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile.held import HELD
from drivers.types.abilities import Capabilities
from drivers.types.identity import Identity
from drivers.types.orders import PushBatch


class SinumerikOffline(SinumerikOpcUa):
    """Driver "sinumerik-offline": settings in `drivers.sinumerik.offline.settings.OfflineSettings`."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        own = OfflineSettings.read(settings, name)
        road = UaSettings.read(own.road, name)
        asked = ReportAsked(own.names, own.cross_tables, road.words, own.r_marker)
        self._stick = Path(own.folder)
        self._carried = CarriedSession(StepFolder(self._stick, name), asked, road, clock=clock, where=name)
        super().__init__(name, url, own.road, clock, session=self._carried)

    @property
    def stick(self) -> Path:
        """As of `drivers.carried.Carried`."""
        return self._stick

    def is_waited_for(self) -> bool:
        """Whether an earlier piece of work waits for its files here."""
        return self._carried.under_way

    def conclude(self) -> None:
        """The piece of work has come to its end. Raises ConfigError (E-OFF-FOLDER)."""
        self._carried.conclude()

    async def open(self, timeout_s: float) -> Identity:
        """Read who the machine is from what was brought back last. Raises ToCarry where it was never seen."""
        found = await super().open(timeout_s)
        return replace(found, driver="sinumerik-offline")

    @property
    def capabilities(self) -> Capabilities:
        """As by OPC UA; no test part is ground, and nobody on a network can change what passes.

        No reversal: the proof of its sign comes from both sides, with an instrument that is read as the axis stands.
        """
        return replace(super().capabilities, tables=HELD, grinding=False, unprotected="")

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """The next program is run after the restart; where none proves what acts, one that only looks.

        Raises as `SinumerikOpcUa.restarted`, and ToCarry.
        """
        if not any(order.enable for order in passed):
            await self._carried.looked(f"restart {passed[0].transaction}", restart=True)
        await super().restarted(tuple(replace(order, enable=True) for order in passed), timeout_s)

    async def left_over(self) -> LeftOver:
        """Nothing that could be told: what waits for its files is no work of nobody."""
        return NOTHING if self.is_waited_for() else await super().left_over()
