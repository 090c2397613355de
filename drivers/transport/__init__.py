"""Urls to wires: open one as a client, or serve one as a simulator does."""

from __future__ import annotations

import asyncio
import ssl
from urllib.parse import urlsplit

from drivers.clock import Clock, SharedTimeLoop
from drivers.errors import ConfigError
from drivers.message import Message
from drivers.serial_io import open_serial
from drivers.transport.memory import listen_memory, name_of, open_memory
from drivers.transport.stream import ByteTransport, FaultyTransport, Handler, Listener
from drivers.transport.tcp import TlsFiles, open_tcp, serve_tcp

__all__ = [
    "ByteTransport",
    "FaultyTransport",
    "Handler",
    "Listener",
    "TlsFiles",
    "hardware_of",
    "listen_memory",
    "open_transport",
    "serve",
]

START_S = 10.0


async def open_transport(
    url: str,
    clock: Clock,
    timeout_s: float,
    *,
    baudrate: int = 115_200,
    parity: str = "N",
    data_bits: int = 8,
    stop_bits: int = 1,
    tls: TlsFiles | None = None,
) -> ByteTransport:
    """Open tcp://host:port, memory://name, socket://host:port, usb://SERIAL-NUMBER, COM3 or /dev/ttyUSB0.

    ``baudrate``, ``parity`` (N, E, O), ``data_bits`` and ``stop_bits`` count for serial ports only, ``tls`` for tcp://.
    Raises ConfigError (E-LINK-URL, E-TLS-...), TransportError (E-LINK-CONNECT, E-LINK-TAKEN, E-LINK-ABSENT, E-TLS-NONE)
    or DeadlineExceeded.
    """
    scheme = urlsplit(url).scheme if "://" in url else ""
    # A socket is plain TCP; where loops share a clock its bytes must be counted, which those of a thread are not.
    if scheme == "tcp" or (scheme == "socket" and isinstance(asyncio.get_running_loop(), SharedTimeLoop)):
        return await open_tcp(url, clock, timeout_s, tls)
    if tls is not None:
        raise ConfigError("E-LINK-URL", url, why="TLS needs tcp://host:port")
    if scheme == "memory":
        return open_memory(url)
    if scheme not in ("", "socket", "usb") or not url.strip():
        raise ConfigError("E-LINK-URL", url, why=Message.of("W-LINK-SCHEME", scheme=scheme))
    return await open_serial(
        url, clock, timeout_s, baudrate=baudrate, parity=parity, data_bits=data_bits, stop_bits=stop_bits
    )


def hardware_of(wire: ByteTransport) -> str:
    """The USB serial number of the port behind a wire; "" where there is none."""
    return str(getattr(wire, "hardware", ""))


async def serve(url: str, handler: Handler, clock: Clock, tls: ssl.SSLContext | None = None) -> Listener:
    """Serve tcp://host:port (with ``tls`` by TLS), socket://host:port (plain TCP; port 0 for any) or memory://name.

    The listener's ``url`` is what a client must open. Raises ConfigError (E-LINK-URL), TransportError
    (E-LINK-LISTEN).
    """
    scheme = urlsplit(url).scheme
    if scheme == "memory":
        return listen_memory(name_of(url), handler)
    if scheme in ("tcp", "socket"):
        async with clock.deadline(START_S, url):
            return await serve_tcp(url, handler, clock, tls)
    raise ConfigError("E-LINK-URL", url, why=f"cannot serve {scheme!r}")
