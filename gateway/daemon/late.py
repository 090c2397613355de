"""Devices whose drivers are loaded beside the page: a start must show soon what pushes left."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from drivers.leftover import NOTHING, LeftOver
from drivers.types.machine import MachineState
from gateway.daemon.desk import Devices
from gateway.views import SeenDevice

D = TypeVar("D", bound=Devices)
_ONE_AT_A_TIME = threading.Lock()
"""Sites that begin together load the same modules."""


class LateDevices(Generic[D]):
    """A `gateway.daemon.desk.Devices` that is made in a thread when it is opened first, and then stays.

    ``shown`` is the picture until then: every device of the site, closed.
    """

    def __init__(self, make: Callable[[], D], shown: Sequence[SeenDevice]) -> None:
        self._make = make
        self._shown = tuple(shown)
        self._coming: asyncio.Future[D] | None = None
        self.made: D | None = None
        """The devices themselves; None before they were made."""

    async def open_all(self) -> object:
        """Make them, then open every one. Raises what making and opening raise."""
        if self._coming is None:
            self._coming = asyncio.ensure_future(asyncio.to_thread(self._loaded))
        # Whoever cancels this does not stop the thread: the next opening takes what it made.
        self.made = await asyncio.shield(self._coming)
        return await self.made.open_all()

    def _loaded(self) -> D:
        with _ONE_AT_A_TIME:
            return self._make()

    def picture(self) -> Sequence[SeenDevice]:
        """All devices as they are now."""
        return self._shown if self.made is None else self.made.picture()

    @property
    def left(self) -> LeftOver:
        """What an earlier gateway left in the control, as seen last."""
        return NOTHING if self.made is None else self.made.left

    @property
    def seen(self) -> MachineState | None:
        """The control's state at the last look."""
        return None if self.made is None else self.made.seen

    async def watch(self, stop: asyncio.Event) -> None:
        """Look after the devices until `stop`."""
        if self.made is not None:
            await self.made.watch(stop)
        else:
            await stop.wait()

    async def close_all(self) -> None:
        """Close every device."""
        if self.made is not None:
            await self.made.close_all()
