"""Faults 1 to 20 and 39 to 45 of an instrument's wire, each by its number, with the behaviour that is promised."""

from __future__ import annotations

import copy
import random
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from drivers.bridge import records
from drivers.bridge.codec import BridgeRefusal, Notification
from drivers.bridge.device import BridgeInstrument, BridgeStream
from drivers.bridge.records import BridgeIdentity, BridgeSamples, CalibratorStatus, Event, read_environment
from drivers.clock import LoopClock
from drivers.errors import (
    DeviceRefused,
    LinkBroken,
    NotReferenced,
    RemoteProtocolError,
    TransportError,
    UnsupportedDevice,
)
from drivers.manual.settings import EntryRefused, ExpectedReading, read_entry
from drivers.types.sensing import SampleBlock
from drivers.umd.codec import SEQUENCE, UmdCodec, encode_rows
from drivers.umd.counting import LEARN_MOVING, UmdCounting
from drivers.umd.device import UmdCounter
from drivers.umd.settings import UmdSettings
from drivers.units import wrap_deg
from tests.contract.ports_of_pty import PtyCounter, plug
from tests.contract.test_instruments import OPEN_S, URLS, Bench, bench, drain, take
from tests.unit.drivers.loops import run_clean

MM = 632.990577e-6 / 8


def rows_of(count: int, start: int = 0) -> np.ndarray:
    numbers = start + np.arange(count)
    rows = np.zeros((count, 8), np.int64)
    rows[:, 2], rows[:, 3], rows[:, SEQUENCE] = 3 * numbers, 3, numbers
    return rows


class Reader:
    """Codec and counting together, as the device has them."""

    def __init__(self, **keys: object) -> None:
        self.codec = UmdCodec("client")
        keys = {"sample_rate_hz": 1000.0, "counts_per_cycle": 4} | keys
        self.counting = UmdCounting(UmdSettings.read(keys, "laser"), "laser")

    def feed(self, data: bytes) -> list[SampleBlock]:
        return [block for message in self.codec.receive(data) for block in self.counting.take(message)]


def whole(blocks: list[SampleBlock]) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    time_s = np.concatenate([block.time_s for block in blocks])
    values = np.concatenate([block.values[:, 0] for block in blocks])
    return time_s, values, np.concatenate([block.valid for block in blocks]), sum(block.lost for block in blocks)


def test_fault_01_a_frame_split_at_any_byte_gives_the_same_samples() -> None:
    data = encode_rows(rows_of(1000))
    time_s, values, valid, lost = whole(Reader().feed(data))
    assert (len(time_s), lost, valid.all()) == (1000, 0, True)
    chance = random.Random(1)
    cuts = [(at,) for at in range(0, len(data), 13)]
    cuts += [tuple(sorted(chance.sample(range(len(data)), 2))) for _ in range(300)]
    for cut in cuts:
        reader, edges = Reader(), [0, *cut, len(data)]
        blocks = [block for a, b in pairwise(edges) for block in reader.feed(data[a:b])]
        assert np.array_equal(whole(blocks)[1], values)


def test_fault_02_many_frames_in_one_read_are_all_parsed_in_order() -> None:
    data = encode_rows(rows_of(20_000))
    reader = Reader()
    blocks = [block for at in range(0, len(data), 1 << 16) for block in reader.feed(data[at : at + (1 << 16)])]
    time_s, values, _valid, lost = whole(blocks)
    assert lost == 0
    assert time_s == pytest.approx(np.arange(20_000) / 1000.0)
    assert values == pytest.approx(3 * np.arange(20_000) * MM)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_fault_03_garbage_is_passed_over_and_its_lines_are_told(share: float) -> None:
    chance = random.Random(7)
    lines = encode_rows(rows_of(400)).splitlines(keepends=True)
    dirty = [chance.randbytes(20) + line if chance.random() < share else line for line in lines]
    blocks = Reader().feed(b"".join(dirty) + lines[-1])
    time_s, values, _valid, lost = whole(blocks)
    assert values == pytest.approx(np.rint(time_s * 1000) * 3 * MM)
    assert len(time_s) + lost == pytest.approx(400, abs=3)
    assert any("damaged lines" in str(event) for block in blocks for event in block.events)


