"""A driver, an agent over the double of LinuxCNC's modules, and a person who restarts the control, in virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator, Coroutine
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock, LoopClock
from drivers.contract import OperatorMoment, Subject
from drivers.errors import DeadlineExceeded, TransportError
from drivers.linuxcnc.agent.__main__ import LOOK_S
from drivers.linuxcnc.agent.answering import Agent
from drivers.linuxcnc.agent.kernel import Kernel
from drivers.linuxcnc.device import LinuxCnc
from drivers.transport import ByteTransport, serve
from drivers.units import AxisUnit
from tests.contract.fileroad import curve
from tests.contract.linuxcnc_double import Machine

TOKEN = "0123456789abcdef"


class Killed(BaseException):
    """kill -9: nothing that runs may catch it."""


_NAMES = itertools.count()


@dataclass
class Stage:
    """What a test plays with."""

    machine: Machine
    agent: Agent
    device: LinuxCnc
    clock: Clock
    url: str
    token: Path

    def new_agent(self) -> None:
        """The agent was killed and started again: what it knew is gone."""
        self.agent = agent_of(self.machine)

    def other(self, **settings: Any) -> LinuxCnc:
        return LinuxCnc("mill", self.url, {"token_file": str(self.token), **settings}, self.clock)

    async def restarting(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Somebody restarts LinuxCNC after a while."""
        task = asyncio.ensure_future(work)
        await self.clock.sleep(3.0)
        await self.restart()
        return await task

    async def restart(self) -> None:
        """A person's: it is down for a while, then up without a home; the agent's lines end with the old life."""
        self.machine.stop()
        await self.clock.sleep(2.0)
        self.machine.start()
        await self.clock.sleep(1.0)
        self.machine.homed = True


def agent_of(machine: Machine) -> Agent:
    return Agent(TOKEN, lambda: Kernel(machine, machine, sleep=lambda _s: None), lambda: machine.life)


@contextlib.asynccontextmanager
async def on_stage(folder: Path, url: str = "") -> AsyncIterator[Stage]:
    """Everything running; the control started once, homed, without rows in any file; at ``url``, else in memory."""
    clock, machine, token = LoopClock(), Machine(folder), folder / "token"
    token.write_text(TOKEN + "\n")
    machine.restart()
    url = url or f"memory://linuxcnc-{next(_NAMES)}"

    async def converse(wire: ByteTransport) -> None:
        """As the agent's child: it looks twice a second whether its life of the kernel is over, and leaves then."""
        held, mine = b"", stage.machine.life
        with contextlib.suppress(TransportError):
            while stage.machine.life is mine:
                try:
                    async with clock.deadline(LOOK_S, url):
                        held += await wire.read(1 << 16)
                except DeadlineExceeded:
                    continue
                *lines, held = held.split(b"\n")
                for line in lines:
                    try:
                        answer = stage.agent.line(line)
                    except Killed:  # the process is gone, and started again
                        stage.new_agent()
                        return
                    await wire.write(answer.data)

    listener = await serve(url, converse, clock)
    device = LinuxCnc("mill", listener.url, {"token_file": str(token)}, clock)
    stage = Stage(machine, agent_of(machine), device, clock, listener.url, token)
    try:
        await stage.device.open(5.0)
        yield stage
    finally:
        await stage.device.close()
        await listener.close()


@contextlib.asynccontextmanager
async def subject(folder: Path, axis: str = "X") -> AsyncIterator[Subject]:
    """For the contract: a curve for each direction at free places."""
    async with on_stage(folder) as on:

        async def person(moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
            return await (work if moment in ("read", "start") else on.restarting(work))

        unit: AxisUnit = "deg" if axis == "A" else "mm"
        table = replace(curve(), input_axis=axis, output_axis=axis, input_unit=unit, output_unit=unit)
        yield Subject(on.device, table, axis, axis == "A", 0.0, person)
