"""A gateway in a process of its own that is killed -9 at a chosen step, beside a machine that goes on.

The machine lives in the parent, in virtual time. The child's loop has virtual time too, and hands every request to the
parent with the moment it is made; the parent lets the machine live up to that moment, and answers. So the two agree
about time without anybody waiting, a run is the same each time, and the kill is a real SIGKILL: nothing is tidied up,
what is not in the file is lost, the lock is the kernel's to free.
"""

from __future__ import annotations

import asyncio
import os
import signal
import traceback
import warnings
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TransportError, TrueflankError
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.transport import ByteTransport, listen_memory, memory, open_transport
from drivers.types.identity import MachineIdentity
from drivers.types.tables import LiveSet
from gateway import audit
from gateway.push import journal
from gateway.push.context import PushContext
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.transaction import push_table
from tests.placed import placed
from tests.push.world import URL, Scene, World, change_of, context_for, driver_settings

_TURNS = 60
LOOKED = "looked"
_COMMANDS = {1: "open", 2: "BEGIN", 3: "CHUNK", 4: "VERIFY", 5: "ACTIVATE", 6: "DISABLE", 7: "read", 9: "close"}
_COMMANDS |= {10: "MARKER", 11: "select"}
_TOLD = ("P-PUSH-JOG", "P-PUSH-ACTIVATE", "P-PUSH-RESTART", LOOKED)
# Steps that look, or open and close a session: before and after them machine and disk are the same.
IDLE = ("poll", "open", "close", "read", "select", "beat")


@dataclass
class Reaper:
    """Counts the steps of a process and kills it at one of them; ``at`` -1 lets it live."""

    at: int = -1
    steps: list[str] = field(default_factory=list)

    def due(self, name: str) -> bool:
        """One more step; whether it is the one to die at."""
        self.steps.append(name)
        return len(self.steps) - 1 == self.at

    def tick(self, name: str) -> None:
        """One more step; dies here if it is the one."""
        if self.due(name):
            die()


def die() -> None:
    """kill -9."""
    os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class Ended:
    """How a gateway's process ended. ``result`` is its last word, None when it was killed.

    ``looked`` is `memory_of` the machine at the moment the gateway had looked and not yet acted.
    """

    killed: bool
    result: Any = None
    steps: tuple[str, ...] = ()
    looked: Any = None


Task = Callable[[Scene, PushContext, LiveSet], Awaitable[Any]]


# ---- in the child ----------------------------------------------------------------------------------


def _name_of(request: bytes) -> str:
    """What a Modbus TCP request does, in capitals where it does something to the machine."""
    function, address = request[7], int.from_bytes(request[8:10], "big")
    if function == 3:
        return "poll"
    if function == 6:
        return "beat"
    return "DATA" if address != 16 else _COMMANDS.get(int.from_bytes(request[13:15], "big"), "OTHER")


class _Wire:
    """The child's end of all wires: every request goes to the parent, with the time it is made at."""

    def __init__(self, pipe: Connection, reaper: Reaper) -> None:
        self._pipe, self._reaper = pipe, reaper
        self._count = 0

    async def handle(self, peer: ByteTransport) -> None:
        self._count += 1
        mine = self._count
        self._ask("open", mine, b"")
        try:
            while True:
                data = await peer.read(4096)
                name = _name_of(data)
                self._reaper.tick(f"{name}<")
                reply = self._ask("data", mine, data)
                self._reaper.tick(f"{name}>")
                if reply is None:
                    return
                await peer.write(reply)
        except TransportError:
            self._ask("close", mine, b"")

    def _ask(self, what: str, wire: int, data: bytes) -> Any:
        self._pipe.send((what, asyncio.get_running_loop().time(), wire, data))
        return self._pipe.recv()


