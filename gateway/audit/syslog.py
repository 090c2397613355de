"""Audit records on their way to a server of logs: one message each (RFC 5424), after the last one that was sent.

The audit log itself is the queue: what a server missed while it was away is sent when it is back, and what commands at
a terminal wrote goes too. Over UDP nobody confirms; over TCP a message is known to have left, framed (RFC 6587).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drivers.clock import Clock
from drivers.errors import LinkBroken, TrueflankError
from drivers.local.ownfiles import make_own_folder, open_own, read_own
from gateway.audit.chain import AUDIT, audit_files, head_of_line, read_log_file

FACILITY = 13
"""Log audit."""
NOTICE, WARNING = 5, 4
LOUD = frozenset({"sign-in-refused", "table-differs", "torn-line", "correction"})
BLOCK = "trueflank@32473"
"""32473 is the number that RFC 5612 leaves to whoever has none."""
LONGEST = 8000
EVERY_S, PAUSE_S, ANSWER_S = 1.0, 30.0, 5.0
LAST_SENT_FILE = "syslog.json"
_LOG = logging.getLogger("trueflank.syslog")


def message_of(record: Mapping[str, Any], host: str) -> bytes:
    """A record as one message: head, structured data, and the record itself as JSON behind a byte order mark."""
    severity = WARNING if record["action"] in LOUD else NOTICE
    names = ("seq", "action", "actor", "role", "serial", "transaction", "hash")
    told = " ".join(f'{name}="{_escape(str(record[name]))}"' for name in names if record.get(name))
    clock = str(record.get("clock", {}).get("synchronised", "unknown")).lower()
    about = f'[{BLOCK} {told} synchronised="{_escape(clock)}"]'
    head = f"<{FACILITY * 8 + severity}>1 {record['utc']} {_word(host, 255)} trueflank {record['process']}"
    action = _word(str(record["action"]), 32)
    text = json.dumps({"details": record["details"], "clock": record.get("clock", {})})
    return f"{head} {action} {about} ".encode("ascii") + b"\xef\xbb\xbf" + text.encode("ascii")[:LONGEST]


def _word(text: str, longest: int) -> str:
    """A name of the head: printable ASCII without spaces, "-" for none."""
    return "".join(letter for letter in text if "!" <= letter <= "~")[:longest] or "-"


def _escape(text: str) -> str:
    plain = text.encode("ascii", "backslashreplace").decode("ascii").replace("\\", "\\\\")
    return "".join(letter for letter in plain.replace('"', '\\"').replace("]", "\\]") if " " <= letter <= "~")


class Unsent:
    """The records of a log behind a number; reads only what was added."""

    def __init__(self, root: Path, after: int) -> None:
        self._folder, self.after = root / AUDIT, after
        self._at: dict[str, int] = {}

    def new(self) -> list[dict[str, Any]]:
        """Sound records that were added, in order. Raises StoreError (E-STORE-DISK)."""
        found: list[dict[str, Any]] = []
        for path in audit_files(self._folder):
            at = self._at.get(path.name, 0)
            if path.stat().st_size <= at:
                continue
            data = read_log_file(path)
            *lines, rest = data[at:].split(b"\n")
            self._at[path.name] = len(data) - len(rest)
            records = (json.loads(line) for line in lines if head_of_line(line) is not None)
            found += [record for record in records if record["seq"] > self.after]
        return found


@asynccontextmanager
async def opened_way(address: str, clock: Clock) -> AsyncIterator[Callable[[bytes], Any]]:
    """A way to ``udp://host:514`` or ``tcp://host:514``. Raises LinkBroken (E-SYSLOG-AWAY), DeadlineExceeded."""
    place = urlsplit(address)
    host, port = str(place.hostname), place.port or 514
    try:
        async with clock.deadline(ANSWER_S, address):
            if place.scheme == "udp":
                loop = asyncio.get_running_loop()
                way, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=(host, port))
            else:
                _reader, writer = await asyncio.open_connection(host, port)
    except OSError as error:
        raise LinkBroken("E-SYSLOG-AWAY", address, why=error.strerror or str(error)) from error

    async def by_tcp(message: bytes) -> None:
        try:
            if _reader.at_eof():
                raise LinkBroken("E-SYSLOG-AWAY", address, why="closed")
            writer.write(str(len(message)).encode("ascii") + b" " + message)
            async with clock.deadline(ANSWER_S, address):
                await writer.drain()
        except OSError as error:
            raise LinkBroken("E-SYSLOG-AWAY", address, why=error.strerror or str(error)) from error

    async def by_udp(message: bytes) -> None:
        way.sendto(message)

    try:
        yield by_udp if place.scheme == "udp" else by_tcp
    finally:
        (way if place.scheme == "udp" else writer).close()


async def forward(root: Path, address: str, clock: Clock) -> None:
    """Send every record of the log below ``root``, for ever, from the one after the last that was sent."""
    told = ""
    while True:
        try:
            async with opened_way(address, clock) as send:
                await _forward(root, send, clock)
        except TrueflankError as error:
            if str(error) != told:
                _LOG.warning("%s", error)
            told = str(error)
        await clock.sleep(PAUSE_S)


async def _forward(root: Path, send: Callable[[bytes], Any], clock: Clock) -> None:
    place, host = root / "service" / LAST_SENT_FILE, socket.gethostname()
    unsent = Unsent(root, await asyncio.to_thread(_read_last_sent, place))
    while True:
        for record in await asyncio.to_thread(unsent.new):
            await send(message_of(record, host))
            unsent.after = record["seq"]
            await asyncio.to_thread(_write_last_sent, place, unsent.after)
        await clock.sleep(EVERY_S)


def _read_last_sent(place: Path) -> int:
    try:
        return int(json.loads(read_own(place))["seq"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


def _write_last_sent(place: Path, seq: int) -> None:
    with contextlib.suppress(OSError):  # then a few are sent again, with their numbers
        make_own_folder(place.parent)
        new = place.with_suffix(".new")
        with open_own(new, "wb") as file:
            file.write(json.dumps({"seq": seq}).encode("ascii"))
        os.replace(new, place)
