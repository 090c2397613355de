"""Machine axes whose numbers leave some out: the map of axes tells them, and a push goes to the right one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.errors import DeviceRefused, UnsupportedDevice
from tests.contract.modbus_stage import AXES, on_stage, order_for, table

GAPS = (AXES[1], replace(AXES[0], number=4))


async def test_a_machine_with_gaps_is_served_by_its_numbers() -> None:
    async with on_stage(spec={"axes": GAPS}, driver={"axis_numbers": {"X1": 4}}) as stage:
        assert (await stage.device.identify()).axis_names == ("C1", "X1")
        await stage.push(await order_for(stage.device, table()))
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert not stage.get("$MA_ENC_COMP_ENABLE[0,C1]")
        assert stage.values(111) == pytest.approx([value / 1000.0 for value in table().deviations], abs=1e-9)


async def test_a_plc_that_shows_a_number_without_a_name_is_refused() -> None:
    async with on_stage(opened=False) as stage:
        shown = stage.plc._status._show_axis

        def nameless(image: object, target: object) -> None:
            shown(image, target)
            if target.axis == 2:  # type: ignore[attr-defined]
                image.put(332, [0] * 8)  # type: ignore[attr-defined]

        stage.plc._status._show_axis = nameless
        with pytest.raises(UnsupportedDevice) as caught:
            await stage.device.open(5.0)
        assert caught.value.code == "E-MBX-SILENT"


async def test_a_table_of_the_measuring_system_that_does_not_act_is_refused() -> None:
    async with on_stage() as stage:
        stage.bench.nck.core.axis("X1").active_encoder = 1
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.stage((await order_for(stage.device, table()),))
        assert (caught.value.code, caught.value.fields["encoder"]) == ("E-MBX-ENCODER", 1)
        assert stage.plc.session == 0
