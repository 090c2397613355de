"""Every hostile switch of the Modbus double does what it says, and only that."""

from __future__ import annotations

import struct

import pytest

from drivers.errors import ConfigError, DeadlineExceeded, TransportError
from simulators.modbus import PlcSettings
from tests.contract.mailbox_master import Desk, at_desk, crc32, words

X1 = {18: 1, 19: 1}
Z1 = {18: 1, 19: 3}
QUICK = {"strict_activation": False}


def acting_um(desk: Desk, axis: str) -> float:
    value = desk.nck.get(f"$VA_ENC1_COMP_VAL[{axis}]")
    assert isinstance(value, float)
    return value * 1000.0


def points(desk: Desk, axis: str, count: int) -> list[float]:
    return [float(desk.nck.get(f"$AA_ENC_COMP[0,{n},{axis}]")) for n in range(count)]


async def test_swapped_words_show_in_the_word_order_test() -> None:
    async with at_desk(swap_words=True) as desk:
        assert await desk.master.read(2, 2) == [0x5678, 0x1234]


async def test_swapped_data_words_pass_every_check_of_the_plc_but_not_a_read_back() -> None:
    async with at_desk(swap_data_words=True) as desk:
        await desk.master.open()
        assert await desk.master.read(2, 2) == [0x1234, 0x5678]
        assert await desk.master.load(Z1, [0, 3000, 0]) == (0, 0)
        assert await desk.master.read_back(Z1, 0, 3) == [0, 3000 << 16, 0]


async def test_another_map_version() -> None:
    async with at_desk(map_version=1) as desk:
        assert await desk.master.read(0, 2) == [0x4743, 1]


async def test_a_stale_heartbeat() -> None:
    async with at_desk(stale_heartbeat=True) as desk:
        (before,) = await desk.master.read(4, 1)
        await desk.bench.sleep(30.0)
        assert await desk.master.read(4, 1) == [before]
        desk.plc.change(stale_heartbeat=False)
        assert await desk.master.read(4, 1) != [before]


async def test_a_wrong_crc_of_the_read_back() -> None:
    async with at_desk(wrong_read_back_crc=True) as desk:
        master = desk.master
        await master.open()
        head = master.header(7, 2, {**X1, 30: 3})
        await master.put(head)
        assert await master.result(2) == (0, 0)
        area = await master.read(200, 102)
        assert crc32([*head, *area[:100]]) != area[100] << 16 | area[101]


async def test_a_command_nobody_answered_comes_late() -> None:
    async with at_desk(late_command=6, late_s=3.0) as desk:
        master = desk.master
        desk.nck.set("$MA_ENC_COMP_ENABLE[0,X1]", 1, 0)
        desk.nck.channel_reset()
        await master.open()
        head = master.header(6, 2, X1)
        with pytest.raises(DeadlineExceeded):
            await master.put(head)
        await desk.reconnect()
        assert await master.read(6, 1) == [1]
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        await desk.bench.sleep(3.0)
        assert await master.read(6, 1) == [2]
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert await master.command(6, X1) == (0, 0), "once"


@pytest.mark.parametrize("redo", [False, True])
async def test_a_repeated_number_is_done_again_when_told_so(redo: bool) -> None:
    async with at_desk(redo_repeats=redo) as desk:
        master = desk.master
        await master.open()
        await master.command(10, {}, [0x3131, *[0] * 7, 1])
        desk.plc.memory.marker_state = 0
        await master.put(master.header(10, 2, {}), [0x3131, *[0] * 7, 1])
        await desk.bench.sleep(0.5)
        assert desk.plc.memory.marker_state == int(redo)


async def test_off_is_said_but_the_table_acts_on() -> None:
    async with at_desk(spec=QUICK, lies_about_disable=True) as desk:
        master = desk.master
        await master.open()
        assert await master.load(X1, [4000, 4000, 4000]) == (0, 0)
        assert await desk.confirmed(5, X1) == (0, 0)
        await desk.bench.sleep(1.0)  # the axis has moved by the table's value
        assert await master.command(6, X1) == (0, 0)
        assert await master.read(366, 1) == [0]
        assert (await master.read(5, 1))[0] >> 9 & 0b101 == 0b100
        assert await master.dint(304) == 4000
        assert acting_um(desk, "X1") == 4.0
        assert await master.load(X1, [0, 0, 0]) == (7, 17070)


async def test_values_kept_in_single_precision() -> None:
    async with at_desk(float32_values=True, careless=True) as desk:
        await desk.master.open()
        assert await desk.master.load(X1, [0, 123_456_789, 0]) == (0, 0)
        kept = points(desk, "X1", 2)[1]
        assert kept == struct.unpack("f", struct.pack("f", 123.456789))[0] != 123.456789
        assert await desk.master.read_back(X1, 0, 2) == [0, round(kept * 1e6)]


