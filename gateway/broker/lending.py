"""The broker's side: who asks with the right token gets the devices, is heard while he has them, and may be stopped."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.message import fields_from_data
from gateway.broker.lines import LONGEST, heard, line
from gateway.broker.notice import BrokerNotice, noticed
from gateway.errors import BusyError
from gateway.say import Say

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
                    notices.enter_context(noticed(root, notice))
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
            asked = await self._asked(reader)
            if asked is not None and asked.get("ping"):
                writer.write(line({"alive": True}))
            elif asked is not None:
                await self._lent(asked, reader, writer)
            await writer.drain()
        except OSError:
            pass  # the borrower is gone; what it had was taken back
        finally:
            writer.close()

    async def _asked(self, reader: asyncio.StreamReader) -> dict[str, Any] | None:
        """The first line of who knows the token; None of anybody else."""
        with contextlib.suppress(DeadlineExceeded):
            async with self._clock.deadline(ASKING_S, "broker"):
                asked = await heard(reader)
                token = str((asked or {}).get("token", "")).encode("utf-8", "replace")
                return asked if secrets.compare_digest(token, self._token.encode("ascii")) else None
        return None

    async def _lent(self, asked: Mapping[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        root, run, who = (str(asked.get(name, "")) for name in ("root", "run", "who"))
        lease = Lease(root, run, who, stop=lambda by: writer.write(line({"stop": by})))
        with _ended(lease):
            try:
                await self._lend(lease)
            except TrueflankError as error:
                writer.write(line({"busy": isinstance(error, BusyError), **error.as_record()}))
                return
            writer.write(line({"granted": True}))
            await writer.drain()
            while (said := await heard(reader)) is not None:
                _pass_on(lease, said)


@contextlib.contextmanager
def _ended(lease: Lease) -> Iterator[None]:
    try:
        yield
    finally:
        lease.ended.set()


def _pass_on(lease: Lease, said: Mapping[str, Any]) -> None:
    code, fields = said.get("code"), said.get("fields")
    if lease.say is not None and isinstance(code, str) and isinstance(fields, dict):
        with contextlib.suppress(ValueError):  # no word of ours
            lease.say(code, **fields_from_data(fields))
