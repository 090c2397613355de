"""Machine axes whose numbers leave some out: the mailbox's map version 2 cannot tell them, and the driver says so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.errors import UnsupportedDevice
from tests.contract.modbus_stage import AXES, on_stage

GAPS = (AXES[0], replace(AXES[1], number=4))


async def test_a_machine_with_gaps_is_refused_by_its_numbers() -> None:
    async with on_stage(opened=False, spec={"axes": GAPS}) as stage:
        with pytest.raises(UnsupportedDevice) as caught:
            await stage.device.open(5.0)
        assert caught.value.code == "E-MBX-GAPS"
        assert caught.value.fields == {"numbers": "2, 3", "count": 4}
        assert "number 2, 3 has no name (MD10000)" in caught.value.what
        assert stage.plc.session == 0


async def test_a_plc_that_shows_a_number_without_a_name_is_refused_alike() -> None:
    async with on_stage(opened=False) as stage:
        shown = stage.plc._picture._show_axis

        def nameless(image: object, target: object) -> None:
            shown(image, target)
            if target.axis == 2:  # type: ignore[attr-defined]
                image.put(332, [0] * 8)  # type: ignore[attr-defined]

        stage.plc._picture._show_axis = nameless
        with pytest.raises(UnsupportedDevice) as caught:
            await stage.device.open(5.0)
        assert (caught.value.code, caught.value.fields["numbers"]) == ("E-MBX-GAPS", "2")
