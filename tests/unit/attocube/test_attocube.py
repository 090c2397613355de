"""The IDS3010 driver against a scripted device that speaks in bytes of its own."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import registry
from drivers.attocube.codec import Ask, AttocubeCodec, DamagedReply, Result
from drivers.clock import Clock, LoopClock
from drivers.errors import ConfigError, TransportError, TrueflankError
from drivers.ports.instruments import Instrument
from drivers.transport import ByteTransport, serve
from drivers.types.sensing import Ambient, SampleBlock

# A request and an answer as public clients of the device print them.
ASKED = b'{"jsonrpc":"2.0","method":"com.attocube.ids.displacement.getAxesDisplacement","params":[],"id":1,"api":2}\r\n'
ANSWERED = b'{"jsonrpc":"2.0","result":[0,1000,-2000,3000000],"id":1}\r\n'
INDEX = 1.00027


def test_a_request_is_the_published_line() -> None:
    asked = Ask(1, "com.attocube.ids.displacement.getAxesDisplacement")
    assert AttocubeCodec().send(asked) == ASKED


@given(st.integers(1, len(ANSWERED) - 1))
def test_an_answer_is_read_wherever_it_is_split(at: int) -> None:
    codec = AttocubeCodec()
    found = [*codec.receive(ANSWERED[:at]), *codec.receive(ANSWERED[at:])]
    assert found == [Result(1, (0, 1000, -2000, 3000000))]


@given(st.binary(max_size=200))
def test_any_bytes_give_answers_or_damage(data: bytes) -> None:
    for found in AttocubeCodec().receive(data + b"\n"):
        assert isinstance(found, DamagedReply | Result)


@pytest.mark.parametrize(
    "line", [b"{}", b"[1]", b'{"id":"1","result":[0]}', b'{"id":1,"result":5}', b'{"id":1,"result":[]}', b"nan"]
)
def test_what_is_no_answer_is_damage(line: bytes) -> None:
    (found,) = AttocubeCodec().receive(line + b"\n")
    assert isinstance(found, DamagedReply)


class ScriptedIds:
    """Axis 2 runs away at 1 mm/s of air; nothing of the driver's arithmetic is used."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.answers: dict[str, Any] = {
            "com.attocube.system.getSerialNumber": [0, "L010 1234"],
            "com.attocube.system.getFirmwareVersion": ["1.9.2"],
            "com.attocube.ids.displacement.getMeasurementEnabled": [0, True],
            "com.attocube.ecu.getRefractiveIndexForCompensation": [0, INDEX],
            "com.attocube.ecu.getConnected": [0, True],
            "com.attocube.ecu.getTemperatureInDegrees": [0, 21.5],
            "com.attocube.ecu.getPressureInHPa": [0, 1001.2],
            "com.attocube.ecu.getHumidityInPercent": [0, 44.0],
        }
        self.warning = 0
        self.raw = b""
        self.cut = False

    async def converse(self, wire: ByteTransport) -> None:
        rest = b""
        while True:
            *lines, rest = (rest + await wire.read(4096)).split(b"\n")
            for line in lines:
                asked = json.loads(line)
                assert (asked["jsonrpc"], asked["api"]) == ("2.0", 2)
                if self.cut:
                    raise TransportError("E-LINK-CLOSED", "script", why="cut")
                await wire.write(self.raw or self._answer(asked))

    def _answer(self, asked: Any) -> bytes:
        found = self.answers.get(asked["method"])
        if asked["method"].endswith("getAxesDisplacement"):
            found = [self.warning, 5, round(self.clock.now() * 1e9), 7]
        body = {"error": {"code": -32601, "message": "Method not found"}} if found is None else {"result": found}
        return json.dumps({"jsonrpc": "2.0", "id": asked["id"], **body}).encode() + b"\r\n"


@asynccontextmanager
async def bench(url: str = "memory://ids", **settings: Any) -> AsyncIterator[tuple[ScriptedIds, Any]]:
    clock = LoopClock()
    script = ScriptedIds(clock)
    listener = await serve(url, script.converse, clock)
    device = registry.load("attocube-ids", "instrument")("ids", listener.url, {"axis": 2, **settings}, clock)
    try:
        yield script, device
    finally:
        await device.close()
        await listener.close()


async def take(device: Instrument, count: int) -> list[SampleBlock]:
    found: list[SampleBlock] = []
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        async for block in stream:
            found.append(block)
            if len(found) >= count:
                break
    return found


