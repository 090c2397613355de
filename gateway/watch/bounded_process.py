"""Work on foreign bytes in a process of its own, within bounds: a file must take neither a core nor the memory."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection

from drivers.errors import FileFormatError, TrueflankError

CPU_S = 120
MEMORY_MB = 4096
LONGEST_S = 900.0
NICE = 10


def run_bounded(work: Callable[[], str], *, where: str, cpu_s: int = CPU_S, memory_mb: int = MEMORY_MB) -> str:
    """What ``work`` returns in a new process that yields to all others; it must be picklable.

    Raises what ``work`` raises of ours; FileFormatError (E-WATCH-LIMIT) where
    the process took more than ``cpu_s`` of a processor or ``memory_mb``, or ended without an answer. Windows bounds
    only how long it is waited for.
    """
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_child_process, args=(theirs, cpu_s, memory_mb, work), daemon=True)
    answer: object = None
    with ours:
        child.start()
        theirs.close()
        try:
            with contextlib.suppress(EOFError):
                answer = ours.recv() if ours.poll(LONGEST_S) else None
        finally:
            child.kill()
            child.join()
    if isinstance(answer, TrueflankError):
        raise answer
    if not isinstance(answer, str):
        raise FileFormatError("E-WATCH-LIMIT", where, seconds=cpu_s, megabytes=memory_mb)
    return answer


def _child_process(told: Connection, cpu_s: int, memory_mb: int, work: Callable[[], str]) -> None:
    if os.name == "posix":
        import resource  # noqa: PLC0415 - there is none elsewhere

        os.nice(NICE)
        for kind, most in ((resource.RLIMIT_CPU, cpu_s), (resource.RLIMIT_AS, memory_mb << 20)):
            with contextlib.suppress(ValueError, OSError):  # a lower limit of the system holds already
                resource.setrlimit(kind, (most, most))
    with contextlib.suppress(MemoryError):
        try:
            told.send(work())
        except TrueflankError as error:
            told.send(error)