def _watch(reaper: Reaper) -> None:
    """Every step that leaves something on the disk. This process is about to be killed: nothing is put back."""
    append, replace, write_text = journal.Journal.append, os.replace, Path.write_text

    def appending(self: journal.Journal, kind: str, **facts: object) -> None:
        reaper.tick(f"journal< {kind}")
        if reaper.due(f"journal/ {kind}"):
            line, _sha = journal._line(self._sequence, self._previous, {"kind": kind, **facts})
            self._file.write(line[: len(line) // 2])
            self._file.flush()
            die()
        append(self, kind, **facts)
        reaper.tick(f"journal> {kind}")

    def replacing(source: Any, target: Any) -> None:
        reaper.tick(f"replace< {Path(target).parent.name}")
        replace(source, target)
        reaper.tick(f"replace> {Path(target).parent.name}")

    def writing(self: Path, *args: Any, **more: Any) -> int:
        reaper.tick("text<")
        count = write_text(self, *args, **more)
        reaper.tick("text>")
        return count

    journal.Journal.append = appending  # type: ignore[method-assign]
    os.replace = replacing  # type: ignore[assignment]
    Path.write_text = writing  # type: ignore[method-assign]


def _child(pipe: Connection, world: World, root: Path, base: LiveSet, task: Task, at: int) -> None:
    """The whole life of a gateway's process."""
    reaper = Reaper(at)
    try:
        asyncio.events._set_running_loop(None)
        memory._listeners.clear()
        _watch(reaper)
        result = run_virtual(lambda: _gateway(pipe, reaper, world, root, base, task))
        pipe.send(("done", 0.0, 0, (result, tuple(reaper.steps))))
    except BaseException:  # noqa: BLE001 - this process has nobody else to tell
        pipe.send(("failed", 0.0, 0, traceback.format_exc()))
    os._exit(0)


async def _gateway(pipe: Connection, reaper: Reaper, world: World, root: Path, base: LiveSet, task: Task) -> Any:
    clock = LoopClock()
    wire = _Wire(pipe, reaper)
    listener = listen_memory("plc", wire.handle)

    def say(code: str, /, **fields: object) -> None:
        if code in _TOLD:
            pipe.send(("say", asyncio.get_running_loop().time(), 0, (code, dict(fields))))
            pipe.recv()

    scene = world.scene
    device = placed(SinumerikModbus("grinder", URL, driver_settings(scene), clock))
    try:
        await device.open(5.0)
        machine: MachineIdentity = await device.identify()
        return await task(scene, context_for(scene, device, clock, root, machine, say=say), base)
    except TrueflankError as error:
        return f"raised {error.code}"
    finally:
        await device.close()
        await listener.close()


# ---- in the parent ---------------------------------------------------------------------------------


async def gateway(world: World, root: Path, base: LiveSet, task: Task, at: int = -1) -> Ended:
    """Run a task in a process of its own, killed at step ``at``; the machine goes on meanwhile."""
    here, there = Pipe()
    with warnings.catch_warnings():  # other threads, those of a test runner, are not ours and hold nothing
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid == 0:
        here.close()
        _child(there, world, root, base, task, at)
    there.close()
    try:
        return await _Server(world, here).serve()
    finally:
        here.close()
        _pid, status = os.waitpid(pid, 0)  # noqa: ASYNC222 - it is dead or about to be
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) != signal.SIGKILL:
            raise AssertionError(f"the gateway's process ended by signal {os.WTERMSIG(status)}")


def memory_of(world: World) -> Any:
    """All that a push may change in the machine: table, switches, marker, and how much was ever written."""
    oracle, plc = world.oracle, world.station.plc
    return oracle.content, oracle.switched_on, oracle.writes, plc.memory.marker, plc.memory.marker_state


class _Server:
    """Answers one child's requests from the machine."""

    def __init__(self, world: World, pipe: Connection) -> None:
        self._world, self._pipe = world, pipe
        self._begun = world.clock.now() - 1000.0  # a virtual loop's time begins at 1000
        self._wires: dict[int, ByteTransport] = {}
        self.looked: Any = None

    async def serve(self) -> Ended:
        try:
            while True:
                try:
                    what, moment, wire, data = self._pipe.recv()
                except (EOFError, ConnectionResetError):
                    return Ended(True)
                if what == "done":
                    return Ended(False, data[0], data[1], self.looked)
                if what == "failed":
                    raise AssertionError(data)
                await self._live_until(self._begun + moment)
                answer = await self._answer(what, wire, data)
                try:
                    self._pipe.send(answer)
                except (BrokenPipeError, ConnectionResetError):
                    return Ended(True)
        finally:
            for open_wire in self._wires.values():
                await open_wire.close()

    async def _live_until(self, moment: float) -> None:
        left = moment - self._world.clock.now()
        if left > 0:
            await self._world.clock.sleep(left)

    async def _answer(self, what: str, wire: int, data: Any) -> Any:
        if what == "say" and data[0] == LOOKED:
            self.looked = memory_of(self._world)
        elif what == "say":
            self._world.person.hear(*data)
        elif what == "open":
            self._wires[wire] = await open_transport(URL, self._world.clock, 5.0)
        elif what == "close":
            await self._wires.pop(wire).close()
        else:
            return await self._ask(self._wires[wire], data)
        return b""

    async def _ask(self, wire: ByteTransport, data: bytes) -> bytes | None:
        """The reply to one request; a PLC answers within its turn, or not at all."""
        try:
            await wire.write(data)
            reading = asyncio.ensure_future(wire.read(4096))
            for _ in range(_TURNS):
                await asyncio.sleep(0)  # noqa: TID251 - a turn of the loop, no time
                if reading.done():
                    return reading.result()
            reading.cancel()
            raise AssertionError("the PLC did not answer at once")
        except TransportError:
            return None


# ---- what a gateway does ---------------------------------------------------------------------------


async def pushing(scene: Scene, context: PushContext, base: LiveSet) -> Any:
    """A push as a run makes it: noted in the audit before, and after."""
    root = context.journals.parent
    audit.record(root, "push-start", clock=context.clock, serial=context.machine.serial)
    record = await push_table(change_of(scene, base), context)
    audit.note(root, f"push-{record.outcome}", clock=context.clock, transaction=record.transaction)
    return record.outcome


async def recovering(_scene: Scene, context: PushContext, _base: LiveSet) -> Any:
    """Start, look, tell, and carry out what is offered: (codes found, outcomes)."""
    root, serial = context.journals.parent, context.machine.serial
    journal.set_ended_aside(journal.machine_folder(context.journals, serial))
    found = [await inspect_unfinished(one, context) for one in unfinished_tables(context.journals, serial)]
    context.say(LOOKED)
    outcomes = []
    for one in unfinished_tables(context.journals, serial):
        record = await recover_table(one, context)
        audit.note(root, f"recover-{record.outcome}", clock=context.clock, transaction=record.transaction)
        outcomes.append(record.outcome)
    return [finding.code for finding in found], outcomes
