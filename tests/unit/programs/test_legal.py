"""Every program of every kind, for every shipped cell and site, passes the judge of the control's language."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import LocalProtocolError
from drivers.programs import NOBODY, PaperMachine, Visits
from drivers.sinumerik.legality import Machine, check
from drivers.sinumerik.ncprogram import measuring, pushing
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.ncprogram.words import Words
from drivers.sinumerik.opcua.preview import preview_programs
from drivers.types.orders import DisableOrder, PushOrder
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from gateway.config import load_site
from gateway.workflow.programs import programs
from gateway.workflow.run.paper_control import SENT_KINDS, ProgramKind
from tests.unit.programs.sites import CELLS, site_file

QUICK: tuple[ProgramKind, ...] = ("load", "backup", "grind", "off")
GOLDEN = Path(__file__).parents[2] / "golden" / "sinumerik"
AXES = ("X1", "Y1", "Z1", "C1")
SETTING = measuring.MachineSetting(Words(80), ReservedPoints(80, (0, 30), AXES), modulo=False)
PLAN = StopPlan("TFMEASX", "X1", "X", "mm", False, (Stop(0.0, 1), Stop(10.0, 1)), 500.0, 5.0, 1.0)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("two", [False, True])
def test_what_a_site_would_send_is_legal(tmp_path: Path, cell: str, two: bool) -> None:
    path = site_file(tmp_path, cell, two_programs=two)
    wanted = SENT_KINDS if cell == "demo" and not two else QUICK
    written = programs(load_site(path), path, wanted)  # each is judged on the way, or raises
    none = {"effect"} if load_site(path).work is not None else {"effect", "grind"}  # nothing is proposed here
    assert {one.what for one in written} == set(wanted) - none
    assert len({one.name for one in written}) == len(written)
    purposes = {one.program.path.split("_TF")[1].split("_")[0] for one in written}
    assert purposes >= ({"LOAD", "ENAB", "OFF"} if two else {"PUSH", "OFF", "MEAS"})


@pytest.mark.soak
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("plan", [False, True])
def test_all_that_every_site_would_send_is_legal(tmp_path: Path, cell: str, two: bool, plan: bool) -> None:
    path = site_file(tmp_path, cell, plan=plan, two_programs=two)
    assert programs(load_site(path), path)


@pytest.mark.parametrize("purpose", ["table", "sign-proof", "restore"])
@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("multiply", [0, 2])
def test_cross_tables_of_every_kind_are_legal(purpose: str, two: bool, coupled: bool, multiply: int) -> None:
    values = (0.0, -3.0, 2.0, 0.0)
    table = CompensationTable("cross", "Z1", "X1", 0.0, 300.0, 100.0, values, index=1, multiply_by=multiply)
    order = PushOrder(4711, table, "Z", False, True, 0.0, purpose, None, coupled)
    machine = PaperMachine(AXES, frozenset({"C1"}), {"X1": 101}, (30, 4, 30))
    settings = {"security": "None", "two_programs": two}
    for enable in (True, False):
        given = replace(order, enable=enable, purpose="restore" if purpose == "table" else purpose)
        assert preview_programs((given,), settings, machine, NOBODY, "here")
    assert preview_programs(DisableOrder(4711, "cross", "X1", 1), settings, machine, NOBODY, "here")


@pytest.mark.parametrize("overrun", [5.0, 400.0])
def test_plans_that_loop_and_one_that_is_written_out_are_legal_together(overrun: float) -> None:
    """A turn with an overrun of more than a turn cannot be told by tables; beside X its counter was not declared."""
    turned = [Stop(target, 1, again, 10 * again) for again in range(3) for target in (0.0, 90.0, 180.0)]
    turn = replace(PLAN, name="TFMEASC", axis="C1", letter="C", unit="deg", rotary=True, stops=tuple(turned))
    plans = Visits(
        (replace(PLAN, stops=tuple(Stop(10.0 * at, 1, 0, at) for at in range(5))), replace(turn, overrun=overrun))
    )
    machine = PaperMachine(AXES, frozenset({"C1"}), {"X1": 101, "C1": 101}, (30,))
    (program,) = preview_programs(plans, {"security": "None"}, machine, NOBODY, "here")
    assert "UTARGET" in program.text
    assert ("UROUND," in program.text) == (overrun > 360.0)


def test_files_that_programs_write_are_legal() -> None:
    for name in ("backup_c1", "saved_c1"):
        assert check((GOLDEN / f"{name}.spf").read_text(), f"{name}.SPF", Machine(frozenset(AXES))) == ()
    assert check(BackupFile("LIVE", 7, "X1", 0, ReservedPoints(3)).first_line + "\nM17\n") == ()


def test_the_two_halves_jump_to_their_own_labels_alone() -> None:
    table = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, -3.0, 0.0))
    order = PushOrder(4711, table, "X", False, True, 0.0, "sign-proof")
    assert "TF_COMPARE_2" not in pushing.build_loading_program([(order, SETTING)])
    assert "TF_COMPARE_1" not in pushing.build_enabling_program([(order, SETTING)])


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ("DEF INT UERR, UPOINT", "DEF INT UERR, N", "E-LEGAL-NAME"),
        ("GOTOF TF_LEFT", "GOTOF TF_LOST", "E-LEGAL-LABEL"),
        ("ENDFOR", "; gone", "E-LEGAL-UNCLOSED"),
        ("$AA_ENC_COMP_STEP[0,X1])", "$AA_ENC_COMP_STEP[0])", "E-LEGAL-INDICES"),
    ],
)
def test_the_gate_names_line_and_rule_and_lets_nothing_pass(old: str, new: str, rule: str) -> None:
    text = measuring.build_measuring_program(PLAN, 123456, SETTING)
    assert old in text
    broken = text.replace(old, new)
    with pytest.raises(LocalProtocolError, match="E-PROGRAM-ILLEGAL") as caught:
        check_program("/_N_MPF_DIR/_N_TFMEAS_X1_MPF", broken, AXES)
    assert caught.value.fields["rule"] == rule
    assert caught.value.fields["line"] > 1
    assert "line" in str(caught.value)


def test_nothing_is_sent_of_an_illegal_program() -> None:
    from drivers.clock import LoopClock
    from drivers.sinumerik.opcua.device import SinumerikOpcUa

    asked: list[str] = []

    class Wire(SinumerikOpcUa):
        async def _setting(self, *_names: object, **_more: object) -> measuring.MachineSetting:
            return replace(SETTING, words=Words(80), origin=replace(NOBODY, site="S"))

        async def _check_encoder(self, *_axis: object, said: bool) -> None:
            """There is no control to ask."""

    async def job() -> None:
        device = Wire("control", "opc.tcp://127.0.0.1:1", {"security": "None"}, LoopClock())
        device._dialogue = type("Silent", (), {"begin": lambda *_: asked.append("begin")})()
        device._configuration = replace(device._configuration, places=AXES)
        await device.prepare_stops(replace(PLAN, letter="N"))

    with pytest.raises(LocalProtocolError, match="E-PROGRAM-ILLEGAL"):
        asyncio.run(job())
    assert asked == []
