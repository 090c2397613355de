"""A machine whose second measuring system acts, with few points: the site file must name it, and a push goes there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.errors import UnsupportedDevice
from drivers.types.stops import Stop
from drivers.types.tables import CompensationTable
from tests.contract.opcua_stage import AXES, ORDER, SPEC, on_stage, plan

X, Z, C = AXES
SCALES = replace(SPEC, axes=(X, replace(Z, number=4), replace(C, eec_points=(0, 25), number=13)), cec_points=())
VALUES = (0.0, *(0.4 * ((n * 5) % 7 - 3) for n in range(1, 24)), 0.0)
TABLE = CompensationTable(
    "axis", "C1", "C1", 0.0, 360.0, 15.0, VALUES, modulo=True, index=1, input_unit="deg", output_unit="deg"
)


async def test_only_the_acting_measuring_system_is_written() -> None:
    async with on_stage(spec=SCALES, server={"null_strings": True}) as on:
        with pytest.raises(UnsupportedDevice, match="E-NC-ENCODER") as caught:
            await on.device.stage((ORDER,))
        assert "the control uses index 1" in caught.value.what
        with pytest.raises(UnsupportedDevice, match="E-NC-ENCODER"):
            await on.device.prepare_stops(plan((Stop(10.0, 1),)))
        order = replace(ORDER, table=TABLE)
        assert await on.push(order)
        assert on.nck.get("$MA_ENC_COMP_ENABLE[1,C1]")
        assert not on.nck.get("$MA_ENC_COMP_ENABLE[0,C1]")
        seen = await on.walk(plan((Stop(10.0, 1),), encoder=1))
        assert [stop.target for stop in seen] == [10.0]
        live = await on.device.saved_tables("C1")
        assert (live.own.enabled, live.own.table.index, len(live.own.table.deviations)) == (True, 1, 25)


async def test_two_that_act_are_refused() -> None:
    async with on_stage() as on:
        for encoder in (0, 1):
            on.nck.set(f"$MA_ENC_COMP_ENABLE[{encoder},X1]", True, 2)
        with pytest.raises(UnsupportedDevice, match="E-NC-ENCODERS"):
            await on.device.prepare_stops(plan((Stop(10.0, 1),), axis="X1", letter="X", unit="mm", rotary=False))
