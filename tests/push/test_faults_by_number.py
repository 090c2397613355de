"""Faults of control and machine 89-108, and those of a read-back 63-64, by number, in a whole push through a wire.

`FAULTS` says which test shows each of the faults 46-108; those of session, values and wire stand in the rooms of the
two drivers.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.push import PushContext, push_table
from simulators.nck import AxisSpec
from tests.push import world as worlds
from tests.push.bench import ALL_COMMANDS, Moment, Plan, Scene, Story, told
from tests.push.judging import Played, ended, judge
from tests.push.uaworld import UaWorld, ua_change, ua_context, ua_world
from tests.push.world import World, long
from tests.sizes import few

UA = "tests/contract/test_opcua_faults.py"
TRUST = "tests/contract/test_opcua_trust.py"
MAILBOX = "tests/unit/mailbox/test_faults.py"
HERE = "tests/push/test_faults_by_number.py"
FAULTS: dict[int, tuple[str, str]] = {
    **{number: (UA, f"test_fault_{number}_") for number in (46, 47, 50, 51, 52, 53, 54, 58, 59, 60, 61, 62)},
    **dict.fromkeys((48, 49), (UA, "test_fault_48_49_")),
    **{number: (UA, f"test_fault_{number}_") for number in (65, 66, 67, 68)},
    **{number: (TRUST, f"test_fault_{number}_") for number in (55, 56, 57)},
    **{number: (MAILBOX, f"test_fault_{number}_") for number in range(69, 89)},
    **{number: (HERE, f"test_fault_{number}_") for number in (63, 64, *range(89, 105), 106, 107, 108)},
    105: ("tests/contract/test_push_opcua.py", "test_a_mismatch_leads_back_and_the_neighbour_works_again"),
}
NOT_THERE = ("rolled-back", "held", "held-on")
TRANSFER = ("DISABLE", "BEGIN", "CHUNK", "VERIFY", "ACTIVATE")


def test_every_number_has_its_tests() -> None:
    assert set(FAULTS) == set(range(46, 109))
    root = Path(__file__).parents[2]
    for number, (path, start) in FAULTS.items():
        tree = ast.parse((root / path).read_text(encoding="utf-8"))
        names = [node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        assert [name for name in names if name.startswith(start)], f"fault {number}: {path} has no {start}..."


def sound(story: Story) -> Story:
    assert story.wrong == []
    return story


def at(command: str, deed: Any, **more: Any) -> Plan:
    return Plan(at=((Moment(1, command), deed),), **more)


# ---- what was written is not what is there ----------------------------------------------------------


def test_fault_63_single_precision_is_the_same_and_anything_coarser_is_not(tmp_path: Path) -> None:
    fine = sound(told(Plan(Scene(plc={"float32_values": True})), tmp_path / "fine"))
    assert fine.outcome == "committed"
    coarse = sound(told(Plan(Scene(plc={"quantum_points": 500})), tmp_path / "coarse"))
    assert coarse.outcome in NOT_THERE
    assert any("E-MBX-READBACK" in step or "E-MBX-MISMATCH" in step for step in coarse.steps)


@pytest.mark.parametrize("command", ["VERIFY", "ACTIVATE"])
def test_fault_64_a_value_overwritten_after_it_was_read_back_is_never_committed(tmp_path: Path, command: str) -> None:
    def hand(here: World) -> None:
        if not here.oracle.switched_on:
            here.oracle.foreign = True
            here.nck.set("$AA_ENC_COMP[0,3,X1]", 0.0123, 0)

    story = told(Plan(at=((Moment(1, command), lambda here: here.spawn(_later(here, hand))),)), tmp_path)
    assert story.outcome in NOT_THERE
    assert not story.as_wanted
    assert story.wrong == []


async def _later(here: World, hand: Any) -> None:
    """Just after the command has done its work."""
    await here.clock.sleep(0.05)
    hand(here)


# ---- the machine does something of its own ----------------------------------------------------------


@pytest.mark.parametrize("command", few(ALL_COMMANDS, 2))
def test_fault_89_a_mode_changed_at_any_command_never_leaves_half_a_table_on(tmp_path: Path, command: str) -> None:
    def mda(here: World) -> None:
        here.nck.channel_reset()
        here.nck.set_mode("MDA")

    plan = at(command, mda, mend=lambda here: here.nck.set_mode("AUTO"))
    story = sound(told(plan, tmp_path))
    # Once the panel is asked all has been proved, and the mailbox does not tell the mode.
    assert story.outcome in NOT_THERE or (command == "ACTIVATE" and story.as_wanted)
    assert story.as_before or story.off or story.as_wanted


@pytest.mark.parametrize("block", few([84, 30, 88, 120, 200]))
def test_fault_89_a_mode_changed_at_a_block_of_the_program(tmp_path: Path, keys: Path, block: int) -> None:
    found = _at_block(tmp_path, keys, block, lambda here: here.nck.change_mode_by_hand())
    assert found.wrong == []
    assert found.outcome in NOT_THERE


def _at_block(root: Path, keys: Path, block: int, deed: Any, **switches: Any) -> Played:
    """A push over OPC UA with something happening at a block of its own program."""
    found = Played(block)

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys, **switches) as here:
            await _push_over_opcua(here, root, block, deed, found)

    run_virtual(main)
    return found


async def _push_over_opcua(here: UaWorld, root: Path, block: int, deed: Any, found: Played) -> None:
    device = here.driver()
    await device.open(5.0)
    base = await here.base(device)
    here.oracle.writes = 0
    said: list[str] = []
    count = [0]

    def done(_block: int) -> None:
        count[0] += "PUSH" in here.nck.selected
        if count[0] == block and "PUSH" in here.nck.selected:
            here.nck.on_block = None
            deed(here)

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        here.person.hear(code, fields)

    here.nck.on_block = done
    machine = await device.identify()
    context = ua_context(device, here.clock, root, machine, say=say, start_timeout_s=25.0)
    found.outcome = await ended(push_table(ua_change(base, here.new), context))
    await device.close()
    judge(here.oracle, found, said, context)


@pytest.mark.parametrize("command", few(TRANSFER, 2))
def test_fault_90_an_axis_that_sets_off_stops_the_push(tmp_path: Path, command: str) -> None:
    def sets_off(here: World) -> None:
        here.nck.set_mode("JOG")
        here.nck.core.move({0: 70.0}, 300.0)

    story = sound(told(at(command, sets_off), tmp_path))
    assert story.outcome in NOT_THERE or (command == "ACTIVATE" and story.outcome == "committed")
    assert story.as_before or story.off or story.as_wanted


@pytest.mark.parametrize("command", few(TRANSFER, 2))
def test_fault_90_a_program_that_is_started_stops_the_push(tmp_path: Path, command: str) -> None:
    def starts(here: World) -> None:
        here.nck.files.write("/_N_MPF_DIR/_N_OTHER_MPF", b"G4 F6\nM30\n")
        here.nck.select("/_N_MPF_DIR/_N_OTHER_MPF")
        here.nck.nc_start()

    story = sound(told(at(command, starts), tmp_path))
    assert story.outcome in NOT_THERE
    assert story.as_before or story.off


@pytest.mark.parametrize("strict", [False, True], ids=["at once", "after reset"])
@pytest.mark.parametrize("command", few(ALL_COMMANDS, 2))
def test_fault_91_an_nck_reset_at_any_command(tmp_path: Path, command: str, strict: bool) -> None:
    story = sound(told(at(command, lambda here: here.nck.nck_reset(), scene=Scene(strict=strict)), tmp_path))
    assert story.outcome in (*NOT_THERE, "raised E-MBX-TIME") or story.outcome.startswith("raised")
    assert story.as_before or story.off


@pytest.mark.parametrize("strict", [False, True], ids=["at once", "after reset"])
@pytest.mark.parametrize("points", few((5, 11, 1, 10, 2, 3, 4, 6, 7, 8, 9), 2))
def test_fault_92_the_mains_cut_at_each_point_never_let_half_a_table_act(
    tmp_path: Path, points: int, strict: bool
) -> None:
    story = sound(told(Plan(Scene(strict=strict, plc={"power_cut_after": points})), tmp_path))
    assert story.outcome in NOT_THERE
    assert "P-PUSH-RESTART" in story.said or not 1 < points < 10, "the control may act by half a table after its start"
    assert story.as_before or story.off


def test_fault_93_a_plc_that_lies_about_its_switch_writes_nothing(tmp_path: Path) -> None:
    story = sound(told(Plan(Scene(plc={"lies_about_disable": True}), recover=False), tmp_path))
    assert story.outcome in NOT_THERE
    assert story.as_before


def test_fault_93_a_control_that_lies_about_its_switch_never_acts_by_half_a_table(tmp_path: Path, keys: Path) -> None:
    """Where the table is zero nobody can see whether it acts; what acts is the old table until it is the new one."""
    found = _at_block(tmp_path, keys, -1, None, lies_about_disable=True)
    assert found.wrong == []
    assert found.outcome in ("committed", *NOT_THERE)


# ---- what the machine is and has --------------------------------------------------------------------


def test_fault_94_too_little_table_memory_is_refused_and_never_enlarged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(worlds.X_SPEC, eec_points=(10, 0))
    assert isinstance(small, AxisSpec)
    monkeypatch.setattr(worlds, "X_SPEC", small)
    monkeypatch.setattr(worlds, "POINTS", 10)
    monkeypatch.setattr(worlds, "OLD", long(10, 0.5))
    story = sound(told(Plan(), tmp_path))
    assert story.outcome == "refused"
    assert (story.writes, story.asked.get("BEGIN", 0)) == (0, 0)


@pytest.mark.parametrize("command", few(ALL_COMMANDS, 2))
def test_fault_95_the_key_turned_back_at_any_command(tmp_path: Path, command: str) -> None:
    plan = at(command, lambda here: here.station.plc.withdraw_release(), mend=lambda here: here.nck.set_access_level(2))
    story = sound(told(plan, tmp_path))
    assert story.outcome in NOT_THERE
    assert story.as_before or story.off


def test_fault_95_without_the_key_nothing_is_asked(tmp_path: Path) -> None:
    story = sound(told(Plan(first=lambda here: here.nck.set_access_level(7)), tmp_path))
    assert (story.outcome, story.asked) == ("refused", {})


def other_points(here: World) -> None:
    """Somebody else has loaded a table of his own."""
    held = here.nck.core.memory.eec[0, 0]
    held.points = [*held.points[:4], 0.0033, *held.points[5:]]
    here.oracle.foreign = True


def test_fault_96_a_table_changed_since_it_was_measured_is_left_alone(tmp_path: Path) -> None:
    story = sound(told(Plan(first=other_points, recover=False), tmp_path))
    assert (story.outcome, story.writes, story.asked) == ("refused", 0, {})


@pytest.mark.parametrize("command", few(["DISABLE", "MARKER", "BEGIN"]))
def test_fault_96_a_second_writer_before_each_command_is_never_overwritten_unseen(tmp_path: Path, command: str) -> None:
    """The old table is off, so that the control does not protect it."""
    story = told(at(command, other_points, scene=Scene(old_on=False), recover=False), tmp_path)
    assert story.wrong == []
    assert story.outcome in ("committed", *NOT_THERE, "refused") or story.outcome.startswith("raised")
    assert story.restores <= 1


@pytest.mark.parametrize("command", few(["BEGIN", "DISABLE", "CHUNK"]))
def test_fault_97_who_else_writes_is_not_fought(tmp_path: Path, command: str) -> None:
    """A PLC program that keeps writing one register: the table never gets in, and only one restore is tried."""
    plan = at(command, lambda here: here.station.plc.change(overwrites=((40, 77),)))
    story = sound(told(replace(plan, mend=lambda here: here.station.plc.change(overwrites=())), tmp_path))
    assert story.outcome in NOT_THERE
    assert story.restores == 1
    assert story.off or story.as_before


@pytest.mark.parametrize("switches", [{"ignores_newconf": True}, {"activation": "power_on"}])
def test_fault_98_a_table_that_does_not_become_active_is_not_committed(
    tmp_path: Path, keys: Path, switches: dict[str, Any]
) -> None:
    found = _at_block(tmp_path, keys, -1, None, **switches)
    assert found.wrong == []
    assert found.outcome in NOT_THERE or switches == {"ignores_newconf": True}


def _refused(root: Path, **changes: Any) -> Story:
    """A push of the scene's table with something of it changed."""
    wanted = replace(worlds.NEW, **changes)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worlds, "NEW", wanted)
        story = sound(told(Plan(), root))
    assert (story.outcome, story.writes, story.asked) == ("refused", 0, {})
    return story


