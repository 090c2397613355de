"""A live table whose step does not divide its range is backed up by a program, replaced, and put back as it was."""

from __future__ import annotations

from dataclasses import replace

from tests.contract.opcua_stage import ORDER, on_stage

POINTS = {0: 0.0, 1: 0.0005, 2: -0.0002, 3: 0.0003}


async def test_a_step_that_does_not_divide_goes_out_and_back_by_programs() -> None:
    async with on_stage() as on:
        for part, value in (("STEP", 100.0), ("MIN", 0.0), ("MAX", 360.0), ("IS_MODULO", False)):
            on.nck.set(f"$AA_ENC_COMP_{part}[0,C1]", value, 2)
        for point, value in POINTS.items():
            on.nck.set(f"$AA_ENC_COMP[0,{point},C1]", value, 2)
        before = on.memory()
        old, _ = await on.loaded(ORDER)
        assert len(old.own.table.deviations) == 4  # k = 3: assumed, floor(360 / 100)
        assert (old.own.table.step, old.own.table.maximum) == (100.0, 360.0)
        await on.device.activate((ORDER,), (ORDER,))
        assert await on.device.confirm((ORDER,), 120.0) == (True,)
        await on.device.restarted((ORDER,), 120.0)
        assert on.memory() != before
        back = replace(ORDER, transaction=4712, table=old.own.table, purpose="restore", enable=False)
        await on.loaded(back)
        assert on.memory()[:-1] == before[:-1]
        assert not on.enabled
