"""The constant reversal through the mailbox: with its proof, the control's factor, off, back; and a hostile control."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import TableError, TrueflankError
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis, numbers_of
from drivers.types.orders import DisableOrder, PushOrder, SwitchReading
from drivers.types.tables import CompensationTable, reversal_of
from gateway.domain.outcomes import PushRecord
from gateway.push import group_transactions, push_table, push_tables
from tests.contract.modbus_stage import Stage, on_stage, order_for, table
from tests.contract.test_push_modbus import change_of, people, proof_of
from tests.sizes import few

NEW = reversal_of("X1", "mm", -2.4)
MD = "$MA_BACKLASH[0,X1]"


async def pushed(on: Stage, root: Path, value: float = -2.4) -> PushRecord:
    live = await on.device.saved_tables("X1")
    async with people(on, root, await proof_of(on, "reversal"), None) as context:
        return await push_table(change_of(live, reversal_of("X1", "mm", value)), context)


def lead(on: Stage, way: int) -> float:
    """How far the encoder goes ahead of the machine part after travel this way, um: the control's own truth."""
    return 1000.0 * float(on.bench.nck.core._setpoints.take_up(0).total(way))


async def test_a_reversal_is_pushed_found_live_and_taken_for_applied(tmp_path: Path) -> None:
    async with on_stage() as on:
        record = await pushed(on, tmp_path)
        assert record.outcome == "committed", record.steps
        # An axis that stays 2.4 um behind when it comes from the other side: the encoder must lead by as much.
        assert on.get(MD) == pytest.approx(0.0024, abs=1e-9)
        assert lead(on, 1) - lead(on, -1) == pytest.approx(2.4, abs=1e-6)
        live = (await on.device.saved_tables("X1")).reversal
        assert (live.enabled, live.table.deviations) == (True, pytest.approx((-2.4,)))
        assert (await pushed(on, tmp_path)).outcome == "already-applied"


@pytest.mark.parametrize("factor", few([2.0, 0.5, 3.0], 1))
async def test_the_factor_of_the_control_is_no_part_of_the_reversal(tmp_path: Path, factor: float) -> None:
    async with on_stage(opened=False, driver={"backlash_factors": {"X1": factor}}) as on:
        on.bench.nck.set("$MA_BACKLASH_FACTOR[0,X1]", factor, 0)
        await on.device.open(5.0)
        assert (await pushed(on, tmp_path)).outcome == "committed"
        assert on.get(MD) == pytest.approx(0.0024 / factor, abs=1e-9)
        assert lead(on, 1) - lead(on, -1) == pytest.approx(2.4, abs=1e-3)
        live = await on.device.saved_tables("X1")
        assert live.reversal.table.deviations == pytest.approx((-2.4,), abs=1e-3)


async def test_a_factor_that_changed_since_the_axes_were_read_counts() -> None:
    async with on_stage(driver={"backlash_factors": {"X1": 2.0}}) as on:
        order = await order_for(on.device, NEW)
        on.bench.nck.set("$MA_BACKLASH_FACTOR[0,X1]", 2.0, 0)
        await on.push(order)
        assert on.get(MD) == pytest.approx(0.0012, abs=1e-9)


def test_a_factor_of_nothing_is_refused() -> None:
    with pytest.raises(TableError) as caught:
        numbers_of(NEW, (Decimal("0.0024"),), MailboxAxis(1, "X1", "mm", modulo=False, factor=Decimal(0)))
    assert caught.value.code == "E-MBX-FACTOR"


async def switched_on(on: Stage) -> PushOrder:
    order = await order_for(on.device, NEW)
    await on.push(order)
    return order


async def test_it_is_switched_off_alone_and_read_back(tmp_path: Path) -> None:
    async with on_stage() as on:
        await switched_on(on)
        off = DisableOrder(18, "reversal", "X1", 0)
        assert await on.device.switch_reading(off) == SwitchReading(True, 0.0)
        await on.device.prepare_disable(off)
        found = await on.device.wait_disabled(off, 100.0)
        assert (found.off, on.get(MD)) == (True, 0.0)


@pytest.mark.parametrize("before", few([0.004, 0.0], 1))
async def test_nobody_at_the_panel_leads_back(tmp_path: Path, before: float) -> None:
    async with on_stage() as on:
        on.bench.nck.set(MD, before, 0)
        async with people(on, tmp_path, await proof_of(on, "reversal"), None) as context:
            confirm, asked = on.device.confirm, [True]

            async def once(passed: Any, timeout_s: float) -> Any:
                if asked:
                    asked.clear()
                    return (False,)
                return await confirm(passed, timeout_s)

            on.device.confirm = once  # type: ignore[method-assign]
            live = await on.device.saved_tables("X1")
            record = await push_table(change_of(live, NEW), context)
        assert record.outcome == "rolled-back", record.steps
        assert on.get(MD) == pytest.approx(before, abs=1e-9)


