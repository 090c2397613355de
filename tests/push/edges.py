"""Pushes in which one value is of the wrong kind, or one answer comes at the very moment of its deadline.

`told(seed, ...)` plays one push, the same each time: values and answers are counted over the whole push.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from asyncua import ua
from asyncua.client.ua_client import UASocketProtocol

from drivers.clock import Deadline, run_virtual
from drivers.errors import TrueflankError
from drivers.link import Link
from drivers.sinumerik.mailbox.wire import ModbusWire
from drivers.sinumerik.opcua.session.client import UaSession
from gateway.push.journal import Journal
from tests.push import schedules, uaschedules
from tests.push.judging import Played
from tests.push.mischief import Mischief
from tests.push.schedules import JumpingClock
from tests.push.uaworld import choice, ua_world
from tests.push.world import world

WRONG: tuple[Any, ...] = (
    [1.5], [], [0.0] * 3, "text", "", b"bytes", None, True, float("inf"), float("-inf"), float("nan"), 10**400, -1, 2.5,
    99, 1e300, {"a": 1}, ua.StatusCode(0x80000000), ua.StatusCode(0x40000000), ua.StatusCode(0x00A60000),
)  # fmt: skip
REGISTERS = (0, 1, 2, 3, 31, 32, 0x7FFF, 0x8000, 0xFFFF)
HAIR_S = 1e-12  # within the resolution of the loop's clock: the same turn


@dataclass
class Count:
    """Acts at the nth of what is counted, once, while it is on."""

    nth: int
    seen: int = 0
    on: bool = False
    hit: str = ""

    def due(self) -> bool:
        """One more; whether it is the one."""
        if self.on:
            self.seen += 1
        return self.on and self.seen == self.nth

    def during(self, task: asyncio.Task[Any]) -> None:
        """Count while a push runs."""
        self.on = True
        task.add_done_callback(lambda _task: setattr(self, "on", False))


# ---- wrong values ------------------------------------------------------------------------------------


@contextlib.contextmanager
def wrong_value(count: Count, wrong: Any, rng: random.Random) -> Iterator[None]:
    """The nth value or output of a method that the server gives is ``wrong``."""
    read, call = UaSession._read, UaSession._call

    async def reading(self: UaSession, wanted: list[Any], what: str, *more: Any, **named: Any) -> list[Any]:
        found = await read(self, wanted, what, *more, **named)
        for place, value in enumerate(found):
            if count.due():
                count.hit = f"{what} {place}"
                found[place] = spoiled(value, wrong, rng)
        return found

    async def calling(self: UaSession, owner: Any, node: Any, name: str, *more: Any) -> list[Any]:
        found = await call(self, owner, node, name, *more)
        if count.due():
            count.hit = name
            found = [] if isinstance(wrong, ua.StatusCode) else [wrong, *found[1:]]
        return found

    UaSession._read, UaSession._call = reading, calling  # type: ignore[method-assign]
    try:
        yield
    finally:
        UaSession._read, UaSession._call = read, call  # type: ignore[method-assign]


def spoiled(value: Any, wrong: Any, rng: random.Random) -> Any:
    """A data value with another status, or another value: in a block all of it or one element."""
    if isinstance(wrong, ua.StatusCode):
        return SimpleNamespace(StatusCode=wrong, Value=value.Value, ServerTimestamp=value.ServerTimestamp)
    held = value.Value.Value if value.Value is not None else None
    if isinstance(held, list) and held and rng.random() < 0.5:
        held = list(held)
        held[rng.randrange(len(held))] = wrong
        wrong = held
    kind = SimpleNamespace(name="Any")
    given = SimpleNamespace(Value=wrong, VariantType=kind)
    return SimpleNamespace(StatusCode=value.StatusCode, Value=given, ServerTimestamp=value.ServerTimestamp)


@contextlib.contextmanager
def wrong_register(count: Count, wrong: int, only: int | None = None) -> Iterator[None]:
    """The nth register (of all, or of one address) that the PLC gives is ``wrong``: out of range, or nothing there."""
    read = ModbusWire.read

    async def reading(self: ModbusWire, address: int, number: int) -> tuple[int, ...]:
        found = list(await read(self, address, number))
        for place in range(len(found)):
            if only in (None, address + place) and count.due():
                count.hit = f"register {address + place}"
                found[place] = wrong
        return tuple(found)

    ModbusWire.read = reading  # type: ignore[method-assign]
    try:
        yield
    finally:
        ModbusWire.read = read  # type: ignore[method-assign]


# ---- answers at their deadline ------------------------------------------------------------------------


@dataclass
class Limits:
    """The deadlines that are running now."""

    running: list[Deadline] = field(default_factory=list)

    def next_s(self, task: Any) -> float | None:
        """When the first of a task's own ends."""
        timers = (one._timer for one in self.running if one._task is task)
        return min((timer.when() for timer in timers if isinstance(timer, asyncio.TimerHandle)), default=None)

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Know of every deadline made inside the block."""
        enter, leave = Deadline.__aenter__, Deadline.__aexit__

        async def entering(one: Deadline) -> None:
            await enter(one)
            self.running.append(one)

        async def leaving(one: Deadline, *why: Any) -> None:
            self.running.remove(one)
            await leave(one, *why)

        Deadline.__aenter__, Deadline.__aexit__ = entering, leaving  # type: ignore[method-assign]
        try:
            yield
        finally:
            Deadline.__aenter__, Deadline.__aexit__ = enter, leave  # type: ignore[method-assign]


@contextlib.contextmanager
def at_the_deadline(count: Count, hair_s: float) -> Iterator[None]:
    """The nth answer is delivered in the very turn of the loop in which its deadline ends, a hair before or after."""
    limits, asking = Limits(), dict[Any, Any]()
    send, opcua, ask, modbus = (
        UASocketProtocol._send_request, UASocketProtocol._call_callback, Link._ask, Link._deliver,
    )  # fmt: skip

    def late(deliver: Callable[[], None], question: Any) -> bool:
        when = limits.next_s(asking.pop(question, None))
        if when is None or not count.due():
            return False
        count.hit = "an answer"
        asyncio.get_running_loop().call_at(when + hair_s, deliver)
        return True

    def sent(self: Any, *what: Any, **more: Any) -> Any:
        found = send(self, *what, **more)
        asking[id(self), self._request_id] = asyncio.current_task()
        return found

    def answered(self: Any, number: int, body: Any) -> None:
        if not late(lambda: opcua(self, number, body), (id(self), number)):
            opcua(self, number, body)

    async def asked(self: Any, question: Any, data: bytes) -> Any:
        asking[id(self)] = asyncio.current_task()
        return await ask(self, question, data)

    def delivered(self: Any, message: Any) -> None:
        def deliver() -> None:
            with contextlib.suppress(TrueflankError):  # a stray answer ends the reader; here nobody reads
                modbus(self, message)

        if not late(deliver, id(self)):
            modbus(self, message)

    UASocketProtocol._send_request, UASocketProtocol._call_callback = sent, answered  # type: ignore[method-assign]
    Link._ask, Link._deliver = asked, delivered  # type: ignore[method-assign]
    try:
        with limits.watched():
            yield
    finally:
        UASocketProtocol._send_request, UASocketProtocol._call_callback = send, opcua  # type: ignore[method-assign]
        Link._ask, Link._deliver = ask, modbus  # type: ignore[method-assign]


# ---- entries of the journal ------------------------------------------------------------------------------


def raised(rng: random.Random) -> BaseException:
    """A bug, a disk, or a cancel that somebody of ours let slip: nobody from outside wants the push to end."""
    made: tuple[BaseException, ...] = (
        TypeError("a bug"),
        ValueError("a bug"),
        KeyError("a bug"),
        OverflowError("a bug"),
        RecursionError("a bug"),
        OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
        OSError(errno.EIO, os.strerror(errno.EIO)),
        TimeoutError("a limit"),
        asyncio.CancelledError("ours"),
        ExceptionGroup("two bugs", [TypeError("one"), OSError(5, "two")]),
    )
    return rng.choice(made)


@contextlib.contextmanager
def failing_entry(count: Count, error: BaseException, *, after: bool) -> Iterator[None]:
    """The nth entry of the journal raises, before or after it is on the disk; a full disk refuses `close` as well."""
    append, close = Journal.append, Journal._let_go

    def appending(self: Journal, kind: str, **facts: object) -> None:
        due = count.due()
        if due and not after:
            count.hit = kind
            raise error
        append(self, kind, **facts)
        if due:
            count.hit = f"{kind} noted"
            raise error

    def closing(self: Journal) -> None:
        close(self)
        if count.hit and isinstance(error, OSError):
            raise error

    Journal.append, Journal._let_go = appending, closing  # type: ignore[method-assign]
    try:
        yield
    finally:
        Journal.append, Journal._let_go = append, close  # type: ignore[method-assign]


# ---- one push ------------------------------------------------------------------------------------------


def played_opcua(seed: int, folder: Path, keys: Path, count: Count, around: Any) -> Played:
    """One push over OPC UA with ``around`` in force; judged, recovered and judged again."""
    made = uaschedules.Schedule(random.Random(seed))
    made.begin.append(lambda _at, _made, task: count.during(task))
    found = Played(seed)
    folder.mkdir(parents=True)

    async def main() -> None:
        clock = JumpingClock()
        async with ua_world(clock, keys, choice(made.rng)) as at:
            await uaschedules._play(made, at, folder, found)

    with around:
        run_virtual(main)
    found.faults.append(f"{count.hit or 'nothing'} ({count.nth} of {count.seen})")
    return found


def played_mailbox(seed: int, folder: Path, count: Count, around: Any) -> Played:
    """The same through the mailbox; every third table is a cross table."""
    rng = random.Random(seed)
    made = schedules.Schedule(rng)
    made.scene = replace(made.scene, cross=seed % 3 == 2, strict=seed % 2 == 1)
    made.late.append(lambda _at, _bad, task: count.during(task))
    found = Played(seed)
    folder.mkdir(parents=True)

    async def main() -> None:
        clock = JumpingClock()
        bad = Mischief(clock, random.Random(seed + 1))
        async with world(made.scene, clock, bad.around) as at:
            await schedules._play(made, at, bad, folder, found)

    with around:
        run_virtual(main)
    found.faults.append(f"{count.hit or 'nothing'} ({count.nth} of {count.seen})")
    return found
