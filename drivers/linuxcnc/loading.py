"""Screw files: a joint's rows <-> a table of deviations; staged on the host, read back, taken over by one rename.

Where a file has no row, BACKLASH of the INI file acts in its place: half of it in each direction. LinuxCNC reads the
files once, when it starts, so a loaded table acts after a person's restart.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TableError, TooManyPoints, TransportError
from drivers.exchange.linuxcnc import MOST_ROWS, LinuxCncScrew
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire
from drivers.types.abilities import Marker
from drivers.types.exchange import ReadAs
from drivers.types.identity import MachineIdentity
from drivers.types.orders import PushBatch, PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet, LiveTable, reversal_of
from drivers.units import AxisUnit, deviation_scale

# Files and tables.

EMPTY = "# no compensation\n"
FORMS = {0: "positions", 1: "trims"}
_EVEN = 1e-7


def machine_of(said: Mapping[str, Any]) -> MachineIdentity:
    """The fingerprint from an agent's answer: names of the INI file and of the host, version, letters of all joints."""
    letters = tuple(joint["letter"] for joint in said["joints"])
    return MachineIdentity(f"{said['machine']}-{said['name']}", said["version"], letters)


def unit_of(joint: Mapping[str, Any]) -> AxisUnit:
    """Unit of a joint as the agent describes it."""
    return "deg" if joint["rotary"] else "mm"


def screw_text(table: CompensationTable, joint: Mapping[str, Any]) -> str:
    """The file of a table, in the form that COMP_FILE_TYPE says.

    Raises TableError (E-LCNC-TABLE), TooManyPoints (E-COMP-POINTS): the kernel would cut the rest and run on.
    """
    if table.kind != "axis" or table.input_axis != table.output_axis:
        raise TableError("E-LCNC-TABLE", table.name, axis=table.output_axis)
    count = len(table.deviations)
    if count > MOST_ROWS:
        raise TooManyPoints("E-COMP-POINTS", table.name, needed=count, reserved=MOST_ROWS, memory="COMP_FILE")
    return LinuxCncScrew().text((table,), FORMS[joint["type"]], ())


def screw_text_off(joint: Mapping[str, Any]) -> str:
    """The file that corrects nothing. Without rows BACKLASH acts, so where there is one it has two rows of no trim."""
    if not joint["backlash"]:
        return EMPTY
    ends = (joint["minimum"], joint["maximum"])
    rows = [f"{end:.6f} {end:.6f} {end:.6f}" if joint["type"] == 0 else f"{end:.6f} 0 0" for end in ends]
    return "\n".join(rows) + f"\n{EMPTY}"


def _is_off(text: str) -> bool:
    """Whether it is a file of `screw_text_off`: what its rows hold is for the kernel, and no table."""
    return text.endswith(EMPTY)


def _has_rows(text: str) -> bool:
    return bool(text.strip()) and not text.lstrip().startswith("#")


def _own(text: str, joint: Mapping[str, Any], where: str) -> LiveTable:
    letter, unit = joint["letter"], unit_of(joint)
    if _has_rows(text) and not _is_off(text):
        (table,) = LinuxCncScrew().read(text, where, ReadAs(letter, unit, FORMS[joint["type"]]))
        return LiveTable(_with_equal_steps(table), enabled=True)
    half = 0.0 if _is_off(text) and text != EMPTY else joint["backlash"] / 2.0 * deviation_scale(unit)
    nothing = replace(reversal_of(letter, unit, 0.0), kind="axis")
    if not half:
        return LiveTable(nothing, enabled=False)
    low, high = joint["minimum"], joint["maximum"]
    both = replace(nothing, minimum=low, maximum=high, step=high - low, deviations=(-half, -half), reverse=(half, half))
    return LiveTable(both, enabled=True)


def _with_equal_steps(table: CompensationTable) -> CompensationTable:
    """Points of equal step are said as such, as those who work with tables ask for them."""
    step = (table.maximum - table.minimum) / (len(table.places) - 1)
    even = table.minimum + step * np.arange(len(table.places))
    if np.abs(even - table.positions).max() > _EVEN:
        return table
    return replace(table, step=round(step, 9), places=())


def live_set_of(text: str, joint: Mapping[str, Any], where: str, *, enabled: bool = True) -> LiveSet:
    """What a file makes the kernel do. Raises FileFormatError (E-EXCHANGE-...) with the line."""
    own = _own(text, joint, where)
    told = f"{joint['type']} {joint['backlash']!r}\n{text if _has_rows(text) else ''}"
    digest = hashlib.sha256(told.encode()).hexdigest()
    own = LiveTable(own.table, own.enabled and enabled)
    return LiveSet(joint["letter"], own, (), backlash=0.0, native=text, digest=digest)


# Loading.

_STATES = ("none", "in-progress", "committed", "held")


