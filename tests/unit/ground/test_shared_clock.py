"""One clock for loops that know each other only by sockets: late threads stand in for late processes."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable, Coroutine
from math import inf
from typing import Any

import pytest

from drivers.clock import HostedTimeLoop, JoinedTimeLoop, LoopClock
from drivers.clock.shared import TimeLimit
from drivers.errors import DeadlineExceeded, TransportError
from drivers.transport import ByteTransport, open_transport, serve

LATE_S = 0.06
END_S = 10.0


def late(wall_s: float) -> None:
    """The processor is somebody else's for so long."""
    threading.Event().wait(wall_s)


class Cell:
    """The host in a thread: a server that thinks 0.3 s about each line, and a clock that ticks every 0.25 s."""

    def __init__(self, speed: float | None = None, late_s: float = 0.0) -> None:
        self._speed, self._late_s = speed, late_s
        self.url, self.address = "", ""
        self.ended = threading.Event()  # the other side of a wire has closed it
        self._loop: HostedTimeLoop
        self._stop = asyncio.Event()
        self._up = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.url.rpartition(":")[2])

    def __enter__(self) -> Cell:
        self._thread.start()
        assert self._up.wait(END_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(END_S)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        self._loop = HostedTimeLoop(self._speed)
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._main())

    async def _main(self) -> None:
        clock = LoopClock()

        async def answer(wire: ByteTransport) -> None:
            with contextlib.suppress(TransportError):
                while line := await wire.read(1 << 10):
                    late(self._late_s)
                    await clock.sleep(0.3)
                    await wire.write(line.upper() * (1 if len(line) < 9 else 5000))
            self.ended.set()

        async def tick() -> None:
            while True:
                await clock.sleep(0.25)

        server = await serve("tcp://127.0.0.1:0", answer, clock)
        self.url, self.address = server.url, self._loop.address
        ticking = asyncio.create_task(tick())
        with self._loop.keeping_up():
            self._up.set()
            await self._stop.wait()
        ticking.cancel()
        await server.close()


async def within(clock: LoopClock, limit_s: float, work: Coroutine[Any, Any, Any]) -> Any:
    """What comes in time. Raises DeadlineExceeded."""
    async with clock.deadline(limit_s, "cell"):
        return await work


def at(cell: Cell, work: Callable[[LoopClock], Coroutine[Any, Any, Any]]) -> Any:
    """What a member finds that joins the cell's clock."""
    with asyncio.Runner(loop_factory=lambda: JoinedTimeLoop(cell.address)) as runner:
        return runner.run(work(LoopClock()))


@pytest.mark.parametrize(("cell_late_s", "member_late_s"), [(0.0, 0.0), (LATE_S, 0.0), (0.0, LATE_S)])
def test_no_deadline_and_no_time_depends_on_who_is_late(cell_late_s: float, member_late_s: float) -> None:
    with Cell(late_s=cell_late_s) as cell:

        async def work(clock: LoopClock) -> list[Any]:
            clock.now()
            wire = await open_transport(cell.url, clock, 1.0)
            seen: list[Any] = []
            for word in (b"a\n", b"b\n", b"0123456789\n"):
                await wire.write(word)
                piece = await within(clock, 0.3001, wire.read(1 << 20))
                late(member_late_s)
                await asyncio.to_thread(late, member_late_s)
                seen.append((len(piece), round(clock.now(), 6)))
                await clock.sleep(100.0)
            await wire.write(b"c\n")
            with pytest.raises(DeadlineExceeded):
                await within(clock, 0.2999, wire.read(1 << 20))
            await wire.close()
            return seen

        assert at(cell, work) == [(2, 0.3), (2, 100.6), (55000, 200.9)]


def test_a_member_that_joins_later_comes_in_at_the_time_it_is() -> None:
    async def work(clock: LoopClock) -> tuple[float, float]:
        began = asyncio.get_running_loop().time()
        await clock.sleep(50.0)
        return began, asyncio.get_running_loop().time()

    with Cell() as cell:
        assert at(cell, work) == (0.0, 50.0)
        assert at(cell, work) == (50.0, 100.0)  # alone, the cell stood still


