"""Executes a program block by block on the machine, in the clock's time.

Strictly in sequence: every block has taken effect before the next begins, as if each were preceded by
STOPRE. On the control R parameters run ahead of motion unless STOPRE stands between; programs should write
it, the double does not punish its absence.
"""

from __future__ import annotations

import asyncio

from simulators.nck.block import Deed
from simulators.nck.core import Core
from simulators.nck.names import Names, Panel
from simulators.nck.scope import Frame
from simulators.nck.statements import Step, prepared
from simulators.nck.syntax import Define, Extern, Proc
from simulators.nck.variables import Variables

SLICE_S = 0.02
_EPS_S = 1e-9


class PowerCut(Exception):
    """The mains fail at this block."""


class Interpreter(Names):
    """One run of a program, with its subprograms."""

    def __init__(self, core: Core, variables: Variables, panel: Panel, path: str) -> None:
        super().__init__(core, variables, panel, path)
        self._clock = core.clock
        self._due_s = 0.0
        self._sleeper: asyncio.Task[None] | None = None
        self._resumed = asyncio.Event()
        self.stop_requested = False
        self.stopped = False

    # -- for the panel -----------------------------------------------------------------------------

    @property
    def line(self) -> int:
        """Source line under execution, from 1."""
        return self._line + 1

    @property
    def program(self) -> str:
        """Name of the program under execution."""
        return self._frames[-1].name if self._frames else ""

    @property
    def paths(self) -> list[str]:
        """Programs under execution, outermost first."""
        return [frame.path for frame in self._frames]

    def stop(self) -> None:
        """NC stop: at once, also in mid-motion."""
        self.stop_requested = True
        if self._sleeper is not None:
            self._sleeper.cancel()

    def resume(self) -> None:
        """NC start after a stop."""
        self.stop_requested = False
        self.stopped = False
        self._resumed.set()

    # -- execution ---------------------------------------------------------------------------------

    async def execute(self) -> None:
        """Run to the end. Raises NckRefusal or NcSyntaxError where the program stops with an alarm."""
        while self._frames:
            frame = self._frames[-1]
            if frame.pc >= len(frame.program.lines):
                self._return()
                continue
            self._line = frame.pc
            frame.pc += 1
            source = frame.program.lines[self._line]
            if not source.text or (source.skippable and self._panel.skips()):
                continue
            deed = self._step(frame, self._line)(self)
            if self._panel.cut_here():
                raise PowerCut
            if deed is not None:
                await self._do(deed)
            await self._pass_block()

    def _step(self, frame: Frame, line: int) -> Step:
        steps = self._steps[frame.path]
        found = steps.get(line)
        if found is None:
            block = frame.program.block(line)
            partner = frame.program.partner.get(line)
            head = frame.program.block(partner) if partner is not None and partner < line else None
            found = steps[line] = prepared(block, head)
        frame.begun = frame.begun or not self._is_declaring(frame, line)
        return found

    @staticmethod
    def _is_declaring(frame: Frame, line: int) -> bool:
        return isinstance(frame.program.block(line), Define | Proc | Extern)

    async def _do(self, deed: Deed) -> None:
        if deed.targets:
            await self._settle_debt()
            await self._travel(deed)
        if deed.dwell_s > 0.0:
            await self._settle_debt()
            await self._dwell(deed.dwell_s)
        if deed.ending == "M0" or (deed.ending == "M1" and self._panel.stops_at_m1()):
            await self._settle_debt()
            self.stopped = True
            await self._hold()
        elif deed.ending == "M30":
            self._frames.clear()
        elif deed.ending == "M17":
            self._return()

    async def _travel(self, deed: Deed) -> None:
        while True:
            seconds = self._core.move(deed.targets, deed.rate)
            if await self._wait_until(self._clock.now() + seconds):
                break
            self._core.halt()
            await self._hold()
        if deed.window is not None:
            now = self._clock.now()
            axes = (self._core.axes[index] for index in deed.targets)
            settling = max(axis.settling_s(now, deed.window) for axis in axes)
            await self._wait_through(now + settling)

    async def _dwell(self, seconds: float) -> None:
        await self._wait_through(self._clock.now() + seconds)

    async def _wait_through(self, time_s: float) -> None:
        while True:
            left = time_s - self._clock.now()
            if await self._wait_until(time_s):
                return
            left = max(time_s - self._clock.now(), 0.0) if left > 0.0 else 0.0
            await self._hold()
            time_s = self._clock.now() + left

    async def _wait_until(self, time_s: float) -> bool:
        """Wait; False as soon as a stop was asked for before that time."""
        while (left := time_s - self._clock.now()) > _EPS_S:
            if self.stop_requested:
                return False
            self._sleeper = asyncio.ensure_future(self._clock.sleep(left))
            try:
                await asyncio.wait({self._sleeper})
            finally:
                self._sleeper.cancel()
                self._sleeper = None
        return True

    async def _pass_block(self) -> None:
        self._due_s += self._core.spec.block_time_s
        if self._due_s >= SLICE_S:
            await self._settle_debt()
        if self.stop_requested:
            await self._hold()

    async def _settle_debt(self) -> None:
        due, self._due_s = self._due_s, 0.0
        if due > 0.0:
            await self._clock.sleep(due)

    async def _hold(self) -> None:
        self.stopped = True
        self._resumed.clear()
        await self._resumed.wait()
