"""A gateway at a simulated machine, stopped or killed at a moment; what the machine then holds, and what is said of it.

One process and virtual time. A killed gateway is one that never gets another turn: its clock and its requests stand
still for ever, its locks are the kernel's to free. What it was about to clean up is not cleaned up.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import pytest

from drivers.clock import LoopClock
from drivers.sinumerik.ncprogram.words import Phase
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.stale_programs import StaleProgram
from drivers.types.orders import SignProof
from gateway.config import SiteFile, load_site
from gateway.daemon.job_runner import JobRunner
from gateway.errors import StoreError
from gateway.push import journal
from gateway.push.journal import JOURNALS
from gateway.push.recovery import unfinished_tables
from gateway.push.sent_programs import SentProgramBook
from gateway.say import Say
from gateway.stopping import StopAsked, Stopped, current, obey
from gateway.store.machine_books import ProofBook
from gateway.supervisor import Supervisor
from gateway.views.runs import pushes_held
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.rollback import recover_site
from gateway.workflow.run.folder import store_of
from simulators.cell import Cell
from tests.cell.bench import short
from tests.selftested import cell_running

WORDS = range(80, 96)  # the marker's two keep what a push left for whoever comes next
RESET, ACTIVE, INTERRUPTED = 0, 1, 2


@dataclass
class Shop:
    """A machine with a site whose one axis was measured by somebody else: what is left to do is reading and pushing."""

    cell: Cell
    clock: LoopClock
    site: SiteFile
    path: Path
    said: list[str] = field(default_factory=list)

    @property
    def serial(self) -> str:
        """The machine's."""
        return self.cell.file.machine.serial

    @property
    def words(self) -> tuple[float, ...]:
        """Our R parameters."""
        return tuple(float(self.cell.nck.get(f"R[{number}]")) for number in WORDS)

    @property
    def program(self) -> str:
        """What would start at NC START, or runs."""
        return str(self.cell.nck.selected)

    @property
    def channel(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        return int(self.cell.nck.channel_status)

    def say(self, code: str, /, **fields: object) -> None:
        """What is told on the way; whoever is asked to press RESET does so."""
        self.said.append(code)
        if str(fields.get("words", "")).startswith("W-LEFT-STOPPED") and self.cell.operator.spec.auto:
            asyncio.get_running_loop().call_later(5.0, self._reset, self.cell.nck.message)

    def _reset(self, shown: str) -> None:
        """Press RESET if it still stands as it did when that was asked for."""
        if self.channel == INTERRUPTED and self.cell.nck.message == shown:
            self.cell.operator.press("RESET")

    def work(self, *, apply: bool = True) -> Coroutine[Any, Any, Any]:
        """A whole run."""
        name = self.site.site.name if apply else ""
        return run_site(self.site, self.path, apply=apply, machine_name=name, clock=self.clock, say=self.say)

    async def served(self) -> None:
        """What `trueflank serve` does when a run is started from its page: watch, run, watch."""
        store = store_of(self.site, self.path)
        devices = Supervisor(self.site, self.clock, only=(), book=SentProgramBook(store.root / JOURNALS, self.serial))

        async def starter(_say: Say) -> object:
            return await self.work(apply=False)

        desk = JobRunner(devices, starter, self.clock)
        starting = asyncio.create_task(desk.start())
        try:
            await desk.work(current().asked)
        finally:
            starting.cancel()
            await asyncio.gather(starting, return_exceptions=True)

    def recovery(self, *, apply: bool) -> Coroutine[Any, Any, Any]:
        """What `trueflank recover` does."""
        name = self.site.site.name if apply else ""
        return recover_site(self.site, self.path, apply=apply, machine_name=name, clock=self.clock, say=self.say)

    async def page(self) -> tuple[StaleProgram, tuple[str, ...]]:
        """What a daemon that opens the devices now sees in the control, and the codes its page shows."""
        store = store_of(self.site, self.path)
        book = SentProgramBook(store.root / JOURNALS, self.serial)
        devices = Supervisor(self.site, self.clock, only=(), book=book)
        try:
            await devices.open_all()
            left = () if devices.left.clear else (devices.left.said.code,)
            return devices.left, (*left, *(one.words.split(":")[0] for one in pushes_held(store)))
        finally:
            await devices.close_all()

    def journal(self) -> tuple[Any, ...]:
        """Pushes that did not end."""
        return unfinished_tables(store_of(self.site, self.path).root / JOURNALS, self.serial)


@contextlib.asynccontextmanager
async def shop(folder: Path, clock: LoopClock | None = None, **operator: Any) -> AsyncIterator[Shop]:
    """A cell, in virtual time without a clock of its own; X1 comes from a result file, its sign was proved before."""
    gateways = LoopClock() if clock else LoopClock(started_utc=datetime.now(UTC))
    clock = clock or gateways
    async with cell_running("demo", folder / "cell", clock, wires="memory", block_s=0.5) as cell:
        cell.operator.change(**operator)
        measured = folder / "measured.rtl"
        cell.write_result_file("X1", measured)
        path = cell.site_path
        edit = short(("X1",), 24, 2, file=str(measured), file_datum=-400.0, instrument="")
        # Signatures cost time and are not what is looked at here.
        plain = path.read_text(encoding="utf-8").replace('security = "Basic256Sha256"', 'security = "None"')
        path.write_text(edit(plain), encoding="utf-8")
        site = load_site(path)
        at = Shop(cell, gateways, site, path)
        supervisor = Supervisor(site, gateways, only=())
        machine = await supervisor.open_all()
        await supervisor.close_all()
        proof = SignProof(machine, "axis", "X1", -1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
        ProofBook(store_of(site, path).root).save(proof)
        yield at


Moment = float | str
"""Seconds after the start of a run, or where its push stands: one of `WAITS`."""
WAITS = {"after the back-up": Phase.SAVED, "between the halves": Phase.WAITING, "at the restart": Phase.ENABLED}


async def come(at: Shop, moment: Moment) -> None:
    """Let the run come to a moment. A push stands at the restart once its program is at M0."""
    if not isinstance(moment, str):
        await at.clock.sleep(moment)
        return
    wanted = INTERRUPTED if moment == "at the restart" else ACTIVE
    while at.cell.nck.get("R[90]") != WAITS[moment] or at.channel != wanted:
        await at.clock.sleep(0.05)


@dataclass
class Stopping:
    """How a stop went: seconds from the start to the asking and from there, and the last word."""

    asked_s: float
    took_s: float
    error: Stopped | None
    told: list[str]


async def stopped(
    at: Shop, work: Coroutine[Any, Any, Any], moment: Moment, then: Callable[[], None], *, ends_itself: bool = False
) -> Stopping:
    """Do some work and ask for a stop at a moment of it; ``then`` is done in the same one."""
    stop, began = StopAsked(), at.clock.now()
    asked: list[float] = []

    async def ask() -> None:
        await come(at, moment)
        asked.append(at.clock.now())
        then()
        stop.ask("SIGTERM")

    asking = asyncio.create_task(ask())
    error: Stopped | None = None
    try:
        await obey(work, stop, at.clock, ends_itself=ends_itself)
    except Stopped as caught:
        error = caught
    finally:
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)
    now = at.clock.now()
    return Stopping(asked[0] - began if asked else 0.0, now - asked[0] if asked else 0.0, error, stop.told)


class Killing:
    """Takes a gateway's turns away, and frees its locks as a kernel does."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._dead: set[asyncio.Task[Any]] = set()
        self._killed: set[asyncio.Task[Any]] = set()
        self._files: list[BinaryIO] = []
        take, request, sleep, append = journal._lock, UaSession._request, LoopClock.sleep, journal.Journal.append

        def taking(file: BinaryIO) -> bool:
            taken = take(file)
            if taken:
                self._files.append(file)
            return taken

        async def requesting(session: UaSession, *given: Any) -> Any:
            await self._turn()
            answer = await request(session, *given)
            await self._turn()
            return answer

        async def sleeping(clock: LoopClock, seconds: float) -> None:
            await self._turn()
            await sleep(clock, seconds)
            await self._turn()

        def appending(kept: journal.Journal, kind: str, **facts: Any) -> None:
            if asyncio.current_task() in self._killed:  # swept away: no process is left that could write
                raise StoreError("E-PUSH-DISK", "journal", why="killed")
            append(kept, kind, **facts)

        patch.setattr(journal.Journal, "append", appending)
        patch.setattr(journal, "_lock", taking)
        patch.setattr(UaSession, "_request", requesting)
        patch.setattr(LoopClock, "sleep", sleeping)

    async def _turn(self) -> None:
        if asyncio.current_task() in self._dead:
            await asyncio.Event().wait()

    def kill(self, task: asyncio.Task[Any]) -> None:
        """It never gets another turn; what it held is free."""
        self._dead.add(task)
        self._killed.add(task)
        for file in self._files:
            if not file.closed:
                journal._unlock(file)

    @contextlib.asynccontextmanager
    async def gateway(self, work: Coroutine[Any, Any, Any]) -> AsyncIterator[asyncio.Task[Any]]:
        """A gateway at work; its remains are swept away at the end."""
        task = asyncio.create_task(work)
        try:
            yield task
        finally:
            self._dead.discard(task)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def table_of(cell: Cell) -> tuple[tuple[float, ...], bool]:
    """X1's points in memory, and whether they are switched on."""
    nck = cell.nck
    count = int(nck.get("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]"))
    points = tuple(float(nck.get(f"$AA_ENC_COMP[0,{point},X1]")) for point in range(count))
    return points, bool(nck.get("$MA_ENC_COMP_ENABLE[0,X1]"))


async def cleared(at: Shop, *, resets: bool = True) -> list[str]:
    """A person comes, presses RESET if anything stands, and has it recovered; what is wrong afterwards."""
    if resets and at.channel != RESET:
        at.cell.operator.press("RESET")
        await at.cell.clock.sleep(2.0)
    await at.cell.operator.power_up()
    at.cell.operator.change(auto=True)
    await at.recovery(apply=True)
    left, codes = await at.page()
    wrong = [f"after recovery: {left.words}"] if not left.clear else []
    wrong += [f"after recovery the page says {codes}"] if codes else []
    wrong += [f"after recovery R parameters are {at.words}"] if any(at.words) else []
    wrong += [f"after recovery {len(at.journal())} journals"] if at.journal() else []
    return wrong
