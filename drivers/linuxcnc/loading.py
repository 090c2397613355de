"""Screw files into the kernel's host: staged, read back, taken over by one rename, at work after a person's restart."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError
from drivers.linuxcnc.screw import EMPTY, live_of, text_of
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire
from drivers.types.abilities import Marker
from drivers.types.orders import PushBatch, PushOrder, ReadBack
from drivers.types.tables import LiveSet

_STATES = ("none", "in-progress", "committed", "held")


class ScrewLoading:
    """The talk about one batch. ``restarted`` waits for a person; everything else answers at once."""

    def __init__(self, wire: AgentWire, settings: LinuxCncSettings, clock: Clock, where: str) -> None:
        self._wire, self._settings, self._clock, self._where = wire, settings, clock, where
        self._life = ""

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
        if said["acting"] != said["standing"]:
            raise DeviceRefused("E-LCNC-PENDING", self._where, axis=axis)
        return live_of(said["acting"], said["joint"], axis)

    async def _joint(self, axis: str) -> Mapping[str, Any]:
        found: Mapping[str, Any] = (await self._wire.read("tables", axis=axis))["joint"]
        return found

    async def begin(self, batch: PushBatch) -> None:
        """Judge every order, then keep what stands and set the marker.

        Raises TableError, DeviceRefused (E-LCNC-PENDING: the last file does not act yet), nothing sent.
        """
        joints = []
        for order in batch:
            said = await self._wire.read("tables", axis=order.table.output_axis)
            text_of(order.table, said["joint"])
            if not said["joint"]["file"]:
                raise DeviceRefused("E-LCNC-NO-FILE", self._where, joint=said["joint"]["joint"])
            if said["acting"] != said["standing"] and order.purpose != "restore":
                raise DeviceRefused("E-LCNC-PENDING", self._where, axis=order.table.output_axis)
            joints.append(said["joint"]["joint"])
        await self._wire.write("begin", transaction=batch[0].transaction, head=batch[0].head, joints=joints)

    async def loaded(self, batch: PushBatch) -> tuple[ReadBack, ...]:
        """Old and new of each order, the new one staged beside the file and read back; what acts stays as it is."""
        return tuple([await self._load(order) for order in batch])

    async def _load(self, order: PushOrder) -> ReadBack:
        joint = await self._joint(order.table.output_axis)
        sent = _staged(order, joint)
        told = {"transaction": order.transaction, "joint": joint["joint"]}
        found = await self._wire.write("put", **told, text=sent)
        new = live_of(found, joint, "read-back", enabled=False)
        return ReadBack(await self._before(order, joint), new, agreed=found == sent)

    async def backup(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch. Raises DeviceRefused (E-LCNC-KEPT)."""
        return tuple([await self._before(order, await self._joint(order.table.output_axis)) for order in batch])

    async def _before(self, order: PushOrder, joint: Mapping[str, Any]) -> LiveSet:
        said = await self._wire.read("before", transaction=order.transaction, joint=joint["joint"])
        return live_of(said, joint, "back-up")

    async def take_over(self, passed: PushBatch) -> None:
        """The staged files take the old ones' place; an order that does not enable leaves a file without rows."""
        digests: dict[str, str] = {}
        self._life = (await self._wire.read("hello"))["life"]
        for order in passed:
            joint = await self._joint(order.table.output_axis)
            text = _staged(order, joint) if order.enable else EMPTY
            if not order.enable:
                await self._wire.write("put", transaction=order.transaction, joint=joint["joint"], text=text)
            digests[str(joint["joint"])] = hashlib.sha256(text.encode()).hexdigest()
        await self._wire.write("commit", transaction=passed[0].transaction, digests=digests)

    async def clear(self, axis: str) -> None:
        """A file without rows in the place of the axis' own; acts after the restart."""
        joint = await self._joint(axis)
        self._life = (await self._wire.read("hello"))["life"]
        await self._wire.write("clear", joint=joint["joint"])

    async def restarted(self, axes: Sequence[str], timeout_s: float) -> None:
        """Another life of the kernel runs, and these axes are homed in it. Raises DeadlineExceeded (E-LCNC-RESTART)."""
        end = self._clock.now() + timeout_s
        while not await self._new_life(axes):
            if self._clock.now() >= end:
                raise DeadlineExceeded("E-LCNC-RESTART", self._where, axes=", ".join(axes), timeout_s=timeout_s)
            await self._clock.sleep(self._settings.poll_s)

    async def _new_life(self, axes: Sequence[str]) -> bool:
        try:
            life = (await self._wire.read("hello"))["life"]
            if life in ("", self._life):
                return False
            joints = (await self._wire.read("state"))["joints"]
        except TransportError:  # it is stopping or starting: only the new life can tell
            return False
        return all(joint["homed"] for joint in joints if joint["letter"] in axes)

    async def finish(self, batch: PushBatch, state: str) -> None:
        """The marker's last state."""
        await self._wire.write("finish", transaction=batch[0].transaction, state=state)


def _staged(order: PushOrder, joint: Mapping[str, Any]) -> str:
    """The file of an order; one point is no table: what was never loaded goes back as a file without rows."""
    return EMPTY if len(order.table.deviations) < 2 else text_of(order.table, joint)
