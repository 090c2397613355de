"""A push that was recorded on the network and is played back by a bare socket: nothing it asks for is done."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.transport import open_transport
from tests.contract.mailbox_master import Master, at_desk, entry_of, words
from tests.contract.modbus_stage import Stage, on_stage, order_for, table

NOT_RELEASED = (5, 0)
X1 = {18: 1, 19: 1}


def recorded(stage: Stage) -> list[tuple[int, tuple[int, ...]]]:
    """From now on, every write that reaches the PLC's registers."""
    found: list[tuple[int, tuple[int, ...]]] = []
    write = stage.plc.write

    def noted(address: int, values: Any) -> None:
        found.append((address, tuple(values)))
        write(address, values)

    stage.plc.write = noted
    return found


async def test_a_recorded_push_is_refused_and_nothing_changes() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        record = recorded(stage)
        await stage.push(order)
        played = tuple(record)
        await stage.device.close()
        stage.plc.on_session = lambda: None  # nobody stands at the panel; the release was left on
        assert stage.plc.release.on
        before = (stage.bench.nck.static_memory(), stage.plc.memory.marker, stage.plc.memory.marker_state)
        master = Master(await open_transport(stage.station.url, LoopClock(), 5.0))
        answers: dict[int, set[tuple[int, int]]] = {}
        try:
            first = next(values[1] for address, values in played if address == 16)
            head = master.header(11, (first - 2) % 0xFFFF + 1, X1)
            await master.put(head)  # a number that is out of order is taken over: the recording fits now
            await stage.bench.sleep(0.5)
            for address, values in played:
                stage.plc.confirm()
                if address == 15:
                    await master.exchange(struct.pack(">BHH", 6, 15, values[0]))
                    continue
                await master.write(address, values)
                if address == 16:
                    answers.setdefault(values[0], set()).add(await master.result(values[1]))
        finally:
            await master.wire.close()
        assert answers[1] == {(0, 0)}, "anybody may open a session"
        for command in (2, 5, 6, 10):
            assert answers[command] == {NOT_RELEASED}, command
        assert all(code for command in (3, 4) for code, _ in answers[command])
        assert before == (stage.bench.nck.static_memory(), stage.plc.memory.marker, stage.plc.memory.marker_state)
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]"), "the live table is still on"


@pytest.mark.parametrize("age_s", [890.0, 901.0])
async def test_a_release_counts_for_a_quarter_of_an_hour(age_s: float) -> None:
    async with at_desk() as desk:
        master = desk.master
        await master.open()
        for _ in range(int(age_s)):
            await desk.bench.sleep(1.0)
            await master.beat()
        begin = {**X1, 28: 2}
        expected = (0, 0) if age_s < 900.0 else NOT_RELEASED
        assert await master.command(2, begin, step=10, maximum=10) == expected
        assert bool((await master.read(5, 1))[0] >> 13 & 1) is (age_s > 900.0)
        assert await master.command(6, X1) == (0, 0), "no clock keeps a table on"
        desk.plc.release.give()
        assert await master.command(2, begin, step=10, maximum=10) == (0, 0)


async def test_a_release_from_before_the_session_counts_for_nothing() -> None:
    async with at_desk() as desk:
        master = desk.master
        desk.plc.on_session = lambda: None
        desk.plc.release.give()
        await master.open()
        assert (await master.read(5, 1))[0] >> 7 & 0b1000001 == 0b1000000
        assert (await master.read(384, 1)) == [0]
        for code in (2, 5, 6):
            assert await master.command(code, {**X1, 28: 2} if code == 2 else X1, step=10, maximum=10) == NOT_RELEASED
        assert await master.command(10, {}, [0x3137, *[0] * 7, 1]) == NOT_RELEASED
        desk.plc.release.set(False)
        desk.plc.release.set(True)
        assert await master.command(6, X1) == (0, 0)
        assert await master.command(10, {}, [0x3137, *[0] * 7, 1, 1, 2, 3, 4]) == (0, 0)
        assert await master.read(380, 4) == [1, 2, 3, 4]


async def test_several_tables_go_off_and_on_in_one_command_or_none_does() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        nck.set("$MA_ENC_COMP_ENABLE[0,X1]", 1, 0)
        nck.set("$MA_ENC_COMP_ENABLE[0,Z1]", 1, 0)
        await master.open()
        two = [*entry_of({18: 1, 19: 1})[1], *entry_of({18: 1, 19: 3})[1]]
        assert await master.command(6, {30: 3}, [*two, 1, 30, 0, 30, 0]) == (9, 3)
        assert nck.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert await master.command(6, {30: 21}, two) == (3, 0)
        assert await master.command(6, {30: 2}, two) == (0, 0)
        assert not nck.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert not nck.get("$MA_ENC_COMP_ENABLE[0,Z1]")
        assert await master.read(351, 4) == [1, 3, 0, 3]


async def test_a_backlash_is_loaded_kept_back_and_written_by_the_confirm() -> None:
    async with at_desk() as desk:
        master, nck = desk.master, desk.nck
        nck.set("$MA_BACKLASH[0,X1]", 0.002, 0)
        await master.open()
        back = {18: 3, 19: 1}
        begin = {**back, 28: 1}
        assert await master.command(2, begin) == (7, 0)
        assert await master.command(6, back) == (0, 0)
        assert nck.get("$MA_BACKLASH[0,X1]") == 0.0
        assert await desk.master.command(5, back) == (10, 1)
        assert await master.command(2, begin) == (0, 0)
        value = words(5500)
        assert await master.command(3, {**begin, 29: 0, 30: 1}, value) == (0, 0)
        master.points = value
        assert await master.command(4, begin) == (0, 0)
        assert nck.get("$MA_BACKLASH[0,X1]") == 0.0, "it would act at once"
        assert await desk.confirmed(5, back) == (0, 0)
        assert nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.0055)
        assert await master.read_back(back, 0, 1) == [5500]
        assert (await master.read(366, 1))[0] & 8
