"""The Modbus double against docs/plc-mailbox.md: the worked exchange byte for byte, every command, every refusal."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock
from drivers.transport import open_transport
from simulators.modbus import running_station
from tests.contract.mailbox_master import FAILED, Desk, Master, at_desk, crc16, crc32, many, words
from tests.unit.nck.bench import Bench

DOCUMENT = Path(__file__).parents[2] / "docs" / "plc-mailbox-reference.md"
X1 = {18: 1, 19: 1}
SPEC_801 = {"eec": 801}


# -- the worked exchange of the document ---------------------------------------------------------------


def worked_exchange() -> list[tuple[str, int, list[int]]]:
    """(read or write, address, words), neighbouring lines of one request joined."""
    text = DOCUMENT.read_text(encoding="utf-8").split("## 7. A worked exchange")[1].split("```")[1]
    found: list[tuple[str, int, list[int]]] = []
    for line in text.splitlines():
        parsed = re.fullmatch(r"(read|write|)\s+(\d+):((?: [0-9A-F]{4})+)", line)
        if parsed is None:
            continue
        values = [int(word, 16) for word in parsed[3].split()]
        if parsed[1]:
            found.append((parsed[1], int(parsed[2]), values))
        else:
            found[-1][2].extend(values)
    return found


async def test_the_worked_exchange_passes_as_printed() -> None:
    from simulators.nck import AxisSpec

    axes = (AxisSpec("X1", "X", travel=(-300.0, 700.0), eec_points=(801, 0)),)

    async with at_desk(spec={"axes": axes, "cec_points": ()}) as desk:
        desk.plc._taken = 41
        desk.plc.on_session = lambda: None
        for place, (way, address, values) in enumerate(worked_exchange()):
            if way == "write":
                await desk.master.write(address, values)
                await desk.bench.sleep(1.5)
                await desk.master.beat()
                continue
            if address == 0 and (values[5], values[6]) == (0x00F5, 42):
                desk.plc.release.give()
            found = await desk.master.read(address, len(values))
            if address == 0:
                # the heart-beat is the hour's; command 41, its check sum and its end were before our time
                for register in (4, 5, 12, 13) if place == 0 else (4,):
                    found[register] = values[register]
            assert [f"{word:04X}" for word in found] == [f"{word:04X}" for word in values], f"read {address}"
        assert [desk.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(4)] == [0.0, 0.003, -0.0015, 0.0]
        assert [desk.nck.get(f"$AA_ENC_COMP_{p}[0,X1]") for p in ("MIN", "STEP", "MAX")] == [0.0, 10.0, 20.0]
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False


def frames_of(mark: str) -> bytes:
    text = DOCUMENT.read_text(encoding="utf-8").split("as whole frames")[1].split("```")[1]
    return bytes.fromhex(re.search(rf"{mark} ((?:[0-9A-F]{{2}}\s+)+)", text + "\n")[1])  # type: ignore[index]


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
async def test_the_whole_frames_of_the_document(framer: str) -> None:
    async with at_desk(framer=framer) as desk:
        desk.plc._taken = 41
        desk.plc.on_session = lambda: None
        await desk.master.wire.write(frames_of(f"{framer} >"))
        assert await desk.master.wire.read(100) == frames_of(f"{framer} <")
        await desk.bench.sleep(0.1)
        assert desk.plc.session == 0x2A17


# -- every wire ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("url", "settings"),
    [
        ("memory://plc", {}),
        ("tcp://127.0.0.1:0", {}),
        ("tcp://127.0.0.1:0", {"word_order": "low-first", "unit": 7}),
        ("socket://127.0.0.1:0", {"framer": "rtu"}),
        ("memory://plc", {"framer": "rtu", "unit": 17, "word_order": "low-first"}),
    ],
)
async def test_a_table_goes_in_acts_and_comes_back_over_every_wire(url: str, settings: dict[str, object]) -> None:
    async with at_desk(url, spec={"strict_activation": False}, **settings) as desk:
        master = desk.master
        if url.startswith("socket"):
            await master.wire.close()
            master.wire = await open_transport(desk.station.url.replace("socket", "tcp"), LoopClock(), 5.0)
        await master.open()
        values = [0, *[(-1) ** k * 37 * k for k in range(1, 118)], 0]
        assert await master.command(6, X1) == (0, 0)
        assert await master.load(X1, values, minimum=-200_000, step=50_000) == (0, 0)
        parts = [await master.read_back(X1, first, min(50, 119 - first)) for first in (0, 50, 100)]
        assert [value for part in parts for value in part] == values
        assert (await master.dint(357), await master.dint(359), await master.dint(361)) == (-200_000, 50_000, 5_700_000)
        assert await desk.confirmed(5, X1) == (0, 0)
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is True


async def test_the_wire_listens_on_loopback_only() -> None:
    async with at_desk("tcp://127.0.0.1:0") as desk:
        assert re.fullmatch(r"tcp://127\.0\.0\.1:\d+", desk.station.url)
        assert not desk.station.url.endswith(":0")


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        ("03 00 00 00 02", "03 04 47 43 00 03"),
        ("03 01 79 00 01", "03 02 00 02"),  # register 377: AUTO
        ("03 01 83 00 02", "83 02"),  # 388
        ("03 00 00 00 7E", "83 03"),
        ("06 00 0F 00 05", "06 00 0F 00 05"),
        ("06 00 0E 00 05", "86 02"),
        ("06 00 88 00 05", "86 02"),
        ("10 00 87 00 02 04 00 00 00 00", "90 02"),  # 135-136
        ("10 00 0E 00 02 04 00 00 00 00", "90 02"),
        ("04 00 00 00 01", "84 01"),
        ("17 00 00 00 01 00 10 00 01 02 00 00", "97 01"),
    ],
)
async def test_addresses_functions_and_quantities(pdu: str, answer: str) -> None:
    async with at_desk() as desk:
        assert (await desk.master.exchange(bytes.fromhex(pdu))).hex(" ").upper() == answer
        rest = desk.plc.image.words[16:136]
        assert set(rest) == {0}


async def test_foreign_units_get_no_register() -> None:
    async def tcp(desk: Desk) -> None:
        desk.master.unit = 9
        assert await desk.master.exchange(bytes.fromhex("03 00 00 00 01")) == bytes.fromhex("83 0B")
        desk.master.unit = 0
        assert await desk.master.is_silent(many(16, [1] * 20))
        desk.master.unit = 255
        assert await desk.master.read(0, 1) == [0x4743]
        assert desk.plc.image.words[16] == 0

    async def rtu(desk: Desk) -> None:
        desk.master.unit = 9
        assert await desk.master.is_silent(bytes.fromhex("03 00 00 00 01"))
        desk.master.unit = 1
        bent = bytes.fromhex("01 03 00 00 00 01") + b"\0\0"
        await desk.master.wire.write(bent)
        assert await desk.master.read(0, 1) == [0x4743]

    async with at_desk() as on:
        await tcp(on)
    async with at_desk(framer="rtu") as on:
        await rtu(on)


# -- pictures ------------------------------------------------------------------------------------------


async def test_the_head_and_the_machine_as_the_map_has_them() -> None:
    async with at_desk() as desk:
        head = await desk.master.read(0, 15)
        assert head[:4] == [0x4743, 3, 0x1234, 0x5678]
        assert head[5:] == [0b0111_0001, *[0] * 9]
        await desk.bench.sleep(3.0)
        assert (await desk.master.read(4, 1))[0] == head[4] + 3
        live = await desk.master.read(302, 86)
        text = b"".join(word.to_bytes(2, "big") for word in live[6:30]).split(b"\0")
        assert [part.decode() for part in text if part] == ["ST-DOUBLE-0001", "4.8.6"]
        assert (live[4], live[5], live[47], live[48], live[75]) == (1, 2, 4, 4, 2)
        assert live[49:73] == [0] * 24
        assert live[30:47] == [0] * 17
        assert live[76:] == [0, 0b1111, *[0] * 8]


async def test_a_selected_axis_and_table_as_the_control_holds_them() -> None:
    async with at_desk() as desk:
        nck, master = desk.nck, desk.master
        nck.set("$MA_BACKLASH[0,C1]", 0.0021, 0)
        nck.set("$AN_CEC_INPUT_AXIS[2]", "Z1", 0)
        nck.set("$AN_CEC_OUTPUT_AXIS[2]", "C1", 0)
        nck.set("$AN_CEC_DIRECTION[2]", -1, 0)
        nck.set("$AN_CEC_MIN[2]", -50.0, 0)
        nck.set("$AN_CEC_STEP[2]", 12.5, 0)
        nck.set("$AN_CEC_MAX[2]", 187.5, 0)
        nck.set("$AN_CEC_MULT_BY_TABLE[2]", 4, 0)
        nck.set("$SN_CEC_TABLE_ENABLE[2]", 1, 0)
        nck.set("$SN_CEC_TABLE_WEIGHT[2]", -0.25, 0)
        assert await master.command(11, {18: 2, 19: 2, 32: 4}) == (0, 0)
        assert (await master.read(332, 8))[:2] == [0x4331, 0]
        assert await master.read(351, 4) == [2, 2, 0, 4]
        assert await master.read(355, 2) == [0b111111, 0b0100]
        assert [await master.dint(address) for address in (357, 359, 361)] == [-500_000, 125_000, 1_875_000]
        assert await master.read(363, 4) == [3, 4, 4, 0b1100]
        assert await master.read(385, 1) == [2]
        assert await master.dint(386) == 1_000_000
        assert await master.dint(367) == -250_000
        assert await master.dint(373) == 21_000
        assert (await master.read(10, 1)) == [20]
        nck.set("$AN_CEC_STEP[2]", 12.50001, 0)
        assert await master.read(356, 7) == [0x8004, 0, 0, 0, 0, 0, 0]


async def test_the_acting_values_are_the_controls_own() -> None:
    async with at_desk(spec={"strict_activation": False}) as desk:
        master = desk.master
        await desk.bench.run(
            "$AA_ENC_COMP_STEP[0,X1]=100 $AA_ENC_COMP_MIN[0,X1]=0 $AA_ENC_COMP_MAX[0,X1]=200\n"
            "$AA_ENC_COMP[0,1,X1]=0.004\n$MA_ENC_COMP_ENABLE[0,X1]=1\nNEWCONF\nG0 X1=50\nM30"
        )
        await desk.bench.sleep(1.0)
        assert await master.command(11, X1) == (0, 0)
        assert await master.dint(302) == pytest.approx(500_000, abs=1)
        assert await master.dint(304) == 2000
        assert await master.dint(369) == 2000
        assert await master.dint(371) == 0
        assert (await master.read(5, 1))[0] >> 9 & 7 == 0b001
        assert await master.command(11, {18: 2, 19: 0, 32: 1}) == (0, 0)
        assert await master.dint(304) == 0
        assert await master.command(11, {18: 3, 19: 1}) == (0, 0)
        assert await master.read(356, 11) == [0] * 10 + [1]


async def test_status_bits_follow_the_machine() -> None:
    async with at_desk() as desk:

        async def bits() -> int:
            return (await desk.master.read(5, 1))[0]

        desk.nck.set_access_level(5)
        assert await bits() == 0b0111_0001
        desk.plc.release.set(True)
        assert await bits() == 0b10_0000_0111_0001, "it counts only in a session"
        desk.plc.release.set(False)
        desk.plc.open_session(5)
        assert await bits() == 0b1111_0001
        desk.nck.lose_reference("Z1")
        assert await bits() == 0b1011_0001
        desk.nck.core.alarms.raise_(700000, "door")
        assert await bits() == 0b1_1011_0001
        assert await desk.master.dint(375) == 700000
        desk.nck.acknowledge_alarms()
        desk.nck.reference_axis("Z1")
        await desk.bench.sleep(30.0)
        desk.bench.press_start("G1 X1=200 F600\nM30")
        await desk.bench.sleep(1.0)
        assert await bits() == 0b10_0000_0100_1001, "the session ended without its heart-beat, and the release with it"
        desk.nck.nck_reset()
        assert await bits() & 0b1_0001 == 0


# -- sessions, numbers, order --------------------------------------------------------------------------


async def test_numbers_are_used_once_and_repeats_are_answered_not_redone() -> None:
    async with at_desk() as desk:
        master = desk.master
        assert await master.command(1, {19: 5}) == (0, 0)
        marker = [0x3137, *[0] * 7, 1]
        assert await master.command(10, {}, marker) == (0, 0)
        desk.plc.memory.marker_state = 0
        head = master.header(10, 2, {})
        await master.put(head, marker)
        await desk.bench.sleep(0.5)
        assert await master.result(2) == (0, 0)
        assert desk.plc.memory.marker_state == 0, "the repeat was done again"
        assert await master.command(8, number=2 + 2) == (2, 3)
        assert await master.command(8) == (0, 0)
        desk.plc._taken = 65535
        assert await master.command(8, number=1) == (0, 0)


async def test_number_0_is_no_command() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        assert await master.command(8, number=0) == (2, 2)
        assert (await master.read(6, 1)) == [0]
        assert await master.command(8) == (0, 0)


async def test_a_torn_transfer_is_never_acted_on() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.write(36, [7] * 100)
        await master.write(18, [1, 1])
        await desk.bench.sleep(5.0)
        assert (await master.read(5, 3)) == [0b0111_0001, 0, 0]


async def test_the_session_lives_by_its_heartbeat() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open(77)
        for _ in range(8):
            await desk.bench.sleep(1.0)
            await master.beat()
        assert (await master.read(14, 1)) == [77]
        assert await master.command(2, {**X1, 28: 3}, step=10, maximum=20) == (0, 0)
        desk.master = await desk.reconnect()
        assert (await master.read(14, 1)) == [77], "a session is not tied to a connection"
        await desk.bench.sleep(4.5)
        assert (await master.read(14, 1)) == [77]
        await desk.bench.sleep(1.0)
        head = await master.read(0, 15)
        assert (head[5] & 0b1110, head[7], head[14], head[11]) == (0b1000, 13, 0, 0)
        assert await master.command(6, X1) == (13, 0)
        assert await master.command(1, {19: 78}) == (0, 0)
        assert await master.command(3, {**X1, 28: 3, 30: 1}, [0, 0], step=10, maximum=20) == (2, 5)


async def test_a_fast_machine_leaves_the_pc_its_own_seconds_for_session_and_release() -> None:
    """The machine sixty times as fast: a beat every second of the PC keeps its session, and the release counts on."""
    bench, pc = Bench(), LoopClock()
    await bench.nck.start()
    await bench.warm_up()
    async with running_station(bench.nck, LoopClock(60.0), {}, "memory://plc") as station:
        station.plc.on_session = station.plc.release.give
        master = Master(await open_transport(station.url, pc, 5.0), False, 1, False)
        await master.open(77)
        for _ in range(30):  # half an hour of the machine
            await pc.sleep(1.0)
            await master.beat()
        assert (await master.read(14, 1)) == [77]
        assert station.plc.release.left_s == 900 - 30
        await pc.sleep(4.5)
        assert (await master.read(14, 1)) == [77]
        await pc.sleep(1.0)
        head = await master.read(0, 15)
        assert (head[7], head[14]) == (13, 0)
        await master.wire.close()
    await bench.nck.stop()


async def test_a_busy_plc_takes_abort_and_close_only() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        await master.put(master.header(5, 2, X1))
        await desk.bench.sleep(1.0)
        assert (await master.read(5, 2)) == [0b1_0000_1111_0011, 2]
        assert await master.command(10, {}, [0] * 9) == (2, 3)
        assert (await master.read(5, 1))[0] >> 12 == 0, "the wait was given up"
        assert desk.plc.confirm() is False
        await master.put(master.header(5, 4, X1))
        await desk.bench.sleep(1.0)
        assert await master.command(8) == (0, 0)
        assert desk.plc.confirm() is False
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False


async def test_a_second_session_is_refused_and_named() -> None:
    async with at_desk() as desk:
        await desk.master.open(300)
        other = Master(await open_transport(desk.station.url, LoopClock(), 5.0))
        assert await other.command(1, {19: 301}) == (14, 300)
        assert await desk.master.command(9) == (0, 0)
        assert await other.command(1, {19: 301}) == (0, 0)
        await other.wire.close()


# -- refusals ------------------------------------------------------------------------------------------

BEGIN = {**X1, 28: 3}
SOUND = {"step": 10, "maximum": 20}
CEC = {18: 2, 19: 1, 28: 3, 31: 3, 32: 1}


@pytest.mark.parametrize(
    ("fields", "places", "expected"),
    [
        ({**BEGIN, 18: 0}, SOUND, (9, 0)),
        ({**BEGIN, 18: 3}, SOUND, (4, 24)),
        ({**X1, 18: 3, 28: 2}, {}, (4, 28)),
        ({**X1, 18: 3, 28: 1, 33: 1}, {}, (4, 33)),
        ({**BEGIN, 18: 4}, SOUND, (9, 0)),
        ({**BEGIN, 18: 5}, SOUND, (9, 0)),
        ({**BEGIN, 19: 0}, SOUND, (9, 0)),
        ({**BEGIN, 19: 5}, SOUND, (9, 0)),
        ({**BEGIN, 20: 2}, SOUND, (9, 0)),
        ({**CEC, 19: 4}, SOUND, (9, 0)),
        ({**CEC, 31: 0}, SOUND, (9, 0)),
        ({**CEC, 32: 5}, SOUND, (9, 0)),
        ({**BEGIN, 21: 2}, SOUND, (4, 21)),
        ({**CEC, 21: 6}, SOUND, (4, 21)),
        ({**CEC, 21: 16}, SOUND, (4, 21)),
        ({**CEC, 33: 5}, SOUND, (4, 33)),
        ({**BEGIN, 31: 1}, SOUND, (4, 31)),
        ({**BEGIN, 32: 1}, SOUND, (4, 32)),
        ({**BEGIN, 33: 1}, SOUND, (4, 33)),
        (BEGIN, {"step": 0, "maximum": 0}, (4, 24)),
        (BEGIN, {"step": -10, "maximum": -20}, (4, 24)),
        (BEGIN, {"step": 10, "maximum": 30}, (4, 26)),
        (BEGIN, {"step": 10, "maximum": 29}, (0, 0)),
        (BEGIN, {"step": 10, "maximum": 19}, (4, 26)),
        ({**BEGIN, 28: 1}, {"step": 10, "maximum": 0}, (4, 28)),
        ({**BEGIN, 28: 901}, {"step": 10, "maximum": 9000}, (8, 900)),
        ({**BEGIN, 19: 2}, SOUND, (8, 0)),
        ({**CEC, 28: 21}, {"step": 10, "maximum": 200}, (8, 20)),
    ],
)
async def test_begin_refuses_what_is_not_sound(
    fields: dict[int, int], places: dict[str, int], expected: tuple[int, int]
) -> None:
    async with at_desk() as desk:
        await desk.master.open()
        assert await desk.master.command(2, fields, **places) == expected
        assert (await desk.master.read(351, 1)) == [int(expected == (0, 0))], "a refused command selects nothing"
        assert bool(desk.plc.memory.half) is (expected == (0, 0))


async def test_refusals_by_the_state_of_the_machine() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        await master.open()
        desk.plc.release.set(False)
        for code in (2, 6):
            assert await master.command(code, BEGIN, **SOUND) == (5, 0)
        assert await master.command(5, X1) == (5, 0)
        assert await master.command(11, X1) == (0, 0)
        assert await master.read_back(X1, 0, 2) == [0, 0]
        desk.plc.release.set(True)
        desk.bench.press_start("G1 X1=300 F6000\nM0\nM30")
        await master.beat()
        for code in (2, 5, 6):
            assert await master.command(code, BEGIN, **SOUND) == (6, 0)
        nck.channel_reset()
        nck.core.alarms.raise_(700123, "lid", "cancel")
        await desk.bench.sleep(1.0)
        assert await master.command(2, BEGIN, **SOUND) == (0, 0)
        assert await master.command(5, {18: 1, 19: 3}) == (6, 700123)
        nck.acknowledge_alarms()
        nck.set("$MA_ENC_COMP_ENABLE[0,Z1]", 1, 0)
        assert await master.command(2, {**BEGIN, 19: 3}, **SOUND) == (7, 0)
        nck.nck_reset()
        assert await master.command(2, BEGIN, **SOUND) == (6, 0)
        assert await master.command(11, X1) == (6, 0)


async def test_refusals_while_loading() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        assert await master.command(3, BEGIN, [0] * 2, **SOUND) == (2, 2)
        assert await master.command(4, BEGIN, **SOUND) == (2, 3)
        fields = {**X1, 28: 60}
        places = {"step": 10, "maximum": 590}
        assert await master.command(2, fields, **places) == (0, 0)
        data = [word for k in range(50) for word in words(k)]
        assert await master.command(3, {**fields, 29: 1, 30: 50}, data, **places) == (3, 0)
        assert await master.command(3, {**fields, 30: 51}, data, **places) == (3, 0)
        assert await master.command(3, {**fields, 30: 0}, data, **places) == (3, 0)
        assert await master.command(3, {**fields, 30: 50}, data, step=10, maximum=600) == (4, 27)
        assert await master.command(3, {**fields, 19: 3, 30: 50}, data, **places) == (4, 19)
        assert await master.command(3, {**fields, 30: 50}, data, crc=5, **places) == (1, 0)
        assert await master.command(3, {**fields, 30: 50}, data, **places) == (0, 0)
        assert (await master.read(11, 1)) == [50]
        assert await master.command(3, {**fields, 30: 50}, data, **places) == (3, 50)
        assert await master.command(3, {**fields, 29: 50, 30: 11}, data, **places) == (3, 50)
        master.points = data
        assert await master.command(4, fields, **places) == (3, 50)
        master.points = data[:-1]
        assert await master.command(4, fields, **places) == (1, 0)
        assert desk.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.0, "nothing goes into the NCK before verify"
        assert await master.command(5, X1) == (10, 1)
        assert await master.command(8) == (0, 0)
        assert (await master.read(11, 1)) == [0]
        assert await master.command(4, fields, **places) == (1, 0)
        master.points = []
        assert await master.command(4, fields, **places) == (2, 19)
        assert await master.command(5, X1) == (10, 1)
        assert await master.command(77) == (9, 0)
        assert await master.command(7, {**X1, 29: 899, 30: 2}) == (8, 900)
        assert await master.command(7, {**X1, 30: 51}) == (3, 0)
        assert await master.command(10, {}, [0] * 8 + [4]) == (4, 44)
        assert await master.command(1, {19: 0}) == (14, 0x2A17)


async def test_what_the_nck_refuses_is_told() -> None:
    async with at_desk(write_level=3) as desk:
        master = desk.master
        await master.open()
        assert await master.command(6, X1) == (11, 4075)
        desk.plc.change(nck_refuses=7)
        assert await master.command(7, {**X1, 30: 1}) == (11, 5)
        desk.nck.set("$AA_ENC_COMP[0,3,X1]", 3000.0, 0)
        desk.plc.change(nck_refuses=0)
        assert await master.command(7, {**X1, 29: 3, 30: 1}) == (4, 0)


# -- switching and reading -----------------------------------------------------------------------------


async def test_nothing_is_switched_on_without_a_person() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        assert desk.plc.confirm() is False, "a button pressed before counts for nothing"
        await master.put(master.header(5, 2, X1))
        for _ in range(59):
            await desk.bench.sleep(1.0)
            await master.beat()
            assert (await master.read(5, 1))[0] >> 12 == 1
        await desk.bench.sleep(1.5)
        assert await master.result(2) == (12, 0)
        assert desk.plc.confirm() is False
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        await master.put(master.header(5, 3, X1))
        await desk.bench.sleep(6.0)  # the PC is gone
        assert desk.plc.confirm() is False
        assert (await master.read(7, 1)) == [13]
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False


async def test_a_cross_table_goes_in_and_is_switched_as_the_map_says() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        await master.open()
        nck.set("$SN_CEC_TABLE_WEIGHT[1]", 0.5, 0)
        nck.set("$AN_CEC[1,7]", 0.09, 0)
        cross = {18: 2, 19: 1, 21: 2 << 1, 31: 3, 32: 1, 33: 3}
        assert await master.load(cross, [0, -4000, 2000], minimum=-100_000) == (0, 0)
        assert [nck.get(f"$AN_CEC[1,{n}]") for n in (0, 1, 2, 7)] == [0.0, -0.004, 0.002, 0.0]
        names = ("INPUT_AXIS", "OUTPUT_AXIS", "DIRECTION", "MULT_BY_TABLE", "MIN", "STEP", "MAX", "IS_MODULO", "TYPE")
        found = [nck.get(f"$AN_CEC_{name}[1]") for name in names]
        assert found == ["Z1", "X1", -1, 3, -10.0, 10.0, 10.0, False, 0]
        assert await desk.confirmed(5, {18: 2, 19: 1, 32: 1}) == (0, 0)
        assert (await master.read(5, 1))[0] >> 9 & 7 == 0b010
        assert await master.read(366, 1) == [0b110]
        assert await master.dint(367) == 1_000_000
        assert await master.command(2, {**cross, 28: 3}, minimum=-100_000, step=10, maximum=-99_980) == (7, 0)
        assert await master.command(2, {**cross, 19: 0, 28: 3}, minimum=-100_000, step=10, maximum=-99_980) == (7, 0)
        assert await master.command(6, {18: 2, 19: 1, 32: 1}) == (0, 0)
        assert await master.read(366, 1) == [0]
        assert await desk.confirmed(5, {18: 2, 19: 1, 21: 1 << 4, 32: 1}) == (0, 0)
        assert await master.read(366, 1) == [0b010]
        assert await master.command(5, {**X1, 21: 1 << 4}) == (4, 40)


async def test_a_rotary_table_has_its_own_units() -> None:
    async with at_desk() as desk:
        await desk.master.open()
        rotary = {18: 1, 19: 4, 21: 1}
        assert await desk.master.load(rotary, [0, 12_345, -7, 0], step=120_000_000) == (0, 0)
        assert desk.nck.get("$AA_ENC_COMP[0,1,C1]") == pytest.approx(0.0012345, abs=1e-12)
        assert desk.nck.get("$AA_ENC_COMP_MAX[0,C1]") == 360.0
        assert desk.nck.get("$AA_ENC_COMP_IS_MODULO[0,C1]") is True


async def test_backlash_and_temperature_are_read_and_temperature_only_read() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        await master.open()
        nck.set("$MA_BACKLASH[0,X1]", -0.0035, 0)
        nck.set("$SA_TEMP_COMP_ABS_VALUE[X1]", 0.004, 0)
        nck.set("$SA_TEMP_COMP_SLOPE[X1]", 0.0000125, 0)
        nck.set("$SA_TEMP_COMP_REF_POSITION[X1]", -120.5, 0)
        assert await master.read_back({18: 3, 19: 1}, 0, 1) == [-3500]
        assert (await master.read(10, 1)) == [1]
        assert await master.read_back({18: 4, 19: 1}, 0, 3) == [4000, 12_500, -1_205_000]
        for code in (2, 5, 6):
            assert await master.command(code, {18: 4, 19: 1}) == (9, int(code > 2))


async def test_left_over_points_above_the_table_are_zeroed() -> None:
    async with at_desk() as desk:
        for place in range(60):
            desk.nck.set(f"$AA_ENC_COMP[0,{place},Z1]", 0.01, 0)
        await desk.master.open()
        assert await desk.master.load({18: 1, 19: 3}, [0, 5, 0]) == (0, 0)
        assert [desk.nck.get(f"$AA_ENC_COMP[0,{n},Z1]") for n in range(60)] == [0.0, 5e-6, *[0.0] * 58]


async def test_what_outlives_a_power_cut() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        assert await master.command(10, {}, [0x3939, *[0] * 7, 1]) == (0, 0)
        assert await master.command(2, BEGIN, **SOUND) == (0, 0)
        await desk.station.power_cycle()
        await desk.reconnect()
        assert (await master.read(5, 11)) == [0b10_0000_0011_0001, *[0] * 10]
        assert (await master.read(15, 121)) == [0] * 121
        assert (await master.read(340, 9)) == [0x3939, *[0] * 7, 1]
        await desk.bench.warm_up()
        await master.open()
        assert await master.command(5, X1) == (10, 1)
        assert await master.load(X1, [0, 1, 2]) == (0, 0)
        assert await desk.confirmed(5, X1) == (0, 0)


async def test_a_forgetful_plc_can_be_had() -> None:
    async with at_desk(retentive=False) as desk:
        await desk.master.open()
        assert await desk.master.command(10, {}, [0x3939, *[0] * 7, 1]) == (0, 0)
        await desk.station.power_cycle()
        await desk.reconnect()
        assert (await desk.master.read(340, 9)) == [0] * 9


async def test_commands_take_program_cycles() -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        begun = desk.bench.clock.now()
        await master.write(16, [*(head := master.header(6, 2, X1)), *words(crc32(head))])
        assert (await master.read(6, 1)) == [1], "not before the next cycle"
        await master.result(2)
        assert 0.03 <= desk.bench.clock.now() - begun <= 0.2


@pytest.mark.parametrize("seed", range(4))
async def test_whatever_is_asked_is_answered_and_nothing_is_switched_on(seed: int) -> None:
    async def body(desk: Desk) -> None:
        rng = np.random.default_rng(seed)
        for _ in range(150):
            pdu = bytes((int(rng.choice((3, 6, 16, 22, 1))),)) + rng.bytes(int(rng.integers(0, 40)))
            answer = await desk.master.exchange(pdu)
            assert answer[0] in (pdu[0], pdu[0] | 0x80)
            assert answer[0] < 0x80 or (len(answer) == 2 and answer[1] in (1, 2, 3))

    async def commands(desk: Desk) -> None:
        rng = np.random.default_rng(seed)
        found = set()
        await desk.master.open()
        for _ in range(250):
            fields = {
                register: int(rng.choice((0, 0, 1, 2, 3, 4, 50, 65535)))
                for register in (*range(18, 22), *range(28, 34))
            }
            data = rng.integers(0, 5, 100).tolist()
            number = (await desk.master.read(6, 1))[0] % 0xFFFF + 1
            code = int(rng.choice((2, 3, 4, 5, 6, 7, 8, 10, 11, 12)))
            places = {"minimum": 0, "step": int(rng.integers(0, 3)), "maximum": int(rng.integers(0, 5))}
            await desk.master.put(desk.master.header(code, number, fields, **places), data if code in (3, 10) else None)
            await desk.bench.sleep(0.3)
            await desk.master.beat()
            status, taken, error = await desk.master.read(5, 3)
            assert taken == number
            assert bool(status & FAILED) == bool(error)
            found.add(error)
        assert {0, 2, 4, 9} <= found
        switches = [desk.nck.get(f"$MA_ENC_COMP_ENABLE[0,{axis}]") for axis in ("X1", "Y1", "Z1", "C1")]
        assert switches == [False] * 4

    async with at_desk() as on:
        await body(on)
    async with at_desk() as on:
        await commands(on)


def test_the_masters_own_checks() -> None:
    assert crc16(bytes.fromhex("02 07")) == bytes.fromhex("41 12")
    assert crc32(struct.unpack(">4H", b"12345678")) != 0
    assert words(-2) == [0xFFFF, 0xFFFE]
