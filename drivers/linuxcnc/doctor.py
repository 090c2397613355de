"""The doctor of the LinuxCNC driver and the survey for a site file: both only read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from drivers.checks import (
    FINGERPRINT,
    CheckLine,
    ControlAxis,
    ControlFacts,
    Wanted,
    failed,
    fine,
    identity_lines,
    unknown,
    wrong,
)
from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.exchange.linuxcnc import MOST_ROWS
from drivers.linuxcnc.loading import live_set_of, machine_of, unit_of
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire

# Doctor.

SEEN = ("2.9",)
"""Versions of which the rows of docs/controls.md were seen."""
_CHECKS = {"E-LCNC-DOWN": "kernel", "E-LCNC-KINS": "kinematics", "E-LCNC-PIN": "HAL pins", "E-LCNC-MARKER": "marker"}


class LinuxCncDoctor:
    """Settings as the controller's; every question is a read."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._settings = LinuxCncSettings.read(settings, name)
        self._wire = AgentWire(url, self._settings, clock, name)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """Every line in the order of the road. Where the road ends, the last line says what could not be asked."""
        plain = self._settings.unprotected(self._url)
        lines = [wrong("W-LCNC-UNPROTECTED", "protection")] if plain else []
        try:
            await self._wire.open(timeout_s)
            lines.append(fine("W-LCNC-AGENT", "agent", host=urlsplit(self._url).netloc))
            lines += await self._kernel(wanted)
        except TrueflankError as error:
            lines += [failed(error, _CHECKS.get(error.code, "agent")), unknown("W-DOC-NOT-REACHED", "rest")]
        finally:
            await self._wire.close()
        return tuple(lines)

    async def _kernel(self, wanted: Wanted) -> list[CheckLine]:
        said = await self._wire.read("identify")
        lines = [fine("W-LCNC-KERNEL", "kernel", version=said["version"], ini=said["ini"])]
        if not said["version"].startswith(SEEN):
            lines.append(unknown("W-LCNC-VERSION", "kernel", version=said["version"], seen=", ".join(SEEN)))
        lines += identity_lines(machine_of(said), wanted, FINGERPRINT)
        joints = {joint["letter"]: joint for joint in said["joints"]}
        for axis in wanted.axes:
            lines += await self._axis(axis.name, axis.points, joints)
        if (await self._wire.read("state"))["emergency"]:
            lines.append(unknown("W-LCNC-EMERGENCY", "emergency stop"))
        return lines + await self._host([one.name for one in wanted.axes if joints.get(one.name, {}).get("file")])

    async def _host(self, axes: list[str]) -> list[CheckLine]:
        """Pins of the hand-shake, and what the agent's user may do with the files."""
        inputs = [self._settings.go_input, self._settings.leave_input]
        outputs = [self._settings.count_output, self._settings.echo_output]
        said = await self._wire.read("look", axes=axes, **{"in": inputs, "out": outputs})
        pins = [wrong("E-LCNC-PIN", "HAL pins", **one) for one in said["pins"]]
        rights = [wrong("E-LCNC-FILE", "rights", **one) for one in said["rights"]]
        pins = pins or [fine("W-LCNC-PINS", "HAL pins", inputs=_listed(inputs), outputs=_listed(outputs))]
        return [*pins, *(rights or [fine("W-LCNC-RIGHTS", "rights")])]

    async def _axis(self, letter: str, points: int, joints: Mapping[str, Any]) -> list[CheckLine]:
        if letter not in joints:
            return [wrong("E-LCNC-AXIS", f"axis {letter}", axis=letter, known=" ".join(joints))]
        joint, check = joints[letter], f"joint {joints[letter]['joint']}"
        told = {"axis": letter, "joint": joint["joint"]}
        lines = [] if joint["homed"] else [unknown("W-LCNC-NOT-HOMED", check, **told)]
        if not joint["file"]:
            return [*lines, wrong("E-LCNC-NO-FILE", check, joint=joint["joint"])]
        if points > MOST_ROWS:
            given = {"needed": points, "reserved": MOST_ROWS, "memory": "COMP_FILE"}
            return [*lines, wrong("E-COMP-POINTS", check, **given)]
        try:
            live = live_set_of((await self._wire.read("tables", axis=letter))["acting"], joint, joint["file"])
        except TrueflankError as error:
            return [*lines, failed(error, check)]
        rows = len(live.own.table.deviations) if live.own.enabled else 0
        return [*lines, fine("W-LCNC-FILE", check, **told, unit=unit_of(joint), file=joint["file"], rows=rows)]


def _listed(pins: list[int]) -> str:
    return ", ".join(f"{pin:02}" for pin in pins)


# Survey.


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
