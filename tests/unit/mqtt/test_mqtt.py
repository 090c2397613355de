"""Messages for other systems: queued on the disk, sent in order, none lost while the server is away, losses counted."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import ConfigError, LinkBroken, TrueflankError
from gateway.config import MqttSection
from gateway.mqtt import KINDS, Publish, Publisher, Spool, connecting
from gateway.mqtt.connecting import connected
from gateway.mqtt.publishing import MOST_UNKEPT
from tests.sizes import few

MB = 1 << 20


@dataclass
class FakeServer:
    """A server of messages that a test takes away."""

    away: bool = False
    dies_after: int = -1
    asked: int = 0
    got: list[dict[str, Any]] = field(default_factory=list)

    @asynccontextmanager
    async def connect(self) -> AsyncIterator[Publish]:
        self.asked += 1
        if self.away:
            raise LinkBroken("E-MQTT-AWAY", "server", why="refused")
        yield self.publish

    async def publish(self, topic: str, payload: bytes, *, stays: bool) -> None:
        if self.away or self.dies_after == 0:
            self.away = True
            raise LinkBroken("E-MQTT-AWAY", "server", why="gone")
        self.dies_after -= 1
        self.got.append({"topic": topic, "stays": stays, **json.loads(payload)})

    def numbers(self) -> list[int]:
        return [one["number"] for one in self.got if "number" in one]


def message(number: int) -> tuple[str, bool, dict[str, Any]]:
    return ("a/b", False, {"n": number})


@asynccontextmanager
async def working(publisher: Publisher) -> AsyncIterator[None]:
    task = asyncio.create_task(publisher.work())
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@pytest.mark.parametrize("hours", few((13.0, 400.0), 1))
async def test_a_server_away_for_hours_loses_nothing(
    tmp_path: Path, hours: float, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "trueflank.mqtt")
    clock, server = LoopClock(), FakeServer()
    publisher = Publisher("hall-3", "trueflank", Spool(tmp_path, 64 * MB), clock=clock, connect=server.connect)
    async with working(publisher):
        publisher.take("state of things", {})
        publisher.take("status", {"state": "ready", "run": {"who": "anna", "axis": "X1"}})
        await clock.sleep(5.0)
        server.away = True
        until, count = clock.now() + hours * 3600.0, 1
        while clock.now() < until:
            publisher.take("taken", {"axis": "X1", "target": float(count), "deviation": 1.5, "secret": "no"})
            count += 1
            await clock.sleep(120.0)
        assert not publisher.standing.connected
        assert publisher.standing.queued == count - 1
        assert server.asked < 10 + hours * 62, "asked again ever more slowly"
        server.away = False
        await clock.sleep(120.0)
        assert publisher.standing.connected
    away, again = (one.getMessage() for one in caplog.records)
    assert "E-MQTT-AWAY" in away
    assert f"accepts messages again, {count - 1} waited" in again
    assert server.numbers() == list(range(1, count + 1))
    taken = [one for one in server.got if one["kind"] == "taken"]
    assert [one["data"]["target"] for one in taken] == [float(number) for number in range(1, count)]
    assert taken[0]["data"] == {"axis": "X1", "target": 1.0, "deviation": 1.5}
    assert {one["dropped"] for one in taken} == {0}
    assert publisher.standing.dropped == 0
    status = next(one for one in server.got if one["kind"] == "status")
    assert (status["topic"], status["stays"], status["version"]) == ("trueflank/v1/hall-3/status", True, 1)
    assert status["data"]["run"] == {"axis": "X1"}
    assert [one["online"] for one in server.got if one["kind"] == "online"][-1] is False


async def test_a_server_that_dies_in_the_middle_gets_the_rest_and_misses_none(tmp_path: Path) -> None:
    clock, server = LoopClock(), FakeServer()
    publisher = Publisher("hall-3", "t", Spool(tmp_path, MB), clock=clock, connect=server.connect)
    async with working(publisher):
        for round_ in range(8):
            server.away, server.dies_after = False, 3 + 5 * round_
            for number in range(20):
                publisher.take("taken", {"target": float(number)})
            await clock.sleep(200.0)
        server.away, server.dies_after = False, -1
        await clock.sleep(200.0)
    assert sorted(set(server.numbers())) == list(range(1, 161))
    first = list(dict.fromkeys(server.numbers()))
    assert first == sorted(first), "in their order, some twice"


async def test_what_comes_faster_than_the_disk_is_counted(tmp_path: Path) -> None:
    clock, server = LoopClock(), FakeServer()
    publisher = Publisher("hall-3", "t", Spool(tmp_path, 64 * MB), clock=clock, connect=server.connect)
    for number in range(MOST_UNKEPT + 7):
        publisher.take("taken", {"target": number})
    assert publisher.standing.dropped == 7
    publisher._unkept = type(publisher._unkept)(list(publisher._unkept)[-5:])
    async with working(publisher):
        await clock.sleep(5.0)
    assert [one["data"]["target"] for one in server.got if one["kind"] == "taken"][-1] == MOST_UNKEPT + 6
    assert server.got[1]["dropped"] == 7
    assert Spool(tmp_path, MB).dropped == 7


def test_a_queue_that_is_full_drops_the_oldest_and_counts_them_for_ever(tmp_path: Path) -> None:
    spool = Spool(tmp_path, 4000, piece_bytes=1000)
    spool.put([message(number) for number in range(1, 301)])
    kept = [one.number for one in _all(spool)]
    assert kept == list(range(kept[0], 301))
    assert spool.dropped == kept[0] - 1 > 100
    assert sum(path.stat().st_size for path in tmp_path.glob("*.jsonl")) <= 4000
    assert Spool(tmp_path, 4000, piece_bytes=1000).dropped == spool.dropped


def _all(spool: Spool) -> list[Any]:
    found = []
    while batch := spool.next(7):
        found += batch
        spool.confirm(batch[-1].number)
    return found


def test_a_queue_that_was_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    spool = Spool(tmp_path, 64 * MB, piece_bytes=400)
    spool.put([message(number) for number in range(1, 41)])
    spool.confirm(17)
    newest = sorted(tmp_path.glob("*.jsonl"))[-1]
    with newest.open("ab") as file:
        file.write(b'{"number": 41, "topic": "torn')
    again = Spool(tmp_path, 64 * MB, piece_bytes=400)
    assert again.queued == 23
    again.put([message(41)])
    assert [one.number for one in _all(again)] == list(range(18, 42))
    assert again.queued == 0
    assert len(list(tmp_path.glob("*.jsonl"))) == 1
    assert Spool(tmp_path, 64 * MB).next() == []


def test_a_queue_that_cannot_be_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(TrueflankError) as caught:
        Spool(tmp_path / "file" / "queue", MB)
    assert caught.value.code == "E-MQTT-QUEUE"


@pytest.mark.wall_time
async def test_nobody_there_is_said_and_no_secret_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listener = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    port = listener.sockets[0].getsockname()[1]
    monkeypatch.setenv("MQTT_WORD", "very-secret")
    monkeypatch.setattr(connecting, "ANSWER_S", 0.3)
    section = MqttSection(host="127.0.0.1", port=port, user="u", password_env="MQTT_WORD")
    with pytest.raises(LinkBroken) as caught:
        async with connected(section, tmp_path, "x", will=("a", b""), clock=LoopClock()):
            pass
    listener.close()
    assert "very-secret" not in str(caught.value)
    gone = MqttSection(host="127.0.0.1", port=port, password_file=Path("no-such"))
    listener = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", port)
    with pytest.raises(ConfigError, match="password"):
        async with connected(gone, tmp_path, "x", will=("a", b""), clock=LoopClock()):
            pass
    listener.close()


def test_every_kind_of_message_is_documented() -> None:
    page = (Path(__file__).parents[3] / "docs" / "service.md").read_text(encoding="utf-8")
    part = page.partition("## Messages for other systems")[2].partition("\n## ")[0]
    for kind, members in KINDS.items():
        row = next(line for line in part.splitlines() if line.startswith(f"| `{kind}`"))
        if kind != "failure":
            assert all(f"`{member}`" in row for member in members), kind
