"""Faults 69-88 of Modbus peers that lie, each by its number, against a scripted PLC in raw bytes."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import (
    ConfigError,
    DeadlineExceeded,
    DeviceRefused,
    LinkBroken,
    LocalProtocolError,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    ValueOutOfRange,
)
from drivers.sinumerik.mailbox.codec.frames import value_chunks
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import ModbusCodec, ModbusWire, Question
from drivers.types.orders import PushOrder
from tests.sizes import few
from tests.unit.mailbox.desk import VALUES, at_rogue, driver, order_for, push, table
from tests.unit.mailbox.rogue import Asked, Lie, Rogue, crc16, serving

NM = [round(value * 1000) for value in VALUES]
HELD = NM + [0] * (70 - len(NM))

# Each operation of a push by the request that does it.
OPERATIONS: dict[str, Callable[[Asked], bool]] = {
    "status": lambda asked: (asked.function, asked.address) == (3, 0),
    "picture": lambda asked: (asked.function, asked.address) == (3, 302),
    "select": lambda asked: asked.command == 11,
    "open": lambda asked: asked.command == 1,
    "data": lambda asked: (asked.function, asked.address) == (16, 36),
    "disable": lambda asked: asked.command == 6,
    "begin": lambda asked: asked.command == 2,
    "chunk": lambda asked: asked.command == 3,
    "verify": lambda asked: asked.command == 4,
    "read back": lambda asked: asked.address == 200,
    "activate": lambda asked: asked.command == 5,
    "heartbeat": lambda asked: (asked.function, asked.address) == (6, 15),
}
Change = Callable[[Asked, bytes], Iterable[bytes | float]]


def once(operation: str, change: Change) -> Lie:
    """Lie at the first request of this kind after the driver was opened."""
    told: list[Asked] = []

    def lie(asked: Asked, reply: bytes) -> Iterable[bytes | float] | None:
        if told or not OPERATIONS[operation](asked):
            return None
        told.append(asked)
        return change(asked, reply)

    return lie


def exception(rogue: Rogue, code: int) -> Change:
    return lambda asked, _reply: [rogue.frame(bytes([asked.function | 0x80, code]), asked.transaction)]


async def refused_push(rogue: Rogue, operation: str, change: Change, **settings: Any) -> TrueflankError:
    """The error of a push that meets one lie; whatever it was, nothing that is not right is enabled or believed."""
    caught: list[TrueflankError] = []
    async with at_rogue(rogue, **settings) as device:
        order = await order_for(device)
        rogue.lie = once(operation, change)
        try:
            await push(device, order)
        except TrueflankError as error:
            caught.append(error)
    assert caught, f"a lie in {operation} was accepted"
    assert not rogue.enabled or rogue.tables[1] == HELD
    for command in (2, 4, 5, 6):
        assert sum(one.command == command for one in rogue.asked) <= 1, "a write was sent twice"
    return caught[0]


# ---- exceptions ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("operation", [name for name in OPERATIONS if name != "heartbeat"])
@pytest.mark.parametrize("code", [1, 2, 3])
async def test_fault_69_exceptions_of_the_map_are_refusals_with_the_address(operation: str, code: int) -> None:
    rogue = Rogue()
    error = await refused_push(rogue, operation, exception(rogue, code))
    assert isinstance(error, UnsupportedDevice)
    wanted = {1: "E-MODBUS-NO-FUNCTION", 2: "E-MODBUS-NO-ADDRESS", 3: "E-MODBUS-NO-VALUE"}[code]
    assert error.code == wanted
    address = {"status": 0, "picture": 302, "data": 36, "read back": 200}.get(operation, 16)
    assert error.fields["first"] == address


@pytest.mark.parametrize("operation", [name for name in OPERATIONS if name != "heartbeat"])
async def test_fault_70_a_device_failure_is_a_refusal(operation: str) -> None:
    rogue = Rogue()
    error = await refused_push(rogue, operation, exception(rogue, 4))
    assert isinstance(error, DeviceRefused)
    assert error.code == "E-MODBUS-FAILED"


@pytest.mark.parametrize("operation", list(OPERATIONS))
@pytest.mark.parametrize("code", [5, 6])
async def test_fault_71_busy_is_waited_for_and_read_back_never_sent_twice(operation: str, code: int) -> None:
    rogue = Rogue()

    async def body(device: SinumerikModbus) -> None:
        order = await order_for(device)
        rogue.lie = once(operation, exception(rogue, code))  # said busy, and did it
        old, new = await push(device, order)
        assert [round(1000 * value) for value in new.own.table.deviations] == NM
        assert not any(old.own.table.deviations)

    async with at_rogue(rogue) as on:
        await body(on)
    assert rogue.tables[1] == HELD
    assert rogue.done.count(2) == rogue.done.count(4) == rogue.done.count(5) == 1
    assert sum(one.command == 5 for one in rogue.asked) == 1


async def test_fault_71_busy_that_did_nothing_is_not_sent_again() -> None:
    rogue = Rogue()
    kept: list[int] = []

    def lie(asked: Asked, reply: bytes) -> Iterable[bytes] | None:
        if asked.command == 1:
            kept.append(asked.place)
            rogue.registers[16:36] = [0] * 20  # nothing of it arrived
            return list(exception(rogue, 6)(asked, reply))  # type: ignore[arg-type]
        return None

    async def body(device: SinumerikModbus) -> None:
        order = await order_for(device)
        rogue.lie = lie
        with pytest.raises(DeviceRefused) as caught:
            await push(device, order)
        assert caught.value.code == "E-MODBUS-BUSY"

    async with at_rogue(rogue) as on:
        await body(on)
    assert len(kept) == 1


@pytest.mark.parametrize(
    ("code", "kind", "name"),
    [
        (8, DeviceRefused, "E-MODBUS-FAILED"),
        (10, TransportError, "E-MODBUS-GATEWAY"),
        (11, TransportError, "E-MODBUS-GATEWAY"),
        (7, RemoteProtocolError, "E-MODBUS-EXCEPTION"),
        (9, RemoteProtocolError, "E-MODBUS-EXCEPTION"),
        (0x55, RemoteProtocolError, "E-MODBUS-EXCEPTION"),
        (0, RemoteProtocolError, "E-MODBUS-EXCEPTION"),
    ],
)
@pytest.mark.parametrize("operation", ["status", "begin", "read back"])
async def test_fault_72_other_exceptions(operation: str, code: int, kind: type[TrueflankError], name: str) -> None:
    rogue = Rogue()
    error = await refused_push(rogue, operation, exception(rogue, code))
    assert isinstance(error, kind)
    assert error.code == name


async def _push_and_wait(device: SinumerikModbus, order: PushOrder) -> None:
    """A push with time between: a heartbeat that failed shows at the next exchange."""
    await device.stage((order,))
    await device.read_back((order,), 100.0)
    await device._talk._clock.sleep(3.0)
    await device.activate((order,), (order,))
    await device.confirm((order,), 100.0)


# ---- no answer, late answer, twice ---------------------------------------------------------------------


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("operation", list(OPERATIONS))
async def test_fault_73_no_reply_is_unknown_and_read_back_over_a_new_connection(operation: str, framer: str) -> None:
    rogue = Rogue(framer=framer)

    async def body(device: SinumerikModbus) -> None:
        order = await order_for(device)
        rogue.lie = once(operation, lambda _asked, _reply: [])
        with pytest.raises(TransportError):
            await _push_and_wait(device, order)
        sent, connections = len(rogue.asked), rogue.connections
        with pytest.raises(LinkBroken):
            await device.state()
        assert len(rogue.asked) == sent, "a broken link was used"
        await device.open(5.0)
        assert rogue.connections == connections + 1
        live = await device.saved_tables("X1")
        held = rogue.tables[1][: len(live.own.table.deviations)]
        assert [round(1000 * value) for value in live.own.table.deviations] == held

    async with at_rogue(rogue) as on:
        await body(on)
    assert max(sum(one.command == command for one in rogue.asked) for command in (2, 4, 5, 6)) <= 1


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("late_s", [1.001, 1.2, 3.0])
async def test_fault_74_a_late_reply_is_never_taken(framer: str, late_s: float) -> None:
    rogue = Rogue(framer=framer)

    async with at_rogue(rogue) as device:
        await device.identify()
        rogue.lie = once("picture", lambda _asked, reply: [late_s, reply])
        with pytest.raises(DeadlineExceeded):
            await device.identify()
        with pytest.raises(LinkBroken):
            await device.identify()
        await device.open(5.0)
        assert (await device.identify()).axis_names == ("X1", "C1")


@pytest.mark.parametrize("operation", list(OPERATIONS))
async def test_fault_75_a_duplicate_is_ignored(operation: str) -> None:
    rogue = Rogue()

    async def body(device: SinumerikModbus) -> None:
        order = await order_for(device)
        rogue.lie = lambda asked, reply: [reply, reply] if OPERATIONS[operation](asked) else None
        _, new = await push(device, order)
        assert [round(1000 * value) for value in new.own.table.deviations] == NM

    async with at_rogue(rogue) as on:
        await body(on)
    assert rogue.tables[1] == HELD
    assert rogue.enabled == {1}


@pytest.mark.parametrize("operation", ["status", "picture", "chunk", "read back"])
async def test_fault_75_a_duplicate_without_transaction_numbers_breaks_the_link(operation: str) -> None:
    rogue = Rogue(framer="rtu")
    error = await refused_push(rogue, operation, lambda _asked, reply: [reply, reply])
    assert isinstance(error, RemoteProtocolError | LinkBroken)


# ---- answers that do not belong to the question ---------------------------------------------------------


@pytest.mark.parametrize("operation", ["status", "picture", "open", "data", "begin", "read back", "activate"])
@pytest.mark.parametrize("change", ["next", "zero", "before", "bytes are swapped"])
async def test_fault_76_another_transaction_is_rejected(operation: str, change: str) -> None:
    def other(asked: Asked, reply: bytes) -> Iterable[bytes]:
        number = {
            "next": asked.transaction + 1,
            "zero": 0,
            "before": asked.transaction - 1,
            "bytes are swapped": asked.transaction << 8 & 0xFFFF | asked.transaction >> 8,
        }[change]
        return [struct.pack(">H", number) + reply[2:]]

    error = await refused_push(Rogue(), operation, other)
    assert error.code == "E-MODBUS-TRANSACTION"


@pytest.mark.parametrize("operation", ["status", "begin", "read back"])
@pytest.mark.parametrize("unit", [0, 2, 255])
async def test_fault_77_another_unit_is_rejected(operation: str, unit: int) -> None:
    error = await refused_push(Rogue(), operation, lambda _asked, reply: [reply[:6] + bytes([unit]) + reply[7:]])
    assert error.code == "E-MODBUS-UNIT"

    def serial(_asked: Asked, reply: bytes) -> Iterable[bytes]:
        body = bytes([unit]) + reply[1:-2]
        return [body + crc16(body)]

    assert (await refused_push(Rogue(framer="rtu"), operation, serial)).code == "E-MODBUS-UNIT"


@pytest.mark.parametrize("protocol", [1, 0x0100, 0xFFFF])
async def test_fault_77_another_protocol_is_rejected_at_once(protocol: int) -> None:
    change: Change = lambda _asked, reply: [reply[:2] + struct.pack(">H", protocol) + reply[4:]]  # noqa: E731
    assert (await refused_push(Rogue(), "status", change)).code == "E-MODBUS-FRAME"


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize(
    ("operation", "function"), [("status", 4), ("read back", 4), ("begin", 15), ("open", 6), ("data", 23)]
)
async def test_fault_78_another_function_is_rejected(operation: str, function: int, framer: str) -> None:
    rogue = Rogue(framer=framer)

    def other(asked: Asked, reply: bytes) -> Iterable[bytes]:
        pdu = reply[7:] if framer == "tcp" else reply[1:-2]
        return [rogue.frame(bytes([function]) + pdu[1:], asked.transaction)]

    assert (await refused_push(rogue, operation, other)).code == "E-MODBUS-REPLY"


def _registers(rogue: Rogue, asked: Asked, count: int, told: int | None = None, odd: bytes = b"") -> Iterable[bytes]:
    values = [*rogue.registers, *[0] * 10][asked.address : asked.address + count]
    data = struct.pack(f">{len(values)}H", *values) + odd
    return [rogue.frame(bytes([3, len(data) if told is None else told]) + data, asked.transaction)]


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("operation", ["status", "picture", "read back"])
@pytest.mark.parametrize("change", ["short", "long", "odd", "count too small", "count too big"])
async def test_fault_79_another_count_is_rejected(operation: str, change: str, framer: str) -> None:
    rogue = Rogue(framer=framer)

    def other(asked: Asked, _reply: bytes) -> Iterable[bytes]:
        count = asked.count
        return {
            "short": lambda: _registers(rogue, asked, count - 8),
            "long": lambda: _registers(rogue, asked, count + 10),
            "odd": lambda: _registers(rogue, asked, count, odd=b"\x55"),
            "count too small": lambda: _registers(rogue, asked, count, 2 * count - 2),
            "count too big": lambda: _registers(rogue, asked, count, 2 * count + 2),
        }[change]()

    assert (await refused_push(rogue, operation, other)).code == "E-MODBUS-LENGTH"


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("operation", ["open", "data", "begin", "chunk", "verify", "activate"])
@pytest.mark.parametrize("change", ["address", "count"])
async def test_fault_80_an_echo_of_another_write_is_unknown_and_never_sent_again(
    operation: str, change: str, framer: str
) -> None:
    rogue = Rogue(framer=framer)

    def other(asked: Asked, _reply: bytes) -> Iterable[bytes]:
        address = asked.address + (change == "address")
        count = asked.count - (change == "count")
        return [rogue.frame(struct.pack(">BHH", asked.function, address, count), asked.transaction)]

    assert (await refused_push(rogue, operation, other)).code == "E-MODBUS-ECHO"


async def test_fault_80_an_echo_of_another_value_breaks_the_session() -> None:
    rogue = Rogue()

    async with at_rogue(rogue) as device:
        order = await order_for(device)
        other = struct.pack(">BHH", 6, 15, 0x1234)
        rogue.lie = once("heartbeat", lambda asked, _reply: [rogue.frame(other, asked.transaction)])
        with pytest.raises(TrueflankError):
            await _push_and_wait(device, order)


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("operation", ["status", "begin", "read back"])
@pytest.mark.parametrize("change", ["cut", "garbage before", "nothing but garbage", "one byte"])
async def test_fault_81_truncated_and_garbled_answers_end_the_connection(
    operation: str, change: str, framer: str
) -> None:
    def other(_asked: Asked, reply: bytes) -> Iterable[bytes]:
        pieces = {
            "cut": reply[:-3],
            "garbage before": b"\xff\x00\xaa" + reply,
            "nothing but garbage": bytes(range(200, 230)),
            "one byte": reply[:1],
        }
        return [pieces[change]]

    rogue = Rogue(framer=framer)
    error = await refused_push(rogue, operation, other)
    assert isinstance(error, TransportError | RemoteProtocolError)

    async with at_rogue(rogue) as device:
        assert (await device.identify()).serial == "ROGUE-1"


# ---- what the registers mean ----------------------------------------------------------------------------


@pytest.mark.parametrize("change", ["words", "bytes", "both"])
async def test_fault_82_a_wrong_order_is_refused_before_anything_is_written(change: str) -> None:
    rogue = Rogue(low_first=change in ("words", "both"))
    if change in ("bytes", "both"):

        def lie(asked: Asked, reply: bytes) -> Iterable[bytes] | None:
            if asked.function != 3:
                return None
            data = reply[9:]
            swapped = bytes(data[place ^ 1] for place in range(len(data)))
            return [reply[:9] + swapped]

        rogue.lie = lie

    async def body(device: SinumerikModbus) -> None:
        with pytest.raises(UnsupportedDevice) as caught:
            await device.open(5.0)
        assert caught.value.code == ("E-MBX-WORD-ORDER" if change == "words" else "E-MBX-MAGIC")

    async with at_rogue(rogue, opened=False, word_order="high-first") as on:
        await body(on)
    assert all(one.function == 3 for one in rogue.asked)


@pytest.mark.parametrize("shift", [-1, 1])
async def test_fault_83_a_base_off_by_one_is_refused_before_anything_is_written(shift: int) -> None:
    rogue = Rogue()
    rogue.registers = [*rogue.registers[1:], 0] if shift > 0 else [0, *rogue.registers[:-1]]

    async def body(device: SinumerikModbus) -> None:
        with pytest.raises(UnsupportedDevice) as caught:
            await device.open(5.0)
        assert caught.value.code == "E-MBX-MAGIC"
        assert "shifted by one register" in str(caught.value) or shift > 0

    async with at_rogue(rogue, opened=False) as on:
        await body(on)
    assert all(one.function == 3 for one in rogue.asked)


@pytest.mark.parametrize("value", [32.767, 32.768, -32.768, -32.769, 65.535, 65.536, 199.999])
async def test_fault_84_values_beyond_16_bits_arrive_whole(value: float) -> None:
    rogue = Rogue()
    values = (0.0, value, -value, 0.0)

    async def body(device: SinumerikModbus) -> None:
        _, new = await push(device, await order_for(device, table(values)))
        assert new.own.table.deviations == values

    async with at_rogue(rogue) as on:
        await body(on)
    assert rogue.tables[1][:4] == [0, round(1000 * value), -round(1000 * value), 0]


@pytest.mark.parametrize("changes", [{"step": 1e6, "maximum": 4e6}, {"step": 10.00001, "maximum": 40.00004}])
async def test_fault_84_what_does_not_fit_is_refused_with_nothing_written(changes: dict[str, float]) -> None:
    rogue = Rogue()

    async def body(device: SinumerikModbus) -> None:
        order = await order_for(device, table((0.0, 1.0, 2.0, 1.0, 0.0), **changes))
        with pytest.raises(ValueOutOfRange):
            await device.stage((order,))

    async with at_rogue(rogue) as on:
        await body(on)
    assert not rogue.writes


@pytest.mark.parametrize("points", [2, 3, 49, 50, 51, 99, 100, 101, 123])
async def test_fault_85_no_value_is_split_over_two_requests(points: int) -> None:
    rogue = Rogue(reserved=123)
    values = (0.0, *(float(place % 7 - 3) * 70.001 for place in range(points - 2)), 0.0)

    async def body(device: SinumerikModbus) -> None:
        _, new = await push(device, await order_for(device, table(values)))
        assert new.own.table.deviations == pytest.approx(values, abs=1e-9)

    async with at_rogue(rogue) as on:
        await body(on)
    data = [one for one in rogue.asked if (one.function, one.address) == (16, 36)]
    assert all(one.count == 100 for one in data)
    assert sum(one.command == 3 for one in rogue.asked) == -(-points // 50)
    assert all(len(block) == 2 * count for _, count, block in value_chunks(list(range(points)), "high-first"))


@pytest.mark.parametrize(("function", "count"), [(16, 124), (16, 0), (3, 126), (3, 0)])
def test_fault_86_a_request_that_is_too_long_is_never_sent(function: int, count: int) -> None:
    values = (0,) * count if function == 16 else ()
    with pytest.raises(LocalProtocolError) as caught:
        ModbusCodec(1, "tcp").send(Question(function, 0, count, values))
    assert caught.value.code == "E-MODBUS-LIMIT"


@pytest.mark.parametrize(("function", "count"), [(16, 123), (3, 125)])
def test_fault_86_the_longest_requests_are_sent(function: int, count: int) -> None:
    values = (0,) * count if function == 16 else ()
    assert ModbusCodec(1, "rtu").send(Question(function, 0, count, values))


def test_fault_87_broadcast_is_forbidden() -> None:
    with pytest.raises(ConfigError):
        ModbusSettings.read({"unit": 0}, "grinder")
    with pytest.raises(LocalProtocolError):
        ModbusCodec(0, "tcp").send(Question(16, 0, 1, (1,)))


async def test_fault_88_after_a_timeout_no_answer_goes_to_the_next_question() -> None:
    """A(10) times out, B(20) would get A's data: the line is drained and opened anew instead."""
    rogue = Rogue(framer="rtu")
    rogue.registers[200:230] = range(1000, 1030)

    async with serving(rogue) as url:
        wire = ModbusWire(url, ModbusSettings(framer="rtu"), rogue.clock, "grinder")
        await wire.open(5.0)
        late: Lie = lambda asked, reply: [1.05, reply] if asked.address == 200 else None  # noqa: E731
        rogue.lie = late
        with pytest.raises(DeadlineExceeded):
            await wire.read(200, 2)
        with pytest.raises(LinkBroken):
            await wire.read(210, 2)
        await wire.open(5.0)
        assert await wire.read(210, 2) == (1010, 1011)
        assert await wire.read(220, 2) == (1020, 1021)
        await wire.close()


