"""The command's side: ask the gateway that serves this state folder for the devices, tell what happens, give back."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TransportError
from drivers.message import Message, digits, fields_as_data
from gateway import audit, stopping
from gateway.broker.lending import LONGEST, LOOPBACK, BrokerNotice, notice_of, object_line, read_object
from gateway.broker.state_folder import hold_folder_lock, is_locked
from gateway.errors import BusyError
from gateway.say import Say, silence

ANSWER_S = 20.0
ALIVE_S = 3.0
ENDING_S = 3.0
LOOK_S = 0.1

_Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]
_taking: ContextVar[str] = ContextVar("why devices are taken", default="")
_held: ContextVar[bool] = ContextVar("devices are held", default=False)


@contextmanager
def take_from_hung_gateway(why: str) -> Iterator[None]:
    """In the block devices are taken from a gateway that does not answer; ``why`` goes into the audit log; "": not."""
    before = _taking.set(why)
    try:
        yield
    finally:
        _taking.reset(before)


@contextmanager
def devices_are_own() -> Iterator[None]:
    """In the block the devices are this process' own: nobody is asked for them."""
    before = _held.set(True)
    try:
        yield
    finally:
        _held.reset(before)


@asynccontextmanager
async def borrow_devices(root: Path, run: str, clock: Clock, say: Say = silence) -> AsyncIterator[Say]:
    """Have the devices while the block lasts; gives the `Say` to use in it. Without a serving gateway: at once.

    Raises BusyError (E-BROKER-BUSY) saying who has them, TransportError (E-BROKER-SILENT) where the gateway does not
    answer, BusyError (E-BROKER-ANSWERS) where devices are to be taken from one that does.
    """
    notice = None if _held.get() else notice_of(root)
    if notice is None:
        yield say
        return
    if why := _taking.get():
        async with _take_over(root, notice, clock, why):
            yield say
        return
    talk = await _connect(notice)
    if talk is None:
        yield say  # a notice that a killed process left: nobody listens
        return
    async with _with_lease(talk, notice, clock, root=root, run=run) as writer:
        yield _heard_by(writer, say)


async def _connect(notice: BrokerNotice) -> _Connection | None:
    try:
        return await asyncio.open_connection(LOOPBACK, notice.port, limit=LONGEST)
    except OSError:
        return None


@asynccontextmanager
async def _with_lease(
    talk: _Connection, notice: BrokerNotice, clock: Clock, *, root: Path, run: str
) -> AsyncIterator[asyncio.StreamWriter]:
    reader, writer = talk
    listening: asyncio.Task[None] | None = None
    try:
        asked = {"token": notice.token, "root": str(root), "run": run, "who": audit.acting_person()}
        answer = await _answer(talk, clock, asked, ANSWER_S)
        if answer is None:
            raise TransportError("E-BROKER-SILENT", str(root), pid=notice.pid, seconds=digits(ANSWER_S, 6))
        if not answer.get("granted"):
            raise BusyError("E-BROKER-BUSY", str(root), why=str(answer.get("what", Message.of("W-BROKER-NO-WHY"))))
        listening = asyncio.create_task(_obey_stops(reader), name="lease")
        yield writer
    finally:
        if listening is not None:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)
        writer.close()


async def _answer(
    talk: _Connection, clock: Clock, asked: Mapping[str, object], timeout_s: float
) -> dict[str, object] | None:
    """What the gateway answers; None where it does not, in time."""
    reader, writer = talk
    with contextlib.suppress(DeadlineExceeded, OSError):
        async with clock.deadline(timeout_s, "broker"):
            writer.write(object_line(asked))
            await writer.drain()
            return await read_object(reader)
    return None


async def _obey_stops(reader: asyncio.StreamReader) -> None:
    """Heed a stop that somebody asks for at the page. A gateway that is gone changes nothing: the work goes on."""
    stop = stopping.current()
    while (said := await read_object(reader)) is not None:
        if by := said.get("stop"):
            stop.ask(str(by))


def _heard_by(writer: asyncio.StreamWriter, say: Say) -> Say:
    def told(code: str, /, **fields: object) -> None:
        say(code, **fields)
        text = object_line({"code": code, "fields": fields_as_data(fields)})
        if not writer.is_closing() and len(text) <= LONGEST:
            writer.write(text)

    return told


@asynccontextmanager
async def _take_over(root: Path, notice: BrokerNotice, clock: Clock, why: str) -> AsyncIterator[None]:
    """End a gateway that hangs and hold its lock, so that a service that starts it again cannot come between."""
    talk = await _connect(notice)
    if talk is not None:
        alive = await _answer(talk, clock, {"token": notice.token, "ping": True}, ALIVE_S)
        talk[1].close()
        if alive is not None:
            raise BusyError("E-BROKER-ANSWERS", str(root), pid=notice.pid)
    audit.record(root, "devices-taken", clock=clock, details={"why": why, "from": notice.pid})
    await _end_process(root, notice.pid, clock)
    with hold_folder_lock(root):
        yield


async def _end_process(root: Path, pid: int, clock: Clock) -> None:
    """End the process that holds the folder's lock: asked first, then killed. Raises BusyError (E-WEB-LOCKED)."""
    for number in (signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM)):
        if not is_locked(root, by=pid):
            return
        with contextlib.suppress(OSError):
            os.kill(pid, number)
        until = clock.now() + ENDING_S
        while is_locked(root, by=pid) and clock.now() < until:
            await clock.sleep(LOOK_S)
