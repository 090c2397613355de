"""Crowds of strangers: half bodies, half handshakes, too many at once; a stop of somebody signed in never waits."""

from __future__ import annotations

import asyncio
import contextlib
import json
import ssl
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from starlette.requests import HTTPConnection

from drivers.clock import LoopClock
from gateway import audit
from gateway.users import Person, Tries, UserRole
from gateway.web.gate import ALL, BODY_S, MOST_OF_STRANGERS, MOST_UNFINISHED, PLACES, URGENT, Gate
from tests.sizes import few
from tests.unit.web.services import Offered, offered
from tests.unit.web.test_daemon import SECURE, SITE, certificate, served

STOP = "/api/v1/sites/hall-3/stop"
LOGIN = "/api/v1/login"
PEOPLE: dict[str, tuple[UserRole, ...]] = {"olga": ("operator",), "vera": ("viewer",), "sam": ("service",)}
Asked = asyncio.Task[tuple[int, str]]
"""The status of an answer (0 for none) and its code."""


@dataclass
class Door:
    """A gate before an application that works on each request until it is let go."""

    asks: Tries = field(default_factory=lambda: Tries(lambda: 0.0, 600, 10.0))
    go: asyncio.Event = field(default_factory=asyncio.Event)
    read: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.gate = Gate(self._work, known=self._known)
        service = SimpleNamespace(doors=SimpleNamespace(hosts=(), asks=self.asks), clock=LoopClock())
        self.app = SimpleNamespace(state=SimpleNamespace(service=service))

    @staticmethod
    def _known(asked: HTTPConnection) -> Person | None:
        name = asked.headers.get("x-name", "")
        return Person(name, frozenset(PEOPLE[name])) if name else None

    async def _work(self, _scope: Any, receive: Any, send: Any) -> None:
        self.read.append((await receive())["body"])
        await self.go.wait()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"{}"})

    def ask(
        self, path: str, *parts: bytes | None, who: str = "", at: str = "10.0.0.66"
    ) -> asyncio.Task[tuple[int, str]]:
        """A request whose body comes in these parts (None: the caller leaves) and then, if too short, never."""
        return asyncio.create_task(self._ask(path, parts, who, at))

    async def _ask(self, path: str, parts: tuple[bytes | None, ...], who: str, at: str) -> tuple[int, str]:
        headers = [(b"host", b"127.0.0.1"), (b"x-name", who.encode())]
        headers += [(b"content-length", b"4")] if parts else []
        scope = {"type": "http", "app": self.app, "path": path, "headers": headers, "client": (at, 5), "method": "POST"}
        scope |= {"scheme": "http", "server": ("127.0.0.1", 80), "query_string": b""}
        coming, told = list(parts), list[Any]()

        async def receive() -> dict[str, Any]:
            if not parts:
                return {"type": "http.request", "body": b""}
            if not coming:
                await asyncio.Event().wait()
            part = coming.pop(0)
            whole = sum(len(one or b"") for one in parts) - sum(len(one or b"") for one in coming)
            left = {"type": "http.disconnect"}
            return left if part is None else {"type": "http.request", "body": part, "more_body": whole < 4}

        async def send(message: Any) -> None:
            told.append(message)

        await self.gate(scope, receive, send)
        status = next((one["status"] for one in told if one["type"] == "http.response.start"), 0)
        body = b"".join(one.get("body", b"") for one in told)
        return status, json.loads(body).get("code", "") if body else ""


async def settled() -> None:
    for _turn in range(20):
        await LoopClock().sleep(0)


async def test_half_bodies_of_an_address_are_few_and_hold_up_nobody_who_is_signed_in() -> None:
    door, clock = Door(), LoopClock()
    begun = clock.now()
    halves = [door.ask(LOGIN, b"{") for _one in range(72)]
    await settled()
    refused = [one.result() for one in halves if one.done()]
    assert refused == [(429, "E-WEB-UNFINISHED")] * (72 - MOST_UNFINISHED["stranger"])
    stop = door.ask(STOP, b"{", b"}  ", who="olga")  # the operator sits behind the same address
    elsewhere = door.ask(LOGIN, b"{}  ", at="10.0.0.7")
    door.go.set()
    await settled()
    assert (stop.result()[0], elsewhere.result()[0]) == (200, 200)
    assert door.read == [b"{}  "] * 2, "no half body is a request"
    ended = await asyncio.gather(*(one for one in halves if not one.done()))
    assert ended == [(408, "E-WEB-SLOW")] * MOST_UNFINISHED["stranger"]
    assert clock.now() - begun == pytest.approx(BODY_S, abs=0.1)
    again = door.ask(LOGIN, b"{}  ")
    await settled()
    assert again.result()[0] == 200, "what was ended counts no more"


async def test_strangers_of_many_addresses_are_bounded_together_and_an_ipv6_network_is_one() -> None:
    door = Door()
    many = [door.ask(LOGIN, b"{", at=f"10.0.{one // 200}.{one % 200}") for one in range(MOST_OF_STRANGERS + 9)]
    await settled()
    assert sum(one.done() for one in many) == 9
    stop = door.ask(STOP, b"{}  ", who="sam")
    door.go.set()
    await settled()
    assert stop.result()[0] == 200
    await asyncio.gather(*many)
    network = [door.ask(LOGIN, b"{", at=f"2001:db8::{one:x}") for one in range(1, 10)]
    await settled()
    assert sum(one.done() for one in network) == 9 - MOST_UNFINISHED["stranger"]
    await asyncio.gather(*network)
    assert not door.gate._unfinished[ALL]


