"""A control of yours: at the machine by --trueflank-site, else on the simulated cell."""

import asyncio

import pytest


@pytest.mark.trueflank_allow("read")
def test_my_machine_is_in_automatic_and_without_alarms(trueflank_desk):
    async def main():
        async with trueflank_desk.bench() as at:
            return await at.supervisor.controller.state()

    state = asyncio.run(main())
    assert state.alarms == ()


def test_a_control_in_single_precision_is_told_from_a_good_one(trueflank_faults):
    async def main(cell):
        cell.nck.set("$AA_ENC_COMP[0,0,X1]", 0.123456789, 0)
        return cell.nck.get("$AA_ENC_COMP[0,0,X1]")

    assert trueflank_faults.in_memory(main, {"control.float32_tables": True}, "zero") != 0.123456789
