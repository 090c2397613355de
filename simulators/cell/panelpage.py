"""The operator's console as a page: keys, lamps and beams of the simulated machine, on loopback and for training."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from drivers.clock import LoopClock
from drivers.errors import TransportError
from drivers.languages import LANGUAGES, texts_of
from drivers.transport import ByteTransport, Listener, serve
from simulators.cell import Cell

Answered = Callable[[bytes], Awaitable[dict[str, Any]]]
FILES = {
    "/": ("panel.html", "text/html"),
    "/panel.js": ("panel.js", "text/javascript"),
    "/panel.css": ("panel.css", "text/css"),
}
WORDS = {f"/words/{language}.json": language for language in LANGUAGES}
HEAD_BYTES, BODY_BYTES = 8192, 2048
HEADERS = (
    "content-security-policy: default-src 'self'; base-uri 'none'; frame-ancestors 'none'\r\n"
    "x-content-type-options: nosniff\r\ncache-control: no-store\r\nconnection: close\r\n"
)


async def panel_served(cell: Cell, answered: Answered) -> Listener:
    """Serve the console on a free port of this computer; ``answered`` does what a typed line says."""
    listener: Listener

    async def visit(wire: ByteTransport) -> None:
        # One question, one answer, then the wire is let go.
        await wire.write(await _answer(wire, cell, answered, urlsplit(listener.url).port or 0))
        await wire.close()

    listener = await serve("tcp://127.0.0.1:0", visit, LoopClock())
    return listener


def url_of(listener: Listener) -> str:
    """Where a browser finds it."""
    return f"http://127.0.0.1:{urlsplit(listener.url).port}/"


async def _answer(wire: ByteTransport, cell: Cell, answered: Answered, port: int) -> bytes:
    method, path, headers, body = await _request(wire)
    # A page from elsewhere must not press keys here: own name, own origin.
    own = {f"127.0.0.1:{port}", f"localhost:{port}"}
    if headers.get("host") not in own or headers.get("origin", f"http://{headers.get('host')}") not in {
        f"http://{one}" for one in own
    }:
        return _sent(403, "text/plain", b"not from here")
    if method == "POST" and path == "/do":
        return _sent(200, "application/json", json.dumps(await answered(body)).encode())
    if method == "GET" and path == "/machine":
        return _sent(200, "application/json", json.dumps({**await answered(b"status"), **_equipment(cell)}).encode())
    if method == "GET" and path in FILES:
        name, kind = FILES[path]
        return _sent(200, kind, resources.files("simulators.cell").joinpath(name).read_bytes())
    if method == "GET" and path in WORDS:
        return _sent(200, "application/json", json.dumps(texts_of("panel", WORDS[path])).encode())
    return _sent(404, "text/plain", b"nothing here")


async def _request(wire: ByteTransport) -> tuple[str, str, Mapping[str, str], bytes]:
    """Method, path, headers (small letters) and body. Raises TransportError for what is no small request."""
    got = b""
    while b"\r\n\r\n" not in got:
        if len(got) > HEAD_BYTES:
            raise TransportError("E-LINK-CLOSED", "panel", why="an endless head")
        got += await wire.read(4096)
    head, _, body = got.partition(b"\r\n\r\n")
    first, *lines = head.decode("latin-1").split("\r\n")
    headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    method, path, *_ = [*first.split(), "", ""]
    wanted = min(
        int(headers.get("content-length", "0") or 0) if headers.get("content-length", "0").isdecimal() else 0,
        BODY_BYTES,
    )
    while len(body) < wanted:
        body += await wire.read(wanted - len(body))
    return method, path, headers, body[:wanted]


def _sent(status: int, kind: str, body: bytes) -> bytes:
    head = f"HTTP/1.1 {status} {'OK' if status == 200 else 'no'}\r\ncontent-type: {kind}; charset=utf-8\r\n"
    return f"{head}content-length: {len(body)}\r\n{HEADERS}\r\n".encode("ascii") + body


def _equipment(cell: Cell) -> dict[str, Any]:
    """What can be mounted and which beams there are."""
    mountings = dict.fromkeys(f"{one.component} {one.axis}" for one in cell.file.setups)
    return {
        "name": cell.file.name,
        "instruments": [one.name for one in cell.file.instruments if one.kind != "gear"],
        "mountings": list(mountings),
        "auto": cell.operator.spec.auto,
    }
