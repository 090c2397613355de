"""What is signed is what is laid down: the writes that `program` prints for a PLC mailbox are those on the wire."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from drivers.errors import ConfigError, DeviceRefused
from drivers.programs import DayNumbers, Origin, PaperMachine
from drivers.sinumerik.mailbox.preview import preview_writes
from drivers.types.orders import DisableOrder, PushBatch
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from tests.contract.laid_down import WireLog, read, wire_log
from tests.contract.modbus_stage import Stage, cross, on_stage, order_for, table
from tests.contract.test_modbus_gaps import GAPS
from tests.contract.test_reversal_modbus import NEW as NEW_REVERSAL
from tests.push.world import NEW

__all__ = ["wire_log"]
HIGH: dict[str, Any] = {"unit": 1}
MACHINE = PaperMachine(("X1", "C1"), frozenset({"C1"}))
ORIGIN = Origin("grinder", "GH-0012", "1.0")


async def pushed(stage: Stage, batch: PushBatch) -> None:
    device = stage.device
    await device.stage(batch)
    await device.read_back(batch, 200.0)
    await device.activate(batch, batch)
    assert await stage.pressed(device.confirm(batch, 100.0)) == (True,) * len(batch)
    await device.restarted(batch, 100.0)
    await device.finish_push(batch, "committed")


def printed(order: Any, numbers: DayNumbers, settings: dict[str, Any]) -> str:
    (one,) = preview_writes(order, settings, replace(MACHINE, numbers=numbers), ORIGIN, "grinder")
    return one.text


@pytest.mark.parametrize("word_order", ["high-first", "low-first"])
async def test_a_batch_is_laid_down_as_it_is_printed(wire_log: WireLog, word_order: str) -> None:
    """Own table and two cross tables of one axis at once: marker, off, points, on, marker."""
    async with on_stage(word_order=word_order) as stage:
        wanted = (table(), cross(0), cross(1))
        batch = tuple([await order_for(stage.device, one, head=0x0123456789ABCDEF) for one in wanted])
        wire_log.writes.clear()
        await pushed(stage, batch)
        text = printed(batch, wire_log.numbers(17), {"word_order": word_order})
        assert read(text) == wire_log.changing
        assert "Axes by number (MD32452): 1 X1 (1), 2 C1 (1)" in text
        assert printed(batch, DayNumbers(), {"word_order": word_order}) != text, "numbers and CRC are of the day"


async def test_numbers_and_factors_of_the_site_file_are_printed_and_laid_down(wire_log: WireLog) -> None:
    """Axis numbers that leave some out, and a reversal that the control multiplies by 2."""
    said: dict[str, Any] = {"axis_numbers": {"C1": 1, "X1": 4}, "backlash_factors": {"X1": 2.0}}
    async with on_stage(spec={"axes": GAPS}, driver=said) as stage:
        stage.bench.nck.set("$MA_BACKLASH_FACTOR[0,X1]", 2.0, 0)
        batch = tuple([await order_for(stage.device, one) for one in (table(), cross(0), NEW_REVERSAL)])
        wire_log.writes.clear()
        await pushed(stage, batch)
        assert stage.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.0012, abs=1e-9)
        machine = PaperMachine(("C1", "X1"), frozenset({"C1"}), numbers=wire_log.numbers(17))
        (one,) = preview_writes(batch, said, machine, ORIGIN, "grinder")
        assert read(one.text) == wire_log.changing
        assert "Axes by number (MD32452): 1 C1 (1), 4 X1 (2)" in one.text


@pytest.mark.parametrize(
    ("wanted", "said", "code", "line"),
    [
        (table(), {}, "E-MBX-NUMBERS", "axis_numbers = { C1 = 1, X1 = 4 }"),
        (cross(0), {"axis_numbers": {"X1": 3}}, "E-MBX-NUMBERS", "axis_numbers = { C1 = 1, X1 = 4 }"),
        (NEW_REVERSAL, {"axis_numbers": {"X1": 4}}, "E-MBX-FACTORS", "backlash_factors = { X1 = 2.0 }"),
    ],
)
async def test_a_push_that_would_send_what_was_not_printed_is_refused_and_the_way_back_is_not(
    wire_log: WireLog, wanted: CompensationTable, said: dict[str, Any], code: str, line: str
) -> None:
    async with on_stage(spec={"axes": GAPS}, driver=said) as stage:
        stage.bench.nck.set("$MA_BACKLASH_FACTOR[0,X1]", 2.0, 0)
        order = await order_for(stage.device, wanted)
        wire_log.writes.clear()
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.stage((order,))
        assert (caught.value.code, caught.value.fields["line"]) == (code, line)
        assert wire_log.changing == []
        await stage.device.stage((replace(order, purpose="restore"),))


def test_axes_that_nobody_has_numbered_are_not_printed() -> None:
    order = DisableOrder(18, "axis", "X1")
    unseen = replace(MACHINE, seen=False)
    with pytest.raises(ConfigError) as caught:
        preview_writes(order, HIGH, unseen, ORIGIN, "grinder")
    assert (caught.value.code, caught.value.fields["axes"]) == ("E-MBX-NOT-ASKED", "X1, C1")
    with pytest.raises(ConfigError, match=r"E-MBX-NOT-ASKED.*C1"):
        preview_writes(order, {"axis_numbers": {"X1": 2}}, MACHINE, ORIGIN, "grinder")
    with pytest.raises(ConfigError, match="a number of its own"):
        preview_writes(order, {"axis_numbers": {"X1": 2, "C1": 2}}, MACHINE, ORIGIN, "grinder")
    (one,) = preview_writes(order, {"axis_numbers": {"X1": 1, "C1": 4}}, unseen, ORIGIN, "grinder")
    assert "1 X1 (1), 4 C1 (1)" in one.text


async def test_an_order_to_switch_off_is_laid_down_as_it_is_printed(wire_log: WireLog) -> None:
    async with on_stage() as stage:
        await stage.push(await order_for(stage.device, table()))
        order = DisableOrder(18, "axis", "X1")
        wire_log.writes.clear()
        await stage.device.prepare_disable(order)
        await stage.pressed(stage.device.wait_disabled(order, 100.0))
        (header,) = [values for first, values in wire_log.changing if first == 16]
        assert read(printed(order, DayNumbers(commands=(header[1],)), HIGH)) == wire_log.changing


def test_what_moves_an_axis_is_not_on_this_road() -> None:
    plan = StopPlan("TF", "X1", "X", "mm", False, (Stop(0.0, 1),), 1.0, 0.0, 1.0)
    assert preview_writes(plan, HIGH, MACHINE, ORIGIN, "grinder") == ()
    assert NEW.kind == "axis"
