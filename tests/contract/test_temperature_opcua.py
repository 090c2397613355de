"""Temperature compensation read beside the tables: as much as acts, and a push over a change of it is refused."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.sinumerik.tablefile.axis_settings import acting_temperature, temperature_of
from drivers.types.tables import TemperatureShift
from gateway.push import push_table
from tests.push.uaworld import ua_change, ua_context, ua_world
from tests.sizes import few
from tests.steps import lines

DATA = {"$SA_TEMP_COMP_ABS_VALUE": 0.004, "$SA_TEMP_COMP_SLOPE": 0.00002, "$SA_TEMP_COMP_REF_POSITION": 10.0}
KINDS = {
    0: TemperatureShift(),
    1: TemperatureShift(0.004),
    2: TemperatureShift(0.0, 0.00002, 10.0),
    3: TemperatureShift(0.004, 0.00002, 10.0),
}


def warm(nck: Any, kind: int, **data: float) -> None:
    """Temperature compensation as the PLC or a person leaves it."""
    for name, value in {**DATA, **data}.items():
        nck.set(f"{name}[X1]", value, 0)
    nck.set("$MA_TEMP_COMP_TYPE[X1]", kind, 0)
    nck.core.newconf()


@pytest.mark.parametrize("kind", few((3, 0, 1, 2), keep=2))
def test_what_acts_is_read_with_the_tables(keys: Path, kind: int) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            warm(at.nck, kind)
            device = at.driver()
            await device.open(5.0)
            try:
                live = await at.base(device)
                place = (await device.state()).axes["X1"].position
            finally:
                await device.close()
            assert live.temperature == KINDS[kind]
            # The double moves the axis by what its own room makes of the manual.
            value = float(at.nck.get("$VA_TEMP_COMP_VAL[X1]"))
            assert abs(value) == pytest.approx(abs(KINDS[kind].at(place)), abs=1e-5)

    run_virtual(job)


def test_a_steep_line_acts_as_far_as_the_control_lets_it() -> None:
    names = {"$MA_TEMP_COMP_TYPE[X1]": "2", "$MA_COMP_ADD_VELO_FACTOR[X1]": "0.01", "$SA_TEMP_COMP_SLOPE[X1]": "-0.5"}
    found = temperature_of({name: Decimal(value) for name, value in names.items()}, "X1")
    assert acting_temperature(found) == TemperatureShift(0.0, -0.01, 0.0)
    assert acting_temperature(None) == TemperatureShift()


def test_a_push_over_a_change_of_it_is_refused_with_nothing_written(keys: Path, tmp_path: Path) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            warm(at.nck, 1)
            device = at.driver()
            await device.open(5.0)
            try:
                base = await at.base(device)
                machine = await device.identify()
                at.nck.set("$SA_TEMP_COMP_ABS_VALUE[X1]", 0.009, 0)
                await clock.sleep(5.0)
                before = at.nck.static_memory()["tables"]
                record = await push_table(ua_change(base, at.new), ua_context(device, clock, tmp_path, machine))
                assert record.outcome == "refused"
                assert [step.partition(":")[0] for step in lines(record) if step.startswith("E-")] == [
                    "E-INT-TEMPERATURE-MOVED"
                ]
                assert "5.0" in lines(record)[-1]
                assert at.nck.static_memory()["tables"] == before
                again = replace(ua_change(base, at.new), base=replace(base, temperature=TemperatureShift(0.009)))
                done = await push_table(again, ua_context(device, clock, tmp_path, machine))
                assert done.outcome == "committed"
            finally:
                await device.close()

    run_virtual(job)
