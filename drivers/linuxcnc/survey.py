"""What a LinuxCNC host tells for a site file: its joints with a COMP_FILE, their letters and limits; reads only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.checks import ControlAxis, ControlFacts
from drivers.clock import Clock
from drivers.exchange.linuxcnc import MOST_ROWS
from drivers.linuxcnc.screw import machine_of, unit_of
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire


class LinuxCncSurvey:
    """Settings as the controller's (implements ports.Survey)."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self._wire = AgentWire(url, LinuxCncSettings.read(settings, name), clock, name)

    async def survey(self, timeout_s: float) -> ControlFacts:
        """Machine, version and every joint that a screw file corrects; mm or deg. Raises as `AgentWire.open`."""
        try:
            await self._wire.open(timeout_s)
            said = await self._wire.read("identify")
        finally:
            await self._wire.close()
        axes = tuple(_axis(joint) for joint in said["joints"] if joint["file"])
        machine = machine_of(said)
        return ControlFacts(machine.serial, machine.version, "metric", axes, identity=machine.facts)


def _axis(joint: Mapping[str, Any]) -> ControlAxis:
    travel = (float(joint["minimum"]), float(joint["maximum"]))
    return ControlAxis(joint["letter"], unit_of(joint), travel=travel, encoder=0, points=MOST_ROWS)
