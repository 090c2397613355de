"""What a control or a hand did against a push, on both roads: it ends off, or told as still on; then home."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.table_status import held_pushes
from gateway.push.transaction import push_table
from tests.push.bench import Plan, Story, told
from tests.push.judging import ended
from tests.push.mischief import Moment
from tests.push.uaworld import UaWorld, ua_change, ua_context, ua_world
from tests.push.world import Scene, World

# ---- through the mailbox ----------------------------------------------------------------------------


def home(story: Story) -> None:
    """The recovery led back to the old table."""
    assert story.wrong == []
    assert "rolled-back" in story.recovered


@pytest.mark.parametrize("cross", [False, True], ids=["axis", "cross"])
def test_points_exchanged_at_the_activating_reset_end_off(tmp_path: Path, cross: bool) -> None:
    scene = Scene(strict=True, cross=cross, nck={"swaps_points_at_reset": 2})
    story = told(Plan(scene, mend=calm), tmp_path)
    assert (story.outcome, story.off) == ("held", True)
    assert story.said.index("P-PUSH-HELD-ON") < story.said.index("P-PUSH-HELD")
    assert "DISABLE" in story.asked
    home(story)


def calm(at: World) -> None:
    """The control is put right."""
    at.nck.core.spec = replace(at.nck.core.spec, swaps_points_at_reset=None)


def on_by_hand(at: World) -> None:
    """Somebody switches compensation on."""
    at.nck.enable_by_itself()


@pytest.mark.parametrize("command", ["VERIFY", "ACTIVATE"])
def test_a_hand_at_the_switch_in_mid_write_ends_off_or_back(tmp_path: Path, command: str) -> None:
    story = told(Plan(at=((Moment(1, command), on_by_hand),)), tmp_path)
    assert story.outcome in ("held", "rolled-back", "committed")
    assert story.off or story.as_before or story.as_wanted
    assert story.wrong == []


def test_without_the_release_it_is_told_as_still_on_until_somebody_gives_it(tmp_path: Path) -> None:
    def hand_and_key(at: World) -> None:
        at.nck.enable_by_itself()
        at.station.plc.withdraw_release()

    story = told(Plan(at=((Moment(2, "CHUNK"), hand_and_key), (Moment(1, "VERIFY"), hand_and_key))), tmp_path)
    assert (story.outcome, story.off) == ("held-on", False)
    assert "P-PUSH-HELD" not in story.said
    home(story)


# ---- with programs ----------------------------------------------------------------------------------


async def pushed(at: UaWorld, root: Path, **more: Any) -> tuple[str, list[str], Any]:
    """A push with a person at the control; how it ended, what was said, and its context."""
    device = at.driver()
    await device.open(5.0)
    base = await at.base(device)
    said: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        at.person.hear(code, fields)

    context = ua_context(device, at.clock, root, await device.identify(), say=say, start_timeout_s=30.0)
    outcome = await asyncio.ensure_future(ended(push_table(ua_change(base, at.new), context)))
    return outcome, said, context


async def recovered(root: Path, context: Any) -> list[tuple[str, str]]:
    """Every recovery until nothing is open."""
    steps = []
    while found := unfinished_tables(root / "journal", context.machine.serial):
        finding = await inspect_unfinished(found[0], context)
        steps.append((finding.code, (await recover_table(found[0], context)).outcome))
        assert len(steps) < 4
    return steps


def on_ua(root: Path, keys: Path, act: Any, **switches: Any) -> None:
    async def main() -> None:
        async with ua_world(LoopClock(), keys, **switches) as at:
            await act(at)

    run_virtual(main)


@pytest.mark.soak
def test_points_exchanged_at_the_activating_reset_end_off_by_a_program(tmp_path: Path, keys: Path) -> None:
    async def act(at: UaWorld) -> None:
        outcome, said, context = await pushed(at, tmp_path)
        assert (outcome, at.oracle.off) == ("held", True)
        assert said.index("P-PUSH-HELD-ON") < said.index("P-PUSH-DISABLE") < said.index("P-PUSH-HELD")
        assert not any(one.needs_attention for one in held_pushes(tmp_path / "journal"))
        at.nck.core.spec = replace(at.nck.core.spec, swaps_points_at_reset=None)
        await at.ready()
        assert await recovered(tmp_path, context) == [("R-PUSH-HALF", "rolled-back")]
        assert at.oracle.as_before
        await context.controller.close()

    on_ua(tmp_path, keys, act, swaps_points_at_reset=2)


def test_a_switch_that_comes_on_in_mid_write_is_switched_off_by_a_program(tmp_path: Path, keys: Path) -> None:
    async def act(at: UaWorld) -> None:
        at.nck.on_block = lambda _block: at.nck.enable_by_itself() if half(at) and not at.oracle.whims else None
        outcome, said, context = await pushed(at, tmp_path)
        assert at.oracle.whims == ["enable"]
        assert (outcome, at.oracle.off) == ("held", True)
        assert "P-PUSH-DISABLE" in said
        assert await recovered(tmp_path, context) == [("R-PUSH-HALF", "rolled-back")]
        assert at.oracle.as_before
        await context.controller.close()

    on_ua(tmp_path, keys, act)


def half(at: UaWorld) -> bool:
    """Whether a table is half written."""
    return not at.oracle.is_old() and not at.oracle.is_new()


def test_nobody_at_the_panel_is_told_as_still_on_and_recovery_switches_off(tmp_path: Path, keys: Path) -> None:
    async def act(at: UaWorld) -> None:
        at.person.restarts = False
        at.spawn(late_reset(at))
        outcome, said, context = await pushed(at, tmp_path)
        assert (outcome, at.oracle.switched_on) == ("held-on", True)
        assert [one.needs_attention for one in held_pushes(tmp_path / "journal")] == [True]
        assert "P-PUSH-HELD" not in said
        at.person.starts = at.person.restarts = True
        at.nck.core.spec = replace(at.nck.core.spec, swaps_points_at_reset=None)
        await at.ready()
        steps = await recovered(tmp_path, context)
        assert steps == [("R-PUSH-STILL-ON", "held"), ("R-PUSH-HALF", "rolled-back")]
        assert at.oracle.as_before
        await context.controller.close()

    on_ua(tmp_path, keys, act, swaps_points_at_reset=2)


def test_a_program_that_nobody_started_has_changed_nothing_and_cannot_any_more(tmp_path: Path, keys: Path) -> None:
    async def act(at: UaWorld) -> None:
        at.person.leaves_at = "P-PUSH-START"
        outcome, said, context = await pushed(at, tmp_path)
        assert (outcome, at.oracle.as_before) == ("untouched", True)
        assert "P-PUSH-HELD-ON" not in said
        assert unfinished_tables(tmp_path / "journal", context.machine.serial) == ()
        assert (await context.controller.marker()).state == "none"
        at.nck.nc_start()  # somebody presses start later: the program leaves before it saves or switches anything
        await at.clock.sleep(5.0)
        assert (at.nck.channel_status, at.oracle.as_before, at.oracle.whims) == (0, True, [])
        await context.controller.close()

    on_ua(tmp_path, keys, act)


def test_a_program_that_was_started_is_never_taken_for_one_that_was_not(tmp_path: Path, keys: Path) -> None:
    async def act(at: UaWorld) -> None:
        at.nck.on_block = lambda _block: setattr(at.person, "starts", False)
        at.spawn(reset_at_backup(at))
        outcome, _said, context = await pushed(at, tmp_path)
        assert outcome != "untouched"
        at.person.starts = at.person.restarts = True
        await at.ready()
        await recovered(tmp_path, context)
        assert at.oracle.as_before
        await context.controller.close()

    on_ua(tmp_path, keys, act)


async def reset_at_backup(at: UaWorld) -> None:
    """RESET at the panel while the push program is at its first blocks."""
    while at.person.starts:
        await at.clock.sleep(0.05)
    at.nck.channel_reset()


async def late_reset(at: UaWorld) -> None:
    """The activating reset, and then everybody goes home."""
    while not at.nck.message.startswith("TRUEFLANK ACTIVATE"):
        await at.clock.sleep(0.5)
    at.person.starts = False
    await at.restart()
