"""TCP wires, with TLS where it is wanted: tcp://host:port as a client, and listeners for tcp:// and socket://."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded, TransportError, TrueflankError
from drivers.message import Message
from drivers.transport.stream import Conversations, Handler

# TLS on a TCP wire: whom we trust, who we are, and what a refused handshake means in words.

_DATES = {9, 10}
"""OpenSSL X509_V_ERR_CERT_NOT_YET_VALID and _HAS_EXPIRED."""
_NAMES = {62, 64}
"""OpenSSL X509_V_ERR_HOSTNAME_MISMATCH and _IP_ADDRESS_MISMATCH."""
_NO_TLS = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "PACKET_LENGTH_TOO_LONG", "RECORD_LAYER_FAILURE", "UNEXPECTED_EOF")


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Certificates of one wire, as PEM files.

    ``trusted`` is the peer's own certificate, or with ``server_name`` that of the authority that signed one with this
    name. ``certificate`` and ``key`` are ours: both ends prove who they are.
    """

    trusted: Path
    certificate: Path
    key: Path
    server_name: str = ""

    def context(self, url: str) -> ssl.SSLContext:
        """What a connection of ours needs; blocking. Raises ConfigError (E-TLS-FILE) naming the file."""
        made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        made.minimum_version = ssl.TLSVersion.TLSv1_2
        made.check_hostname = bool(self.server_name)
        made.verify_mode = ssl.CERT_REQUIRED
        made.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
        self.pinned(url)
        try:
            made.load_verify_locations(cafile=str(self.trusted))
        except (OSError, ValueError) as error:
            raise ConfigError("E-TLS-FILE", url, file=self.trusted, why=str(error)) from error
        try:
            made.load_cert_chain(str(self.certificate), str(self.key), password=_no_password)
        except (OSError, ValueError) as error:
            files = f"{self.certificate}, {self.key}"
            raise ConfigError("E-TLS-FILE", url, file=files, why=str(error)) from error
        return made

    def pinned(self, url: str) -> bytes:
        """The trusted certificate itself (DER). Raises ConfigError (E-TLS-FILE)."""
        try:
            return ssl.PEM_cert_to_DER_cert(self.trusted.read_text(encoding="ascii"))
        except (OSError, ValueError) as error:
            raise ConfigError("E-TLS-FILE", url, file=self.trusted, why=str(error)) from error


def _no_password() -> str:
    raise ValueError("the key is protected by a password; give one without")


def tls_error(error: OSError, url: str) -> TrueflankError:
    """What a failed handshake means, or an alert later: TLS 1.3 tells of our own certificate after it."""
    if isinstance(error, ssl.SSLCertVerificationError):
        dated, named = error.verify_code in _DATES, error.verify_code in _NAMES
        code = "E-TLS-DATE" if dated else "E-TLS-NAME" if named else "E-TLS-TRUST"
        return ConfigError(code, url, why=error.verify_message)
    if not isinstance(error, ssl.SSLError):
        return TransportError("E-TLS-NONE", url, why=str(error) or type(error).__name__)
    reason = error.reason or str(error)
    if "ALERT" in reason:
        return TransportError("E-TLS-REFUSED", url, why=reason.lower().replace("_", " "))
    return TransportError("E-TLS-NONE" if reason.startswith(_NO_TLS) else "E-LINK-CONNECT", url, why=reason)


# TCP.

QUEUE_BYTES = 1 << 20
FLUSH_S = 1.0


class _Pieces(asyncio.Protocol):
    """What has come and was not taken yet, in the pieces it came in; a full queue holds the peer back."""

    def __init__(self, accept: Callable[[_Pieces, asyncio.Transport], None] | None = None) -> None:
        self._accept = accept
        self._transport: asyncio.Transport | None = None
        self._pieces: deque[bytes] = deque()
        self._waiting = 0
        self._paused = False
        self._ended: str | Message = ""
        self._secured = self._heard = False
        self._alert: ssl.SSLError | None = None
        self._news = asyncio.Event()
        self._room = asyncio.Event()
        self._room.set()
        self.gone = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
            self._secured = transport.get_extra_info("sslcontext") is not None
            if self._accept is not None:
                self._accept(self, transport)

    def data_received(self, data: bytes) -> None:
        self._pieces.append(data)
        self._heard = True
        self._waiting += len(data)
        self._news.set()
        if self._waiting > QUEUE_BYTES and not self._paused and self._transport is not None:
            self._paused = True
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        self._end(Message.of("W-LINK-PEER-CLOSED"))
        return not self._secured  # what we still have to say may be said; TLS ends in both directions

    def connection_lost(self, exc: Exception | None) -> None:
        self._alert = exc if isinstance(exc, ssl.SSLError) else None
        self._end(str(exc) if exc is not None else Message.of("W-LINK-PEER-CLOSED"))
        self.gone.set()

    def _end(self, why: str | Message) -> None:
        self._ended = self._ended or why
        self._news.set()
        self._room.set()

    def pause_writing(self) -> None:
        self._room.clear()

    def resume_writing(self) -> None:
        self._room.set()

    async def drained(self) -> None:
        """Wait while the peer takes nothing."""
        await self._room.wait()

    def failure(self, where: str) -> TrueflankError:
        """Why no more comes: an alert of the peer's TLS, or its end."""
        if self._alert is not None:
            return tls_error(self._alert, where)
        if self._secured and not self._heard and self._ended:
            # TLS 1.3: who does not like our certificate hangs up after the handshake, with an alert or without.
            return TransportError("E-TLS-REFUSED", where, why=self._ended)
        return TransportError("E-LINK-CLOSED", where, why=self._ended or Message.of("W-LINK-CLOSED"))

    async def take(self, max_bytes: int, where: str) -> bytes:
        """The oldest piece, or its beginning; TransportError (E-LINK-CLOSED) once all is taken and the peer gone."""
        while not self._pieces:
            if self._ended:
                raise self.failure(where)
            self._news.clear()
            await self._news.wait()
        piece = self._pieces.popleft()
        if len(piece) > max_bytes:
            self._pieces.appendleft(piece[max_bytes:])
            piece = piece[:max_bytes]
        self._waiting -= len(piece)
        if self._paused and self._waiting <= QUEUE_BYTES // 2 and self._transport is not None:
            self._paused = False
            self._transport.resume_reading()
        return piece


