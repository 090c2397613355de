"""Executes a program block by block on the machine, in the clock's time.

Strictly in sequence: every block has taken effect before the next begins, as if each were preceded by
STOPRE. On the control R parameters run ahead of motion unless STOPRE stands between; programs should write
it, the double does not punish its absence.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from simulators.nck.channel import BlockWords, Deed, Modal, is_silent
from simulators.nck.core import Core
from simulators.nck.files import program_path
from simulators.nck.language import outline
from simulators.nck.procedures import PROCEDURES, Host
from simulators.nck.program_data import ProgramData
from simulators.nck.scope import Frame
from simulators.nck.spec import NckRefusal
from simulators.nck.statements import Given, Step, prepared
from simulators.nck.syntax import Call, Define, Expression, Extern, Indexed, Jump, Listing, Name, Proc, Words
from simulators.nck.expressions import R_NAME, compiled
from simulators.nck.values import AxisName, Value, converted, whole
from simulators.nck.variables import Variables

SLICE_S = 0.02
_DEPTH = 16
_EPS_S = 1e-9


class PowerCut(Exception):  # noqa: N818 - an event, no failure of ours
    """The mains fail at this block."""


class Panel(Host, Protocol):
    """What the interpreter tells the control."""

    def cut_here(self) -> bool:
        """Count a block; whether the mains fail now."""
        ...

    def skips(self) -> bool:
        """Whether blocks marked / are skipped."""
        ...

    def stops_at_m1(self) -> bool:
        """Whether the optional stop is on."""
        ...


class Interpreter:
    """One run of a program, with its subprograms."""

    def __init__(self, core: Core, variables: Variables, panel: Panel, path: str) -> None:
        self._core = core
        self._clock = core.clock
        self._variables = variables
        self._panel = panel
        self._data = ProgramData(core, self)
        self._steps: dict[str, dict[int, Step]] = {}
        self._frames: list[Frame] = []
        self._line = 0
        self._due_s = 0.0
        self._modal = Modal()
        self._sleeper: asyncio.Task[None] | None = None
        self._resumed = asyncio.Event()
        self.stop_requested = False
        self.stopped = False
        self._push(path, ())

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

    # -- program levels ----------------------------------------------------------------------------

    def _push(self, path: str, arguments: tuple[Value, ...]) -> Frame:
        if len(self._frames) >= _DEPTH:
            raise NckRefusal(12540, "subprograms nested too deeply")
        program = outline(self._panel.files.text(path))
        self._steps[path] = {}
        frame = Frame(program, path, arguments=arguments)
        self._frames.append(frame)
        return frame

    def _return(self) -> None:
        frame = self._frames.pop()
        for name, hand_back in frame.returns.items():
            hand_back(frame.variables[name].values[0])

    def _find_program(self, name: str) -> str | None:
        directory = self._frames[-1].directory
        for place, kind in ((directory, "SPF"), (directory, "MPF"), ("/_N_SPF_DIR", "SPF")):
            path = program_path(f"{place}/_N_{name}_{kind}", directory)
            if self._panel.files.exists(path):
                return path
        return None

    # -- what blocks ask (statements.Runner) ---------------------------------------------------------

    def block_words(self) -> BlockWords:
        """An empty collection for a block."""
        return BlockWords(self._core, self._modal)

    def variable(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a name."""
        if name == "R":
            return self._variables.read("R", indices)
        local = self._frames[-1].variables.get(name)
        if local is not None:
            return local.read(indices)
        if name.startswith("$"):
            return self._data.read(name, indices) if self._data.knows(name) else self._variables.read(name, indices)
        if not indices and self._core.axis_index(name) is not None:
            return AxisName(name)
        raise NckRefusal(12550, f"name {name} not defined or option not available")

    def assign(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Assign to a name."""
        local = self._frames[-1].variables.get(name)
        if local is not None:
            local.write(indices, value)
        elif name.startswith("$") and self._data.knows(name):
            self._data.write(name, indices, value)
        elif name == "R" or name.startswith("$"):
            self._variables.write(name, indices, value, self._core.access_level, program=True)
        else:
            raise NckRefusal(12550, f"name {name} not defined or option not available")

    def is_local(self, name: str) -> bool:
        """Whether a local variable of that name exists."""
        return name in self._frames[-1].variables

    def axis_of(self, name: str, indices: tuple[Value, ...]) -> int | None:
        """The axis a left-hand word moves."""
        if name in ("POS", "POSA") and len(indices) == 1:
            return self._core.axis(str(indices[0])).index
        if name == "AX" and len(indices) == 1 and isinstance(indices[0], AxisName):
            return self._core.axis(indices[0]).index
        return None if indices else self._core.axis_index(name)

    def jump(self, jump: Jump) -> None:
        """Go on at a label."""
        frame = self._frames[-1]
        label = jump.label
        variable = frame.variables.get(label)
        if variable is not None and variable.kind == "STRING":
            label = str(variable.values[0]).upper()
        line = frame.program.find_label(jump.kind, label, self._line)
        if line is not None:
            frame.pc = line
        elif jump.kind != "GOTOC":
            raise NckRefusal(14080, f"jump destination {label} not found")

    def go(self, line: int) -> None:
        """Go on at a line."""
        self._frames[-1].pc = line

    def partner(self) -> int:
        """The line this line's structure leads to."""
        return self._frames[-1].program.partner[self._line]

    def word(self, name: str) -> str:
        """A bare word."""
        if name == "NEWCONF":
            self._core.newconf()
        elif name == "RET":
            return "M17"
        elif not is_silent(name):
            self._call(name, ())
        return ""

    def _call(self, name: str, arguments: tuple[Value, ...]) -> Frame:
        path = self._find_program(name)
        if path is None:
            raise NckRefusal(12550, f"name {name} not defined or option not available")
        return self._push(path, arguments)

    def procedure(self, name: str, arguments: tuple[Expression, ...], given: Given) -> None:
        """A call that stands alone."""
        work = PROCEDURES.get(name)
        frame = self._frames[-1]
        if work is None:
            called = self._call(name, tuple(evaluate(self) for evaluate in given))
            called.returns = {}
            self._referenced(called, frame, arguments)
            return
        values = [self._value_or_array(frame, node, evaluate) for node, evaluate in zip(arguments, given, strict=True)]
        work(self._panel, frame, values, self._storing(frame, arguments))
