"""The channel: mode, selected program, its run from NC START to the end, messages and stops."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Literal

from simulators.nck.language.syntax import NcSyntaxError
from simulators.nck.machine.core import Core
from simulators.nck.machine.data import AlarmList
from simulators.nck.machine.files import FileSystem, canonical_path
from simulators.nck.program.block import Modal
from simulators.nck.program.interpreter import Interpreter, PowerCut, ProgramAborted
from simulators.nck.program.variables import Variables
from simulators.nck.spec import NckRefusal

Mode = Literal["AUTO", "JOG", "MDA"]

RESET, ACTIVE, INTERRUPTED = 0, 1, 2
PROGRAM_INTERRUPTED, PROGRAM_STOPPED, PROGRAM_RUNNING, PROGRAM_ABORTED = 1, 2, 3, 5


class Channel:
    """One channel; ``power_cut`` is called when the mains fail at a block, ``at_block`` after each block."""

    def __init__(
        self, core: Core, variables: Variables, power_cut: Callable[[], None], at_block: Callable[[int], None]
    ) -> None:
        spec = core.spec
        self._core = core
        self._variables = variables
        self._power_cut = power_cut
        self._at_block = at_block
        self.files = FileSystem(
            spec.files_max_total,
            spec.files_max_count,
            self._check_reading,
            self._check_changing,
            stale=spec.stale_files,
        )
        self.mode: Mode = "JOG"
        self.message = ""
        self.selected = ""
        self.skip_active = False
        self.optional_stop = False
        self.cut_after_blocks: int | None = None
        self._run: Interpreter | None = None
        self._task: asyncio.Task[None] | None = None
        self._ending: set[asyncio.Task[None]] = set()
        self._faulted = False
        self._line = 0
        self._modal = Modal()

    # -- state -------------------------------------------------------------------------------------

    @property
    def status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        if self._faulted:
            return INTERRUPTED
        if self._run is None:
            return RESET
        return INTERRUPTED if self._run.stopped else ACTIVE

    @property
    def program_status(self) -> int:
        """1 interrupted, 2 stopped, 3 running, 5 aborted (also after a program's end)."""
        if self._faulted:
            return PROGRAM_INTERRUPTED
        if self._run is None:
            return PROGRAM_ABORTED
        return PROGRAM_STOPPED if self._run.stopped else PROGRAM_RUNNING

    @property
    def line(self) -> int:
        """Source line under execution, from 1; 0 in reset."""
        return self._run.line if self._run is not None else self._line

    @property
    def program_name(self) -> str:
        """The program under execution, else the one selected."""
        running = self._run.program if self._run is not None else ""
        return running or self.selected.rpartition("/")[2]

    @property
    def task(self) -> asyncio.Task[None] | None:
        """The task of the run."""
        return self._task

    # -- keys --------------------------------------------------------------------------------------

    def select(self, path: str) -> int:
        """Select a program: 0 ok, 2 not found, 3 channel not in reset."""
        if not self.files.exists(path):
            return 2
        if self.status != RESET:
            return 3
        self.selected = canonical_path(path)
        self._line = 0
        return 0

    def unselect(self) -> int:
        """Unselect: 0 ok, 3 channel not in reset."""
        if self.status != RESET:
            return 3
        self.selected = ""
        return 0

    def set_mode(self, mode: Mode) -> bool:
        """Choose a mode; not while a program runs. Raises ValueError for another word."""
        if mode not in ("AUTO", "JOG", "MDA"):
            raise ValueError(f"no mode {mode!r}")
        if self.status == ACTIVE:
            return False
        self.mode = mode
        return True

    def start(self) -> bool:
        """NC START: begin the selected program, or go on after M0 or NC STOP. False when refused."""
        if self.mode != "AUTO" or self._faulted or self._core.alarms.lock_start:
            return False
        if self._run is not None:
            if not self._run.stopped:
                return False
            self._run.main.resume()
            return True
        return bool(self.selected) and self._referenced() and self._begin()

    def stop(self) -> None:
        """NC STOP: motion stops at once."""
        if self._run is not None and not self._run.stopped:
            self._run.main.stop()

    def abort(self) -> None:
        """End whatever runs; the channel is in reset."""
        if self._task is not None:
            self._ending.add(self._task)
            self._task.add_done_callback(self._ending.discard)
            self._task.cancel()
        self._run = None
        self._task = None
        self._faulted = False
        self._core.wheel_runs = False
        self._line = 0
        self.message = ""

    async def ended(self) -> None:
        """Wait until nothing of a run that was broken off goes on."""
        await asyncio.gather(*self._ending, return_exceptions=True)

    # -- the run -----------------------------------------------------------------------------------

    def _referenced(self) -> bool:
        data = self._core.data
        needed = [axis for axis in self._core.axes if data.effective("$MA_REFP_CYCLE_NR", axis.index) > -1]
        missing = [axis.spec.name for axis in needed if not axis.referenced]
        if missing and data.effective("$MC_REFP_NC_START_LOCK"):
            self._core.alarms.raise_(22062, f"axes not referenced: {', '.join(missing)}", "start")
            return False
        return True

    def _begin(self) -> bool:
        if not self.files.exists(self.selected):
            self._core.alarms.raise_(14011, f"program {self.selected} does not exist", "start")
            return False
        try:
            run = Interpreter(self._core, self._variables, self, path=self.selected, modal=self._in_force())
        except NcSyntaxError as error:
            self._fault(error.number, error.reason, error.line)
            return False
        self._run = run
        self._task = asyncio.ensure_future(self._execute(run))
        return True

    def _in_force(self) -> Modal:
        """What a program begins with: as the one before left it, or the control's own (`Switches.modal_stays`)."""
        if not self._core.spec.modal_stays:
            return Modal()
        self._modal.planned.clear()
        self._modal.feed = None
        return self._modal

    async def _execute(self, run: Interpreter) -> None:
        try:
            await run.execute()
        except NcSyntaxError as error:
            self._fault(error.number, error.reason, error.line)
        except NckRefusal as error:
            self._fault(error.number, error.text, run.interpreted_line)
        except PowerCut:
            self._finish()
            self._power_cut()
        except ProgramAborted:
            return
        else:
            self._finish()

    def _finish(self) -> None:
        self._run = None
        self._core.wheel_runs = False
        self._line = 0
        self.message = ""

    def _fault(self, number: int, text: str, line: int) -> None:
        self._run = None
        self._line = line
        self._faulted = True
        self._core.halt()
        self._core.alarms.raise_(number, f"channel 1 line {line}: {text}", "reset")

    # -- what the interpreter and the files ask (names.Panel) ----------------------------------------

    @property
    def alarms_list(self) -> AlarmList:
        """The alarms standing."""
        return self._core.alarms

    def show(self, text: str) -> None:
        """MSG."""
        self.message = text

    def file_limit(self) -> int:
        """MD11420 in bytes."""
        return int(self._core.data.effective("$MN_LEN_PROTOCOL_FILE")) * 1024

    def skips(self) -> bool:
        """Whether blocks marked / are skipped."""
        return self.skip_active

    def stops_at_m1(self) -> bool:
        """Whether the optional stop is on."""
        return self.optional_stop

    def mains_fail_here(self) -> bool:
        """Count a block against ``cut_after_blocks``; whether the mains fail now."""
        if self.cut_after_blocks is None:
            return False
        self.cut_after_blocks -= 1
        if self.cut_after_blocks > 0:
            return False
        self.cut_after_blocks = None
        return True

    def block_done(self, run: object) -> bool:
        """Another block of a run is done: whether that run still exists after what happens at it."""
        if self._run is run and self._run is not None:
            self._at_block(self._run.blocks)
        return self._run is run

    def interrupt(self, number: int, text: str) -> None:
        """An alarm of the drive or the PLC stops whatever runs."""
        if self._run is None:
            self._core.alarms.raise_(number, text, "reset")
            return
        line, task = self._run.line, self._task
        self._fault(number, text, line)
        if task is not None:
            task.cancel()

    def _check_reading(self, _path: str) -> None:
        if not self._core.spec.fetch_while_waiting and self.status != RESET:
            raise NckRefusal(0, "files cannot be fetched while a program is running or waiting")

    def _check_changing(self, path: str) -> None:
        running = self._run.paths if self._run is not None else []
        if path in running or (path == self.selected and self.status != RESET):
            raise NckRefusal(0, f"{path} is being executed")