async def test_values_coarsened_unnoticed() -> None:
    async with at_desk(quantum_points=100) as desk:
        await desk.master.open()
        assert await desk.master.load(X1, [0, 1234, -1260]) == (0, 0)
        assert await desk.master.read_back(X1, 0, 3) == [0, 1200, -1300]


async def test_a_wrong_length_is_taken() -> None:
    async with at_desk(accepts_wrong_length=True) as desk:
        master = desk.master
        await master.open()
        fields, places = {**X1, 28: 60}, {"step": 10, "maximum": 590}
        assert await master.command(2, fields, **places) == (0, 0)
        data = [word for k in range(50) for word in words(7)]
        assert await master.command(3, {**fields, 29: 9, 30: 50}, data, **places) == (0, 0)
        master.points = data
        assert await master.command(4, fields, **places) == (0, 0)
        assert points(desk, "X1", 60) == [7e-6] * 50 + [0.0] * 10


async def test_the_end_of_each_chunk_is_lost_silently() -> None:
    async with at_desk(lose_points=2) as desk:
        for place in range(60):
            desk.nck.set(f"$AA_ENC_COMP[0,{place},Z1]", 0.001, 0)
        await desk.master.open()
        assert await desk.master.load(Z1, [7] * 60) == (0, 0)
        assert points(desk, "Z1", 60) == [7e-6] * 48 + [0.001] * 2 + [7e-6] * 8 + [0.001] * 2
        assert await desk.master.read_back(Z1, 47, 3) == [7, 1000, 1000]


@pytest.mark.parametrize("code", [2, 4, 6])
async def test_busy_for_ever(code: int) -> None:
    async with at_desk(busy_forever=code) as desk:
        master = desk.master
        await master.open()
        places = {"step": 10, "maximum": 20}
        if code == 4:
            assert await master.command(2, {**X1, 28: 3}, **places) == (0, 0)
        number = (await master.read(6, 1))[0] + 1
        await master.put(master.header(code, number, {**X1, 28: 3}, **places))
        for _ in range(100):
            await desk.bench.sleep(1.0)
            await master.beat()
        status, taken = await master.read(5, 2)
        assert (status & 0b1110, taken) == (0b0010, number)
        assert await master.command(8) == (0, 0)


async def test_the_key_turned_back_before_activation() -> None:
    async with at_desk(key_back=True) as desk:
        await desk.master.open()
        assert await desk.master.load(X1, [0, 1, 0]) == (0, 0)
        assert await desk.confirmed(5, X1) == (5, 0)
        assert not (await desk.master.read(5, 1))[0] & 0x80
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False


async def test_an_alarm_in_the_middle() -> None:
    async with at_desk(alarm_during=4) as desk:
        await desk.master.open()
        assert await desk.master.load(X1, [0, 1, 0]) == (0, 0)
        assert (await desk.master.read(5, 1))[0] >> 8 & 1 == 1
        assert await desk.master.dint(375) == 700016
        assert await desk.master.command(5, X1) == (6, 700016)


async def test_power_off_between_disable_and_enable() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        await master.open()
        assert await master.load(Z1, [1000, 2000, 1000], minimum=-500_000) == (0, 0)
        assert await desk.confirmed(5, Z1) == (0, 0)
        await desk.bench.sleep(1.0)
        desk.plc.change(power_cut_after=2)
        assert await master.command(6, Z1) == (0, 0)
        with pytest.raises(TransportError):
            await master.load(Z1, [0, 70, 80, 90], minimum=0, step=200_000)
        await desk.bench.sleep(30.0)
        await desk.reconnect()
        assert await master.read(6, 1) == [0]
        await desk.bench.warm_up()
        # the EEC stays off, the new points stand with the old MIN, STEP and MAX
        assert nck.get("$MA_ENC_COMP_ENABLE[0,Z1]") is False
        assert points(desk, "Z1", 4) == [0.0, 70e-6, 0.001, 0.0]
        assert nck.get("$AA_ENC_COMP_MIN[0,Z1]") == -50.0
        await master.open()
        assert await master.command(11, Z1) == (0, 0)
        assert await master.dint(357) == -500_000
        assert await master.command(5, Z1) == (10, 1)


async def test_parameters_first_leaves_the_new_limits_with_old_points() -> None:
    async with at_desk(parameters_first=True, power_cut_after=2) as desk:
        await desk.master.open()
        desk.nck.set("$AA_ENC_COMP[0,2,Z1]", 0.009, 0)
        with pytest.raises(TransportError):
            await desk.master.load(Z1, [0, 70, 80, 90])
        await desk.bench.sleep(30.0)
        assert desk.nck.get("$AA_ENC_COMP_MAX[0,Z1]") == 30.0
        assert points(desk, "Z1", 3) == [0.0, 70e-6, 0.009]


