"""The person who carries files to a control that no wire reaches, runs what the sheet names, and carries files back."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

from drivers.clock import Clock

POLL_S = 0.25
LOOKS_S = 5.0
_STEP = re.compile(r"^step = (\d+)$", re.MULTILINE)
_RESTART = "NCK reset"
NOTHING_DONE = "NOTHING WAS DONE"


class Porter:
    """Works at one control double by its panel and its files; sees of the gateway the folder alone."""

    def __init__(self, nck: Any, clock: Clock, folder: Path) -> None:
        self._nck = nck
        self._clock = clock
        self._folder = folder
        self._task: asyncio.Task[None] | None = None
        self.read: list[str] = []

    def start(self) -> None:
        """From now on go whenever there is a new sheet."""
        self._task = asyncio.get_running_loop().create_task(self._works())

    async def stop(self) -> None:
        """Go home."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _works(self) -> None:
        """For ever: each sheet once, by the number in its form, some time after it was laid out."""
        done: set[str] = set()
        while True:
            await self._clock.sleep(LOOKS_S)
            form = self._folder / "carry" / "SEEN.toml"
            sheet = self._folder / "carry" / "SHEET.txt"
            text = form.read_text(encoding="utf-8") if form.exists() and sheet.exists() else ""
            if text and text not in done:
                done.add(text)
                await self._clock.sleep(LOOKS_S)
                await self.goes()

    async def goes(self, *, only: str = "") -> None:
        """Everything that the sheet asks for; ``only`` another program than the sheet's."""
        folder = self._folder
        carry = folder / "carry"
        sheet = (carry / "SHEET.txt").read_text(encoding="utf-8")
        if _RESTART in sheet:
            await self.restarts()
        self.puts(carry)
        program = only or sheet.partition("\n")[0].rpartition(": ")[2].strip()
        await self.runs(program)
        self.brings()

    def puts(self, carry: Path) -> None:
        """Every program on the stick into the part programs."""
        for path in carry.glob("*.MPF"):
            self._nck.files.write(f"/_N_MPF_DIR/_N_{path.stem}_MPF", path.read_bytes())

    async def runs(self, program: str) -> None:
        """Select it, NC START, and on at every M0 until its end."""
        nck = self._nck
        if nck.channel_status != 0:
            nck.channel_reset()
        if nck.select(f"/_N_MPF_DIR/_N_{program.replace('.', '_')}") != 0:
            raise LookupError(program)
        nck.set_mode("AUTO")
        nck.nc_start()
        await self._clock.sleep(POLL_S)
        while nck.channel_status != 0 and not nck.alarms:
            if nck.channel_status == 2:
                self.read.append(nck.message)
                nck.nc_start()
            await self._clock.sleep(POLL_S)

    async def restarts(self) -> None:
        """NCK reset, then every axis to its reference."""
        self._nck.nck_reset()
        await self.ready()

    async def ready(self) -> None:
        """Wait for the control, reference what is not, choose AUTO."""
        nck = self._nck
        while nck.booting:
            await self._clock.sleep(0.5)
        names = [axis.name for axis in nck.spec.axes]
        for name in names:
            if not nck.axis_state(name).referenced:
                nck.reference_axis(name)
        while not all(nck.axis_state(name).referenced for name in names):
            await self._clock.sleep(POLL_S)
        nck.set_mode("AUTO")

    def brings(self) -> None:
        """Every file of the subprograms, and the form filled in as the screen shows it."""
        folder = self._folder
        back = folder / "back"
        for name in self._nck.files.list("/_N_SPF_DIR"):
            stem, _, ending = name.removeprefix("_N_").rpartition("_")
            (back / f"{stem}.{ending}").write_bytes(self._nck.files.read(f"/_N_SPF_DIR/{name}"))
        form = (folder / "carry" / "SEEN.toml").read_text(encoding="utf-8")
        step = _STEP.search(form)
        alarms = ", ".join(str(alarm.number) for alarm in self._nck.alarms)
        level = self._nck.core.access_level
        text = f"step = {step[1] if step else 0}\nalarms = [{alarms}]\naccess_level = {level}\n"
        (back / "SEEN.toml").write_text(text, encoding="utf-8")
