"""The operator's workplace: the PLC's panel with lamp, button and switches, and the work on the table."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence

import numpy as np

from drivers.clock import Clock
from simulators.cellfile import CellFile
from simulators.grinding import Grinder, WorkPiece
from simulators.modbus import PlcStation
from simulators.optics import OpticsBench


class MailboxPanel:
    """Lamps and buttons of one PLC."""

    def __init__(self, station: PlcStation) -> None:
        self._station = station
        self._plc = station.plc

    @property
    def lamp(self) -> bool:
        """Whether the PLC waits for the local confirm."""
        return self._plc.waiting

    def confirm(self) -> bool:
        """The confirm button; False when nothing waited for it."""
        return self._plc.confirm()

    @property
    def release_wanted(self) -> bool | None:
        """True: a session is open and no release counts in it; False: the release stayed on after it; else None."""
        if self._plc.session:
            return None if self._plc.release.counts else True
        return False if self._plc.release.on else None

    def set_release(self, *, given: bool) -> None:
        """The release switch, off and on again where it was left on."""
        if given:
            self._plc.release.give()
        else:
            self._plc.release.set(False)

    @property
    def tables_loaded(self) -> int:
        """How many tables have gone into the control through the PLC so far."""
        return self._plc.loads_done

    @property
    def acts_from(self) -> str:
        """When changed tables act, as people know it of this control: newconf, nck_reset or power_on."""
        return self._plc.nck.spec.acts_from

    async def power_cycle(self) -> None:
        """The main switch, off and on: PLC and NCK."""
        await self._station.power_cycle()


LOOK_S = 20.0


class ShopFloor:
    """Looks at the machine from time to time while a part is clamped; nothing to do when none is."""

    def __init__(
        self, file: CellFile, bench: OpticsBench, clock: Clock, dressed_mm: Callable[[], float] = lambda: 0.0
    ) -> None:
        """``dressed_mm`` tells the offset that a dressing program takes now."""
        self._clock = clock
        self._grinder = Grinder(bench, file.part, file.wheel, dressed_mm) if file.part is not None else None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to look."""
        if self._grinder is not None:
            self._task = asyncio.get_running_loop().create_task(self._look(self._grinder), name="shopfloor")

    async def stop(self) -> None:
        """Look no more."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _look(self, grinder: Grinder) -> None:
        while True:
            await self._clock.sleep(LOOK_S)
            grinder.follow(self._clock.now())

    def load(self) -> bool:
        """Clamp a new blank, taking off what is there; False when the cell has no part to make."""
        if self._grinder is not None:
            self._grinder.load(self._clock.now())
        return self._grinder is not None

    def unload(self) -> bool:
        """Take the part off; False when nothing was clamped."""
        return self._grinder is not None and self._grinder.unload(self._clock.now()) is not None

    def change_wheel(self, number: int) -> bool:
        """Put on the roughing (1) or the finishing wheel (2); False when the cell has no part to make."""
        if self._grinder is not None:
            self._grinder.change_wheel(self._clock.now(), roughing=number == 1)
        return self._grinder is not None

    def give_dresser(self, axial_mm: Sequence[float], correction_um: Sequence[float]) -> bool:
        """A person types a correction of the profile into the dresser; it acts from the next blank's dressing on.

        False when the cell has no part to make. Raises ValueError for a table that the dresser does not take.
        """
        if self._grinder is not None:
            self._grinder.dresser.give(np.asarray(axial_mm, dtype=float), np.asarray(correction_um, dtype=float))
        return self._grinder is not None

    def put(self, work: WorkPiece, number: int = 0) -> None:
        """A part that was ground without this control, to be inspected next; for judges and tests."""
        if self._grinder is not None:
            self._grinder.put(work, self._clock.now(), number)

    def take_to_inspection(self) -> WorkPiece | None:
        """The part that was ground last, carried over to be inspected; None before the first."""
        self.unload()
        return self.ground

    @property
    def clamped(self) -> WorkPiece | None:
        """What is on the table now, as it is by now."""
        if self._grinder is not None:
            self._grinder.follow(self._clock.now(), whole=True)
        return self._grinder.work if self._grinder is not None else None

    @property
    def ground(self) -> WorkPiece | None:
        """The part that was ground last, on the table or off it; None before the first."""
        return self._grinder.latest(self._clock.now()) if self._grinder is not None else None
