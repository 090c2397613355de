"""The machine's console: typed words, and the panel page with keys, lamps and beams for training.

Both end as the questions and orders of the back door. The page is served on loopback only, by a few lines of HTTP: the
simulators need no web framework.
"""

from __future__ import annotations

import json
import re
from collections.abc import Awaitable, Callable, Mapping
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from drivers.clock import LoopClock
from drivers.errors import TransportError
from drivers.languages import LANGUAGES, texts_of
from drivers.transport import ByteTransport, Listener, serve
from simulators.cell import Cell
from simulators.operator import KEYS

Order = dict[str, Any]
WEATHER = {"AIR": "air_degc", "MATERIAL": "material_degc", "PRESSURE": "pressure_hpa", "HUMIDITY": "humidity_pct"}
NUMBER = r"(?P<value>[+-]?\d+(?:\.\d+)?)"
WORDS: Mapping[str, str] = {
    "reset | nc start | nck reset": "a key of the machine's panel",
    "auto off | auto on": "whether the operator does by himself what the control's message says",
    "mount EXX X1": "mount the set-up of that component on that axis",
    "break laser | clear laser": "something stands in the beam of that instrument; it is gone",
    "pull laser | plug laser": "the instrument's cable",
    "load blank | take part": "clamp a new blank; take off what is on the table",
    "cycle": "select the builder's own cycle for the part",
    "air 25 | material 23 | pressure 980 | humidity 40": "the weather from now on, in degC, hPa and %",
    "jog X1 -200 | mode AUTO": "move an axis by hand; AUTO, JOG or MDA",
    "confirm | release on | release off": "the PLC's panel",
    "power": "the main switch off and on",
    "status": "channel, message, positions and what the operator did",
    "help": "these words",
}

Made = Callable[[re.Match[str], str], Order]


def _same(order: Order) -> Made:
    return lambda _found, _line: order


PATTERNS: tuple[tuple[str, Made], ...] = (
    ("|".join(KEYS), lambda found, _line: {"set": "press", "key": found[0]}),
    (r"AUTO (?P<how>ON|OFF)", lambda found, _line: {"set": "operator", "options": {"auto": found["how"] == "ON"}}),
    (
        r"MOUNT (?P<what>\S+) (?P<axis>\S+)",
        lambda f, _l: {"set": "mount", "component": f["what"], "axis": f["axis"]},
    ),
    (r"(?P<how>BREAK|CLEAR) \S+", lambda f, line: {**_named("beam", line), "broken": f["how"] == "BREAK"}),
    (r"PULL \S+", lambda _f, line: _named("pull", line)),
    (r"PLUG \S+", lambda _f, line: _named("plug", line)),
    (r"LOAD BLANK", _same({"set": "load_blank"})),
    (r"CYCLE", _same({"set": "builder_cycle"})),
    (r"TAKE PART", _same({"set": "unload_part"})),
    (
        rf"(?P<what>{'|'.join(WEATHER)}) {NUMBER}",
        lambda f, _line: {"set": "weather", WEATHER[f["what"]]: float(f["value"])},
    ),
    (rf"JOG (?P<axis>\S+) {NUMBER}", lambda f, _line: {"set": "jog", "axis": f["axis"], "value": float(f["value"])}),
    (r"MODE (?P<mode>AUTO|JOG|MDA)", lambda f, _line: {"set": "mode", "value": f["mode"]}),
    (r"CONFIRM", _same({"set": "confirm"})),
    (r"RELEASE (?P<how>ON|OFF)", lambda f, _line: {"set": "release", "value": f["how"] == "ON"}),
    (r"POWER", _same({"set": "power_cycle"})),
    (r"STATUS", _same({"ask": "status"})),
)


def _named(what: str, line: str) -> Order:
    """Instruments are named as they are written."""
    return {"set": what, "instrument": line.split()[1]}


def parse_order(line: str) -> Order | None:
    """What a typed line asks for; None when it is none of `WORDS`. Names of instruments are taken as typed."""
    typed = " ".join(line.split())
    for pattern, made in PATTERNS:
        found = re.fullmatch(pattern, typed.upper())
        if found is not None:
            return made(found, typed)
    return None


# The panel page.

PanelAnswer = Callable[[bytes], Awaitable[dict[str, Any]]]
FILES = {
    "/": ("panel.html", "text/html"),
    "/panel.js": ("panel.js", "text/javascript"),
    "/panel.css": ("panel.css", "text/css"),
}
PAGE_TEXTS = {f"/words/{language}.json": language for language in LANGUAGES}
HEAD_BYTES, BODY_BYTES = 8192, 2048
HEADERS = (
    "content-security-policy: default-src 'self'; base-uri 'none'; frame-ancestors 'none'\r\n"
    "x-content-type-options: nosniff\r\ncache-control: no-store\r\nconnection: close\r\n"
)


async def serve_panel(cell: Cell, answered: PanelAnswer) -> Listener:
    """Serve the console on a free port of this computer; ``answered`` does what a typed line says."""
    listener: Listener

    async def visit(wire: ByteTransport) -> None:
        # One question, one answer, then the wire is let go.
        await wire.write(await _answer(wire, cell, answered, urlsplit(listener.url).port or 0))
        await wire.close()

    listener = await serve("tcp://127.0.0.1:0", visit, LoopClock())
    return listener


def panel_url(listener: Listener) -> str:
    """Where a browser finds it."""
    return f"http://127.0.0.1:{urlsplit(listener.url).port}/"


async def _answer(wire: ByteTransport, cell: Cell, answered: PanelAnswer, port: int) -> bytes:
    method, path, headers, body = await _read_request(wire)
    # A page from elsewhere must not press keys here: own name, own origin.
    own = {f"127.0.0.1:{port}", f"localhost:{port}"}
    if headers.get("host") not in own or headers.get("origin", f"http://{headers.get('host')}") not in {
        f"http://{one}" for one in own
    }:
        return _http_response(403, "text/plain", b"not from here")
    if method == "POST" and path == "/do":
        return _http_response(200, "application/json", json.dumps(await answered(body)).encode())
    if method == "GET" and path == "/machine":
        return _http_response(
            200, "application/json", json.dumps({**await answered(b"status"), **_equipment(cell)}).encode()
        )
    if method == "GET" and path in FILES:
        name, kind = FILES[path]
        return _http_response(200, kind, resources.files("simulators.cell").joinpath(name).read_bytes())
    if method == "GET" and path in PAGE_TEXTS:
        return _http_response(200, "application/json", json.dumps(texts_of("panel", PAGE_TEXTS[path])).encode())
    return _http_response(404, "text/plain", b"nothing here")


async def _read_request(wire: ByteTransport) -> tuple[str, str, Mapping[str, str], bytes]:
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


def _http_response(status: int, kind: str, body: bytes) -> bytes:
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
