"""Virtual time: it stands still while anything runs, jumps when nothing can, and follows real sockets."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future

import pytest

from drivers.clock import LoopClock, run_virtual, virtual
from drivers.errors import DeadlineExceeded


def test_an_hour_passes_at_once_and_in_order() -> None:
    async def main() -> list[tuple[str, float]]:
        clock = LoopClock()
        start = clock.now()
        seen: list[tuple[str, float]] = []

        async def wait(name: str, seconds: float) -> None:
            await clock.sleep(seconds)
            seen.append((name, round(clock.now() - start, 6)))

        await asyncio.gather(wait("late", 3600.0), wait("early", 0.5), wait("middle", 60.0))
        return seen

    assert run_virtual(main) == [("early", 0.5), ("middle", 60.0), ("late", 3600.0)]


def test_speed_multiplies_time_and_divides_waits() -> None:
    async def main() -> tuple[float, float]:
        slow, fast = LoopClock(), LoopClock(speed=100.0)
        before = slow.now(), fast.now()
        await fast.sleep(500.0)
        return slow.now() - before[0], fast.now() - before[1]

    real, cell = run_virtual(main)
    assert real == pytest.approx(5.0)
    assert cell == pytest.approx(500.0)


def test_a_changed_speed_goes_on_from_where_the_clock_stood() -> None:
    async def main() -> list[float]:
        wall, cell = LoopClock(), LoopClock(speed=100.0)
        seen, start = [cell.now()], wall.now()
        for speed in (2.0, 100.0):
            await wall.sleep(10.0)
            cell.change_speed(speed)
            seen.append(cell.now())
        await cell.sleep(50.0)
        return [*seen, cell.now(), wall.now() - start]

    assert run_virtual(main) == pytest.approx([0.0, 1000.0, 1020.0, 1070.0, 20.5])


@pytest.mark.parametrize("speed", [0.0, -1.0])
def test_a_clock_that_does_not_run_forward_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        LoopClock(speed)
    with pytest.raises(ValueError, match="positive"):
        LoopClock().change_speed(speed)


def test_a_deadline_is_ours_and_names_the_place() -> None:
    async def main() -> None:
        clock = LoopClock()
        async with clock.deadline(2.0, "laser"):
            await clock.sleep(3.0)

    with pytest.raises(DeadlineExceeded, match=r"E-LINK-DEADLINE \[laser\].*2\.0 s"):
        run_virtual(main)


def test_a_cancel_from_outside_is_not_taken_for_a_deadline() -> None:
    async def main() -> bool:
        clock = LoopClock()

        async def work() -> None:
            async with clock.deadline(10.0, "laser"):
                await clock.sleep(5.0)

        task = asyncio.create_task(work())
        await clock.sleep(1.0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return task.cancelled()

    assert run_virtual(main)


def test_time_stands_still_while_a_thread_works() -> None:
    release = threading.Event()

    async def main() -> float:
        clock = LoopClock()
        start = clock.now()
        loop = asyncio.get_running_loop()
        work = loop.run_in_executor(None, release.wait, 5.0)
        sleeper = asyncio.create_task(clock.sleep(1000.0))
        loop.call_soon(release.set)
        await work
        passed = clock.now() - start
        sleeper.cancel()
        await asyncio.gather(sleeper, return_exceptions=True)
        return passed

    assert run_virtual(main) == 0.0


def test_a_loopback_socket_answers_within_virtual_time() -> None:
    async def main() -> tuple[list[bytes], float]:
        clock = LoopClock()

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            while line := await reader.readline():
                await clock.sleep(10.0)
                writer.write(b"re " + line)
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        start, got = clock.now(), []
        for index in range(20):
            writer.write(b"%d\n" % index)
            got.append(await reader.readline())
        passed = clock.now() - start
        writer.close()
        await writer.wait_closed()
        server.close()
        await server.wait_closed()
        return got, passed

    got, passed = run_virtual(main)
    assert got == [b"re %d\n" % index for index in range(20)]
    assert passed == pytest.approx(200.0, abs=1.0)


def test_a_thread_that_works_on_a_starved_computer_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four waits in vain: three in which the process spent time, and one in which nothing did."""
    spent = iter([0.0, 0.5, 0.5, 1.0, 1.0, 1.5, 1.5, 1.5])
    monkeypatch.setattr(virtual, "SPENT", lambda: next(spent))
    monkeypatch.setattr(virtual, "PATIENCE_S", 0.0)
    waits: Future[None] = Future()
    assert virtual._unfinished([waits]) == {waits}
    assert next(spent, None) is None