async def test_places_of_strangers_of_people_and_of_a_stop_are_kept_apart() -> None:
    door = Door()
    strangers = [door.ask("/x", at=f"10.0.1.{one}") for one in range(PLACES["stranger"] + 3)]
    people = [door.ask(STOP, b"{}  ", who="vera") for _one in range(PLACES["person"] + 2)]
    await settled()
    crowded = (503, "E-WEB-CROWDED")
    assert [one.result() for one in strangers if one.done()] == [crowded] * 3
    assert [one.result() for one in people if one.done()] == [crowded] * 2, "who may only look has no place of a stop"
    stop = door.ask(STOP, b"{}  ", who="olga")
    await settled()
    assert not stop.done()
    assert len(door.read) == PLACES["stranger"] + PLACES["person"] + 1, "it is at work"
    door.go.set()
    await asyncio.gather(stop, *strangers, *people)
    assert stop.result()[0] == 200


async def test_a_person_who_asks_too_often_can_still_stop() -> None:
    door = Door(asks=Tries(lambda: 0.0, 5, 10.0))
    door.go.set()
    answers = [await door.ask("/api/v1/sites", who="olga") for _one in range(7)]
    assert [one[0] for one in answers] == [200] * 5 + [429] * 2
    assert (await door.ask(STOP, b"{}  ", who="olga"))[0] == 200
    assert (await door.ask("/api/v1/sites", who="sam"))[0] == 200, "budgets go by person"


async def test_who_leaves_in_the_middle_of_a_body_has_asked_nothing() -> None:
    door = Door()
    assert await door.ask(LOGIN, b"{", None) == (0, "")
    assert door.read == []


def test_what_has_reserved_places_are_routes(tmp_path: Path) -> None:
    described = offered(tmp_path, SITE).app.openapi()["paths"]
    found = {path for path in described if URGENT.fullmatch(path.replace("{site}", "hall-3"))}
    at = "/api/v1/sites/{site}"
    assert found == {f"{at}/stop", f"{at}/commands/disable", f"{at}/commands/recover"}


@pytest.mark.parametrize("proxies", [("127.0.0.1",), ()])
def test_only_a_known_proxy_says_who_asks_and_that_it_was_over_tls(tmp_path: Path, proxies: tuple[str, ...]) -> None:
    site = SITE.model_copy(update={"service": SITE.service.model_copy(update={"proxies": proxies})})
    told: list[bool] = []

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        through = {"x-forwarded-for": "10.0.0.7", "x-forwarded-proto": "https"}
        wrong = {"name": "anna", "password": "wrong"}
        async with httpx.AsyncClient(trust_env=False, base_url=client.base_url) as stranger:
            answer = await stranger.post(LOGIN, json=wrong, headers=through)
        told.append("strict-transport-security" in answer.headers)

    served(tmp_path, body, site=site)
    (refused,) = (one for one in audit.read_entries(tmp_path) if one["action"] == "sign-in-refused")
    assert refused["details"]["address"] == ("10.0.0.7" if proxies else "127.0.0.1")
    assert told == [bool(proxies)]


@pytest.mark.parametrize("number", few((60, 1000), 1))
@pytest.mark.parametrize("secure", [False, True])
def test_a_stop_is_answered_next_to_half_bodies_and_half_handshakes(tmp_path: Path, number: int, secure: bool) -> None:
    """Judged by the order of events: the stop is answered while every half body that was let in still waits."""
    head = b"POST /api/v1/login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 40\r\n\r\n{"
    trust: ssl.SSLContext | bool = certificate(tmp_path) if secure else True
    context = trust if isinstance(trust, ssl.SSLContext) else None

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        async def half() -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            reader, writer = await asyncio.open_connection("127.0.0.1", client.base_url.port, ssl=context)
            writer.write(head)
            return reader, writer

        halves = await asyncio.gather(*(half() for _one in range(number)))
        shaking = [await asyncio.open_connection("127.0.0.1", client.base_url.port) for _one in range(number)]
        for _reader, writer in shaking:
            writer.write(b"\x16\x03\x01")
        answers = [asyncio.create_task(reader.readline()) for reader, _writer in halves]
        asked = await client.post(STOP, json={}, timeout=60.0)
        assert (asked.status_code, asked.json()) == (200, {"asked": False})
        before = [one.result() for one in answers if one.done()]
        assert all(b" 429 " in line for line in before), "none of those let in has waited out its time"
        while len(before) < number - MOST_UNFINISHED["stranger"]:
            await asyncio.wait([one for one in answers if not one.done()], return_when=asyncio.FIRST_COMPLETED)
            before = [one.result() for one in answers if one.done()]
        for one in answers:
            one.cancel()
        await asyncio.gather(*answers, return_exceptions=True)
        for _reader, writer in (*halves, *shaking):
            writer.transport.abort()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    served(tmp_path, body, site=SECURE if secure else SITE, trust=trust)


def test_of_the_offered_service_a_stop_passes_where_strangers_asked_too_often(tmp_path: Path) -> None:
    offer: Offered = offered(tmp_path, SITE)
    for _ask in range(600):
        offer.service.doors.asks.count("address 127.0.0.1")

    async def ask(headers: dict[str, str]) -> int:
        transport = httpx.ASGITransport(app=offer.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return (await client.post(STOP, json={}, headers=headers)).status_code

    assert asyncio.run(ask({})) == 429
    assert asyncio.run(ask(offer.signed_in("operator"))) == 200
    assert offer.at.stopped == ["anna at the page"]