class ScrewLoading:
    """The talk about one batch. ``restarted`` waits for a person; everything else answers at once."""

    def __init__(self, wire: AgentWire, settings: LinuxCncSettings, clock: Clock, where: str) -> None:
        self._wire, self._settings, self._clock, self._where = wire, settings, clock, where

    async def marker(self) -> Marker:
        """What the host keeps of the last push. Raises DeviceRefused (E-LCNC-MARKER)."""
        said = await self._wire.read("marker")
        if said["state"] not in _STATES:
            raise DeviceRefused("E-LCNC-MARKER", self._where, file=said["state"])
        return Marker(said["transaction"], said["state"], said["head"])

    async def acting(self, axis: str) -> LiveSet:
        """What acts on an axis: the file that this life of the kernel read, and that the next one will read.

        Raises DeviceRefused (E-LCNC-EDITED; E-LCNC-PENDING: what acts now is not what a restart brings).
        """
        said = await self._wire.read("tables", axis=axis)
        if _waits(said):
            raise DeviceRefused("E-LCNC-PENDING", self._where, axis=axis)
        return live_set_of(said["acting"], said["joint"], axis)

    async def standing(self, axis: str) -> LiveSet:
        """What the next start reads: off as long as the kernel that runs read another file. Raises as `acting`."""
        said = await self._wire.read("tables", axis=axis)
        waits = _waits(said)
        found = live_set_of(said["standing"], said["joint"], axis, enabled=not waits)
        return replace(found, waits=waits)

    async def _said(self, order: PushOrder) -> Mapping[str, Any]:
        found: Mapping[str, Any] = await self._wire.read("tables", axis=order.table.output_axis)
        return found

    async def begin(self, batch: PushBatch) -> None:
        """Judge every order, then keep what stands and set the marker.

        Raises TableError, DeviceRefused (E-LCNC-PENDING: the last file does not act yet), nothing sent.
        """
        joints = []
        for order in batch:
            said = await self._said(order)
            screw_text(order.table, said["joint"])
            if not said["joint"]["file"]:
                raise DeviceRefused("E-LCNC-NO-FILE", self._where, joint=said["joint"]["joint"])
            if _waits(said) and order.purpose != "restore":
                raise DeviceRefused("E-LCNC-PENDING", self._where, axis=order.table.output_axis)
            joints.append(said["joint"]["joint"])
        await self._wire.write("begin", transaction=batch[0].transaction, head=batch[0].head, joints=joints)

    async def loaded(self, batch: PushBatch) -> tuple[ReadBack, ...]:
        """Old and new of each order, the new one staged beside the file and read back; what acts stays as it is."""
        return tuple([await self._load(order) for order in batch])

    async def _load(self, order: PushOrder) -> ReadBack:
        said = await self._said(order)
        joint, sent = said["joint"], _staged(order, said)
        told = {"transaction": order.transaction, "joint": joint["joint"]}
        found = await self._wire.write("put", **told, text=sent)
        new = live_set_of(found, joint, "read-back", enabled=False)
        return ReadBack(await self._before(order, joint), new, agreed=found == sent)

    async def backup(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch. Raises DeviceRefused (E-LCNC-KEPT)."""
        return tuple([await self._before(order, (await self._said(order))["joint"]) for order in batch])

    async def _before(self, order: PushOrder, joint: Mapping[str, Any]) -> LiveSet:
        said = await self._wire.read("before", transaction=order.transaction, joint=joint["joint"])
        return live_set_of(said, joint, "back-up")

    async def take_over(self, passed: PushBatch) -> None:
        """The staged files take the old ones' place; an order that does not enable leaves one that corrects nothing."""
        digests: dict[str, str] = {}
        for order in passed:
            said = await self._said(order)
            joint, text = said["joint"], _staged(order, said)
            if not order.enable and order.purpose != "restore":
                text = screw_text_off(joint)
                await self._wire.write("put", transaction=order.transaction, joint=joint["joint"], text=text)
            digests[str(joint["joint"])] = hashlib.sha256(text.encode()).hexdigest()
        await self._wire.write("commit", transaction=passed[0].transaction, digests=digests)

    async def clear(self, axis: str) -> None:
        """A file that corrects nothing in the place of the axis' own; acts after the restart."""
        joint = (await self._wire.read("tables", axis=axis))["joint"]
        await self._wire.write("clear", joint=joint["joint"], text=screw_text_off(joint))

    async def restarted(self, axes: Sequence[str], timeout_s: float) -> None:
        """The kernel that runs read the files that stand, and these axes are homed in it.

        Raises DeadlineExceeded (E-LCNC-RESTART), DeviceRefused (E-LCNC-EDITED).
        """
        end = self._clock.now() + timeout_s
        while not await self._at_work(axes):
            if self._clock.now() >= end:
                raise DeadlineExceeded("E-LCNC-RESTART", self._where, axes=", ".join(axes), timeout_s=timeout_s)
            await self._clock.sleep(self._settings.poll_s)

    async def _at_work(self, axes: Sequence[str]) -> bool:
        try:
            found = [await self._wire.read("tables", axis=axis) for axis in axes]
        except TransportError:  # it is stopping or starting
            return False
        return all(one["joint"]["homed"] and not _waits(one) for one in found)

    async def finish(self, batch: PushBatch, state: str) -> None:
        """The marker's last state."""
        await self._wire.write("finish", transaction=batch[0].transaction, state=state)


def _waits(said: Mapping[str, Any]) -> bool:
    """Whether the next start brings something else than what acts."""
    acts, stands = (live_set_of(said[name], said["joint"], "file") for name in ("acting", "standing"))
    return acts.digest != stands.digest


def _staged(order: PushOrder, said: Mapping[str, Any]) -> str:
    """The file of an order. What acts, or stands, goes back as it was written, BACKLASH alone without any row."""
    joint = said["joint"]
    if order.purpose == "restore":
        wanted = (order.table, order.enable)
        for text in (said["acting"], said["standing"], EMPTY):
            found = live_set_of(text, joint, "file").own
            if (found.table, found.enabled) == wanted:
                return str(text)
        if not order.enable:
            return screw_text_off(joint)
    return screw_text_off(joint) if len(order.table.deviations) < 2 else screw_text(order.table, joint)