def test_a_stranger_is_answered_though_nobody_has_joined() -> None:
    with Cell(speed=40.0) as cell, socket.create_connection(("127.0.0.1", cell.port)) as plain:
        plain.sendall(b"a\n")
        assert plain.recv(9) == b"A\n"


def test_time_lost_on_a_busy_computer_is_not_caught_up() -> None:
    walls = iter((100.0, 101.0, 101.01, 101.02, 161.02, 161.03))
    limit = TimeLimit(10.0, lambda: next(walls))
    assert limit.allowed(9.9) == 10.0
    assert limit.allowed(10.0) == pytest.approx(10.1)
    assert limit.wait_s(10.35, 10.1) == pytest.approx(0.025)
    assert limit.allowed(10.1) == pytest.approx(10.2)
    # A minute in which nobody was served counts as a fiftieth of a second.
    assert limit.allowed(10.2) == pytest.approx(10.4)
    assert limit.allowed(10.4) == pytest.approx(10.5)
    assert (TimeLimit(None).allowed(5.0), TimeLimit(None).wait_s(5.0, inf)) == (inf, None)
    with pytest.raises(ValueError, match="positive"):
        TimeLimit(0.0)


def test_what_comes_from_outside_is_answered_by_a_member_that_waits() -> None:
    with Cell(speed=100.0) as cell:

        async def work(_: LoopClock) -> bool:
            asked = asyncio.Event()
            loop = asyncio.get_running_loop()
            threading.Timer(0.02, lambda: loop.call_soon_threadsafe(asked.set)).start()
            return await asked.wait()

        assert at(cell, work)


MEMBER = """
    import asyncio, sys
    from drivers.clock import JoinedTimeLoop, LoopClock

    async def main():
        reader, writer = await asyncio.open_connection("127.0.0.1", int(sys.argv[2]))
        print("in", flush=True)
        if sys.argv[3] == "hangs":
            sys.stdin.readline()
        await LoopClock().sleep(1e6)

    with asyncio.Runner(loop_factory=lambda: JoinedTimeLoop(sys.argv[1])) as runner:
        runner.run(main())
"""


@pytest.mark.parametrize("how", ["hangs", "waits"])
def test_a_process_that_is_killed_holds_nobody(how: str) -> None:
    with Cell() as cell:
        words = [sys.executable, "-c", textwrap.dedent(MEMBER), cell.address, str(cell.port), how]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == b"in\n"

            async def work(clock: LoopClock) -> float:
                clock.now()
                await clock.sleep(10.0)
                return clock.now()

            child.kill()
            assert at(cell, work) == 10.0
        # A member that waits holds nobody even before the kill arrives: the end of its wire may come later than ours.
        assert cell.ended.wait(END_S)


def test_a_member_whose_host_is_gone_goes_on_by_the_walls_clock() -> None:
    async def work(clock: LoopClock) -> float:
        clock.now()
        ending = threading.Thread(target=cell.__exit__)
        wire = await open_transport(cell.url, clock, 1.0)
        await clock.sleep(1.0)
        ending.start()
        with pytest.raises(TransportError):
            await wire.read(1)
        await wire.close()
        await clock.sleep(0.02)
        await asyncio.to_thread(ending.join, END_S)
        return clock.now()

    cell = Cell()
    cell.__enter__()
    assert 0.02 <= at(cell, work) < END_S


def test_a_clock_that_nobody_keeps_cannot_be_joined() -> None:
    with socket.create_server(("127.0.0.1", 0)) as plain:
        port = plain.getsockname()[1]
    with pytest.raises(OSError, match="refused"):
        JoinedTimeLoop(f"127.0.0.1:{port}")


def test_a_serial_port_is_an_uncounted_wire_as_long_as_it_is_open() -> None:
    master, slave = os.openpty()
    loop = HostedTimeLoop()

    async def main() -> list[int]:
        wire = await open_transport(os.ttyname(slave), LoopClock(), 5.0)
        open_ports = loop._turns.uncounted
        await wire.close()
        return [open_ports, loop._turns.uncounted]

    try:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            assert runner.run(main()) == [1, 0]
    finally:
        os.close(master)
        os.close(slave)