def bits(count: int) -> None:
    """No valid sample differs from the truth, whichever bit of these lines is flipped."""
    warm = LEARN_MOVING + 64
    reader = Reader()
    reader.feed(encode_rows(rows_of(warm)))
    tail = encode_rows(rows_of(3, warm + 1))
    for _ in range(count):
        line = encode_rows(rows_of(1, warm))
        for bit in range(8 * (len(line) - 2)):
            bent = bytearray(line)
            bent[bit // 8] ^= 1 << bit % 8
            other = copy.deepcopy(reader)
            for block in other.feed(bytes(bent) + tail):
                at = np.rint(block.time_s * 1000)
                right = np.isclose(block.values[:, 0], at * 3 * MM, atol=MM / 2)
                assert not (block.valid & ~right).any(), bytes(bent)
        reader.feed(line)
        warm += 1
        tail = encode_rows(rows_of(3, warm + 1))


def test_fault_05_no_flipped_bit_becomes_a_believed_wrong_value() -> None:
    bits(10)


@pytest.mark.soak
def test_fault_05_no_flipped_bit_of_two_hundred_lines() -> None:
    bits(200)


@pytest.mark.parametrize("foreign", [b"\0", b"\xff", b"\xff\0\x41", b"\xff\xff", b"\0\0\0"])
def test_fault_06_breaks_and_parity_errors_are_dropped_and_counted(foreign: bytes) -> None:
    data = encode_rows(rows_of(50))
    lines = data.splitlines(keepends=True)
    for at in range(len(lines[20])):
        bent = b"".join((*lines[:20], lines[20][:at], foreign, lines[20][at:], *lines[21:]))
        reader = Reader()
        time_s, values, valid, lost = whole(reader.feed(bent))
        assert values == pytest.approx(np.rint(time_s * 1000) * 3 * MM)
        assert reader.counting.damaged == 1
        assert len(time_s) + lost == 50
        assert valid.all()


async def test_fault_09_a_slow_drip_is_no_work_and_no_half_reading() -> None:
    async with bench("umd", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            last = await anext(stream)
            plain = at.script._put

            async def drip(wire: object, data: bytes) -> None:
                for byte in data:
                    await plain(wire, bytes([byte]))
                    await at.clock.sleep(1.0)

            at.script._put = drip
            used = process_time()
            with pytest.raises(TransportError, match="E-LINK-STALE"):
                await drain(stream, last)
            assert process_time() - used < 0.5


@asynccontextmanager
async def on_port(*counters: PtyCounter) -> AsyncIterator[None]:
    """Counters that are unplugged whatever happens."""
    try:
        yield
    finally:
        for counter in counters:
            await counter.unplug()


def with_ports(main: Callable[[LoopClock], Awaitable[None]]) -> None:
    async def wrapped() -> None:
        await main(LoopClock(speed=10.0))

    run_clean(wrapped, virtual=False)


def test_fault_11_and_12_an_unplugged_counter_is_found_again_under_its_own_name(tmp_path: Path) -> None:
    link = tmp_path / "usb-Teensyduino_USB_Serial_1234567-if00"

    async def main(clock: LoopClock) -> None:
        first, second = PtyCounter(), PtyCounter()
        device = UmdCounter("laser", str(link), {}, clock)
        async with on_port(first, second):
            plug(link, first)
            first.start(clock)
            assert (await device.open(OPEN_S)).serial == str(link)
            async with aclosing(device.blocks()) as stream:
                await anext(stream)
                await first.unplug()
                told = clock.now()
                with pytest.raises(TransportError) as caught:
                    await drain(stream)
            assert caught.value.code == "E-LINK-CLOSED"
            assert clock.now() - told < 10.0
            plug(link, second)
            second.start(clock)
            await device.open(OPEN_S)
            assert len(await take(device, 20))
        await device.close()

    with_ports(main)


def test_fault_12_and_13_another_counter_on_the_port_is_refused(tmp_path: Path) -> None:
    link = tmp_path / "port"

    async def main(clock: LoopClock) -> None:
        first, other = PtyCounter(), PtyCounter(firmware=131)
        device = UmdCounter("laser", str(link), {}, clock)
        async with on_port(first, other):
            plug(link, first)
            first.start(clock)
            await device.open(OPEN_S)
            plug(link, other)
            other.start(clock)
            with pytest.raises(UnsupportedDevice, match=r"1\.31"):
                await device.open(OPEN_S)
        await device.close()

    with_ports(main)


async def test_fault_13_another_instrument_behind_the_bridge_is_refused() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        at.script.kind = "laser"
        with pytest.raises(UnsupportedDevice) as caught:
            await at.device.open(OPEN_S)
        assert caught.value.code == "E-BRIDGE-OTHER"


HOLDER = "import serial, sys; port = serial.Serial(sys.argv[1], exclusive=True); print(1, flush=True); sys.stdin.read()"


def test_fault_14_a_port_held_by_another_program_is_named() -> None:
    counter = PtyCounter()

    async def main(clock: LoopClock) -> None:
        async with on_port(counter):
            device = UmdCounter("laser", counter.path, {}, clock)
            with pytest.raises(TransportError) as caught:
                await device.open(OPEN_S)
        assert caught.value.code == "E-LINK-TAKEN"
        assert counter.path in str(caught.value)

    command = [sys.executable, "-c", HOLDER, counter.path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"1\n"
        with_ports(main)
        holder.kill()


def test_fault_15_what_waited_in_the_port_from_before_is_never_seen() -> None:
    async def main(clock: LoopClock) -> None:
        stale = encode_rows(rows_of(64, 900_000))
        counter = PtyCounter(stale=stale)
        device = UmdCounter("laser", counter.path, {}, clock)
        traced: list[bytes] = []
        device.trace = lambda _direction, data: traced.append(data)
        async with on_port(counter):
            counter.start(clock)
            await device.open(OPEN_S)
            assert (await take(device, 20))[-1].time_s[-1] < 100.0
        await device.close()
        assert b" 900" not in b"".join(traced)

    with_ports(main)


@pytest.mark.parametrize("seed", range(5))
def test_fault_16_what_an_overrun_swallows_is_counted_exactly(seed: int) -> None:
    chance = random.Random(seed)
    data = bytearray(encode_rows(rows_of(5000)))
    for _ in range(4):
        at = chance.randrange(1000, len(data) - 20_000)
        del data[at : at + chance.randrange(1, 9000)]
    reader = Reader()
    time_s, values, valid, lost = whole(reader.feed(bytes(data)))
    assert len(time_s) + lost == 5000
    assert valid.all()
    assert values == pytest.approx(np.rint(time_s * 1000) * 3 * MM)


NUMBERS = ["1,5", "1e3", "+5", "-0", "1,234.5", "0x10", "١٢", "NaN", "inf", "1e308", "9" * 40, "", "1.5", "--1", "007"]


@pytest.mark.parametrize("number", NUMBERS)
def test_fault_17_and_18_no_number_but_the_counters_own_form_is_read(number: str) -> None:
    reader = Reader()
    good = encode_rows(rows_of(2))
    bad = f"0 0 {number} 0 0 2 0 0\r\n".encode()
    time_s, _values, _valid, _lost = whole(reader.feed(good + bad))
    assert len(time_s) == 2
    assert reader.counting.damaged == 1


@pytest.mark.parametrize("number", [*NUMBERS, "1 2", "1.2.3", "abc", "1mm"])
def test_fault_17_and_18_a_typed_reading_is_never_guessed(number: str) -> None:
    for mark in ("point", "comma"):
        found = read_entry(number, mark, ExpectedReading(), "mm", sure=True)  # type: ignore[arg-type]
        allowed = {
            ("1,5", "comma"): 1.5,
            ("1.5", "point"): 1.5,
            ("+5", mark): 5.0,
            ("-0", mark): 0.0,
            ("007", mark): 7.0,
        }
        if (number, mark) in allowed:
            assert found == allowed[number, mark]
        else:
            assert isinstance(found, EntryRefused)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999", "1,5", "+5", "01", '"5"', "9" * 400])
async def test_fault_17_and_18_no_number_but_a_finite_one_comes_over_the_bridge(number: str) -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.bend = lambda data: data.replace(b'"device_deg":[-', b'"device_deg":[' + number.encode() + b",")
            with pytest.raises(RemoteProtocolError):
                await drain(stream)


def echoing(at: Bench) -> None:
    answer = at.script._answer
    sent: list[bytes] = []

    def answer_after(message: object) -> object:
        sent.append(
            b'{"jsonrpc":"2.0","id":%d,"method":"%s","params":{}}\n' % (message.id, message.method.encode())  # type: ignore[attr-defined]
        )
        return answer(message)

    at.script._answer = answer_after
    at.script.bend = lambda data: (sent.pop() if sent else b"") + data


async def test_fault_20_an_echo_is_taken_out_where_the_site_file_says_so() -> None:
    async with bench("bridge", URLS[0], echo=True) as at:
        echoing(at)
        await at.device.open(OPEN_S)
        await at.device.hold()
        assert len(await take(at.device, 20))


async def test_fault_20_an_echo_nobody_spoke_of_is_an_error() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        echoing(at)
        await at.device.hold()
        with pytest.raises(LinkBroken, match="E-BRIDGE-LINE"):
            await at.device.track()


def test_fault_22_samples_at_low_signal_are_flagged() -> None:
    reader = Reader(least_signal=20)
    rows = rows_of(40)
    rows[[5, 15, 25], 6] = 2
    rows[[5, 15, 25], 7] = [90, 12, 60]
    blocks = reader.feed(encode_rows(rows))
    assert np.flatnonzero(~whole(blocks)[2]).tolist() == list(range(15, 25))
    assert str(blocks[0].events[0]).startswith("low signal at 0.015")
    again = reader.feed(encode_rows(rows_of(2, 40)))
    assert whole(again)[2].all()
    assert reader.counting.low_speed.signal_strength == 60


async def test_fault_24_an_unstable_laser_does_not_start_and_is_told_in_between() -> None:
    async with bench("bridge", URLS[0]) as at:
        at.script.refusals[records.START] = BridgeRefusal(None, records.UNSTABLE, "warming up")
        await at.device.open(OPEN_S)
        with pytest.raises(DeviceRefused, match="warming up"):
            await take(at.device, 1)
    stream = BridgeStream(("a_mm",), "x")
    samples = BridgeSamples(0, 0.0, 0.1, {"a_mm": np.zeros(2)}, np.ones(2, bool), events=(Event("unstable", 0.1),))
    block = stream.take(samples)
    assert block is not None
    assert [*map(str, block.events)] == ["unstable at 0.100000 s"]


@pytest.mark.parametrize(
    ("member", "value"),
    [("air_degc", -50.0), ("pressure_hpa", 0.0), ("humidity_pct", 140.0), ("material_degc", [300.0])],
)
def test_fault_26_an_impossible_environment_is_refused_by_the_sensors_name(member: str, value: object) -> None:
    with pytest.raises(RemoteProtocolError, match=member):
        read_environment({member: value}, "x")


def test_fault_26_a_counter_that_tells_an_impossible_environment_has_no_sensor() -> None:
    reader = Reader()
    rows = rows_of(10)
    rows[:4, 6], rows[:4, 7] = (3, 4, 5, 6), (-5000, 2000, 0, 1400)
    reader.feed(encode_rows(rows))
    ambient = reader.counting.ambient()
    assert (ambient.air_degc, ambient.pressure_hpa, ambient.humidity_pct) == (None, None, None)
    assert ambient.material_degc == (20.0,)


def told(at: Bench, event: str) -> None:
    """Let the calibrator say something happened, in whichever form it streams."""
    plain = at.script._samples

    def with_event(sequence: int, now: int, count: int) -> object:
        samples = plain(sequence, now, count)
        if isinstance(samples, Notification):
            told = [{"kind": event, "at_s": (now + 1) / 1000.0}]
            return Notification(samples.method, {**samples.params, "events": told})
        return samples

    at.script._samples = with_event


async def test_fault_39_a_battery_that_runs_empty_ends_the_stream_cleanly() -> None:
    async with bench("bridge in frames", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.status = CalibratorStatus(True, False, 4.0)
            with pytest.raises(DeviceRefused) as caught:
                await drain(stream)
        assert caught.value.code == "E-BRIDGE-EMPTY"
        assert not at.script.streaming


async def test_fault_40_a_dropped_calibrator_must_be_referenced_again() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            at.script.drop()
            with pytest.raises(TransportError):
                await drain(stream)
        at.script.status = CalibratorStatus(False, False, 80.0)
        await at.device.open(OPEN_S)
        with pytest.raises(NotReferenced):
            await take(at.device, 1)


async def test_fault_41_a_lost_reference_ends_the_stream() -> None:
    async with bench("bridge", URLS[0]) as at:
        await at.device.open(OPEN_S)
        async with aclosing(at.device.blocks()) as stream:
            await anext(stream)
            told(at, "reference_lost")
            with pytest.raises(NotReferenced, match="reference lost"):
                await drain(stream)


def test_fault_42_turns_go_on_over_360_and_differences_take_the_shorter_way() -> None:
    angles = np.linspace(-3600.0, 3600.0, 1441)
    stream = BridgeStream(("device_deg", "laser_deg"), "x")
    values = {"device_deg": -angles, "laser_deg": np.zeros(len(angles))}
    block = stream.take(BridgeSamples(0, 0.0, 0.01, values, np.ones(len(angles), bool)))
    assert block is not None
    assert np.array_equal(block.values[:, 1] - block.values[:, 0], angles)
    chance = random.Random(3)
    for _ in range(500):
        small, turns = chance.uniform(-179.9, 179.9), chance.randrange(-10, 11)
        assert wrap_deg(small + 360.0 * turns) == pytest.approx(small, abs=1e-9)
    assert wrap_deg(359.999 - (-0.001)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "channels"),
    [
        ("rotary_calibrator", ["device_rad", "laser_deg"]),
        ("rotary_calibrator", ["device_deg", "laser_arcsec"]),
        ("angle", ["pitch_arcmin"]),
        ("angle", ["pitch_deg"]),
        ("angle", []),
        ("straightness", ["straightness_mm"]),
        ("laser", ["displacement_inch"]),
    ],
)
def test_fault_43_a_channel_without_its_unit_is_refused(kind: str, channels: list[str]) -> None:
    who = BridgeIdentity("laser", "E", "M", "1", "", ("displacement_mm",), 10.0).as_object()
    with pytest.raises(RemoteProtocolError, match="channels"):
        BridgeIdentity.read(who | {"kind": kind, "channels": channels}, "x")


def test_fault_44_device_and_laser_have_one_time_or_no_sample() -> None:
    samples = BridgeSamples(0, 0.0, 0.1, {"device_deg": np.zeros(3), "laser_deg": np.zeros(3)}, np.ones(3, bool))
    wire = samples.as_object()
    wire["values"]["laser_deg"] = [0.0, 0.0]
    with pytest.raises(RemoteProtocolError, match="one length"):
        BridgeSamples.read(wire, ("device_deg", "laser_deg"), "x")


@pytest.mark.parametrize("driver", ["bridge", "bridge in frames"])
async def test_fault_45_the_driver_turns_no_sign_around(driver: str) -> None:
    """The axis turns at +1 deg/s and the device against it: laser - device must say +1 deg/s."""

    async with bench(driver, URLS[0]) as at:
        await at.device.open(OPEN_S)
        blocks = await take(at.device, 100)
        time_s = np.concatenate([block.time_s for block in blocks])
        values = np.concatenate([block.values for block in blocks])
        names = at.device.channels
        axis = values[:, names.index("laser_deg")] - values[:, names.index("device_deg")]
        assert np.polyfit(time_s, axis, 1)[0] == pytest.approx(1.0)


def test_a_bridge_of_any_kind_is_an_instrument() -> None:
    for kind, names in (("angle", ("pitch_arcsec",)), ("straightness", ("x_um", "y_um")), ("environment", ())):
        who = BridgeIdentity(kind, "E", "M", "1", "", names, 10.0 if names else 0.0)  # type: ignore[arg-type]
        assert BridgeIdentity.read(who.as_object(), "x").channels == names
    assert BridgeInstrument("a", "COM1", {}, LoopClock()).channels == ()
