"""Messages through a mosquitto that is killed and started again; run by `make services`."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import shutil
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import aiomqtt
import pytest

from drivers.clock import LoopClock
from gateway.config import MqttSection
from gateway.mqtt import Publish, Publisher, Spool
from gateway.mqtt.connecting import _Quietly, connected
from tests.services.peers import lasting_port

pytestmark = [pytest.mark.services, pytest.mark.wall_time]
MESSAGES, ROUNDS = 400, 4
THEIRS = "somebody-else"
LONG_S = 120.0  # far more than anything here takes: only an end that never comes is a failure


class Mosquitto:
    """One server of messages on loopback, with a password."""

    def __init__(self, folder: Path) -> None:
        self._program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
        if not Path(self._program).exists():
            pytest.skip("NOT RUN: no mosquitto here (Debian package mosquitto)")
        self.port = lasting_port()
        words = folder / "words"
        subprocess.run(["mosquitto_passwd", "-b", "-c", str(words), "gateway", "secret"], check=True)
        words.chmod(0o644)
        folder.chmod(0o755)
        self._config = folder / "mosquitto.conf"
        self._config.write_text(f"listener {self.port} 127.0.0.1\npassword_file {words}\nuser root\n")
        self._process: subprocess.Popen[bytes] | None = None

    async def start(self) -> None:
        self._process = await asyncio.to_thread(self._begun)
        await self._answers()

    def _begun(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen([self._program, "-c", str(self._config)], stderr=subprocess.DEVNULL)

    async def _answers(self) -> None:
        while True:
            with suppress(OSError):
                _reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
                writer.close()
                return
            assert self._process is not None
            assert self._process.poll() is None
            await LoopClock().sleep(0.05)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Mosquitto]:
    made = Mosquitto(tmp_path)
    yield made
    made.kill()


async def listen(port: int, got: list[int], topics: set[str], ready: asyncio.Event) -> None:
    """Somebody else's client, which comes back as often as it takes."""
    while True:
        with suppress(aiomqtt.MqttError):
            client = _Quietly(
                "127.0.0.1", port, username="gateway", password="secret", logger=logging.getLogger(THEIRS)
            )
            client.look()
            async with client:
                await client.subscribe("trueflank/#", qos=1)
                ready.set()
                async for found in client.messages:
                    assert isinstance(found.payload, bytes)
                    told = json.loads(found.payload)
                    topics.add(str(found.topic))
                    if "number" in told:
                        got.append(told["number"])
        await LoopClock().sleep(0.05)


async def until(come: Callable[[], bool]) -> None:
    async with LoopClock().deadline(LONG_S, "mosquitto"):
        while not come():
            await LoopClock().sleep(0.02)


async def test_killed_and_started_again_every_message_arrives(
    server: Mosquitto, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "word").write_text("secret\n")
    section = MqttSection(host="127.0.0.1", port=server.port, user="gateway", password_file=Path("word"))
    confirmed: list[int] = []
    clock = LoopClock(speed=20.0)
    noise: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda _loop, met: noise.append(str(met)))
    caplog.set_level(logging.WARNING)

    @asynccontextmanager
    async def noted() -> AsyncIterator[Publish]:
        # A server keeps nothing for who has not subscribed yet: what it confirms before that reaches nobody.
        await listening.wait()
        async with connected(section, tmp_path, "trueflank-test", will=publisher.will, clock=LoopClock()) as publish:

            async def through(topic: str, payload: bytes, *, stays: bool) -> None:
                await publish(topic, payload, stays=stays)
                confirmed.append(json.loads(payload).get("number", 0))

            yield through

    publisher = Publisher("hall-3", "trueflank", Spool(tmp_path / "queue", 1 << 26), clock=clock, connect=noted)
    got: list[int] = []
    topics: set[str] = set()
    listening = asyncio.Event()
    await server.start()
    tasks = [
        asyncio.create_task(publisher.work()),
        asyncio.create_task(listen(server.port, got, topics, listening)),
    ]
    await listening.wait()
    on_the_way: set[int] = set()
    for round_ in range(ROUNDS):
        for number in range(MESSAGES):
            publisher.take("taken", {"axis": "X1", "target": float(number)})
            if number == MESSAGES // 2:
                count = len(confirmed) + 3 * (round_ + 1)
                await until(lambda: len(confirmed) >= count)  # noqa: B023 - awaited here
                server.kill()
                listening.clear()
        await until(lambda: not publisher.standing.connected)
        # What a server confirmed and had not handed on when it was killed is its own loss: no gateway can know.
        on_the_way |= set(confirmed) - set(got)
        await server.start()
        await listening.wait()
        await until(lambda: publisher.standing.queued == 0)
    await until(lambda: max(got, default=0) >= MESSAGES * ROUNDS)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    every = set(range(1, MESSAGES * ROUNDS + 1))
    assert every <= set(confirmed), "each was confirmed"
    assert every - on_the_way <= set(got), "and each came to who listens"
    assert len(on_the_way) < 5 * ROUNDS, "one at a time: hardly any is on its way"
    assert publisher.standing.dropped == 0
    assert topics == {"trueflank/v1/hall-3/taken", "trueflank/v1/hall-3/online"}
    gc.collect()
    assert noise == []
    told = [one.name for one in caplog.records if one.name != THEIRS]
    assert set(told) <= {"trueflank.mqtt"}, "our own words alone"
    assert len(told) <= ROUNDS, "once for each time that it was away"
