"""One suite for every instrument driver over every wire: what the gateway may rely on."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing, asynccontextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from drivers import registry
from drivers.bridge import records
from drivers.bridge.codec import BridgeRefusal
from drivers.bridge.device import BridgeInstrument
from drivers.bridge.records import CalibratorStatus
from drivers.clock import LoopClock
from drivers.errors import (
    BeamObstructed,
    ConfigError,
    DeviceRefused,
    LinkBroken,
    NotReferenced,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
)
from drivers.ports.instruments import Instrument, RotaryCalibrator
from drivers.transport import Listener, serve
from drivers.types.sensing import SampleBlock
from drivers.umd.device import UmdCounter
from tests.contract.servers import ScriptedBridge, ScriptedFrames, ScriptedInstrument, ScriptedUmd

SCRIPTS: dict[str, Callable[[LoopClock], Any]] = {
    "umd": ScriptedUmd,
    "bridge": ScriptedBridge,
    "bridge in frames": ScriptedFrames,
}
# On sockets the clock runs ten times as fast: this is 6 s of a loaded machine.
OPEN_S = 60.0
URLS = ["memory://instrument", "tcp://127.0.0.1:0", "socket://127.0.0.1:0"]
each_driver = pytest.mark.parametrize("driver", sorted(SCRIPTS))
each_wire = pytest.mark.parametrize(
    "url", [URLS[0], *(pytest.param(url, marks=pytest.mark.wall_time) for url in URLS[1:])]
)


class Bench:
    """One scripted instrument behind its wire, and its driver."""

    def __init__(self, script: Any, device: Any, listener: Listener, clock: LoopClock) -> None:
        self.script, self.device, self.listener, self.clock = script, device, listener, clock


@asynccontextmanager
async def bench(driver: str, url: str, **settings: Any) -> AsyncIterator[Bench]:
    """One instrument and its driver. On sockets time is real (`wall_time`) and runs ten times as fast."""
    clock = LoopClock() if url.startswith("memory") else LoopClock(speed=10.0)
    script: ScriptedInstrument = SCRIPTS[driver](clock)
    listener = await serve(url, script.converse, LoopClock())
    device = registry.load(driver.split(maxsplit=1)[0], "instrument")("instrument", listener.url, settings, clock)
    try:
        yield Bench(script, device, listener, clock)
    finally:
        await device.close()
        await listener.close()


async def take(device: Instrument, count: int) -> list[SampleBlock]:
    """The first `count` samples from now on, as blocks."""
    found: list[SampleBlock] = []
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        async for block in stream:
            found.append(block)
            if sum(map(len, found)) >= count:
                break
    return found


async def drain(stream: Any, last: SampleBlock | None = None) -> None:
    """Read a stream to its end; no block may repeat what came before."""
    async for block in stream:
        assert last is None or block.time_s[0] > last.time_s[-1]
        last = block


@each_driver
@each_wire
async def test_it_opens_says_who_it_is_and_streams_true_values_in_instrument_time(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        identity = await at.device.open(OPEN_S)
        assert isinstance(at.device, Instrument)
        assert identity.driver == driver.split(maxsplit=1)[0]
        assert identity.serial == ("K12345" if identity.driver == "bridge" else at.listener.url)
        assert at.device.channels == at.script.channels
        assert at.device.compensated_for == "nothing"
        blocks = await take(at.device, 500)
        time_s = np.concatenate([block.time_s for block in blocks])
        values = np.concatenate([block.values for block in blocks])
        assert np.diff(time_s) == pytest.approx(0.001)
        assert values == pytest.approx(at.script.expected(time_s), abs=1e-9)
        assert all(block.valid.all() and not block.lost and not block.events for block in blocks)


@each_driver
@each_wire
async def test_streams_can_follow_one_another_and_begin_now(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.device.open(OPEN_S)
        ends = []
        for _ in range(3):
            blocks = await take(at.device, 60)
            ends.append((float(blocks[0].time_s[0]), float(blocks[-1].time_s[-1])))
            await at.clock.sleep(0.5)
        assert all(later[0] - earlier[1] > 0.02 for earlier, later in pairwise(ends))


@each_driver
@each_wire
async def test_fault_11_and_40_a_pulled_line_ends_the_stream_and_a_new_open_works(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.drop()
            with pytest.raises(TransportError) as caught:
                await drain(stream)
        assert caught.value.code == "E-LINK-CLOSED"
        with pytest.raises(TransportError):
            await take(at.device, 1)
        await at.device.close()
        with pytest.raises(TransportError):
            await take(at.device, 1)
        await at.device.open(OPEN_S)
        await take(at.device, 20)


@each_driver
@each_wire
async def test_a_silent_device_is_told_within_the_limit(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        at.script.silent = True
        before = at.clock.now()
        with pytest.raises(TransportError) as caught:
            await at.device.open(2.0)
        assert caught.value.code in ("E-LINK-DEADLINE", "E-UMD-SILENT")
        assert at.clock.now() - before < 2.0 + (0.5 if url.startswith("memory") else 8.0)
        at.script.silent = False
        await at.device.open(OPEN_S)


@each_driver
@each_wire
async def test_nobody_there(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.listener.close()
        with pytest.raises(TransportError) as caught:
            await at.device.open(OPEN_S)
        assert caught.value.code == "E-LINK-CONNECT"
        await at.device.close()


@each_driver
@each_wire
async def test_fault_10_a_stream_that_stops_is_stale_and_not_repeated(driver: str, url: str) -> None:
    async with bench(driver, url, stale_s=2.0) as at:
        await at.device.open(8.0)
        async with aclosing(at.device.blocks()) as stream:
            last = await anext(stream)
            at.script.silent = True
            with pytest.raises(TransportError, match="E-LINK-STALE"):
                await drain(stream, last)


@each_driver
@each_wire
async def test_fault_16_skipped_samples_are_counted(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.skip = 17
            lost = 0
            async for block in stream:
                lost += block.lost
                if lost:
                    break
        assert lost == 17
        assert block.values == pytest.approx(at.script.expected(block.time_s), abs=1e-9)


@each_driver
@each_wire
async def test_pieces_of_any_size_make_the_same_samples(driver: str, url: str) -> None:
    """The wire is cut into single bytes on the way in."""

    async def main(at: Bench) -> None:
        await at.device.open(OPEN_S)
        blocks = await take(at.device, 100)
        time_s = np.concatenate([block.time_s for block in blocks])
        assert np.diff(time_s) == pytest.approx(0.001)

    async with bench(driver, url) as at:
        plain = at.script._put

        async def put(wire: Any, data: bytes) -> None:
            for start in range(0, len(data), 7):
                await plain(wire, data[start : start + 7])

        at.script._put = put
        await main(at)


@each_driver
def test_unknown_settings_are_refused_before_anything_is_opened(driver: str) -> None:
    with pytest.raises(ConfigError) as caught:
        registry.load(driver.split(maxsplit=1)[0], "instrument")(
            "laser", "tcp://127.0.0.1:1", {"bautrate": 9600}, LoopClock()
        )
    assert caught.value.code == "E-CFG-SETTING"
    assert "baudrate" in str(caught.value)


@each_driver
@each_wire
async def test_closing_twice_and_before_opening_is_quiet(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.device.close()
        await at.device.open(OPEN_S)
        await at.device.close()
        await at.device.close()


@each_driver
@each_wire
async def test_a_cancelled_opening_leaves_nothing_behind(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        at.script.silent = True
        opening = asyncio.create_task(at.device.open(50.0))
        await at.clock.sleep(1.0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening


@each_driver
@each_wire
async def test_the_wire_trace_sees_every_byte(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        traced: list[tuple[str, bytes]] = []
        at.device.trace = lambda direction, data: traced.append((direction, data))
        await at.device.open(OPEN_S)
        await take(at.device, 20)
        assert any(direction == "<" and data for direction, data in traced)
        assert any(direction == ">" for direction, _data in traced) is (driver != "umd")


@each_driver
@each_wire
async def test_fault_07_garbage_alone_is_no_reading(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        at.script.garbage = True
        with pytest.raises(TrueflankError) as caught:
            await at.device.open(6.0)
        assert caught.value.code == ("E-UMD-BAUD" if driver == "umd" else "E-LINK-DEADLINE")
        assert at.clock.now() < (5.5 if driver == "umd" and url.startswith("memory") else 60.0)


@each_driver
@each_wire
async def test_ambient_is_what_the_instrument_measures_and_nothing_else(driver: str, url: str) -> None:
    async with bench(driver, url) as at:
        await at.device.open(OPEN_S)
        await take(at.device, 64)
        ambient = await at.device.ambient()
        assert ambient.air_degc == 21.5
        assert ambient.pressure_hpa == pytest.approx(1000.1)
        assert ambient.humidity_pct is None
        assert ambient.material_degc == (20.2,)
        assert 0 <= ambient.age_s <= 1.0


async def test_a_counter_says_what_it_cannot_see() -> None:
    async with bench("umd", URLS[0]) as at:
        identity = await at.device.open(OPEN_S)
        assert identity.firmware == "1.26"
        assert any("broken beam" in notice for notice in at.device.notices)
        assert identity.notes == at.device.notices
        assert (await at.device.optics()).kind == "unknown"


async def test_a_counter_without_its_codes_is_named() -> None:
    async with bench("umd", URLS[0]) as at:
        at.script.facts = ()
        with pytest.raises(UnsupportedDevice) as caught:
            await at.device.open(3.0)
        assert caught.value.code == "E-UMD-CODES"
        assert caught.value.fields["codes"] == "8, 20"


async def test_a_counter_without_its_codes_opens_on_settings() -> None:
    async with bench("umd", URLS[0], sample_rate_hz=1000.0, counts_per_cycle=4) as at:
        at.script.facts = ()
        assert (await at.device.open(3.0)).firmware == ""
        assert len(await take(at.device, 20))


async def test_a_baud_rate_that_goes_wrong_in_between_is_named() -> None:
    async with bench("umd", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.garbage = True
            with pytest.raises(UnsupportedDevice, match="E-UMD-BAUD"):
                await drain(stream)


def test_the_scaled_output_says_what_it_holds() -> None:
    device = UmdCounter("laser", "COM3", {"count_size_nm": 10.0, "compensated_for": "air"}, LoopClock())
    assert device.compensated_for == "air"


@pytest.mark.wall_time
async def test_a_calibrator_does_what_it_is_told() -> None:
    async with bench("bridge", URLS[1]) as at:
        await at.device.open(OPEN_S)
        assert isinstance(at.device, RotaryCalibrator)
        await at.device.hold()
        await at.device.turn(-0.1)
        await at.device.track()
        assert (await at.device.optics()).kind == "rotary"
        assert at.script.asked[1:4] == [(records.HOLD, {}), (records.TURN, {"by_deg": -0.1}), (records.TRACK, {})]


async def test_the_stream_runs_only_while_somebody_reads() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        assert not at.script.streaming
        await take(at.device, 20)
        assert not at.script.streaming
        assert [method for method, _params in at.script.asked] == [
            records.IDENTIFY, records.STATUS, records.START, records.STOP,
        ]  # fmt: skip


@pytest.mark.parametrize(
    ("status", "error", "code"),
    [
        (CalibratorStatus(False, False, 87.0), NotReferenced, "E-BRIDGE-REFERENCE"),
        (CalibratorStatus(True, False, 9.0), DeviceRefused, "E-BRIDGE-BATTERY"),
    ],
)
async def test_fault_39_and_41_a_calibrator_that_is_not_fit_does_not_start(
    status: CalibratorStatus, error: type[TrueflankError], code: str
) -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.status = status
        await at.device.open(OPEN_S)
        with pytest.raises(error) as caught:
            await take(at.device, 1)
        assert caught.value.code == code
        assert not at.script.streaming


async def test_fault_39_a_low_battery_is_a_notice() -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.status = CalibratorStatus(True, False, 15.0)
        await at.device.open(OPEN_S)
        await take(at.device, 1)
        assert any("battery" in notice for notice in at.device.notices)


@pytest.mark.parametrize(
    ("number", "error", "code"),
    [
        (records.BUSY, DeviceRefused, "E-BRIDGE-BUSY"),
        (records.BEAM_OBSTRUCTED, BeamObstructed, "E-BRIDGE-BEAM"),
        (records.NOT_REFERENCED, NotReferenced, "E-BRIDGE-REFERENCE"),
        (records.UNSUPPORTED, DeviceRefused, "E-BRIDGE-UNSUPPORTED"),
        (records.METHOD_NOT_FOUND, DeviceRefused, "E-BRIDGE-UNSUPPORTED"),
        (records.BATTERY_LOW, DeviceRefused, "E-BRIDGE-BATTERY"),
        (records.UNSTABLE, DeviceRefused, "E-BRIDGE-REFUSED"),
        (records.INVALID_PARAMS, TrueflankError, "E-BRIDGE-REJECTED"),
        (7, DeviceRefused, "E-BRIDGE-REFUSED"),
    ],
)
async def test_refusals_say_who_must_act_and_the_line_goes_on(
    number: int, error: type[TrueflankError], code: str
) -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        at.script.refusals[records.TURN] = BridgeRefusal(None, number, "Kein Licht")
        with pytest.raises(error) as caught:
            await at.device.turn(1.0)
        assert caught.value.code == code
        assert "Kein Licht" in str(caught.value)
        await at.device.hold()


async def test_an_instrument_without_sensors_has_no_ambient() -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.refusals[records.ENVIRONMENT] = BridgeRefusal(None, records.METHOD_NOT_FOUND, "no")
        at.script.refusals[records.OPTICS] = BridgeRefusal(None, records.UNSUPPORTED, "no")
        await at.device.open(OPEN_S)
        assert (await at.device.ambient()).air_degc is None
        assert (await at.device.optics()).kind == "unknown"


async def test_an_instrument_that_cannot_turn_says_so() -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.kind = "laser"
        await at.device.open(OPEN_S)
        assert at.device.channels == ("displacement_mm",)
        with pytest.raises(DeviceRefused, match="it is a laser"):
            await at.device.hold()


async def test_another_version_of_the_bridge_is_refused() -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.protocol = 2
        with pytest.raises(UnsupportedDevice, match="E-BRIDGE-VERSION"):
            await at.device.open(OPEN_S)


async def test_an_answer_with_another_id_breaks_the_line() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        at.script.id_shift = 1
        with pytest.raises(RemoteProtocolError, match="E-LINK-STRAY"):
            await at.device.hold()
        with pytest.raises(LinkBroken):
            await at.device.track()


@pytest.mark.parametrize("cancelled", [False, True])
async def test_an_interrupted_request_breaks_the_line_for_good(cancelled: bool) -> None:
    async with bench("bridge", URLS[0], turn_timeout_s=2.0) as at:
        await at.device.open(OPEN_S)
        at.script.silent = True
        asking = asyncio.create_task(at.device.turn(1.0))
        await at.clock.sleep(0.5)
        if cancelled:
            asking.cancel()
        with pytest.raises(asyncio.CancelledError if cancelled else TransportError):
            await asking
        at.script.silent = False
        before = len(at.script.asked)
        with pytest.raises(LinkBroken):
            await at.device.turn(1.0)
        assert len(at.script.asked) == before
        await at.device.open(OPEN_S)
        await at.device.turn(1.0)


@pytest.mark.parametrize(
    "line", [b"rubbish\n", b'{"jsonrpc":"2.0","id":1}\n', b'{"jsonrpc":"2.0","id":9,"method":"x"}\n']
)
async def test_an_unreadable_line_ends_the_stream_with_its_bytes(line: bytes) -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.bend = lambda data: data + line
            with pytest.raises(RemoteProtocolError) as caught:
                await drain(stream)
        assert caught.value.code == "E-BRIDGE-LINE"
        assert line[:7].decode() in str(caught.value)


async def test_what_stood_on_the_line_before_the_opening_is_thrown_away() -> None:
    async with bench("bridge", URLS[0]) as at:
        late = b'es":{"device_deg":[0.0]}}}\n{"jsonrpc":"2.0","method":"stream.samples","params":{"sequence":1}}\n'
        at.script.bend = lambda data: late + data
        await at.device.open(OPEN_S)
        at.script.bend = lambda data: data
        await take(at.device, 20)


async def test_samples_with_a_wrong_member_end_the_stream_and_name_it() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.bend = lambda data: data.replace(b"laser_deg", b"laser_rad")
            with pytest.raises(RemoteProtocolError, match="values"):
                await drain(stream)


def test_the_ports_are_met() -> None:
    assert isinstance(UmdCounter("a", "COM1", {}, LoopClock()), Instrument)
    assert isinstance(BridgeInstrument("a", "COM1", {}, LoopClock()), RotaryCalibrator)


async def test_a_bridge_is_told_to_count_afresh_after_a_lost_beam() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        await at.device.set_datum()
        assert at.script.asked[-1][0] == records.DATUM
        at.script.refusals[records.DATUM] = BridgeRefusal(None, records.BEAM_OBSTRUCTED, "no light")
        with pytest.raises(BeamObstructed):
            await at.device.set_datum()
        at.script.refusals[records.DATUM] = BridgeRefusal(None, records.UNSUPPORTED, "cannot")
        await at.device.set_datum()