@pytest.mark.parametrize("url", ["memory://ids", pytest.param("tcp://127.0.0.1:0", marks=pytest.mark.wall_time)])
async def test_it_says_who_it_is_and_gives_the_optical_path_in_vacuum(url: str) -> None:
    async with bench(url) as (_script, device):
        assert isinstance(device, Instrument)
        who = await device.open(5.0)
        assert (who.serial, who.firmware) == ("L010 1234", "1.9.2")
        assert device.compensated_for == "nothing"
        assert await device.ambient() == Ambient(21.5, 1001.2, 44.0)
        blocks = await take(device, 3)
        time_s, path = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("time_s", "values"))
        assert np.diff(time_s).min() > 0.0
        # The device answers in pm of air: 1 mm/s, so path = t * n in mm of vacuum, within the time of an answer.
        assert path[:, 0] == pytest.approx(time_s * INDEX, abs=1e-9 if url.startswith("memory") else 0.05)
        assert all(block.valid.all() for block in blocks)


async def test_a_warning_makes_samples_invalid_and_is_told_once() -> None:
    async with bench() as (script, device):
        await device.open(5.0)
        script.warning = 3
        first, second = await take(device, 2)
        assert not first.valid.any()
        assert [*map(str, first.events)] == ["warning 3 of the device"]
        assert second.events == ()


@pytest.mark.parametrize(
    ("method", "answer", "code"),
    [
        ("com.attocube.ids.displacement.getMeasurementEnabled", [0, False], "E-IDS-OFF"),
        ("com.attocube.ecu.getRefractiveIndexForCompensation", None, "E-IDS-INDEX"),
        ("com.attocube.ecu.getRefractiveIndexForCompensation", [0, 0.0], "E-IDS-INDEX"),
        ("com.attocube.ecu.getRefractiveIndexForCompensation", [0, "x"], "E-IDS-ANSWER"),
        ("com.attocube.ecu.getRefractiveIndexForCompensation", [12, 1.0], "E-IDS-INDEX"),
        ("com.attocube.system.getSerialNumber", None, "E-IDS-ERROR"),
    ],
)
async def test_what_it_cannot_work_with_is_refused_at_opening(method: str, answer: Any, code: str) -> None:
    async with bench() as (script, device):
        script.answers[method] = answer
        with pytest.raises(TrueflankError) as caught:
            await device.open(5.0)
        assert caught.value.code == code
        assert caught.value.what


async def test_an_index_of_the_site_file_is_used_without_asking() -> None:
    async with bench(refractive_index=1.0003) as (script, device):
        script.answers["com.attocube.ecu.getRefractiveIndexForCompensation"] = None
        await device.open(5.0)
        (block,) = await take(device, 1)
        assert block.values[:, 0] == pytest.approx(block.time_s * 1.0003, abs=1e-9)


async def test_without_an_environment_unit_nothing_is_claimed() -> None:
    async with bench() as (script, device):
        script.answers["com.attocube.ecu.getConnected"] = [0, False]
        await device.open(5.0)
        assert await device.ambient() == Ambient()


@pytest.mark.parametrize("raw", [b"HTTP/1.1 400 Bad Request\r\n", b'{"id":99,"result":[0,1]}\r\n', b"\xff\r\n"])
async def test_nonsense_breaks_the_line_and_is_told(raw: bytes) -> None:
    async with bench() as (script, device):
        await device.open(5.0)
        script.raw = raw
        with pytest.raises(TrueflankError) as caught:
            await take(device, 1)
        assert caught.value.code in ("E-IDS-ANSWER", "E-LINK-STRAY")
        script.raw = b""
        with pytest.raises(TrueflankError) as later:
            await device.ambient()
        assert later.value.code == "E-LINK-BROKEN"
        await device.open(5.0)
        await take(device, 1)


async def test_a_pulled_line_ends_the_stream_and_a_new_open_works() -> None:
    async with bench() as (script, device):
        await device.open(5.0)
        script.cut = True
        with pytest.raises(TransportError):
            await take(device, 1)
        script.cut = False
        await device.open(5.0)
        await take(device, 1)


@pytest.mark.parametrize(
    ("key", "value"), [("axis", 4), ("poll_hz", 0.0), ("block_s", 9.0), ("refractive_index", 0.5), ("timeout_s", 0.0)]
)
def test_settings_out_of_limits_are_refused(key: str, value: float) -> None:
    with pytest.raises(ConfigError) as caught:
        registry.load("attocube-ids", "instrument")("ids", "tcp://x", {key: value}, LoopClock())
    assert caught.value.code == "E-CFG-SETTING-VALUE"
