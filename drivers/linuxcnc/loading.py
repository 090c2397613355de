"""Screw files into the kernel's host: staged, read back, taken over by one rename, at work after a person's restart."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError
from drivers.linuxcnc.screw import EMPTY, live_of, off_text, text_of
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
        return live_of(said["acting"], said["joint"], axis)

    async def standing(self, axis: str) -> LiveSet:
        """What the next start reads: off as long as the kernel that runs read another file. Raises as `acting`."""
        said = await self._wire.read("tables", axis=axis)
        waits = _waits(said)
        found = live_of(said["standing"], said["joint"], axis, enabled=not waits)
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
            text_of(order.table, said["joint"])
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
        new = live_of(found, joint, "read-back", enabled=False)
        return ReadBack(await self._before(order, joint), new, agreed=found == sent)

    async def backup(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch. Raises DeviceRefused (E-LCNC-KEPT)."""
        return tuple([await self._before(order, (await self._said(order))["joint"]) for order in batch])

    async def _before(self, order: PushOrder, joint: Mapping[str, Any]) -> LiveSet:
        said = await self._wire.read("before", transaction=order.transaction, joint=joint["joint"])
        return live_of(said, joint, "back-up")

    async def take_over(self, passed: PushBatch) -> None:
        """The staged files take the old ones' place; an order that does not enable leaves one that corrects nothing."""
        digests: dict[str, str] = {}
        for order in passed:
            said = await self._said(order)
            joint, text = said["joint"], _staged(order, said)
            if not order.enable and order.purpose != "restore":
                text = off_text(joint)
                await self._wire.write("put", transaction=order.transaction, joint=joint["joint"], text=text)
            digests[str(joint["joint"])] = hashlib.sha256(text.encode()).hexdigest()
        await self._wire.write("commit", transaction=passed[0].transaction, digests=digests)

    async def clear(self, axis: str) -> None:
        """A file that corrects nothing in the place of the axis' own; acts after the restart."""
        joint = (await self._wire.read("tables", axis=axis))["joint"]
        await self._wire.write("clear", joint=joint["joint"], text=off_text(joint))

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
    acts, stands = (live_of(said[name], said["joint"], "file") for name in ("acting", "standing"))
    return acts.digest != stands.digest


def _staged(order: PushOrder, said: Mapping[str, Any]) -> str:
    """The file of an order. What acts, or stands, goes back as it was written, BACKLASH alone without any row."""
    joint = said["joint"]
    if order.purpose == "restore":
        wanted = (order.table, order.enable)
        for text in (said["acting"], said["standing"], EMPTY):
            found = live_of(text, joint, "file").own
            if (found.table, found.enabled) == wanted:
                return str(text)
        if not order.enable:
            return off_text(joint)
    return off_text(joint) if len(order.table.deviations) < 2 else text_of(order.table, joint)