class TcpTransport:
    """One TCP connection; pieces are handed on as the system gave them, without copies."""

    def __init__(self, url: str, pieces: _Pieces, transport: asyncio.Transport, clock: Clock) -> None:
        self._url = url
        self._pieces = pieces
        self._transport = transport
        self._clock = clock

    @property
    def description(self) -> str:
        """The url."""
        return self._url

    async def read(self, max_bytes: int) -> bytes:
        """Return 1 .. max_bytes bytes; TransportError (E-LINK-CLOSED) at the end of the stream."""
        return await self._pieces.take(max_bytes, self._url)

    async def write(self, data: bytes) -> None:
        """Write, waiting while the peer is slow; TransportError (E-LINK-CLOSED)."""
        self._check_open()
        self._transport.write(data)
        await self._pieces.drained()
        self._check_lost()

    def _check_open(self) -> None:
        if self._transport.is_closing():
            raise self._pieces.failure(self._url)

    def _check_lost(self) -> None:
        if self._pieces.gone.is_set():
            raise self._pieces.failure(self._url)

    async def close(self) -> None:
        """Flush for a moment, then let go; a peer that does not read cannot hold us."""
        self._transport.close()
        try:
            async with self._clock.deadline(FLUSH_S, self._url):
                await self._pieces.gone.wait()
        except DeadlineExceeded:
            self._transport.abort()


def host_and_port(url: str) -> tuple[str, int]:
    """Split scheme://host:port. Raises ConfigError (E-LINK-URL)."""
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError as error:
        raise ConfigError("E-LINK-URL", url, why=str(error)) from error
    if not parts.hostname or port is None:
        raise ConfigError("E-LINK-URL", url, why=Message.of("W-LINK-HOST-PORT"))
    return parts.hostname, port


async def open_tcp(url: str, clock: Clock, timeout_s: float, tls: TlsFiles | None = None) -> TcpTransport:
    """Connect to tcp://host:port, with ``tls`` by TLS.

    Raises TransportError (E-LINK-CONNECT, E-TLS-NONE, E-TLS-REFUSED), DeadlineExceeded, ConfigError (E-TLS-...: what
    is wrong with which certificate).
    """
    host, port = host_and_port(url)
    loop = asyncio.get_running_loop()
    async with clock.deadline(timeout_s, url):
        try:
            if tls is None:
                transport, pieces = await loop.create_connection(_Pieces, host, port)
            else:
                transport, pieces = await _secured(tls, url, host=host, port=port)
        except OSError as error:
            raise TransportError("E-LINK-CONNECT", url, why=str(error)) from error
    return TcpTransport(url, pieces, transport, clock)


async def _secured(tls: TlsFiles, url: str, *, host: str, port: int) -> tuple[asyncio.Transport, _Pieces]:
    """A connection under TLS, its peer the one that was pinned. Raises as `open_tcp`, and OSError."""
    context = await asyncio.to_thread(tls.context, url)
    loop, name = asyncio.get_running_loop(), tls.server_name or host
    try:
        found, pieces = await loop.create_connection(_Pieces, host, port, ssl=context, server_hostname=name)
    except (ssl.SSLError, ConnectionResetError, ConnectionAbortedError) as error:
        raise tls_error(error, url) from error
    shown = found.get_extra_info("ssl_object").getpeercert(binary_form=True)
    if not tls.server_name and shown != await asyncio.to_thread(tls.pinned, url):
        found.abort()
        raise ConfigError("E-TLS-OTHER", url, file=tls.trusted)
    return found, pieces


class TcpListener:
    """A listening socket; ``url`` names the port the system gave."""

    def __init__(self, server: asyncio.Server, url: str, conversations: Conversations) -> None:
        self._server = server
        self._url = url
        self._conversations = conversations

    @property
    def url(self) -> str:
        """Where clients reach it."""
        return self._url

    async def close(self) -> None:
        """Stop listening and end all conversations; raises what a handler died of."""
        self._server.close()
        try:
            await self._conversations.end()
        finally:
            with contextlib.suppress(OSError):
                await self._server.wait_closed()


async def serve_tcp(url: str, handler: Handler, clock: Clock, tls: ssl.SSLContext | None = None) -> TcpListener:
    """Listen on scheme://host:port (port 0: any free one) and run `handler` for each peer; with ``tls`` by TLS."""
    host, port = host_and_port(url)
    scheme = urlsplit(url).scheme
    conversations = Conversations(handler, url)

    def accept(pieces: _Pieces, transport: asyncio.Transport) -> None:
        conversations.begin(TcpTransport(f"peer of {url}", pieces, transport, clock))

    try:
        server = await asyncio.get_running_loop().create_server(lambda: _Pieces(accept), host, port, ssl=tls)
    except OSError as error:
        raise TransportError("E-LINK-LISTEN", url, why=str(error)) from error
    real = server.sockets[0].getsockname()[1]
    return TcpListener(server, f"{scheme}://{host}:{real}", conversations)
