"""Runs a coroutine on a loop of its own, in virtual or wall time, and proves that nothing is left behind."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from drivers.clock import LoopClock, run_virtual

T = TypeVar("T")
# The standard library's child watcher tells the loop that a child has ended before its own thread ends: a thread that
# is on its way out gets this long, one that stays is a leak.
THREAD_END_S = 5.0


def run_clean(main: Callable[[], Coroutine[Any, Any, T]], *, virtual: bool) -> T:
    """Run `main`; afterwards no task but its own may be alive, and no thread that was not there before."""
    before = set(threading.enumerate())
    left: list[str] = []

    async def watched() -> T:
        try:
            return await main()
        finally:
            await LoopClock().sleep(0)
            others = asyncio.all_tasks() - {asyncio.current_task()}
            left.extend(task.get_name() for task in others)

    result = run_virtual(watched) if virtual else asyncio.run(watched())
    assert left == []
    for thread in set(threading.enumerate()) - before:
        thread.join(THREAD_END_S)
        assert not thread.is_alive(), f"{thread.name} is left"
    return result
