"""A gauge that answers a question: lines as the manuals print them, each display on its wire, what is refused."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.clock import LoopClock
from drivers.errors import (
    ConfigError,
    DeadlineExceeded,
    DeviceRefused,
    RemoteProtocolError,
    TransportError,
    UnsupportedDevice,
)
from drivers.gauge.codec import DamagedLine, GaugeAsk, GaugeCodec, GaugeError, GaugeReading
from drivers.ports.instruments import Instrument
from drivers.transport import serve
from drivers.types.sensing import SampleBlock
from simulators.gauge import GaugeDisplay, Make, PtyGauge

GOLDEN = Path(__file__).parents[1] / "golden" / "gauge" / "answers.toml"
ANSWERS = tomllib.loads(GOLDEN.read_text(encoding="utf-8"))["answers"]
MAKES: dict[Make, dict[str, Any]] = {
    "mahr": {},
    "mahr-c1202": {"question": "M1?", "unit": "mm"},
    "tesa": {"unit": "mm"},
    "sylvac": {"question": "PRI", "unit": "mm", "scale": -1.0},
}


@pytest.mark.parametrize("one", ANSWERS, ids=lambda one: repr(one["bytes"]))
def test_answers_of_the_manuals_are_read_whole_and_in_pieces(one: dict[str, Any]) -> None:
    wanted = (
        GaugeError(one["error"])
        if "error" in one
        else GaugeReading(one["value"], one["unit"], one["decimals"], one.get("mark", ""))
    )
    data = one["bytes"].encode("ascii")
    assert list(GaugeCodec().receive(data)) == [wanted]
    codec = GaugeCodec()
    assert [message for byte in data for message in codec.receive(bytes([byte]))] == [wanted]


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=600))
def test_any_bytes_give_readings_errors_or_damage(data: bytes) -> None:
    for message in GaugeCodec().receive(data + b"\r\n"):
        assert isinstance(message, GaugeReading | GaugeError | DamagedLine)
        if isinstance(message, GaugeReading):
            assert np.isfinite(message.value)


@pytest.mark.parametrize("line", [b"+\t1.234 mm\r", b"-\x0b.5\r", b"+\x0c12\r"])
def test_a_sign_apart_from_its_number_by_more_than_a_blank_is_damage(line: bytes) -> None:
    """Found by the search of parsers: the number was then no number for Python."""
    (found,) = GaugeCodec().receive(line)
    assert isinstance(found, DamagedLine)


def test_questions_end_with_a_carriage_return() -> None:
    assert GaugeCodec().send(GaugeAsk("M1?")) == b"M1?\r"
    assert GaugeCodec("server").questions(b"?\rPRI\r\nM") == [GaugeAsk("?"), GaugeAsk("PRI")]


@asynccontextmanager
async def gauge(display: GaugeDisplay, **said: Any) -> AsyncIterator[Any]:
    clock = LoopClock()
    listener = await serve("memory://gauge", display.converse, clock)
    device = registry.load("gauge", "instrument")("gauge", listener.url, said, clock)
    try:
        yield device
    finally:
        await device.close()
        await listener.close()


async def first_block(device: Any) -> SampleBlock:
    async with aclosing(device.blocks()) as stream:
        found: SampleBlock = await anext(stream)
    return found


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("position_mm", [0.0, 0.0424, -1.2346])
async def test_every_display_gives_its_true_position(make: Make, position_mm: float) -> None:
    display = GaugeDisplay(make, lambda: position_mm, step=0.0005)
    async with gauge(display, resolution_um=0.5, **MAKES[make]) as device:
        identity = await device.open(10.0)
        assert isinstance(device, Instrument)
        assert (identity.driver, device.channels) == ("gauge", ("gauge_um",))
        block = await first_block(device)
    sign = MAKES[make].get("scale", 1.0)
    assert block.values[:, 0] == pytest.approx(np.full(5, sign * 1000.0 * position_mm), abs=0.2501)
    assert np.diff(block.time_s) == pytest.approx(0.2)
    assert block.valid.all()


async def test_inches_become_millimetres_and_the_unit_of_the_answer_counts() -> None:
    display = GaugeDisplay("mahr", lambda: 2.54, step=0.0001, inch=True)
    async with gauge(display, channel="gauge_mm") as device:
        await device.open(10.0)
        block = await first_block(device)
        assert block.values[0, 0] == pytest.approx(2.54)
    async with gauge(display, unit="mm") as device:
        with pytest.raises(UnsupportedDevice) as other:
            await device.open(10.0)
        assert (other.value.code, other.value.fields["found"]) == ("E-GAUGE-UNIT", "inch")
    async with gauge(GaugeDisplay("tesa", lambda: 0.1)) as device:
        with pytest.raises(UnsupportedDevice) as unknown:
            await device.open(10.0)
        assert unknown.value.code == "E-GAUGE-UNIT"


async def test_a_reading_between_two_steps_is_another_unit_or_resolution() -> None:
    async with gauge(GaugeDisplay("tesa", lambda: 0.0012, step=0.0001), unit="mm", resolution_um=5.0) as device:
        with pytest.raises(UnsupportedDevice) as between:
            await device.open(10.0)
    assert between.value.code == "E-GAUGE-RESOLUTION"


async def test_a_feature_that_goes_off_makes_samples_invalid_and_comes_back() -> None:
    display = GaugeDisplay("mahr-c1202", lambda: 0.05)
    async with gauge(display, **MAKES["mahr-c1202"]) as device:
        await device.open(10.0)
        async with aclosing(device.blocks()) as stream:
            await anext(stream)
            display.feature_on = False
            block = await anext(stream)
            display.feature_on = True
            after = await anext(stream)
    assert not block.valid.any()
    assert [*map(str, block.events)] == ["error 6 of the display"]
    assert after.valid.all()


async def test_a_question_that_the_display_does_not_know_is_refused() -> None:
    async with gauge(GaugeDisplay("mahr", lambda: 0.0), question="M1?") as device:
        with pytest.raises(DeviceRefused) as asked:
            await device.open(10.0)
    assert (asked.value.code, asked.value.fields["number"]) == ("E-GAUGE-ERROR", 23)


async def test_silence_ends_in_a_deadline_and_noise_in_a_broken_line() -> None:
    display = GaugeDisplay("mahr", lambda: 0.0)
    async with gauge(display) as device:
        await device.open(10.0)
        display.silent = True
        with pytest.raises(DeadlineExceeded):
            await first_block(device)
        with pytest.raises(TransportError):  # no later answer may belong to an earlier question
            await first_block(device)
    async with gauge(GaugeDisplay("mahr", lambda: 0.0, noisy=True)) as device:
        with pytest.raises(RemoteProtocolError) as noise:
            await device.open(10.0)
    assert noise.value.code == "E-GAUGE-ANSWER"


@pytest.mark.parametrize("said", [{"channel": "gauge_deg"}, {"scale": 2.0}, {"unit": "cm"}, {"data_bits": 6}])
def test_settings_that_cannot_be_are_refused(said: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        registry.load("gauge", "instrument")("gauge", "COM5", said, None)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals")
@pytest.mark.wall_time
async def test_a_display_on_a_serial_port() -> None:
    display = PtyGauge(GaugeDisplay("sylvac", lambda: -0.125))
    display.start()
    said = {"unit": "mm", "baudrate": 4800, "parity": "E", "data_bits": 7, "stop_bits": 2, "poll_hz": 50.0}
    device = registry.load("gauge", "instrument")("gauge", display.path, said | {"block_s": 0.05}, LoopClock())
    try:
        await device.open(30.0)
        block = await first_block(device)
        assert block.values[:, 0] == pytest.approx(np.full(len(block), -125.0))
    finally:
        await device.close()
        display.close()
