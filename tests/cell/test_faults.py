"""What can go wrong in a run: each ends with what, where and what to do, and the tables as they were."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import ConfigError, DeviceError, TableError, TransportError, TrueflankError
from gateway.errors import Incomplete, VerifyError, WriteRefused
from gateway.supervisor import DevicesFailed
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cell.control import with_serial_number
from tests.cell.bench import main_job, short
from tests.sizes import few


class Watched:
    """Remembers the controller's tables at the start and at the end of a run."""

    def __init__(self) -> None:
        self.cell: Cell | None = None
        self.first: Any = None

    async def start(self, cell: Cell) -> None:
        self.cell = cell
        self.first = await self.tables()

    async def tables(self) -> Any:
        assert self.cell is not None
        return await BackDoor(self.cell).answer({"ask": "tables"})


def _fails(tmp_path: Path, expected: type[TrueflankError], text: str, **options: Any) -> TrueflankError:
    """Run, expect this error with what, where and what to do, and byte for byte the same tables after it."""
    watched = Watched()
    prepare = options.pop("prepare", None)
    last: list[Any] = []
    heard = options.pop("heard", None)

    async def during(cell: Cell) -> None:
        await watched.start(cell)
        stop = cell.stop

        async def stop_and_look() -> None:
            last.append(await watched.tables())
            await stop()

        cell.stop = stop_and_look  # type: ignore[method-assign]
        if prepare is not None:
            prepare(cell)

    with pytest.raises(expected) as caught:
        main_job(tmp_path, during=during, heard=heard, **{"edit": short(), **options})
    told = str(caught.value)
    assert text in told
    assert "->" in told
    assert caught.value.exit_code not in (0, 1)
    assert last == [watched.first]
    return caught.value


def _at_stop(number: int, act: Callable[[Cell], Any]) -> Callable[[Cell, str, dict[str, object]], None]:
    done: list[bool] = []

    def heard(cell: Cell, code: str, fields: dict[str, object]) -> None:
        if code == "P-STOP" and str(fields["program"]).startswith("TFMEAS") and fields["done"] == number and not done:
            done.append(True)
            result = act(cell)
            if asyncio.iscoroutine(result):
                cell.acting = asyncio.ensure_future(result)  # type: ignore[attr-defined]

    return heard


def test_the_lasers_line_pulled_mid_run(tmp_path: Path) -> None:
    heard = _at_stop(5, lambda cell: cell.pull("laser"))
    error = _fails(tmp_path, TransportError, "laser", edit=short(("X1",)), heard=heard)
    assert error.exit_code == 3


def test_the_beam_of_the_calibrator_broken_mid_run_and_never_restored(tmp_path: Path) -> None:
    heard = _at_stop(5, lambda cell: cell.beam("calibrator", broken=True))
    _fails(tmp_path, DeviceError, "BEAM", heard=heard)


@pytest.mark.parametrize(("axis", "instrument"), few([("X1", "laser"), ("C1", "calibrator")]))
def test_a_beam_that_is_restored_costs_a_new_datum_only(tmp_path: Path, axis: str, instrument: str) -> None:
    def heard(cell: Cell, code: str, fields: dict[str, object]) -> None:
        if code == "P-STOP" and fields["program"] == f"TFMEAS{axis[0]}" and fields["done"] == 5:
            cell.beam(instrument, broken=True)
        if code == "P-CAP-BEAM":
            cell.beam(instrument, broken=False)

    judged = main_job(tmp_path, apply=False, edit=short((axis,)), heard=heard)
    assert [code for code, _fields in judged.said].count("P-CAP-BEAM") == 1
    measured = judged.outcome.data["axes"][axis]["before"]["M"]
    assert measured == pytest.approx(judged.before[axis]["M"], rel=0.3)


@pytest.mark.parametrize(("axis", "component"), [("X1", "EXX"), ("C1", "ECC")])
def test_the_wrong_optics_mounted(tmp_path: Path, axis: str, component: str) -> None:
    def prepare(cell: Cell) -> None:
        cell.operator.change(mounts_wrong=(component,))

    error = _fails(tmp_path, TrueflankError, axis, edit=short((axis,)), prepare=prepare)
    assert error.exit_code in (5, 6)


def test_the_login_refused(tmp_path: Path) -> None:
    def edit(text: str) -> str:
        return short()(text).replace("password.txt", "wrong.txt")

    def prepare(cell: Cell) -> None:
        (cell.site_path.parent / "wrong.txt").write_text("not the password\n", encoding="utf-8")

    error = _fails(tmp_path, DevicesFailed, "E-UA-LOGIN", edit=edit, prepare=prepare)
    assert isinstance(error, DevicesFailed)
    assert [name for name, _cause in error.causes] == ["controller"]


