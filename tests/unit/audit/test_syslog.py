"""Audit records at a server of logs: each once and in order, whatever the server did; and the clock's state."""

from __future__ import annotations

import asyncio
import json
import re
from contextlib import suppress
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from gateway import audit
from gateway.audit.recording import clock_from, clock_now
from gateway.audit.syslog import message_of
from tests.unit.audit.log import Moments

# Written from the ABNF of RFC 5424, section 6: head, structured data, message.
RFC5424 = re.compile(
    rb"<(?P<pri>\d{1,3})>1 (?P<utc>\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{1,6}(?:Z|[+-]\d\d:\d\d)) (?P<host>[!-~]{1,255})"
    rb" (?P<app>[!-~]{1,48}) (?P<proc>[!-~]{1,128}) (?P<id>[!-~]{1,32})"
    rb' (?P<data>\[[!-<>-\\^-~]{1,32}(?: [!-<>-\\^-~]{1,32}="(?:[^"\\\]]|\\["\\\]])*")*\])'
    rb" \xef\xbb\xbf(?P<text>[\x20-\x7e]*)"
)


def records(root: Path, count: int, first: int = 1) -> None:
    for number in range(first, first + count):
        audit.record(root, "approve", clock=Moments(), actor="ann", serial="SN-1", transaction=number)


def test_a_record_is_one_message_whatever_it_says(tmp_path: Path) -> None:
    odd = {"why": 'a "quoted" ] \\ line\n<13>1 forged', "name": "µ\x1b[31m"}
    audit.record(tmp_path, "sign-in-refused", clock=Moments(), actor='e"v]il\\\n', details=odd)
    (found,) = audit.read_entries(tmp_path)
    message = message_of(found, "hall 3\n<1>")
    told = RFC5424.fullmatch(message)
    assert told is not None, message
    assert int(told["pri"]) == 13 * 8 + 4
    assert told["utc"].decode() == found["utc"]
    assert told["host"] == b"hall3<1>"
    assert json.loads(told["text"])["details"] == odd
    assert b'actor="e\\"v\\]il' in told["data"]


class Logs:
    """A server of logs over TCP: frames with their length."""

    def __init__(self) -> None:
        self.got: list[int] = []
        self.writers: list[asyncio.StreamWriter] = []
        self.tasks: list[asyncio.Task[None] | None] = []
        self.server: asyncio.Server | None = None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.append(writer)
        self.tasks.append(asyncio.current_task())
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                length = int(await reader.readuntil(b" "))
                told = RFC5424.fullmatch(await reader.readexactly(length))
                assert told is not None
                found = re.search(rb' seq="(\d+)"', told["data"])
                assert found is not None
                self.got.append(int(found[1]))

    async def start(self, port: int = 0) -> int:
        self.server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        return int(self.server.sockets[0].getsockname()[1])

    async def end(self) -> None:
        assert self.server is not None
        self.server.close()
        for writer in self.writers:
            writer.transport.abort()
        await asyncio.gather(*(task for task in self.tasks if task is not None), return_exceptions=True)


@pytest.mark.wall_time
async def test_what_a_server_missed_comes_when_it_is_back(tmp_path: Path) -> None:
    logs, clock = Logs(), LoopClock(speed=200.0)
    records(tmp_path, 5)
    port = await logs.start()
    task = asyncio.create_task(audit.forward(tmp_path, f"tcp://127.0.0.1:{port}", clock))
    await reached(logs, 5)
    await logs.end()
    records(tmp_path, 7, 6)
    await clock.sleep(100.0)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    records(tmp_path, 3, 13)
    await logs.start(port)
    task = asyncio.create_task(audit.forward(tmp_path, f"tcp://127.0.0.1:{port}", clock))
    await reached(logs, 15)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await logs.end()
    # What had left for a server that died cannot be known: over TCP the first of them may be gone with it.
    assert logs.got[:5] == [1, 2, 3, 4, 5]
    assert logs.got[-3:] == [13, 14, 15]
    assert logs.got == sorted(set(logs.got))


async def reached(logs: Logs, last: int) -> None:
    async with LoopClock().deadline(20.0, "logs"):
        while last not in logs.got:
            await LoopClock().sleep(0.01)


@pytest.mark.wall_time
async def test_over_udp_each_record_is_a_datagram(tmp_path: Path) -> None:
    got: list[bytes] = []

    class Heard(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, _addr: object) -> None:
            got.append(data)

    way, _ = await asyncio.get_running_loop().create_datagram_endpoint(Heard, local_addr=("127.0.0.1", 0))
    records(tmp_path, 3)
    port = way.get_extra_info("sockname")[1]
    task = asyncio.create_task(audit.forward(tmp_path, f"udp://127.0.0.1:{port}", LoopClock(speed=100.0)))
    async with LoopClock().deadline(20.0, "logs"):
        while len(got) < 3:
            await LoopClock().sleep(0.01)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    way.close()
    assert all(RFC5424.fullmatch(one) for one in got)


def test_every_record_says_what_is_known_of_the_clock(tmp_path: Path) -> None:
    records(tmp_path, 1)
    (found,) = audit.read_entries(tmp_path)
    assert found["clock"] == dict(clock_now())
    assert found["clock"]["synchronised"] in (True, False, "unknown")
    assert audit.is_sound(tmp_path)


@pytest.mark.parametrize(
    ("state", "status", "said"),
    [
        (0, 0x2001, {"synchronised": True, "offset_s": 0.00125, "most_s": 0.02}),
        (0, 0x0001, {"synchronised": True, "offset_s": 1.25, "most_s": 0.02}),
        (5, 0x2040, {"synchronised": False}),
        (0, 0x0040, {"synchronised": False}),
    ],
)
def test_the_clocks_answer_is_read_in_its_own_unit(state: int, status: int, said: dict[str, object]) -> None:
    assert clock_from(state, status=status, offset=1_250_000, most_us=20_000) == said
