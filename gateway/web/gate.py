"""Who may come in: own host names only, small requests only, and headers that keep a page harmless."""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.errors import TrueflankError

HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?", re.IGNORECASE)
MOST_BYTES = 4096

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
    """ASGI middleware: refuses foreign Host names (400) and large bodies (413), adds security headers."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                _harden(MutableHeaders(scope=message))
            await send(message)

        refusal = _refusal(Headers(scope=scope))
        await (refusal or self._app)(scope, receive, guarded)


def _harden(headers: MutableHeaders) -> None:
    for name, value in _ALWAYS.items():
        headers[name] = value
    headers.setdefault("content-security-policy", PAGE_POLICY)


def _refusal(headers: Headers) -> JSONResponse | None:
    host = headers.get("host", "")
    if not is_own_host(host):
        # Another name that leads here is how a foreign page reaches a local server (DNS rebinding).
        return JSONResponse(TrueflankError("E-WEB-HOST", "web", host=host).as_record(), 400)
    if "transfer-encoding" in headers or not _is_small(headers.get("content-length", "0")):
        return JSONResponse(TrueflankError("E-WEB-SIZE", "web", limit=MOST_BYTES).as_record(), 413)
    return None


def _is_small(length: str) -> bool:
    return length.isascii() and length.isdigit() and len(length) < 10 and int(length) <= MOST_BYTES


def is_own_host(host: str) -> bool:
    """Whether a Host header names this server's loopback address, with or without a port."""
    return HOST.fullmatch(host) is not None


def is_token(header: str, token: str) -> bool:
    """Whether an Authorization header bears the token; compared in constant time; no empty token."""
    scheme, _, given = header.partition(" ")
    same = secrets.compare_digest(given.strip().encode("utf-8", "replace"), token.encode("utf-8"))
    return same and scheme.lower() == "bearer" and bool(token)


def is_same_origin(headers: Mapping[str, str]) -> bool:
    """Whether a request comes from this server's own page, or from no page at all (a command)."""
    if headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
        return False
    origin = headers.get("origin")
    return origin is None or origin == f"http://{headers.get('host', '')}"
