"""One conversation: answers belong to their questions or the link is broken."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.clock import LoopClock
from drivers.errors import (
    DeadlineExceeded,
    DeviceRefused,
    LinkBroken,
    LocalProtocolError,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
)
from drivers.link import Feed, Link
from drivers.transport import ByteTransport, listen_memory, open_transport
from drivers.types.sensing import SampleBlock
from tests.unit.drivers.loops import run_clean


@dataclass(frozen=True)
class Word:
    text: str


class WordCodec:
    """Words between line feeds; "*..." is news."""

    def __init__(self) -> None:
        self._pending = b""

    def send(self, message: Word) -> bytes:
        if not message.text:
            raise LocalProtocolError("E-LINK-URL", "test", why="empty")
        return message.text.encode() + b"\n"

    def receive(self, data: bytes) -> list[Word]:
        *lines, self._pending = (self._pending + data).split(b"\n")
        return [Word(line.decode()) for line in lines]


Server = Callable[[ByteTransport], Awaitable[None]]
Client = Callable[[Link[Word, Word], LoopClock], Awaitable[None]]


def talk(server: Server, client: Client, *, backlog: int = 64) -> list[tuple[str, bytes]]:
    """Run a client against a server in virtual time; what passed the wire."""
    traced: list[tuple[str, bytes]] = []

    async def main() -> None:
        clock = LoopClock()
        listener = listen_memory("link", server)
        link: Link[Word, Word] = Link(
            "device",
            await open_transport("memory://link", clock, 1.0),
            WordCodec(),
            clock,
            is_answer=lambda word: not word.text.startswith("*"),
            matches=lambda asked, word: word.text.endswith(asked.text),
            trace=lambda direction, data: traced.append((direction, data)),
            backlog=backlog,
        )
        try:
            await client(link, clock)
        finally:
            await link.close()
            await link.close()
            await listener.close()

    run_clean(main, virtual=True)
    return traced


def answering(delay_s: dict[bytes, float] | None = None, extra: bytes = b"") -> Server:
    async def server(wire: ByteTransport) -> None:
        clock, pending = LoopClock(), b""
        while True:
            *lines, pending = (pending + await wire.read(1000)).split(b"\n")
            for line in lines:
                await clock.sleep((delay_s or {}).get(line, 0.0))
                await wire.write(extra + b"re:" + line + b"\n")

    return server


def test_questions_are_answered_one_at_a_time_and_traced() -> None:
    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        answers = await asyncio.gather(*(link.exchange(Word(f"q{number}"), 5.0) for number in range(5)))
        assert [answer.text for answer in answers] == [f"re:q{number}" for number in range(5)]

    traced = talk(answering(), client)
    assert traced[:4] == [(">", b"q0\n"), ("<", b"re:q0\n"), (">", b"q1\n"), ("<", b"re:q1\n")]


def test_after_a_timeout_the_link_is_broken_and_no_late_answer_is_ever_given() -> None:
    async def client(link: Link[Word, Word], clock: LoopClock) -> None:
        with pytest.raises(DeadlineExceeded, match="E-LINK-DEADLINE"):
            await link.exchange(Word("slow"), 1.0)
        for wait_s in (0.0, 10.0):
            await clock.sleep(wait_s)
            with pytest.raises(LinkBroken, match="E-LINK-BROKEN"):
                await link.exchange(Word("next"), 5.0)
        assert link.failure is not None

    traced = talk(answering({b"slow": 3.0}), client)
    assert (">", b"next\n") not in traced


def test_after_a_cancel_the_link_is_broken() -> None:
    async def client(link: Link[Word, Word], clock: LoopClock) -> None:
        asking = asyncio.create_task(link.exchange(Word("slow"), 5.0))
        await clock.sleep(0.5)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        with pytest.raises(LinkBroken):
            await link.exchange(Word("next"), 5.0)

    talk(answering({b"slow": 3.0}), client)


def test_who_only_waits_for_the_lock_breaks_nothing() -> None:
    async def client(link: Link[Word, Word], clock: LoopClock) -> None:
        first = asyncio.create_task(link.exchange(Word("slow"), 10.0))
        await clock.sleep(0.1)
        with pytest.raises(DeadlineExceeded):
            await link.exchange(Word("impatient"), 1.0)
        assert (await first).text == "re:slow"
        assert (await link.exchange(Word("next"), 1.0)).text == "re:next"

    talk(answering({b"slow": 3.0}), client)


def test_a_question_that_cannot_be_said_breaks_nothing() -> None:
    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        with pytest.raises(LocalProtocolError):
            await link.exchange(Word(""), 1.0)
        assert (await link.exchange(Word("next"), 1.0)).text == "re:next"

    talk(answering(), client)


def test_an_answer_to_another_question_is_an_error_and_breaks() -> None:
    async def wrong(wire: ByteTransport) -> None:
        await wire.read(100)
        await wire.write(b"re:other\n")
        await wire.read(100)

    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        with pytest.raises(RemoteProtocolError, match="E-LINK-STRAY"):
            await link.exchange(Word("this"), 5.0)
        with pytest.raises(LinkBroken, match="E-LINK-STRAY"):
            await link.exchange(Word("next"), 5.0)

    talk(wrong, client)


def test_an_answer_that_nobody_asked_for_breaks() -> None:
    async def eager(wire: ByteTransport) -> None:
        await wire.write(b"re:nothing\n")
        await wire.read(100)

    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        with pytest.raises(RemoteProtocolError, match="E-LINK-STRAY"):
            await link.news()
        with pytest.raises(LinkBroken):
            await link.exchange(Word("this"), 5.0)

    talk(eager, client)


def test_news_come_between_question_and_answer_in_their_order() -> None:
    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        for number in range(3):
            await link.exchange(Word(f"q{number}"), 5.0)
        assert [(await link.news()).text for _ in range(6)] == ["*one", "*two"] * 3

    talk(answering(extra=b"*one\n*two\n"), client)


def test_news_nobody_takes_are_bounded_by_an_error() -> None:
    async def noisy(wire: ByteTransport) -> None:
        for number in range(100):
            await wire.write(b"*%d\n" % number)
        await wire.read(1)

    async def client(link: Link[Word, Word], clock: LoopClock) -> None:
        await clock.sleep(1.0)
        with pytest.raises(LinkBroken, match="E-LINK-OVERFLOW"):
            await link.exchange(Word("x"), 1.0)

    talk(noisy, client, backlog=10)


def test_a_lost_wire_ends_the_question_and_the_news() -> None:
    async def leaving(wire: ByteTransport) -> None:
        await wire.write(b"*last\n")
        await wire.read(100)

    async def client(link: Link[Word, Word], _clock: LoopClock) -> None:
        with pytest.raises(TransportError, match="E-LINK-CLOSED"):
            await link.exchange(Word("x"), 5.0)
        assert (await link.news()).text == "*last"
        for _ in range(2):
            with pytest.raises(TransportError, match="E-LINK-CLOSED"):
                await link.news()

    talk(leaving, client)


def block(count: int = 3) -> SampleBlock:
    return SampleBlock(("x_mm",), np.arange(float(count)), np.zeros((count, 1)), np.ones(count, bool))


def feed_test(main: Callable[[Feed, LoopClock], Awaitable[None]], limit: int = 1000) -> None:
    async def wrapped() -> None:
        await main(Feed("laser", limit), LoopClock())

    run_clean(wrapped, virtual=True)


def test_a_feed_gives_what_comes_after_one_sits_down() -> None:
    async def main(feed: Feed, clock: LoopClock) -> None:
        feed.publish(block(1))
        follow = feed.follow(clock, 5.0)
        waiting = asyncio.create_task(anext(follow))
        await clock.sleep(0.1)
        feed.publish(block(2))
        feed.publish(block(3))
        assert len(await waiting) == 2
        assert len(await anext(follow)) == 3
        await follow.aclose()

    feed_test(main)


def test_a_feed_that_is_not_read_ends_with_an_error_after_what_it_held() -> None:
    async def main(feed: Feed, clock: LoopClock) -> None:
        follow = feed.follow(clock, 5.0)
        waiting = asyncio.create_task(anext(follow))
        await clock.sleep(0.1)
        for _ in range(5):
            feed.publish(block(400))
        await waiting
        assert len(await anext(follow)) == 400
        assert len(await anext(follow)) == 400
        with pytest.raises(TransportError, match="E-LINK-OVERFLOW"):
            await anext(follow)

    feed_test(main)


def test_silence_is_an_error_and_not_a_repeated_reading() -> None:
    async def main(feed: Feed, clock: LoopClock) -> None:
        before = clock.now()
        with pytest.raises(TransportError, match="E-LINK-STALE"):
            await anext(feed.follow(clock, 5.0))
        assert clock.now() - before == pytest.approx(5.0, abs=0.1)

    feed_test(main)


def test_the_later_reader_takes_the_seat_and_the_former_is_told() -> None:
    async def main(feed: Feed, clock: LoopClock) -> None:
        first, second = feed.follow(clock, 50.0), feed.follow(clock, 50.0)
        waiting = asyncio.create_task(anext(first))
        await clock.sleep(0.1)
        other = asyncio.create_task(anext(second))
        with pytest.raises(DeviceRefused, match="E-LINK-SEAT"):
            await waiting
        feed.publish(block())
        assert len(await other) == 3
        await second.aclose()

    feed_test(main)


def test_a_failure_reaches_every_reader_now_and_later() -> None:
    async def main(feed: Feed, clock: LoopClock) -> None:
        waiting = asyncio.create_task(anext(feed.follow(clock, 50.0)))
        await clock.sleep(0.1)
        feed.fail(TrueflankError("E-LINK-CLOSED", "laser", why="unplugged"))
        for reader in (waiting, anext(feed.follow(clock, 5.0))):
            with pytest.raises(TrueflankError, match="unplugged"):
                await reader

    feed_test(main)