HOSTILE: dict[str, tuple[dict[str, Any], str, float]] = {
    "another value is written": ({"other_backlash": 500}, "held", 0.0),
    "the machine data are locked": ({"write_level": 7}, "held-on", 0.004),
    "the activation is refused": ({"nck_refuses": 5}, "held", 0.0),
    "off is a lie": ({"lies_about_disable": True}, "held-on", 0.004),
}


@pytest.mark.parametrize("how", HOSTILE)
async def test_a_hostile_control_gets_no_reversal_that_nobody_stands_for(tmp_path: Path, how: str) -> None:
    hostile, ends, left = HOSTILE[how]
    async with on_stage(**hostile) as on:
        on.bench.nck.set(MD, 0.004, 0)
        told = await _ended(on, tmp_path)
        assert (told, round(float(on.get(MD)), 9)) == (ends, left)


async def _ended(on: Stage, root: Path) -> str:
    try:
        return (await pushed(on, root)).outcome
    except TrueflankError as error:
        return error.code


async def test_a_reversal_and_a_table_go_in_one_order_with_one_confirm() -> None:
    async with on_stage() as on:
        batch = tuple([await order_for(on.device, one) for one in (table(), NEW)])
        await on.device.stage(batch)
        found = await on.device.read_back(batch, 300.0)
        assert all(read.agreed for read in found)
        assert on.get(MD) == 0.0, "it is written when it is switched on"
        await on.device.activate(batch, batch)
        assert await on.pressed(on.device.confirm(batch, 100.0)) == (True, True)
        await on.device.restarted(batch, 100.0)
        await on.device.finish_push(batch, "committed")
        assert on.get(MD) == pytest.approx(0.0024, abs=1e-9)


async def test_without_its_proof_or_with_one_that_says_the_opposite_nothing_is_loaded() -> None:
    async with on_stage() as on:
        order = await order_for(on.device, NEW)
        for wrong in (None, replace(order.proof, sign=-1, slope=1.0)):
            with pytest.raises(TableError):
                await on.device.stage((replace(order, proof=wrong),))
        assert on.get(MD) == 0.0


async def test_the_gateway_hands_over_table_and_reversal_in_one_transaction(tmp_path: Path) -> None:
    async with on_stage() as on:
        live = await on.device.saved_tables("X1")
        async with people(on, tmp_path, await proof_of(on, "axis"), None) as context:
            turned = replace(context, proof=await proof_of(on, "reversal"))
            asked = [(change_of(live, table()), context), (change_of(live, NEW), turned)]
            (group,) = group_transactions(asked)
            records = await push_tables(group, lambda _changes: True)
        assert [one.outcome for one in records] == ["committed", "committed"], records
        now = await on.device.saved_tables("X1")
        assert (now.own.enabled, now.own.table.deviations) == (True, table().deviations)
        assert now.reversal.table.deviations == pytest.approx((-2.4,))


def halves() -> tuple[CompensationTable, CompensationTable]:
    """X over itself, 1.5 um more of a reversal at each 450 mm from the reference: half of it in each direction."""
    places = np.arange(-200.0, 701.0, 25.0)
    half = np.round(places / 300.0, 3)
    made = [
        CompensationTable(
            "cross", "X1", "X1", -200.0, 700.0, 25.0, tuple(map(float, way * half)), index=place, direction=way
        )
        for place, way in enumerate((1, -1))
    ]
    return made[0], made[1]


async def stood(on: Stage, place: float) -> tuple[float, float]:
    """Where the encoder of X stands at a place that it comes to from below, and from above, mm: the control's truth."""
    nck, found = on.bench.nck, list[float]()
    for way in (1.0, -1.0):
        for target in (place - 20.0 * way, place):
            await on.bench.clock.sleep(float(nck.core.move({nck.core.axis("X1").index: target}, None)) + 2.0)
        found.append(float(nck.encoder("X1", np.array([on.bench.clock.now()]))[0][0]))
    return found[0], found[1]


@pytest.mark.parametrize("sign", few([1, -1], 1))
async def test_a_pair_acts_each_half_in_its_direction_and_goes_by_one_order(tmp_path: Path, sign: int) -> None:
    """A reversal that varies with the position, by truth: what the encoder does from both sides at three places."""
    async with on_stage(spec={"cec_sign": sign}) as on:
        before = {place: await stood(on, place) for place in (-150.0, 0.0, 300.0, 600.0)}
        await stood(on, 0.0)
        live, pair = await on.device.saved_tables("X1"), halves()
        async with people(on, tmp_path, await proof_of(on, "cross", sign), None) as context:
            asked = [(change_of(live, one), context) for one in pair]
            (group,) = group_transactions(asked)
            records = await push_tables(group, lambda _changes: True)
        assert [one.outcome for one in records] == ["committed", "committed"], records
        assert records[0].transaction == records[1].transaction
        for place, (up, down) in before.items():
            now_up, now_down = await stood(on, place)
            # A table holds the deviation that it cancels: the axis goes as much less far where it comes from below.
            assert 1000.0 * (now_up - up) == pytest.approx(-place / 300.0, abs=0.01), place
            assert 1000.0 * (now_down - down) == pytest.approx(place / 300.0, abs=0.01), place
