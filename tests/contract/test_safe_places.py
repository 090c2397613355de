"""Safe places on the control's double: what is said before the press, and what a program does when an axis has left."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceRefused, words
from drivers.message import joined
from drivers.types.moves import SafePlaces
from drivers.types.stops import Stop
from gateway.moves import Patience, walk_plan
from gateway.push import push_table
from tests.contract.opcua_stage import Stage, on_stage, plan
from tests.contract.test_push_opcua import SPEC, WAVE, change_of, context_for, live_of, proof
from tests.sizes import few
from tests.steps import lines

PLACES = SafePlaces({"X1": (-100.0, 100.0), "Z1": (0.0, 450.0), "C1": (0.0, 360.0)}, feed_mm=6000.0)


class Told(list[tuple[str, dict[str, Any]]]):
    """What was said, in order."""

    def __call__(self, code: str, /, **fields: object) -> None:
        self.append((code, dict(fields)))

    def before(self, code: str) -> list[tuple[str, dict[str, Any]]]:
        """All that was said from the last press on, up to the first of this code."""
        place = [one for one, _ in self].index(code)
        return self[:place]


@contextlib.asynccontextmanager
async def operator(on: Stage, *, leaves: str = "", at: float = 0.0) -> AsyncIterator[None]:
    """Starts what is selected; the first program of a push only after having jogged an axis away."""
    selected: list[str] = []
    select = on.nck.select

    def noticing(path: str, channel: int = 1) -> int:
        selected.append(path)
        return select(path, channel)

    async def work() -> None:
        gone = not leaves
        while True:
            await on.clock.sleep(0.3)
            if not selected or on.nck.channel_status != 0:
                continue
            path = selected.pop()
            selected.clear()
            if not gone and "TFPUSH" in path:
                assert on.nck.set_mode("JOG")
                await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis(leaves).index: at}, None)) + 0.5)
                assert on.nck.set_mode("AUTO")
                gone = True
            on.nck.nc_start()

    on.nck.select = noticing  # type: ignore[method-assign]
    task = asyncio.get_running_loop().create_task(work())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        on.nck.select = select  # type: ignore[method-assign]


def stands(on: Stage, axis: str) -> float:
    return float(on.nck.axis_state(axis).set_position)


@pytest.mark.parametrize(("axis", "at"), few([("C1", 0.0), ("X1", 180.0), ("Z1", 500.0)]))
async def test_a_push_ends_before_its_first_move_when_an_axis_left_its_place(
    keys: Path, tmp_path: Path, axis: str, at: float
) -> None:
    places = replace(PLACES, ranges=PLACES.ranges | ({"C1": (10.0, 350.0)} if axis == "C1" else {}))
    async with on_stage(SPEC, folder=keys) as on:
        if axis == "C1":
            await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("C1").index: 90.0}, None)) + 0.5)
        base, told = await live_of(on, tmp_path), Told()
        context = replace(await context_for(on, tmp_path, proof(on, 1)), say=told)
        on.device.keep_to(places)
        before = stands(on, "Z1")
        async with operator(on, leaves=axis, at=at):
            record = await push_table(change_of(base, WAVE, 1), context)
        assert record.outcome == "rolled-back"
        assert any("E-NC-AWAY" in step and axis in step for step in lines(record)), record.steps
        assert stands(on, axis) == pytest.approx(at)
        assert axis == "Z1" or stands(on, "Z1") == before
        assert not on.nck.get("$MA_CEC_ENABLE[X1]")


async def test_each_press_of_a_push_is_said_with_what_moves_and_who_stands_where(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        base, told = await live_of(on, tmp_path), Told()
        context = replace(await context_for(on, tmp_path, proof(on, 1)), say=told)
        on.device.keep_to(PLACES)
        await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("Z1").index: 40.0}, None)) + 0.5)
        async with operator(on):
            task = asyncio.get_running_loop().create_task(push_table(change_of(base, WAVE, 1), context))
            while not on.nck.message.startswith("TRUEFLANK LOADED"):
                await on.clock.sleep(0.2)
            assert stands(on, "Z1") == 0.0
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
    said = told.before("P-PUSH-START")
    assert "it moves no axis" in words("P-NC-READ", axis="X1")
    goes = next(fields for code, fields in said if code == "P-MOVE-TO")
    assert {key: str(one).strip() if isinstance(one, str) else one.value for key, one in goes.items()} == {
        "axis": "Z1", "unit": "mm", "start": 40.0, "end": 0.0, "feed": 6000.0,
    }  # fmt: skip
    others = [joined(fields["others"]) for code, fields in said if code == "P-MOVE-OTHERS"][-1]
    assert re.findall(r"\b[A-Z]1 at", others) == ["C1 at", "X1 at"]
    assert "in its safe place (-100 to 100)" in others
    off = next(fields for code, fields in said if code == "P-MOVE-OFF-STILL")
    assert "moves no axis" in words("P-MOVE-OFF-STILL", **off)
    assert "P-MOVE-SWITCH-OFF" not in dict(said)
    on_again = next(fields for code, fields in said if code == "P-MOVE-ON-STILL")
    assert on_again == off == {"tables": change_of(base, WAVE, 1).name}


async def test_no_push_without_a_safe_place_for_every_axis_and_none_from_outside(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        base, told = await live_of(on, tmp_path), Told()
        context = replace(await context_for(on, tmp_path, proof(on, 1)), say=told)
        on.device.keep_to(replace(PLACES, ranges={"Z1": (0.0, 450.0), "X1": (50.0, 100.0)}))
        record = await push_table(change_of(base, WAVE, 1), context)
    assert record.outcome == "refused"
    assert [step for step in lines(record) if "E-INT-NO-PLACE" in step and "C1" in step]
    assert [step for step in lines(record) if "E-INT-OUTSIDE" in step and "X1" in step]


async def test_a_measuring_program_is_said_and_ends_when_a_parked_axis_left_its_place(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        on.device.keep_to(PLACES)
        stops = (Stop(0.0, 1), Stop(50.0, 1))
        wanted = plan(stops, axis="Z1", letter="Z", unit="mm", rotary=False, output_axis="X1")

        async def nothing(*_given: object) -> None:
            return None

        async def leave() -> None:
            while not told or told[-1][0] != "P-START":
                await on.clock.sleep(0.1)
            assert on.nck.set_mode("JOG")
            await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("X1").index: 150.0}, None)) + 0.5)
            assert on.nck.set_mode("AUTO")
            on.nck.nc_start()

        task = asyncio.get_running_loop().create_task(leave())
        before = stands(on, "Z1")
        with pytest.raises(DeviceRefused, match="E-NC-AWAY"):
            await walk_plan(on.device, wanted, nothing, Patience(100.0, 100.0), told)
        await task
        assert stands(on, "Z1") == before
    between = next(fields for code, fields in told if code == "P-MOVE-BETWEEN")
    assert (between["axis"], between["high"].value, between["end"].value) == ("Z1", 50.0, 50.0)