def test_fault_99_a_modulo_table_on_an_axis_that_is_none(tmp_path: Path) -> None:
    _refused(tmp_path / "open", modulo=True)
    _refused(tmp_path / "ends", modulo=True, minimum=-180.0, maximum=180.0, step=36.0)


@pytest.mark.parametrize("changes", [{"step": 17.0}, {"maximum": 89.0}, {"minimum": 90.0}, {"step": -18.0}])
def test_fault_100_a_grid_that_does_not_fit_its_points(tmp_path: Path, changes: dict[str, float]) -> None:
    _refused(tmp_path, **changes)


def _for_machine(changes: dict[str, Any]) -> Callable[[PushContext], PushContext]:
    """A push that was made for another machine."""
    return lambda context: replace(context, machine=replace(context.machine, **changes))


def test_fault_101_another_machine_is_refused(tmp_path: Path) -> None:
    others: tuple[dict[str, Any], ...] = ({"serial": "SN-9"}, {"version": "V1"}, {"axis_names": ("Q1",)})
    for number, changes in enumerate(others):
        plan = Plan(edit=_for_machine(changes), recover=False)
        story = sound(told(plan, tmp_path / str(number)))
        assert (story.outcome, story.writes, story.asked) == ("refused", 0, {})


@pytest.mark.parametrize("command", few(ALL_COMMANDS, 2))
def test_fault_101_another_machine_behind_the_wire_in_the_middle(tmp_path: Path, command: str) -> None:
    def swapped(here: World) -> None:
        here.nck.spec = replace(here.nck.spec, serial="SN-9")

    def back(here: World) -> None:
        here.nck.spec = replace(here.nck.spec, serial="ST-DOUBLE-0001")

    story = sound(told(at(command, swapped, mend=back), tmp_path))
    assert story.outcome in NOT_THERE or (command == "ACTIVATE" and story.outcome == "committed")
    assert story.as_before or story.off or story.as_wanted


