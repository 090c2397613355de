"""Interprets a program block by block, ahead of the machine as far as the control's preprocessing goes.

Motion, dwell, messages and stops are done in time by the main run; R parameters, machine data, tables, files
and system variables are read and written at once, when their block is interpreted, unless STOPRE, NEWCONF or
SETAL stands before: these wait until everything programmed so far has been done.
"""

from __future__ import annotations

import re

from simulators.nck.language.syntax import BareWord, Define, Extern, NcSyntaxError, OrdinaryBlock, Proc, Procedure
from simulators.nck.machine.core import Core
from simulators.nck.program.block import Deed, Modal
from simulators.nck.program.declarations import DeclaringNames
from simulators.nck.program.mainrun import MainRun
from simulators.nck.program.names import Panel
from simulators.nck.program.scope import Frame
from simulators.nck.program.statements import Step, prepared
from simulators.nck.program.variables import Variables
from simulators.nck.spec import NckRefusal

SLICE_S = 0.02
_SYNCHRONOUS = frozenset({"STOPRE", "NEWCONF", "SETAL"})
_SYSTEM_READ = re.compile(r"\$(?:AA|VA|AC|VC)_[A-Z0-9_]+(?!\w|\s*(?:\[[^\]]*\])?\s*=[^=])")


class PowerCut(Exception):
    """The mains fail at this block."""


class BrokenOff(Exception):
    """Something from outside has ended this run."""


class Interpreter(DeclaringNames):
    """One run of a program, with its subprograms; ``modal`` is what is in force when it begins."""

    def __init__(self, core: Core, variables: Variables, panel: Panel, path: str, modal: Modal) -> None:
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
            if self._panel.cut_here():
                raise PowerCut
            if not self._panel.goes_on(self):
                raise BrokenOff
            await self._hand_over(deed)
            await self._pass_block()

    def _step(self, frame: Frame, line: int) -> Step:
        steps = self._steps[frame.path]
        found = steps.get(line)
        if found is None:
            block = frame.program.block(line)
            partner = frame.program.partner.get(line)
            head = frame.program.block(partner) if partner is not None and partner < line else None
            found = steps[line] = prepared(block, head)
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

    async def _hand_over(self, deed: Deed | None) -> None:
        said, self.said = self.said, None
        if said is not None:
            if self.main.is_calm:
                self._panel.show(said)
            else:
                await self._take(Deed(message=said))
        if deed is None:
            return
        if deed.targets or deed.dwell_s > 0.0 or deed.ending in ("M0", "M1"):
            await self._take(deed)
        if deed.ending == "M30":
            self._frames.clear()
        elif deed.ending == "M17":
            self._return()

    async def _take(self, deed: Deed) -> None:
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
