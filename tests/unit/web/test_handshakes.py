"""Callers over TLS before their handshake: few at a time, the newest first, the silent and the oldest hung up on."""

from __future__ import annotations

import asyncio
import socket
import ssl
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from gateway.daemon.handshakes import AT_ONCE, MOST_WAITING, Handshakes
from tests.unit.web.test_daemon import certificate

pytestmark = pytest.mark.wall_time
HELLO = b"\x16\x03\x01"


class Callers:
    """Both ends of callers, and in which order their handshakes began."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ends: list[tuple[socket.socket, socket.socket]] = []
        self.begun: list[int] = []

        async def noted(_protocol: object, sock: socket.socket, **_told: object) -> None:
            self.begun.append([ours for ours, _theirs in self.ends].index(sock))
            sock.close()

        monkeypatch.setattr(asyncio.get_running_loop(), "connect_accepted_socket", noted)

    def come(self, at: Handshakes, *, says: bool = True) -> None:
        """One more."""
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        self.ends.append((ours, theirs))
        at.enter(ours)
        if says:
            theirs.sendall(HELLO)

    def hung_up(self) -> list[int]:
        """Whose connection is closed here."""
        return [number for number, (ours, _theirs) in enumerate(self.ends) if ours.fileno() < 0]

    def close(self) -> None:
        for pair in self.ends:
            for end in pair:
                end.close()


def made(patience_s: float = 5.0) -> Handshakes:
    return Handshakes(asyncio.Protocol, ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), patience_s=patience_s)


async def until(done: Any) -> None:
    async with LoopClock().deadline(10.0, "test"):
        while not done():
            await LoopClock().sleep(0)


async def test_of_a_crowd_the_newest_are_heard_first_and_the_oldest_hung_up_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at, callers = made(), Callers(monkeypatch)
    crowd = MOST_WAITING + 40
    for _one in range(crowd):
        callers.come(at)
    await until(lambda: callers.begun)
    assert len(callers.begun) <= AT_ONCE
    late = len(callers.ends)
    callers.come(at)
    await until(lambda: late in callers.begun)
    assert len(callers.begun) <= 8 * AT_ONCE, "whoever comes into a crowd is not behind it"
    await until(lambda: len(callers.hung_up()) == crowd + 1)
    never = set(range(crowd + 1)) - set(callers.begun)
    assert 40 - 8 * AT_ONCE <= len(never) <= 41
    assert max(never) < crowd // 2, "only of those that came first"
    callers.close()


async def test_who_says_nothing_is_hung_up_on_in_time_and_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    at, callers = made(0.3), Callers(monkeypatch)
    for _one in range(100):
        callers.come(at, says=False)
    callers.come(at)
    await until(lambda: callers.begun == [100])
    assert callers.hung_up() == [100]
    await until(lambda: len(callers.hung_up()) == 101)
    assert callers.begun == [100]
    callers.close()


async def test_at_the_end_nobody_is_left_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    at, callers = made(), Callers(monkeypatch)
    for number in range(20):
        callers.come(at, says=number % 2 == 0)
    await until(lambda: callers.begun)
    callers.come(at)
    await at.end()
    assert len(callers.hung_up()) == 21
    callers.close()


async def test_a_handshake_that_is_not_whole_in_time_is_ended(tmp_path: Path) -> None:
    certificate(tmp_path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "gateway.pem", tmp_path / "key.pem")
    at = Handshakes(asyncio.Protocol, context, patience_s=0.2)
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    theirs.setblocking(False)
    at.enter(ours)
    theirs.sendall(HELLO)
    loop = asyncio.get_running_loop()
    async with LoopClock().deadline(5.0, "test"):
        while await loop.sock_recv(theirs, 1000):
            pass
    theirs.close()
    await at.end()
