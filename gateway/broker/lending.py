"""The broker's side: who asks with the right token gets the devices, is heard while he has them, and may be stopped.

The serving gateway leaves a notice (process, port, token of the day) in each state folder and listens on loopback. A
command sends the token, then both sides exchange one JSON object a line, each of bounded length. When the connection
ends, the devices are the gateway's again.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.local.ownfiles import open_own, read_own
from drivers.message import fields_from_data
from gateway.errors import BusyError, StoreError
from gateway.say import Say

# The broker's side: who asks with the right token gets the devices, is heard while he has them, and may be stopped.

LOOPBACK = "127.0.0.1"
ASKING_S = 5.0


@dataclass(slots=True)
class Lease:
    """One borrowing: by whom, for which run of which state folder. ``stop`` asks the borrower to end."""

    root: str
    run: str
    who: str
    stop: Callable[[str], None] = lambda _by: None
    say: Say | None = None
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    async def over(self) -> None:
        """Wait until the borrower gives the devices back, or is gone."""
        await self.ended.wait()


Lend = Callable[[Lease], Awaitable[None]]
"""Lets go of the devices of a lease and returns once they are free. Raises BusyError, ConfigError."""


class Broker:
    """Listens on loopback for commands of the same computer."""

    def __init__(self, lend: Lend, clock: Clock) -> None:
        self._lend = lend
        self._clock = clock
        self._token = secrets.token_urlsafe(32)
        self._talks: set[asyncio.Task[None]] = set()

    @asynccontextmanager
    async def open(self, roots: tuple[Path, ...]) -> AsyncIterator[None]:
        """Listen while the block lasts, told to all by a notice in each state folder. Raises StoreError."""
        server = await asyncio.start_server(self._begin, LOOPBACK, 0, limit=LONGEST)
        notice = BrokerNotice(os.getpid(), server.sockets[0].getsockname()[1], self._token)
        try:
            with ExitStack() as notices:
                for root in dict.fromkeys(roots):
                    notices.enter_context(leave_notice(root, notice))
                yield
        finally:
            server.close()
            for talk in self._talks:
                talk.cancel()
            await asyncio.gather(*self._talks, return_exceptions=True)

    def _begin(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        talk = asyncio.create_task(self._talk(reader, writer), name="lease")
        self._talks.add(talk)
        talk.add_done_callback(self._talks.discard)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            asked = await self._authenticated_request(reader)
            if asked is not None and asked.get("ping"):
                writer.write(object_line({"alive": True}))
            elif asked is not None:
                await self._lent(asked, reader, writer)
            await writer.drain()
        except OSError:
            pass  # the borrower is gone; what it had was taken back
        finally:
            writer.close()

    async def _authenticated_request(self, reader: asyncio.StreamReader) -> dict[str, Any] | None:
        """The first line of who knows the token; None of anybody else."""
        with contextlib.suppress(DeadlineExceeded):
            async with self._clock.deadline(ASKING_S, "broker"):
                asked = await read_object(reader)
                token = str((asked or {}).get("token", "")).encode("utf-8", "replace")
                return asked if secrets.compare_digest(token, self._token.encode("ascii")) else None
        return None

    async def _lent(self, asked: Mapping[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        root, run, who = (str(asked.get(name, "")) for name in ("root", "run", "who"))
        lease = Lease(root, run, who, stop=lambda by: writer.write(object_line({"stop": by})))
        with _borrower_ended(lease):
            try:
                await self._lend(lease)
            except TrueflankError as error:
                writer.write(object_line({"busy": isinstance(error, BusyError), **error.as_record()}))
                return
            writer.write(object_line({"granted": True}))
            await writer.drain()
            while (said := await read_object(reader)) is not None:
                _pass_on(lease, said)


@contextlib.contextmanager
def _borrower_ended(lease: Lease) -> Iterator[None]:
    try:
        yield
    finally:
        lease.ended.set()


def _pass_on(lease: Lease, said: Mapping[str, Any]) -> None:
    code, fields = said.get("code"), said.get("fields")
    if lease.say is not None and isinstance(code, str) and isinstance(fields, dict):
        with contextlib.suppress(ValueError):  # no word of ours
            lease.say(code, **fields_from_data(fields))


# One JSON object a line in both directions, each of bounded length; what is none ends the conversation.

LONGEST = 1 << 16


def object_line(data: Mapping[str, object]) -> bytes:
    """An object as a line."""
    return json.dumps(data, default=str, separators=(",", ":")).encode("ascii") + b"\n"


async def read_object(reader: asyncio.StreamReader) -> dict[str, Any] | None:
    """The next object; None once the other side has left, or said something that is none."""
    try:
        text = await reader.readline()
        said = json.loads(text) if text.endswith(b"\n") else None
    except (OSError, ValueError, RecursionError):  # a line too long is a ValueError
        return None
    return said if isinstance(said, dict) else None


# The notice that a serving gateway leaves in each of its state folders: its process, port and password of the day.

NOTICE_FILE = "broker.json"
LARGEST = 4096


@dataclass(frozen=True, slots=True)
class BrokerNotice:
    """Where a broker listens on loopback; ``token`` is drawn anew at each start."""

    pid: int
    port: int
    token: str


def notice_of(root: Path) -> BrokerNotice | None:
    """The notice in a state folder; None where nobody left one, or it cannot be read as one."""
    try:
        kept = json.loads(read_own(root / NOTICE_FILE)[:LARGEST])
        return BrokerNotice(int(kept["pid"]), int(kept["port"]), str(kept["token"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


@contextmanager
def leave_notice(root: Path, notice: BrokerNotice) -> Iterator[None]:
    """Leave the notice while the block lasts; for its owner's eyes alone. Raises StoreError (E-WEB-STATE)."""
    path = root / NOTICE_FILE
    try:
        path.unlink(missing_ok=True)
        with open_own(path, "xb", secret=True) as file:
            file.write(json.dumps(asdict(notice)).encode("ascii"))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise StoreError("E-WEB-STATE", str(path), why=error.strerror or str(error)) from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