async def test_the_plc_program_overwrites_a_register() -> None:
    async with at_desk(overwrites=[[37, 99]]) as desk:
        await desk.master.open()
        fields, places = {**X1, 28: 3}, {"step": 10, "maximum": 20}
        assert await desk.master.command(2, fields, **places) == (0, 0)
        assert await desk.master.command(3, {**fields, 30: 3}, [0, 1, 0, 2, 0, 3], **places) == (1, 0)
        assert await desk.master.read(37, 1) == [99]


async def test_a_second_master_gets_between() -> None:
    async with at_desk(second_master=2) as desk:
        master = desk.master
        await master.open()
        head = master.header(8, 2, {})
        await master.put(head)
        await desk.bench.sleep(1.0)
        taken = await master.read(6, 1) + await master.read(12, 2)
        assert taken[0] == 3
        assert taken[1] << 16 | taken[2] != crc32(head)
        assert await master.command(8, number=3 + 1) == (0, 0)


async def test_the_nck_refuses_with_its_own_result() -> None:
    async with at_desk(nck_refuses=4, nck_result=70_003) as desk:
        await desk.master.open()
        assert await desk.master.load(X1, [0, 1, 0]) == (11, 70_003)
        assert await desk.master.read(8, 2) == [70_003 & 0xFFFF, 1]


async def test_a_button_without_wires() -> None:
    async with at_desk(confirm_dead=True) as desk:
        await desk.master.open()
        await desk.master.put(desk.master.header(5, 2, X1))
        for _ in range(62):
            await desk.bench.sleep(1.0)
            await desk.master.beat()
            assert desk.plc.confirm() is False
        assert await desk.master.result(2) == (12, 0)


async def test_a_silent_plc_and_a_pulled_cable() -> None:
    async def body(desk: Desk) -> None:
        desk.station.silent = True
        assert await desk.master.is_silent(bytes.fromhex("03 00 00 00 01"))
        desk.station.silent = False
        await desk.reconnect()
        await desk.station.pull()
        await desk.station.plug(desk.station.home)
        await desk.reconnect()
        assert await desk.master.read(0, 1) == [0x4743]

    async with at_desk() as on:
        await body(on)
    async with at_desk("tcp://127.0.0.1:0") as on:
        await body(on)


@pytest.mark.parametrize(
    "wrong",
    [{"swap_word": True}, {"unit": "one"}, {"swap_words": 1}, {"framer": "ascii"}, {"late_s": "soon"}],
)
def test_settings_are_checked(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        PlcSettings.of(wrong)


async def loaded_off(desk: Desk) -> None:
    """A table in the control that nobody switched on."""
    await desk.master.open()
    assert await desk.master.load(Z1, [0, 3000, 0]) == (0, 0)
    assert not desk.nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")


async def test_a_control_that_switches_on_by_itself_at_a_command() -> None:
    async with at_desk(spec=QUICK) as desk:
        await loaded_off(desk)
        desk.plc.change(enables_itself=7)
        await desk.master.read_back(Z1, 0, 3)
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")
        assert desk.nck.core.injected_faults == ["enable"]


@pytest.mark.parametrize("what", ["words", "memory", "switch"])
async def test_a_plc_that_forgets_at_a_command(what: str) -> None:
    async with at_desk(spec=QUICK, forgets_what=what) as desk:
        await loaded_off(desk)
        desk.nck.set("$MA_ENC_COMP_ENABLE[0,Z1]", 1, 0)
        desk.plc.memory.marker_state = 1
        before = points(desk, "Z1", 3)
        desk.plc.forget(what)
        assert (desk.plc.memory.marker_state == 0, desk.plc.session == 0) == ((what == "words"),) * 2
        assert (points(desk, "Z1", 3) != before) is (what == "memory")
        assert bool(desk.nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")) is (what != "switch")


async def test_forgetting_comes_while_the_command_is_under_way() -> None:
    async with at_desk(spec=QUICK) as desk:
        await loaded_off(desk)
        desk.plc.change(forgets=7, forgets_what="memory")
        assert await desk.master.read_back(Z1, 0, 3) == [0, 0, 0]


async def test_a_switching_on_that_is_done_a_second_time() -> None:
    async with at_desk(spec=QUICK) as desk:
        await loaded_off(desk)
        desk.plc.change(enables_twice_s=8.0)
        assert await desk.confirmed(5, Z1) == (0, 0)
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")
        desk.nck.set("$MA_ENC_COMP_ENABLE[0,Z1]", 0, 0)
        await desk.bench.sleep(10.0)
        assert desk.nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")
