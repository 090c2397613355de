"""Whether a control can be reached at all: does its name resolve, does its port answer."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from urllib.parse import urlsplit

from drivers.checks import CheckLine, fine, wrong
from drivers.clock import Clock
from drivers.errors import DeadlineExceeded


def host_and_port(url: str, default_port: int) -> tuple[str, int]:
    """Of an address with a scheme. Raises ValueError for a port that is none."""
    parts = urlsplit(url)
    return parts.hostname or "", parts.port or default_port


async def reach(host: str, port: int, clock: Clock, timeout_s: float) -> list[CheckLine]:
    """Lines "name" and "port"; the first that is wrong is the last. Nothing is sent."""
    try:
        async with clock.deadline(timeout_s, host):
            found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError, DeadlineExceeded) as error:
        return [wrong("E-DOC-NAME", "name", host=host, why=str(error))]
    addresses = ", ".join(sorted({str(entry[4][0]) for entry in found}))
    named = addresses != host
    told = {"host": host, "addresses": addresses}
    lines = [fine("W-DOC-NAME" if named else "W-DOC-NUMERIC", "name", **told)]
    try:
        async with clock.deadline(timeout_s, host):
            _reader, writer = await asyncio.open_connection(host, port)
    except (OSError, DeadlineExceeded) as error:
        return [*lines, wrong("E-DOC-PORT", "port", host=host, port=port, why=str(error))]
    writer.close()
    with contextlib.suppress(OSError):
        await writer.wait_closed()
    return [*lines, fine("W-DOC-PORT", "port", host=host, port=port)]