@pytest.mark.parametrize("number", few([300504, 3000]))
def test_fault_102_an_alarm_refuses_and_stops(tmp_path: Path, number: int) -> None:
    def alarm(here: World) -> None:
        here.nck.drive_alarm(number, "something is wrong")

    first = sound(told(Plan(first=alarm), tmp_path / "first"))
    assert (first.outcome, first.asked) == ("refused", {})
    for command in TRANSFER:
        plan = at(command, alarm, mend=lambda here: here.nck.channel_reset())
        story = sound(told(plan, tmp_path / command))
        assert story.outcome in NOT_THERE
        assert story.as_before or story.off


def test_fault_102_a_harmless_alarm_is_one_the_site_names(tmp_path: Path) -> None:
    plan = Plan(
        first=lambda here: here.nck.drive_alarm(700001, "oil low"),
        edit=lambda context: replace(context, harmless_alarms=(700001,)),
        mend=lambda here: here.nck.channel_reset(),
    )
    assert sound(told(plan, tmp_path)).outcome != "refused"


def test_fault_103_an_axis_without_reference(tmp_path: Path) -> None:
    first = sound(told(Plan(first=lambda here: here.nck.lose_reference("X1")), tmp_path / "first"))
    assert (first.outcome, first.asked) == ("refused", {})
    later = sound(told(at("ACTIVATE", lambda here: here.nck.lose_reference("X1")), tmp_path / "later"))
    assert later.outcome in NOT_THERE


