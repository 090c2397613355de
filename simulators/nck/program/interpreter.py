"""The interpreter and the main run: blocks are interpreted ahead of the machine, motion happens in time behind them.

Theory of operation. A control prepares blocks ahead of the motion. The interpreter executes block after block at once:
R parameters, machine data, tables, files and system variables are read and written when their block is interpreted.
Motion, dwell, messages and stops become `BlockAction`s in a queue of limited length, which the main run does one after
the other in time. STOPRE, NEWCONF and SETAL wait until the main run is `calm`, that is until everything programmed so
far has been done; so does a block that reads a system variable of the machine's state. NC stop and M0 hold the main
run; NC start lets it go on. A program that forgets STOPRE thus reads values of before the motion, as on the control.
"""

from __future__ import annotations

import asyncio
import re
from collections import deque
from typing import Protocol

from simulators.nck.language.syntax import BareWord, Define, Extern, NcSyntaxError, OrdinaryBlock, Proc, Procedure
from simulators.nck.machine.core import Core
from simulators.nck.program.block import BlockAction, Modal
from simulators.nck.program.names import ControlPort, DeclaringResolver
from simulators.nck.program.procedures import Frame
from simulators.nck.program.statements import Step, prepare_block
from simulators.nck.program.variables import Variables
from simulators.nck.spec import NckRefusal

_EPS_S = 1e-9


class MessageScreen(Protocol):
    """What the main run asks of the control."""

    def show(self, text: str) -> None:
        """Show a message of the part program."""
        ...

    def stops_at_m1(self) -> bool:
        """Whether the optional stop is on."""
        ...


class MainRun:
    """A queue of deeds with the source line each came from, and the task that does them."""

    def __init__(self, core: Core, screen: MessageScreen) -> None:
        self._core = core
        self._clock = core.clock
        self._screen = screen
        self._queue: deque[tuple[int, BlockAction]] = deque()
        self._work = asyncio.Event()
        self._calm = asyncio.Event()
        self._calm.set()
        self._room = asyncio.Event()
        self._resumed = asyncio.Event()
        self._sleeper: asyncio.Task[None] | None = None
        self._task: asyncio.Task[None] | None = None
        self.line: int | None = None
        self.stop_requested = False
        self.stopped = False

    @property
    def is_calm(self) -> bool:
        """Whether everything handed over has been done."""
        return self._calm.is_set()

    def begin(self) -> None:
        """Start the task."""
        self._task = asyncio.ensure_future(self._follow())

    async def end(self) -> None:
        """End the task, whatever it is doing."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    # -- for the interpreter -----------------------------------------------------------------------

    async def take(self, line: int, deed: BlockAction, ahead: int) -> None:
        """Hand over a deed; waits until no more than ``ahead`` are not yet done."""
        self._queue.append((line, deed))
        self._calm.clear()
        self._work.set()
        while self._open > ahead:
            self._room.clear()
            await self._room.wait()
            self._check()

    @property
    def _open(self) -> int:
        return len(self._queue) + (self.line is not None)

    async def calm(self) -> None:
        """Wait until everything handed over has been done."""
        await self._calm.wait()
        self._check()

    def _check(self) -> None:
        if self._task is not None and self._task.done() and not self._task.cancelled():
            self._task.result()

    # -- for the panel -----------------------------------------------------------------------------

    def stop(self) -> None:
        """NC stop: at once, also in mid-motion."""
        self.stop_requested = True
        self._resumed.clear()
        if self._sleeper is not None:
            self._sleeper.cancel()

    def resume(self) -> None:
        """NC start after a stop."""
        self.stop_requested = False
        self.stopped = False
        self._resumed.set()

    async def hold(self) -> None:
        """Stand until NC start."""
        self.stopped = True
        self._resumed.clear()
        await self._resumed.wait()

    async def stand(self) -> None:
        """The interpreter's part of an NC stop: wait for NC start; without deeds at hand the program stands."""
        self.stopped = self.stopped or self.is_calm
        await self._resumed.wait()

    # -- doing -------------------------------------------------------------------------------------

    async def _follow(self) -> None:
        try:
            while True:
                while self._queue:
                    self.line, deed = self._queue.popleft()
                    await self._do(deed)
                    self.line = None
                    self._room.set()
                self._calm.set()
                self._work.clear()
                await self._work.wait()
        finally:
            self._calm.set()
            self._room.set()

    async def _do(self, deed: BlockAction) -> None:
        while self.stop_requested:
            await self.hold()
        if deed.message is not None:
            self._screen.show(deed.message)
        if deed.targets:
            await self._travel(deed)
        if deed.dwell_s > 0.0:
            await self._wait_through(self._clock.now() + deed.dwell_s)
        if deed.ending == "M0" or (deed.ending == "M1" and self._screen.stops_at_m1()):
            await self.hold()

    async def _travel(self, deed: BlockAction) -> None:
        while True:
            seconds = self._core.move(deed.targets, deed.rate)
            if await self._wait_until(self._clock.now() + seconds):
                break
            self._core.halt()
            await self.hold()
        if deed.window is not None:
            now = self._clock.now()
            axes = (self._core.axes[index] for index in deed.targets)
            settling = max(axis.settling_s(now, deed.window) for axis in axes)
            await self._wait_through(now + settling)

    async def _wait_through(self, time_s: float) -> None:
        while True:
            left = time_s - self._clock.now()
            if await self._wait_until(time_s):
                return
            left = max(time_s - self._clock.now(), 0.0) if left > 0.0 else 0.0
            await self.hold()
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


