"""Who may come in: own host names only, small requests only, and headers that keep a page harmless."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from http import HTTPStatus
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from gateway.users import Tries

HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?", re.IGNORECASE)
PORT = re.compile(r":[0-9]{1,5}$")
MOST_BYTES = 1 << 16
MOST_INSIDE = 64
BODY_S = 10.0

# Nothing here needs inline scripts or styles; a stored report has its style inside and no script at all.
PAGE_POLICY = "default-src 'self'; base-uri 'none'; object-src 'none'; form-action 'none'; frame-ancestors 'none'"
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox allow-modals; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_ALWAYS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}


class Gate:
    """ASGI middleware before everything else; the service behind the application says what is allowed.

    It refuses foreign Host names (400), large bodies (413), slow bodies (408), an address that asks too often (429) and
    more requests at once than can be served (503); health alone is never crowded out. It adds the security headers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._inside = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started = False

        async def guarded(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                _harden(MutableHeaders(scope=message), secure=scope["scheme"] == "https")
            await send(message)

        service = scope["app"].state.service
        refusal = self._refusal(scope, service.doors.hosts, service.doors.asks)
        if refusal is not None:
            await refusal(scope, receive, guarded)
            return
        self._inside += 1
        try:
            await self._app(scope, _in_time(receive, service.clock), guarded)
        except DeadlineExceeded:
            if not started:
                await _answer("E-WEB-SLOW", 408, seconds=f"{BODY_S:g}")(scope, receive, guarded)
        finally:
            self._inside -= 1

    def _refusal(self, scope: Scope, hosts: Sequence[str], asks: Tries) -> JSONResponse | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not is_own_host(host, frozenset(name.lower() for name in hosts)):
            # Another name that leads here is how a foreign page reaches a local server (DNS rebinding).
            return _answer("E-WEB-HOST", 400, host=host[:100])
        if "transfer-encoding" in headers or not _is_small(headers.get("content-length", "0")):
            return _answer("E-WEB-SIZE", 413, limit=MOST_BYTES)
        if scope["path"] == "/healthz":
            return None
        address = str((scope.get("client") or ("",))[0])
        if (wait := asks.wait_s(address)) > 0.0:
            return _too_often(int(wait) + 1)
        asks.count(address)
        return _crowded() if self._inside >= MOST_INSIDE else None


def _in_time(receive: Receive, clock: Clock) -> Receive:
    """The body must be there soon; what comes after it is only that the caller has left."""
    until, whole = clock.now() + BODY_S, False

    async def received() -> Message:
        nonlocal whole
        if whole:
            return await receive()
        async with clock.deadline(max(until - clock.now(), 0.01), "web"):
            message = await receive()
        whole = not message.get("more_body", False)
        return message

    return received


def at_the_door(asks: Tries) -> Callable[[str, int], bytes]:
    """What an address that asks too often, or finds too many waiting, is told before its request is read; b"": none."""

    def refused(address: str, waiting: int) -> bytes:
        if (wait := asks.wait_s(address)) > 0.0:
            return _as_bytes(int(wait) + 1)
        return _as_bytes(0) if waiting >= MOST_INSIDE else b""

    return refused


def _too_often(seconds: int) -> JSONResponse:
    return _answer("E-WEB-OFTEN", 429, {"retry-after": str(seconds)}, seconds=seconds)


def _crowded() -> JSONResponse:
    return _answer("E-WEB-CROWDED", 503, {"retry-after": "1"})


@cache
def _as_bytes(seconds: int) -> bytes:
    answer = _too_often(seconds) if seconds else _crowded()
    _harden(answer.headers, secure=False)
    begin = f"HTTP/1.1 {answer.status_code} {HTTPStatus(answer.status_code).phrase}".encode()
    head = [begin, b"connection: close"]
    return b"\r\n".join((*head, *(name + b": " + value for name, value in answer.raw_headers), b"", bytes(answer.body)))


def _answer(code: str, status: int, headers: dict[str, str] | None = None, /, **fields: Any) -> JSONResponse:
    return JSONResponse(TrueflankError(code, "web", **fields).as_record(), status, headers)


def _harden(headers: MutableHeaders, *, secure: bool) -> None:
    for name, value in _ALWAYS.items():
        headers[name] = value
    headers.setdefault("content-security-policy", PAGE_POLICY)
    if secure:
        headers["strict-transport-security"] = "max-age=31536000"


def _is_small(length: str) -> bool:
    return length.isascii() and length.isdigit() and len(length) < 10 and int(length) <= MOST_BYTES


def is_own_host(host: str, more: frozenset[str] = frozenset()) -> bool:
    """Whether a Host header names this server: its loopback address or one of ``more``, with or without a port."""
    return HOST.fullmatch(host) is not None or PORT.sub("", host).lower() in more


def is_token(header: str, token: str) -> bool:
    """Whether an Authorization header bears the token; compared in constant time; no empty token."""
    scheme, _, given = header.partition(" ")
    same = secrets.compare_digest(given.strip().encode("utf-8", "replace"), token.encode("utf-8"))
    return same and scheme.lower() == "bearer" and bool(token)


def is_same_origin(headers: Mapping[str, str], *, secure: bool = False) -> bool:
    """Whether a request comes from this server's own page, or from no page at all (a command)."""
    if headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
        return False
    origin = headers.get("origin")
    return origin is None or origin == f"{'https' if secure else 'http'}://{headers.get('host', '')}"