async def test_fault_88_a_line_that_answers_the_question_before_is_found_out() -> None:
    rogue = Rogue(framer="rtu")
    former: list[bytes] = []

    def lie(_asked: Asked, reply: bytes) -> Iterable[bytes]:
        former.append(reply)
        return [former[-2]] if len(former) > 1 else []

    async with at_rogue(rogue) as device:
        await device.identify()
        rogue.lie = lie
        for _ in range(6):
            try:
                assert (await device.identify()).axis_names == ("X1", "C1")
            except TrueflankError:
                with pytest.raises(TrueflankError):
                    await device.identify()
                await device.open(5.0) if not former else None
                return
        raise AssertionError("answers to other questions were believed")


# ---- many lies --------------------------------------------------------------------------------------------


def _lies(seed: int, rogue: Rogue) -> Lie:
    """A lie in every answer, of a kind that the frame betrays."""
    chance = random.Random(seed)

    def lie(asked: Asked, reply: bytes) -> Iterable[bytes | float]:
        bent = bytearray(reply)
        if rogue.framer == "rtu":
            kinds = ["flip", "cut", "late", "garbage", "nothing", "exception"]
        else:
            kinds = ["head", "cut", "late", "garbage", "nothing", "exception", "count"]
        kind = chance.choice(kinds)
        if kind == "flip":
            bent[chance.randrange(len(bent))] ^= 1 << chance.randrange(8)
        elif kind == "head":
            bent[chance.choice([0, 1, 2, 3, 6])] ^= 1 << chance.randrange(8)
        elif kind == "count":
            bent[8] ^= 1 << chance.randrange(8)
        elif kind == "cut":
            return [bytes(bent[: chance.randrange(len(bent))])]
        elif kind == "late":
            return [0.3, reply]
        elif kind == "garbage":
            return [chance.randbytes(chance.randrange(1, 40))]
        elif kind == "nothing":
            return []
        else:
            return exception(rogue, chance.randrange(256))(asked, reply)
        return [bytes(bent)]

    return lie