SLICE_S = 0.02
_SYNCHRONOUS = frozenset({"STOPRE", "NEWCONF", "SETAL"})
_SYSTEM_READ = re.compile(r"\$(?:AA|VA|AC|VC)_[A-Z0-9_]+(?!\w|\s*(?:\[[^\]]*\])?\s*=[^=])")


class PowerCut(Exception):
    """The mains fail at this block."""


class ProgramAborted(Exception):
    """Something from outside has ended this run."""


class Interpreter(DeclaringResolver):
    """One run of a program, with its subprograms; ``modal`` is what is in force when it begins."""

    def __init__(self, core: Core, variables: Variables, panel: ControlPort, path: str, modal: Modal) -> None:
        super().__init__(core, variables, panel, path, modal)
        self._clock = core.clock
        self._due_s = 0.0
        self._waits: dict[str, set[int]] = {}
        self.main = MainRun(core, panel)
        self.blocks = 0

    # -- for the panel -----------------------------------------------------------------------------

    @property
    def stopped(self) -> bool:
        """Whether the program stands and waits for NC start."""
        return self.main.stopped

    @property
    def line(self) -> int:
        """Source line under execution, from 1."""
        return (self._line if self.main.line is None else self.main.line) + 1

    @property
    def interpreted_line(self) -> int:
        """Source line last interpreted, from 1."""
        return self._line + 1

    @property
    def program(self) -> str:
        """Name of the program under execution."""
        return self._frames[-1].name if self._frames else ""

    @property
    def paths(self) -> list[str]:
        """Programs under execution, outermost first."""
        return [frame.path for frame in self._frames]

    # -- execution ---------------------------------------------------------------------------------

    async def execute(self) -> None:
        """Run to the end. Raises NckRefusal or NcSyntaxError where the program stops with an alarm."""
        self.main.begin()
        try:
            await self._interpret()
            await self.main.calm()
        except (NckRefusal, NcSyntaxError):
            # The blocks before the bad one are still done.
            await self.main.calm()
            raise
        finally:
            await self.main.end()

    async def _interpret(self) -> None:
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
            step = self._step(frame, self._line)
            if self._line in self._waits[frame.path]:
                await self._synchronise()
            deed = step(self)
            self.blocks += 1
            if self._panel.mains_fail_here():
                raise PowerCut
            if not self._panel.block_done(self):
                raise ProgramAborted
            await self._hand_over(deed)
            await self._pass_block()

    def _step(self, frame: Frame, line: int) -> Step:
        steps = self._steps[frame.path]
        found = steps.get(line)
        if found is None:
            block = frame.program.block(line)
            partner = frame.program.partner.get(line)
            head = frame.program.block(partner) if partner is not None and partner < line else None
            found = steps[line] = prepare_block(block, head)
            waits = self._waits.setdefault(frame.path, set())
            if self._is_synchronous(block, frame.program.lines[line].text):
                waits.add(line)
        if not frame.begun:
            frame.begun = not isinstance(frame.program.block(line), Define | Proc | Extern)
        return found

    def _is_synchronous(self, block: object, text: str) -> bool:
        if self._core.spec.system_reads_stop and _SYSTEM_READ.search(text):
            return True
        items = block.items if isinstance(block, OrdinaryBlock) else ()
        return any(isinstance(item, BareWord | Procedure) and item.name in _SYNCHRONOUS for item in items)

    async def _synchronise(self) -> None:
        await self._settle_debt()
        if not self.main.is_calm:
            await self.main.calm()
        self._modal.planned.clear()

    async def _hand_over(self, deed: BlockAction | None) -> None:
        said, self.said = self.said, None
        if said is not None:
            if self.main.is_calm:
                self._panel.show(said)
            else:
                await self._take(BlockAction(message=said))
        if deed is None:
            return
        if deed.targets or deed.dwell_s > 0.0 or deed.ending in ("M0", "M1"):
            await self._take(deed)
        if deed.ending == "M30":
            self._frames.clear()
        elif deed.ending == "M17":
            self._return()

    async def _take(self, deed: BlockAction) -> None:
        await self._settle_debt()
        ahead = self._core.spec.preprocess_ahead
        await self.main.take(self._line, deed, ahead)
        if ahead == 0:
            self._modal.planned.clear()

    async def _pass_block(self) -> None:
        self._due_s += self._core.spec.block_time_s
        if self._due_s >= SLICE_S:
            await self._settle_debt()
        while self.main.stop_requested:
            await self.main.stand()

    async def _settle_debt(self) -> None:
        due, self._due_s = self._due_s, 0.0
        if due > 0.0:
            await self._clock.sleep(due)
