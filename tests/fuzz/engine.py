"""Coverage-guided fuzzing without a library: damage an input, keep it where it went a way that none went before.

The way of an input is the set of steps from line to line in our own code, told by the interpreter's trace. Kept inputs
are damaged further, so that the search goes deeper than damage of the seeds alone. Steps are also the measure of time:
a computer that is busy changes nothing. Where a search inside the C library takes long, processor time ends it.

The invariant: every input gives a result or one of our errors, within `STEPS` and a share for each byte; any other
exception is a finding.
"""

from __future__ import annotations

import hashlib
import random
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from drivers.errors import TrueflankError
from tests.unit.drivers.mutations import mutate

OURS = ("/drivers/", "/gateway/")
STEPS, STEPS_A_BYTE = 300_000, 2_000
PATIENCE_S = 20.0
LONGEST = 20_000
MOST_KEPT = 400


class Endless(BaseException):
    """An input took more steps, or more of the processor, than any may."""


@dataclass
class Finding:
    """An input that broke the invariant, and how."""

    data: bytes
    why: str

    @property
    def name(self) -> str:
        """Of the file that keeps it."""
        return hashlib.sha256(self.data).hexdigest()[:16]


@dataclass
class Search:
    """What a search has met: ways, inputs kept for them, how inputs ended, and findings."""

    ways: set[int] = field(default_factory=set)
    kept: list[bytes] = field(default_factory=list)
    tried: int = 0
    accepted: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


class _Trace:
    """The ways of one input, and how many steps it took."""

    def __init__(self, limit: int) -> None:
        self.ways: set[int] = set()
        self._left = limit

    def call(self, frame: FrameType, _event: str, _arg: Any) -> Any:
        """The interpreter's hook for a call: only our own code is followed."""
        code = frame.f_code
        if not any(part in code.co_filename for part in OURS):
            return None
        last, ours = 0, hash((code.co_filename, code.co_firstlineno))

        def line(here: FrameType, event: str, _arg: Any) -> Any:
            nonlocal last
            if event == "line":
                self.ways.add(hash((ours, last, here.f_lineno)))
                last = here.f_lineno
                self._left -= 1
                if self._left < 0:
                    raise Endless(f"more than {STEPS} steps and {STEPS_A_BYTE} a byte")
            return line

        return line


@contextmanager
def bounded() -> Iterator[None]:
    """End what takes too long of the processor inside one step: a search of the C library looks for signals."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def over(_signal: int, _frame: Any) -> None:
        raise Endless(f"more than {PATIENCE_S:.0f} s of the processor")

    before = signal.signal(signal.SIGVTALRM, over)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def tried(read: Callable[[bytes], object], data: bytes, found: Search) -> bool:
    """Give one input to a reader; whether it went a new way."""
    trace = _Trace(STEPS + STEPS_A_BYTE * len(data))
    before = sys.gettrace()
    why = ""
    with bounded():
        sys.settrace(trace.call)
        try:
            read(data)
            found.accepted += 1
        except TrueflankError as error:
            found.refused[error.code] = found.refused.get(error.code, 0) + 1
        except (Endless, Exception) as error:  # noqa: BLE001 - that is what is looked for
            why = repr(error)[:400]
        finally:
            sys.settrace(before)
    found.tried += 1
    if why:
        found.findings.append(Finding(data, why))
    new = not trace.ways <= found.ways
    found.ways |= trace.ways
    return new


def damaged(found: Search, rng: random.Random) -> bytes:
    """A kept input, the younger ones more often, damaged; or two of them joined at seeded places."""
    count = len(found.kept)
    data = found.kept[max(rng.randrange(count), rng.randrange(count))]
    if rng.random() < 0.15:
        other = rng.choice(found.kept)
        data = data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = mutate(data, rng)
    return data[:LONGEST]


def search(read: Callable[[bytes], object], seeds: Sequence[bytes], seed: int, going: Callable[[int], bool]) -> Search:
    """Search from the seeds, which must all be read or refused, as long as ``going`` says of the count of tries."""
    rng, found = random.Random(seed), Search()
    for data in seeds:
        tried(read, data, found)
        found.kept.append(data)
    while going(found.tried) and len(found.findings) < 20:
        data = damaged(found, rng)
        if tried(read, data, found) and len(found.kept) < MOST_KEPT:
            found.kept.append(data)
    return found
