"""Who may come in: own host names only, small requests only, and headers that keep a page harmless."""

from __future__ import annotations

import re
import secrets
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import ip_network
from typing import Any, Literal

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.local.names import person_key
from drivers.message import digits
from gateway.users import Person, Tries

HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?", re.IGNORECASE)
PORT = re.compile(r":[0-9]{1,5}$")
MOST_BYTES = 1 << 16
BODY_S = 10.0
Rank = Literal["stranger", "person", "urgent"]
PLACES: Mapping[Rank, int] = {"stranger": 32, "person": 64, "urgent": 16}
"""How many requests of each kind are at work at once."""
MOST_UNFINISHED: Mapping[Rank, int] = {"stranger": 4, "person": 16, "urgent": 4}
"""How many bodies an address, or a person who is signed in, may leave unfinished at once."""
ALL, MOST_OF_STRANGERS = "all strangers", 256
URGENT = re.compile(r"/api/v1/sites/[^/]+/(stop|commands/(disable|recover))")
"""What ends or undoes something at the machine."""

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
}


class Gate:
    """ASGI middleware before everything else; the service behind the application says what is allowed.

    It refuses foreign Host names (400), large bodies (413), slow bodies (408), who asks too often or leaves too many
    bodies unfinished (429) and more requests at once than can be served (503); health alone is never refused. A
    request counts as one at work when its body is there. Strangers count by address, people who are signed in by
    name, and the stop, the disabling and the recovery of those who may do that have places and a budget that nothing
    else takes. It adds the security headers.

    ``known`` tells who is signed in, None for a stranger.
    """

    def __init__(self, app: ASGIApp, known: Callable[[HTTPConnection], Person | None]) -> None:
        self._app, self._known = app, known
        self._inside: Counter[Rank] = Counter()
        self._unfinished: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                _harden(MutableHeaders(scope=message), secure=scope["scheme"] == "https")
            await send(message)

        service, headers = scope["app"].state.service, Headers(scope=scope)
        if (refusal := _unfit(headers, service.doors.hosts)) is not None:
            await refusal(scope, receive, guarded)
            return
        if scope["path"] == "/healthz":
            await self._app(scope, receive, guarded)
            return
        caller = _caller_of(HTTPConnection(scope), self._known)
        body: Receive | Response | None = _often(service.doors.asks, caller) or receive
        if not isinstance(body, Response) and headers.get("content-length", "0").strip("0"):
            body = await self._whole(receive, caller, service.clock)
        if body is None:
            return  # the caller has left before it had asked
        if not isinstance(body, Response) and self._inside[caller.rank] >= PLACES[caller.rank]:
            body = _answer("E-WEB-CROWDED", 503, {"retry-after": "1"})
        if isinstance(body, Response):
            await body(scope, receive, guarded)
            return
        self._inside[caller.rank] += 1
        try:
            await self._app(scope, body, guarded)
        finally:
            self._inside[caller.rank] -= 1

    async def _whole(self, receive: Receive, caller: Caller, clock: Clock) -> Receive | Response | None:
        """The body of a request as soon as all of it is there; what to answer instead; None: the caller has left."""
        most = MOST_UNFINISHED[caller.rank]
        strangers = caller.rank == "stranger"
        if self._unfinished[caller.key] >= most or (strangers and self._unfinished[ALL] >= MOST_OF_STRANGERS):
            return _answer("E-WEB-UNFINISHED", 429, {"retry-after": str(int(BODY_S))}, most=most)
        counted = (caller.key, ALL) if strangers else (caller.key,)
        self._unfinished.update(counted)
        try:
            async with clock.deadline(BODY_S, "web"):
                data = await _read(receive)
        except DeadlineExceeded:
            return _answer("E-WEB-SLOW", 408, seconds=digits(BODY_S, 6))
        finally:
            self._unfinished.subtract(counted)
            if not self._unfinished[caller.key]:
                del self._unfinished[caller.key]
        return None if data is None else _told(data, receive)


@dataclass(frozen=True, slots=True)
class Caller:
    """Whose budgets a request counts in, and which places it takes."""

    key: str
    rank: Rank


def _caller_of(asked: HTTPConnection, known: Callable[[HTTPConnection], Person | None]) -> Caller:
    person = known(asked)
    if person is None:
        return Caller(f"address {network_of(asked)}", "stranger")
    if URGENT.fullmatch(asked.url.path) and (person.may("operator") or person.may("service")):
        return Caller(f"urgent {person_key(person.name)}", "urgent")
    return Caller(f"person {person_key(person.name)}", "person")


def address_of(asked: HTTPConnection) -> str:
    """Where a request comes from; "" where that is not known."""
    return asked.client.host if asked.client is not None else ""


def network_of(asked: HTTPConnection) -> str:
    """The address that budgets are kept by: of IPv6 the first 64 bits, which one subscriber has whole."""
    address = address_of(asked)
    try:
        return str(ip_network(f"{address}/64", strict=False)) if ":" in address else address
    except ValueError:
        return address


def _unfit(headers: Headers, hosts: Sequence[str]) -> Response | None:
    host = headers.get("host", "")
    if not is_own_host(host, frozenset(name.lower() for name in hosts)):
        # Another name that leads here is how a foreign page reaches a local server (DNS rebinding).
        return _answer("E-WEB-HOST", 400, host=host[:100])
    if "transfer-encoding" in headers or not _is_small(headers.get("content-length", "0")):
        return _answer("E-WEB-SIZE", 413, limit=MOST_BYTES)
    return None


def _often(asks: Tries, caller: Caller) -> Response | None:
    if (wait := asks.wait_s(caller.key)) > 0.0:
        seconds = int(wait) + 1
        return _answer("E-WEB-OFTEN", 429, {"retry-after": str(seconds)}, seconds=seconds)
    asks.count(caller.key)
    return None


async def _read(receive: Receive) -> bytes | None:
    """All of a body, which the server holds to its stated length; None where the caller has left."""
    data = bytearray()
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return None
        data += message.get("body", b"")
        if not message.get("more_body", False):
            return bytes(data)


def _told(data: bytes, receive: Receive) -> Receive:
    """Gives a body that has been read once more; what comes after it is only that the caller has left."""
    ahead = [data]

    async def received() -> Message:
        return {"type": "http.request", "body": ahead.pop(), "more_body": False} if ahead else await receive()

    return received


def _answer(code: str, status: int, headers: dict[str, str] | None = None, /, **fields: Any) -> Response:
    # What a refused request still holds is not read: the next one has a connection of its own.
    more = {"connection": "close", **(headers or {})}
    return Response(_record(code, tuple(fields.items())), status, more, "application/json")


@lru_cache(maxsize=128)
def _record(code: str, fields: tuple[tuple[str, Any], ...]) -> bytes:
    """A refusal's record as JSON: in a crowd it is asked for a thousand times."""
    return bytes(JSONResponse(TrueflankError(code, "web", **dict(fields)).as_record()).body)


def _harden(headers: MutableHeaders, *, secure: bool) -> None:
    for name, value in _ALWAYS.items():
        headers[name] = value
    headers.setdefault("cache-control", "no-store")
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