def _lied_to(framer: str, seed: int, count: int) -> int:
    """Ask ``count`` times, each answer a lie; how many were refused. Wrong data fails the test."""
    rogue = Rogue(framer=framer)
    rogue.registers[200:260] = range(5000, 5060)
    rogue.lie = _lies(seed, rogue)
    refused = 0

    async def main() -> None:
        nonlocal refused
        chance = random.Random(seed + 1)
        async with serving(rogue) as url:
            settings = ModbusSettings(framer=framer, reply_s=0.1)
            for _ in range(count):
                wire = ModbusWire(url, settings, rogue.clock, "grinder")
                await wire.open(5.0)
                address, size = 200 + chance.randrange(40), chance.randrange(1, 20)
                try:
                    found = await wire.read(address, size)
                    assert found == tuple(range(4800 + address, 4800 + address + size)), (seed, address, size)
                except TrueflankError:
                    refused += 1
                await wire.close()

    run_virtual(main)
    return refused


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("seed", range(4))
def test_no_wrong_data_is_accepted_from_lying_answers(framer: str, seed: int) -> None:
    assert _lied_to(framer, seed, 1250) == 1250


@pytest.mark.soak
@pytest.mark.parametrize("framer", ["tcp", "rtu"])
@pytest.mark.parametrize("seed", range(100, 140))
def test_no_wrong_data_is_accepted_from_many_more(framer: str, seed: int) -> None:
    assert _lied_to(framer, seed, 2500) == 2500


