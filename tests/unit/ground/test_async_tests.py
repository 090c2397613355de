"""One hook runs tests that are `async def`: in virtual time, on a real loop where asked, and nothing is left alive."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.clock import LoopClock, VirtualTimeLoop

DAY_S = 86400.0


async def test_time_is_virtual_and_fixtures_are_given(tmp_path: Path) -> None:
    clock = LoopClock()
    before = clock.now()
    await clock.sleep(DAY_S)
    assert clock.now() - before >= DAY_S
    assert isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
    assert tmp_path.is_absolute()


@pytest.mark.wall_time
async def test_a_real_loop_where_it_is_asked_for() -> None:
    assert not isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
    await LoopClock().sleep(0.001)


@pytest.mark.parametrize("number", [1, 2])
async def test_parameters_are_given(number: int) -> None:
    assert number in (1, 2)


@pytest.mark.xfail(strict=True, raises=ZeroDivisionError)
async def test_what_a_test_raises_fails_it() -> None:
    await LoopClock().sleep(1.0)
    raise ZeroDivisionError


@pytest.mark.xfail(strict=True, raises=AssertionError)
async def test_a_task_left_behind_fails_it(request: pytest.FixtureRequest) -> None:
    request.node.left = asyncio.get_running_loop().create_task(LoopClock().sleep(DAY_S))
    await LoopClock().sleep(1.0)