@pytest.mark.parametrize("place", few([-75.0, 54.0, -40.0, 12.0, 88.0], 2))
def test_fault_104_switching_never_moves_the_axis_by_more_than_a_micrometre(tmp_path: Path, place: float) -> None:
    def away(here: World) -> None:
        here.nck.set_mode("JOG")
        here.nck.core.move({0: place}, None)
        here.spawn(_auto(here))

    story = sound(told(Plan(first=away), tmp_path))
    assert story.outcome == "refused" or (story.outcome == "committed" and "P-PUSH-JOG" in story.said)
    if story.outcome == "committed":
        assert len(story.jumps) >= 2
        assert max(map(abs, story.jumps)) <= 1.0


async def _auto(here: World) -> None:
    await here.clock.sleep(0.05)
    here.nck.set_mode("AUTO")


def test_fault_106_an_inch_machine_is_refused(tmp_path: Path) -> None:
    plan = Plan(Scene(nck={"unit_system": "inch"}), recover=False)
    story = told(plan, tmp_path)
    assert (story.outcome, story.asked) == ("refused", {})


def test_fault_107_a_marker_that_is_not_ours_refuses(tmp_path: Path) -> None:
    def foreign(here: World) -> None:
        here.station.plc.memory.marker = (0x3737, 0x3737, 0, 0, 0, 0, 0, 0)
        here.station.plc.memory.marker_state = 1

    story = sound(told(Plan(first=foreign, recover=False), tmp_path))
    assert (story.outcome, story.asked, story.marker) == ("refused", {}, 1)


@pytest.mark.parametrize("command", few(TRANSFER, 2))
def test_fault_107_a_second_pc_in_the_middle(tmp_path: Path, command: str) -> None:
    def intrudes(here: World) -> None:
        here.station.plc.change(second_master=here.station.plc._taken + 1)

    story = sound(told(at(command, intrudes), tmp_path))
    assert story.as_before or story.off or story.as_wanted
    assert story.outcome in ("committed", *NOT_THERE)


def test_fault_108_a_restore_that_fails_too_is_held_off_marked_and_told(tmp_path: Path) -> None:
    refuses: dict[str, Any] = {"nck_refuses": 4, "nck_result": 5}
    plan = Plan(Scene(plc=refuses), mend=lambda here: here.station.plc.change(nck_refuses=0))
    story = sound(told(plan, tmp_path))
    assert story.outcome == "held"
    assert story.off
    assert story.marker == 3, "held"
    assert "P-PUSH-HELD" in story.said
    assert story.restores == 1
    (backup,) = tmp_path.glob("live-X1-*.mpf")
    assert "$MA_ENC_COMP_ENABLE[0,X1]=1" in backup.read_text()
    assert re.search(r"\$AA_ENC_COMP\[0,1,X1\]=0\.0015", backup.read_text())
    assert "rolled-back" in story.recovered
