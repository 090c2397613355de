"""A little machine for capture tests: an axis that moves, an instrument that sees it, a hand-shake between."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded
from drivers.ports.devices import Tell
from drivers.sinumerik.tablefile.tables import HELD_KINDS, table_by_proof, tables_by_proof
from drivers.types.abilities import Capabilities
from drivers.types.identity import Identity
from drivers.types.machine import ChannelStatus, MachineState
from drivers.types.orders import SignProof, TableQuestion
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense

RATE_HZ = 100.0
BLOCK_S = 0.1


@dataclass
class LittleMachine:
    """One axis: piecewise linear motion in clock time; `reads` turns its position into an instrument value."""

    clock: Clock
    reads: Callable[[np.ndarray, np.ndarray], np.ndarray]
    channels: tuple[str, ...] = ("displacement_mm",)
    name: str = "laser"
    speed: float = 100.0
    late_s: float = 0.0
    bad_at: float | None = None
    skip_stop: int | None = None
    compensated_for: str = "nothing"
    notices: tuple[str, ...] = ()
    knots_s: list[float] = field(default_factory=lambda: [0.0])
    knots: list[float] = field(default_factory=lambda: [0.0])
    reached: asyncio.Queue[StopReached | None] = field(default_factory=asyncio.Queue)
    echo: int = 0
    echoed: asyncio.Event = field(default_factory=asyncio.Event)
    aborted: bool = False
    task: asyncio.Task[None] | None = None
    setups: list[str] = field(default_factory=list)

    def at(self, times: np.ndarray) -> np.ndarray:
        return np.interp(times, self.knots_s, self.knots)

    async def move(self, target: float) -> None:
        now = self.clock.now()
        here = float(self.at(np.array([now]))[0])
        duration = abs(target - here) / self.speed + 0.01
        self.knots_s += [now, now + duration]
        self.knots += [here, target]
        await self.clock.sleep(duration)

    # the controller's part
    async def prepare_stops(self, plan: StopPlan) -> None:
        self.setups.append(plan.setup)
        self.reached = asyncio.Queue()
        self.echo = 0
        self.task = asyncio.create_task(self._program(plan))

    async def _program(self, plan: StopPlan) -> None:
        for index, stop in enumerate(plan.stops):
            if index == self.skip_stop:
                continue
            await self.move(stop.target - stop.approach * plan.overrun)
            await self.move(stop.target)
            await self.clock.sleep(plan.dwell_s)
            self.echoed.clear()
            self.reached.put_nowait(
                StopReached(index + 1, stop.repetition, stop.label, stop.approach, stop.target, 0.0, 0.0)
            )
            while self.echo != index + 1:
                await self.echoed.wait()
                self.echoed.clear()
        self.reached.put_nowait(None)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        async with self.clock.deadline(timeout_s, "controller"):
            return await self.reached.get()
        raise DeadlineExceeded("E-LINK-DEADLINE", "controller", timeout_s=timeout_s)

    async def release_stop(self, counter: int) -> None:
        self.echo = counter
        self.echoed.set()

    async def abort_program(self) -> None:
        self.aborted = True
        if self.task is not None:
            self.task.cancel()
            await asyncio.gather(self.task, return_exceptions=True)

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(stops=True, tables=HELD_KINDS, switched="at-stop", marker=True, consent="start")

    async def state(self) -> MachineState:
        running = self.task is not None and not self.task.done()
        return MachineState(ChannelStatus.ACTIVE if running else ChannelStatus.RESET, "AUTO", "", (), 7, {})

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        del tell
        return await self.saved_tables(question.axis, question.proof)

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        return tables_by_proof(live, proof)

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        return table_by_proof(table, sense, proof)

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        del proof
        table = CompensationTable("axis", axis, axis, 0.0, 100.0, 50.0, (0.0, 0.0, 0.0))
        return LiveSet(axis, LiveTable(table, enabled=False), (), 0.0, "", "0" * 64)

    # the instrument's part
    async def open(self, timeout_s: float) -> Identity:
        return Identity("little", "little", "1")

    async def close(self) -> None:
        return None

    async def optics(self) -> Optics:
        return Optics()

    async def ambient(self) -> Ambient:
        return Ambient(20.0, 1013.25, 50.0, (20.0,))

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        sent = self.clock.now()
        while True:
            await self.clock.sleep(BLOCK_S)
            now = self.clock.now()
            times = np.arange(sent + 1 / RATE_HZ, now, 1 / RATE_HZ)
            sent = float(times[-1]) if len(times) else sent
            seen = times - self.late_s
            values = self.reads(self.at(seen), seen)
            if values.ndim == 1:
                values = values[:, None]
            valid = np.ones(len(times), dtype=bool)
            if self.bad_at is not None:
                valid &= ~((times > self.bad_at) & (times < self.bad_at + 0.05))
            yield SampleBlock(self.channels, times, values, valid)