def _bent_push(seed: int, framer: str) -> bool:
    """One push in which one bit of one answer's data is wrong in a frame that is right; whether it went through."""
    chance = random.Random(seed)
    rogue = Rogue(framer=framer)
    honest: list[int] = []
    target = chance.randrange(130)
    through = False

    def lie(asked: Asked, reply: bytes) -> Iterable[bytes] | None:
        honest.append(asked.place)
        if len(honest) != target + 1 or asked.function != 3:
            return None
        pdu = bytearray(reply[7:] if framer == "tcp" else reply[1:-2])
        pdu[chance.randrange(2, len(pdu))] ^= 1 << chance.randrange(8)
        return [rogue.frame(bytes(pdu), asked.transaction)]

    async def body(device: SinumerikModbus) -> None:
        nonlocal through
        order = await order_for(device)
        rogue.lie = lie
        try:
            _, new = await push(device, order)
        except TrueflankError:
            return
        through = True
        assert [round(1000 * value) for value in new.own.table.deviations] == NM

    async def main() -> None:
        async with at_rogue(rogue) as on:
            await body(on)

    run_virtual(main)
    assert not rogue.enabled or rogue.tables[1] == HELD, seed
    return through


@pytest.mark.parametrize("framer", few(["tcp", "rtu"]))
def test_a_wrong_bit_in_a_right_frame_never_enables_a_wrong_table(framer: str) -> None:
    ended = [_bent_push(seed, framer) for seed in range(60)]
    assert any(ended)
    assert not all(ended)


@pytest.mark.soak
@pytest.mark.parametrize("framer", few(["tcp", "rtu"]))
def test_a_wrong_bit_never_enables_a_wrong_table_many_times(framer: str) -> None:
    assert not all(_bent_push(seed, framer) for seed in range(1000, 2500))


def test_another_url_of_the_driver_is_the_same_driver() -> None:
    assert driver(Rogue(), "memory://rogue").capabilities.consent == "panel"
