"""Which switches of the double a conversation tells apart, and why the others need more than one."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from drivers.probes import ProbedSession, differences
from simulators.cellfile import CellFile, load_cell
from simulators.nck import Switches
from tests.conform.sessions import of_control

# A value that is not the usual one, and the questions that tell it. Each is one control's way.
FOUND: dict[str, tuple[Any, frozenset[str]]] = {
    "locked_alarm": (17180, frozenset({"locked-while-on"})),
    "fetch_while_waiting": (False, frozenset({"running-fetch"})),
    "r_writable": (False, frozenset({"right-to-r-parameter", "write-r-own", "running-r-write"})),
    "preprocess_ahead": (0, frozenset({"timer-waits"})),
    "system_reads_stop": (True, frozenset({"timer-waits"})),
    "float32_tables": (True, frozenset({"resolution-of-points", "last-point"})),
    "writes_late_s": (5.0, frozenset({"resolution-of-points", "last-point"})),
    "accepts_points_beyond": (True, frozenset({"write-point-beyond", "write-cross-point-beyond"})),
    "loses_last_points": (1, frozenset({"last-point"})),
    "stale_files": (True, frozenset({"send-replaced"})),
    "reads_another_axis": (True, frozenset({"resolution-of-points", "last-point"})),
    "enables_again_s": (5.0, frozenset({"switched-once"})),
}
READING = frozenset({"read-point-beyond", "read-cross-point-beyond"})
TOGETHER = ("locked_alarm", "fetch_while_waiting", "system_reads_stop", "loses_last_points", "enables_again_s")

# What docs/conform.md says of the rest, by the words of its table.
ACTS = "what acts on a position"
STARTS = "a start of the control"
LEAVES = "states of a program that stay"
CHANCE = "what happens by chance"
OWN = "the machine's own settings"
TRIED = "a word of the language that a control lacks"
WRITER = "a value that no program can make"
UNSEEN = {
    **dict.fromkeys(("cec_sign", "cec_factor_tables_count", "cec_direction_at_start"), ACTS),
    **dict.fromkeys(("cec_direction_at_standstill", "activation", "strict_activation", "uneven_step"), ACTS),
    **dict.fromkeys(("backlash_reacts_to_cec", "backlash_sign", "backlash_activation", "encoder_lead_shared"), ACTS),
    **dict.fromkeys(("lies_about_disable", "ignores_newconf"), ACTS),
    **dict.fromkeys(("shortened_max_is_stored", "enable_cleared_at_boot", "swaps_points_at_reset"), STARTS),
    **dict.fromkeys(("modal_stays",), LEAVES),
    **dict.fromkeys(("power_cut_at_block", "alarm_at_block", "block_alarm", "keyswitch_at_block"), CHANCE),
    **dict.fromkeys(("block_access_level", "mode_change_at_block", "hmi_writes_at_block", "hmi_writes"), CHANCE),
    **dict.fromkeys(("enables_at_block", "forgets_at_block", "forgets"), CHANCE),
    **dict.fromkeys(("diameter_axis", "zero_offset_mm", "tool_length_mm"), OWN),
    **dict.fromkeys(("card_exchanged", "hardware_exchanged", "software_updated", "axes_swapped"), OWN),
    "accepts_nan": WRITER,
    "fills_arrays": TRIED,
    "judges_programs": "the gate, which the leniencies of the language take away rule by rule",
}


def _with(**switches: Any) -> CellFile:
    cell = load_cell("demo")
    machine = cell.machine.model_copy(update={"switches": {**cell.machine.switches, **switches}})
    return cell.model_copy(update={"machine": machine})


def test_every_switch_is_told_by_a_question_or_its_reason_is_said() -> None:
    assert set(FOUND) | set(UNSEEN) == {one.name for one in fields(Switches)}
    assert set(FOUND) & set(UNSEEN) == set()
    page = (Path(__file__).parents[2] / "docs" / "conform.md").read_text(encoding="utf-8")
    assert [reason for reason in {*UNSEEN.values()} - {UNSEEN["judges_programs"]} if reason not in page] == []
    usual = Switches()
    assert [name for name, (value, _) in FOUND.items() if value == getattr(usual, name)] == []


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> ProbedSession:
    return of_control(tmp_path_factory.mktemp("usual"))


@pytest.mark.long
def test_ways_of_one_control_are_told_apart_and_nothing_else_is(usual: ProbedSession, tmp_path: Path) -> None:
    other = of_control(tmp_path, _with(**{name: FOUND[name][0] for name in TOGETHER}))
    found = {one.probe.name for one in differences(other, usual)}
    assert found == frozenset().union(*(FOUND[name][1] for name in TOGETHER))


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted(FOUND))
def test_a_way_alone_is_told_and_nothing_else_is(name: str, usual: ProbedSession, tmp_path: Path) -> None:
    value, named = FOUND[name]
    found = {one.probe.name for one in differences(of_control(tmp_path, _with(**{name: value})), usual)}
    assert found & named
    assert found <= named | READING


@pytest.mark.soak
@pytest.mark.parametrize("name", ["cec_sign", "uneven_step", "modal_stays", "swaps_points_at_reset", "accepts_nan"])
def test_what_is_said_to_be_unseen_makes_no_difference(name: str, usual: ProbedSession, tmp_path: Path) -> None:
    other = {"cec_sign": -1, "uneven_step": "ceil", "swaps_points_at_reset": 1}.get(name, True)
    assert differences(of_control(tmp_path, _with(**{name: other})), usual) == ()
