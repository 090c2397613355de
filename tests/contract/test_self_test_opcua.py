"""The self-test through OPC UA: whatever stops it is told as the word it stopped at, and nothing that acts changes."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeviceRefused
from drivers.programs import SelfTest, SelfTested, SelfTests
from drivers.sinumerik.ncprogram.selftest import LOOPS
from drivers.types.machine import ChannelStatus
from drivers.types.stops import Stop
from tests.contract.opcua_stage import SPEC, Stage, on_stage, plan

C1 = SelfTest("C1")
Act = Callable[[Stage], Awaitable[None]]


async def at_message(on: Stage) -> None:
    """Press NC START and wait until the program stands at its message."""
    on.press()
    while not on.nck.message:
        await on.clock.sleep(0.2)


async def pressed_on(on: Stage) -> None:
    await at_message(on)
    on.nck.nc_start()


async def reset(on: Stage) -> None:
    await at_message(on)
    on.nck.channel_reset()


async def key_taken(on: Stage) -> None:
    on.nck.core.access_level = 7
    await pressed_on(on)


async def short_files(on: Stage) -> None:
    on.nck.set("$MN_LEN_PROTOCOL_FILE", 1, 0)
    on.press()


def outcome(person: Act, **switches: object) -> SelfTested:
    """What the driver says of one run of it at which somebody does this."""
    found: list[Any] = []

    async def act(on: Stage) -> None:
        device: Any = on.device
        assert isinstance(device, SelfTests)
        before = on.nck.static_memory()
        await device.prepare_self_test(C1)
        works = asyncio.ensure_future(person(on))
        test = await device.wait_self_test(C1, 120.0)
        await works
        after = on.nck.static_memory()
        assert test.machine == await device.identify()
        if person is not short_files:
            assert (before["tables"], before["data"]) == (after["tables"], after["data"])
        if (await device.state()).channel is ChannelStatus.INTERRUPTED:
            on.nck.channel_reset()
        found.append(test)

    async def main() -> None:
        async with on_stage(replace(SPEC, **switches)) as on:
            await act(on)

    run_virtual(main)
    test: SelfTested = found[0]
    return test


def test_a_control_that_knows_every_word() -> None:
    test = outcome(pressed_on)
    assert (test.ok, test.missed, test.stopped) == (True, "", "")
    assert test.passed[-1] == "MSG AND M0"
    assert test.without == ()


def test_a_control_that_takes_no_lists_passes_and_gets_programs_without_them() -> None:
    """The alarm at the word that programs can do without costs nothing; any other word still must be passed."""
    test = outcome(pressed_on, fills_arrays=False)
    assert (test.ok, test.missed, test.stopped) == (True, "", "")
    assert test.passed[-1] == "MSG AND M0"
    assert test.without == (LOOPS,)


async def test_programs_do_without_what_the_self_test_found(keys: Path) -> None:
    """At a control that takes no lists: with its self-test known a plan is visited, without it an alarm stops it."""
    stops = plan((Stop(0.0, 1), Stop(30.0, 1, 0, 1), Stop(10.0, -1, 0, 2)))
    async with on_stage(replace(SPEC, fills_arrays=False), folder=keys) as on:
        on.device.do_without((LOOPS,))
        await on.device.prepare_stops(stops)
        on.press()
        for count in range(1, 4):
            stop = await on.device.wait_stop(count - 1, 60.0)
            assert stop.target == stops.stops[count - 1].target
            await on.device.release_stop(count)
        assert await on.device.wait_stop(3, 60.0) is None
        on.device.do_without(())
        await on.device.prepare_stops(stops)
        on.press()
        with pytest.raises(DeviceRefused, match="12550"):
            await on.device.wait_stop(0, 60.0)


def test_reset_at_its_message_is_no_pass() -> None:
    test = outcome(reset)
    assert (test.ok, test.failed) == (False, ("MSG AND M0",))
    assert test.stopped.startswith("E-NC-SELF-STOPPED")


def test_a_write_that_is_ignored_with_an_alarm_is_no_pass() -> None:
    test = outcome(key_taken)
    assert (test.ok, test.failed) == (False, ())
    assert "4075" in test.stopped


def test_files_too_short_are_named_as_such() -> None:
    test = outcome(short_files)
    assert not test.ok
    assert "MD11420" in test.missed
