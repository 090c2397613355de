"""Messages through a mosquitto that is killed and started again; run by `make services`."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import aiomqtt
import pytest

from drivers.clock import LoopClock
from gateway.config import MqttSection
from gateway.mqtt import Publisher, Spool, connected
from gateway.mqtt.connecting import Publish

pytestmark = [pytest.mark.services, pytest.mark.wall_time]
MESSAGES, ROUNDS = 400, 4


class Mosquitto:
    """One server of messages on loopback, with a password."""

    def __init__(self, folder: Path) -> None:
        self._program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
        if not Path(self._program).exists():
            pytest.skip("NOT RUN: no mosquitto here (Debian package mosquitto)")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
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
            async with aiomqtt.Client("127.0.0.1", port, username="gateway", password="secret") as client:
                await client.subscribe("trueflank/#", qos=1)
                ready.set()
                async for found in client.messages:
                    assert isinstance(found.payload, bytes)
                    told = json.loads(found.payload)
                    topics.add(str(found.topic))
                    if "number" in told:
                        got.append(told["number"])
        ready.clear()
        await LoopClock().sleep(0.05)


async def test_killed_and_started_again_every_message_arrives(server: Mosquitto, tmp_path: Path) -> None:
    (tmp_path / "word").write_text("secret\n")
    section = MqttSection(host="127.0.0.1", port=server.port, user="gateway", password_file=Path("word"))
    confirmed: list[int] = []
    clock = LoopClock(speed=20.0)

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
    for round_ in range(ROUNDS):
        for number in range(MESSAGES):
            publisher.take("taken", {"axis": "X1", "target": float(number)})
            if number == MESSAGES // 2:
                await LoopClock().sleep(0.05 * (round_ + 1))
                server.kill()
                listening.clear()
                before = len(confirmed)
                await LoopClock().sleep(0.2)
        async with LoopClock().deadline(30.0, "mosquitto"):
            while publisher.standing.connected:
                await LoopClock().sleep(0.05)
        await server.start()
        await listening.wait()
        async with LoopClock().deadline(30.0, "mosquitto"):
            while publisher.standing.queued:
                await LoopClock().sleep(0.05)
        assert len(confirmed) > before
    async with LoopClock().deadline(30.0, "mosquitto"):
        while not got or max(got) < MESSAGES * ROUNDS:
            await LoopClock().sleep(0.05)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    every = set(range(1, MESSAGES * ROUNDS + 1))
    assert every <= set(confirmed), "each was confirmed"
    assert every <= set(got), "and each came to who listens"
    assert publisher.standing.dropped == 0
    assert topics == {"trueflank/v1/hall-3/taken", "trueflank/v1/hall-3/online"}
