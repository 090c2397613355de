"""What a deadline must do, whatever the order of timer, answer and cancel in one turn of the loop: plain asyncio only.

`python -m tests.unit.ground.deadlines` plays every case under any Python from 3.11 on and prints how many there were;
the first that goes wrong ends it with a traceback. It needs nothing but the standard library and `drivers`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import sys
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from typing import Any

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeadlineExceeded, DeviceRefused

LIMIT_S = 2.0
Future = asyncio.Future[Any]
Inside = Callable[[Future], Awaitable[Any]]
EVENTS = ("timer", "answer", "cancel")


class WithResult(asyncio.CancelledError):
    """A cancel that a library raises as a class of its own, as `wait_for2` does."""


# ---- what may stand inside a deadline: how a library treats the cancel that the deadline sends ----------


async def plainly(answer: Future) -> Any:
    """No library at all."""
    return await answer


async def as_own_class(answer: Future) -> Any:
    """A cancel comes out as a class of the library's own."""
    try:
        return await answer
    except asyncio.CancelledError as error:
        raise WithResult(None) from error


async def swallowed(answer: Future) -> Any:
    """A cancel is taken for the end of waiting, as 3.11's `wait_for` does where the answer is there too."""
    with contextlib.suppress(asyncio.CancelledError):
        return await answer
    return "swallowed"


async def swallowed_then_more(answer: Future) -> Any:
    """The same, and the block then goes on to something that fails."""
    found = await swallowed(answer)
    await asyncio.sleep(0)  # noqa: TID251 - plain asyncio
    if found == "swallowed":
        raise KeyError("what a later line made of it")
    return found


async def as_error(answer: Future) -> Any:
    """A cancel comes out as an error."""
    try:
        return await answer
    except asyncio.CancelledError:
        raise ConnectionError("the library closed its connection") from None


async def as_our_error(answer: Future) -> Any:
    """A cancel comes out as an error of ours, made on the way out."""
    try:
        return await answer
    except asyncio.CancelledError as error:
        raise DeviceRefused("E-LINK-SEAT", "library") from error


async def in_a_task(answer: Future) -> Any:
    """The library waits in a task of its own."""
    return await asyncio.ensure_future(plainly(answer))


async def by_wait_for(answer: Future) -> Any:
    """The library has a limit of its own, far away."""
    return await asyncio.wait_for(answer, 1000.0)  # noqa: TID251 - the library's


async def nested(answer: Future) -> Any:
    """A deadline in the deadline, for the same moment."""
    async with LoopClock().deadline(LIMIT_S, "inner"):
        return await answer


LIBRARIES: tuple[Inside, ...] = (
    plainly, as_own_class, swallowed, swallowed_then_more, as_error, as_our_error, in_a_task, by_wait_for, nested,
)  # fmt: skip


# ---- one case ------------------------------------------------------------------------------------------


def orders() -> Iterator[tuple[str, ...]]:
    """Every order in which some of timer, answer and a cancel from outside may come in one turn of the loop."""
    for count in range(1, len(EVENTS) + 1):
        yield from itertools.permutations(EVENTS, count)


async def case(library: Inside, order: tuple[str, ...], *, refused: bool) -> str:
    """How the block ended: "answer", "deadline", "cancel" or the name of what came out instead."""
    loop = asyncio.get_running_loop()
    answer: Future = loop.create_future()
    started = asyncio.Event()

    async def block() -> str:
        clock = LoopClock()
        started.set()
        try:
            async with clock.deadline(LIMIT_S, "block"):
                await library(answer)
        except DeadlineExceeded as error:
            outcome = "deadline" if (error.code, error.where) == ("E-LINK-DEADLINE", "block") else str(error)
        except DeviceRefused:
            outcome = "refused"
        except asyncio.CancelledError:
            task = asyncio.current_task()
            assert task is not None
            assert task.cancelling() == 1, "only the cancel from outside is left"
            raise
        else:
            outcome = "answer"
        await nothing_follows()
        return outcome

    task = asyncio.ensure_future(block())
    await started.wait()
    due = loop.time() + LIMIT_S
    acts: dict[str, Callable[[], Any]] = {
        "answer": lambda: tell(answer, refused=refused),
        "cancel": task.cancel,
    }
    # Timers of one moment run in the order of their times: a hair before or after is the same turn of the loop.
    at = {name: due + 1e-12 * (place - order.index("timer")) for place, name in enumerate(order) if "timer" in order}
    for name in order:
        if name != "timer":
            loop.call_at(at.get(name, due - 1.0), acts[name])
    try:
        return await task
    except asyncio.CancelledError:
        return "cancel"
    finally:
        answer.cancel()


def tell(answer: Future, *, refused: bool) -> None:
    """The answer comes, if anybody still waits for it."""
    if not answer.done():
        if refused:
            answer.set_exception(DeviceRefused("E-LINK-SEAT", "device"))
        else:
            answer.set_result("answer")


async def nothing_follows() -> None:
    """No cancel of the deadline's own may reach what is awaited afterwards."""
    task = asyncio.current_task()
    assert task is not None
    assert task.cancelling() == 0, "the deadline's cancel is still counted"
    await asyncio.sleep(0)  # noqa: TID251 - plain asyncio
    await asyncio.sleep(3.0 * LIMIT_S)  # noqa: TID251 - plain asyncio


def allowed(order: tuple[str, ...], refused: bool) -> set[str]:
    """What may come of these events: nothing else, and no foreign exception ever."""
    answered = {"refused"} if refused else {"answer"}
    if "cancel" in order:
        # Whoever wants the task to end gets its end; an answer or a limit of the same turn may be quicker.
        return {"cancel", *(answered if "answer" in order else ())} | ({"deadline"} if "timer" in order else set())
    return {"deadline"} if "timer" in order else answered


def play() -> int:
    """Every library with every order; the number of cases."""
    count = 0
    for library, order, refused in itertools.product(LIBRARIES, orders(), (False, True)):
        if library is swallowed_then_more and "cancel" in order:
            continue  # an error of a later line says nothing of the cancel from outside
        found = run_virtual(lambda library=library, order=order, refused=refused: ended(library, order, refused))
        told = f"{library.__name__} with {' '.join(order)}{' refused' if refused else ''} on {sys.version.split()[0]}"
        assert found in allowed(order, refused), f"{told}: {found}"
        count += 1
    return count


def ended(library: Inside, order: tuple[str, ...], refused: bool) -> Coroutine[Any, Any, str]:
    """One case, its unexpected exceptions by name."""

    async def main() -> str:
        try:
            return await asyncio.wait_for(case(library, order, refused=refused), 100.0)  # noqa: TID251
        except Exception as error:  # noqa: BLE001 - whatever it is, it is told
            return f"{type(error).__name__}: {error}"

    return main()


if __name__ == "__main__":
    print(f"deadlines: {play()} cases on {sys.version_info[0]}.{sys.version_info[1]}")