def test_another_machine_behind_the_same_address(tmp_path: Path) -> None:
    _fails(tmp_path, DeviceError, "E-SUP-IDENTITY", prepare=lambda cell: with_serial_number(cell.nck, "YK7350B-9999"))


@pytest.mark.long
def test_the_machine_exchanged_between_capture_and_push(tmp_path: Path) -> None:
    def heard(cell: Cell, code: str, _fields: dict[str, object]) -> None:
        if code == "P-PROPOSED":
            with_serial_number(cell.nck, "YK7350B-9999")

    _fails(tmp_path, WriteRefused, "serial", heard=heard)


@pytest.mark.long
def test_too_few_points_reserved_names_the_machine_data_and_the_number(tmp_path: Path) -> None:
    def edit(text: str) -> str:
        return short()(text).replace("step = 5.0", "step = 1.0")

    error = _fails(tmp_path, TableError, "MD38000", edit=edit)
    assert "361" in str(error)


@pytest.mark.long
def test_a_table_changed_after_the_capture_is_not_overwritten(tmp_path: Path) -> None:
    """The program of the push finds it in its own back-up, before it switches or writes anything."""
    changed: list[Cell] = []

    def heard(cell: Cell, code: str, _fields: dict[str, object]) -> None:
        if code == "P-SIGN-PROVED" and not changed:
            changed.append(cell)
            cell.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 0, 0)
            for name, value in (("STEP", 5.0), ("MIN", 0.0), ("MAX", 360.0), ("IS_MODULO", 1)):
                cell.nck.set(f"$AA_ENC_COMP_{name}[0,C1]", value, 0)
            cell.nck.set("$AA_ENC_COMP[0,3,C1]", 0.0004, 0)

    with pytest.raises(VerifyError, match="E-PUSH-LOST-UPDATE") as caught:
        main_job(tmp_path, edit=short(("C1",), 9, 3), heard=heard)
    (cell,) = changed
    assert "C1" in str(caught.value)
    assert 0.0004 in [one.points[3] for one in cell.nck.core.memory.eec.values() if len(one.points) > 3]


def test_nobody_presses_nc_start(tmp_path: Path) -> None:
    _fails(tmp_path, TransportError, "E-NC-NO-STOP", prepare=lambda cell: cell.operator.change(auto=False))


def test_the_channel_reset_in_the_middle_of_a_measuring_program(tmp_path: Path) -> None:
    _fails(tmp_path, Incomplete, "E-WALK-ENDED", heard=_at_stop(5, lambda cell: cell.panel.channel_reset()))


@pytest.mark.long
def test_apply_without_the_machines_name_opens_nothing(tmp_path: Path) -> None:
    judged = main_job(tmp_path, apply=False, edit=short())
    assert judged.outcome.data["outcome"] == "not-pushed"
    assert judged.outcome.state == "proposed"
    assert judged.before == judged.after


def test_typed_readings_of_a_rotary_axis_are_refused_before_any_axis_is_measured(tmp_path: Path) -> None:
    def edit(text: str) -> str:
        site = short(("X1", "C1"))(text)
        assert site.count('instrument = "calibrator"') == 1
        own = '[[instruments]]\nname = "typed"\ndriver = "manual"\nurl = "terminal://"\n'
        return site.replace('instrument = "calibrator"', 'instrument = "typed"') + own

    heard: list[str] = []
    _fails(tmp_path, ConfigError, "E-CAP-CALIBRATOR", edit=edit, heard=lambda _cell, code, _fields: heard.append(code))
    assert "P-RUN" in heard
    assert "P-STOP" not in heard


def test_axes_without_a_safe_place_are_all_named_before_any_axis_is_measured(tmp_path: Path) -> None:
    def edit(text: str) -> str:
        return re.sub(r"(?ms)^safe = \{.*?\}", "safe = { C1 = [-30.0, 390.0] }", short(("C1",))(text))

    heard: list[str] = []
    error = _fails(tmp_path, WriteRefused, "E-RUN-PLACES", edit=edit, heard=lambda _cell, code, _: heard.append(code))
    assert error.fields["axes"].split(", ") > ["X1"]
    assert "C1" not in error.fields["axes"]
    assert "P-RUN" in heard
    assert "P-STOP" not in heard
