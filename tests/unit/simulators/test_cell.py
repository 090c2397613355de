"""A whole cell: it starts, says how to reach it, lets programs run, and is judged by its truth."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from drivers.umd.device import UmdCounter
from gateway.config import load_site
from simulators.cell import Cell
from simulators.cell.__main__ import answered
from simulators.cell.backdoor import BackDoor
from simulators.cellfile import load_cell
from simulators.pytest_plugin import CellStarter, WireCell

JOG = """G500 D0 G90 G94 G60 G601
MSG("TRUEFLANK SETUP EXX ON X")
M0
MSG("")
SUPA G1 X1=-20 F6000
G4 F3
SUPA G1 X1=-10 F6000
G4 F3
STOPRE
R99=1
M30
"""


def load_table(cell: Cell, axis: str, minimum: float, step: float, values: list[float], modulo: int = 0) -> None:
    """Put an EEC table into the control as a service engineer would, and let it act."""
    nck = cell.nck
    nck.set(f"$MA_ENC_COMP_ENABLE[0,{axis}]", 0, 0)
    for place, value in enumerate(values):
        nck.set(f"$AA_ENC_COMP[0,{place},{axis}]", value, 0)
    nck.set(f"$AA_ENC_COMP_STEP[0,{axis}]", step, 0)
    nck.set(f"$AA_ENC_COMP_MIN[0,{axis}]", minimum, 0)
    nck.set(f"$AA_ENC_COMP_MAX[0,{axis}]", minimum + step * (len(values) - 1), 0)
    nck.set(f"$AA_ENC_COMP_IS_MODULO[0,{axis}]", modulo, 0)
    nck.set(f"$MA_ENC_COMP_ENABLE[0,{axis}]", 1, 0)
    restart(cell)


def restart(cell: Cell) -> None:
    cell.nck.nck_reset()


async def settled(cell: Cell) -> None:
    """Wait until the control is up again and every axis is referenced."""
    await cell.clock.sleep(20.0)
    for axis in cell.file.axes:
        cell.nck.reference_axis(axis.name)
    await cell.clock.sleep(20.0)
    cell.nck.set_mode("AUTO")


def test_a_cell_prints_a_site_file_that_leads_to_its_wires(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> tuple[Ambient, Path, str]:
        site = load_site(cell.site_path)
        assert site.controller.url.startswith("opc.tcp://127.0.0.1:")
        assert [i.name for i in site.instruments][:2] == ["laser", "calibrator"]
        laser = UmdCounter("laser", site.instruments[0].url, site.instruments[0].settings, cell.clock)
        await laser.open(5.0)
        ambient = await laser.ambient()
        await laser.close()
        return ambient, cell.site_path, cell.password

    ambient, path, password = trueflank_cell.in_memory(main)
    settings = load_site(path).controller.settings
    assert Path(settings["password_file"]).read_text().strip() == password
    assert Path(settings["server_certificate"]).is_file()
    assert ambient.air_degc == pytest.approx(22.35, abs=0.5)


def test_an_operator_mounts_and_the_laser_follows_a_program(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        cell.nck.files.write("/_N_MPF_DIR/_N_JOG_MPF", JOG.encode())
        assert cell.nck.select("/_N_MPF_DIR/_N_JOG_MPF", 1) == 0
        for _ in range(600):
            await cell.clock.sleep(0.5)
            if cell.nck.get("R[99]") == 1:
                break
        assert cell.operator.log == ["NC START", "mounted EXX on X", "NC START"]
        counter = cell.instruments["laser"].counter
        position, _ = cell.nck.encoder("X1", np.asarray([cell.clock.now()]))
        assert position[0] == pytest.approx(-10.0, abs=1e-6)
        await cell.clock.sleep(0.013)
        counts = counter.read(cell.clock.now()).counts
        travelled = counter.sense * float(counts[-1]) * counter.count_mm / 1.00026
        assert travelled == pytest.approx(-10.0, abs=0.02)
        assert cell.nck.channel_status == 0

    trueflank_cell.in_memory(main)


def test_the_truth_is_seen_through_the_live_table(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        before = cell.figures("C1")
        assert before == cell.figures("C1", live=False)
        at = np.arange(0.0, 361.0, 5.0)
        mean = (cell.raw_deviation("C1", at, 1, 0.0) + cell.raw_deviation("C1", at, -1, 0.0)) / 2.0
        load_table(cell, "C1", 0.0, 5.0, ((mean - mean[0]) / 3600.0).tolist(), modulo=1)
        await settled(cell)
        after = cell.figures("C1")
        assert after["M"] < 0.1 * before["M"]
        assert after["M"] < 1.0
        assert after["B"] == pytest.approx(0.6, abs=0.01)
        assert cell.figures("C1", live=False) == before

    trueflank_cell.in_memory(main)


def test_the_encoder_agrees_with_the_judge(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        load_table(cell, "X1", -400.0, 100.0, [0.004, -0.003, 0.002, 0.001, 0.0])
        await settled(cell)
        cell.nck.files.write("/_N_MPF_DIR/_N_GO_MPF", b"G500 D0 G90 G94 G601\nSUPA G1 X1=-250 F6000\nG4 F2\nM30\n")
        cell.nck.select("/_N_MPF_DIR/_N_GO_MPF", 1)
        await cell.clock.sleep(30.0)
        position, direction = cell.nck.encoder("X1", np.asarray([cell.clock.now()]))
        assert direction[0] == -1.0
        at = np.asarray([-250.0])
        judged = cell.true_deviation("X1", at, -1, 0.0)
        stands = (position - at) * 1e3 + cell.truth.deviation("X1", position, -1, 0.0)
        np.testing.assert_allclose(judged, stands, atol=1e-3)
        assert (position - at)[0] == pytest.approx(-(-0.003 + 0.002) / 2.0, abs=1e-5)

    trueflank_cell.in_memory(main)


def test_senses_are_drawn_apart(trueflank_cell: CellStarter, tmp_path: Path) -> None:
    async def main(cell: Cell) -> tuple[int, int, int]:
        senses = (await BackDoor(cell).answer({"ask": "senses"}))["instruments"]
        return senses["laser"], senses["calibrator"], cell.nck.spec.cec_sign

    drawn = {trueflank_cell.in_memory(main, "zero", seed=seed) for seed in range(6)}
    assert len(drawn) >= 3


def test_the_judge_answers_and_says_what_it_does_not_know(trueflank_cell: CellStarter, tmp_path: Path) -> None:
    async def main(cell: Cell) -> None:
        judge = BackDoor(cell)
        answer = await judge.answer({"ask": "deviation", "axis": "X1", "positions": [-10.0], "direction": 1, "t": 0})
        assert answer["unit"] == "um"
        assert answer["deviation"] == pytest.approx(cell.raw_deviation("X1", np.asarray([-10.0]), 1, 0.0).tolist())
        assert (await judge.answer({"set": "serial", "value": "OTHER"})) == {"done": True}
        assert (await judge.answer({"ask": "status"}))["serial"] == "OTHER"
        tables = await judge.answer({"ask": "tables"})
        name = "$AA_ENC_COMP[0,3,X1]"
        await judge.answer({"set": "variable", "name": name, "value": 0.001})
        assert (await judge.answer({"ask": "tables"}))["digest"] != tables["digest"]
        assert (await judge.answer({"set": "drop_connections"})) == {"done": True}
        assert (await judge.answer({"set": "beam", "instrument": "laser"})) == {"done": True}
        assert cell.bench.broken == {"laser"}
        assert "E-CELL-ASK" in (await judge.answer({"ask": "weather"}))["error"]
        assert "KeyError" in (await judge.answer({"ask": "deviation"}))["error"]
        assert "error" in await judge.answer({"ask": "figures", "axis": "Q9"})
        await judge.answer({"set": "result_file", "axis": "X1", "path": str(tmp_path / "x.rtl")})

    trueflank_cell.in_memory(main)
    assert (tmp_path / "x.rtl").read_bytes().startswith(b"HEADER::")


def test_the_panel_has_a_reset_key(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        judge, nck = BackDoor(cell), cell.nck
        cell.operator.change(auto=False)
        path = "/_N_MPF_DIR/_N_STANDS_MPF"
        nck.files.write(path, b"M0\nM30\n")
        nck.select(path)
        assert await answered(judge, b"NC start\n") == {"done": True, "pressed": "NC START"}
        await cell.clock.sleep(1.0)
        assert int(nck.channel_status) == 2
        assert await answered(judge, b" reset ") == {"done": True, "pressed": "RESET"}
        assert int(nck.channel_status) == 0
        assert cell.operator.log[-2:] == ["NC START", "RESET"]
        assert await answered(judge, b"auto on") == {"done": True}
        assert cell.operator.spec.auto
        assert "is none of: reset" in (await answered(judge, b"emergency stop"))["error"]

    trueflank_cell.in_memory(main)


def test_a_result_file_holds_the_axis_as_it_is(trueflank_cell: CellStarter, tmp_path: Path) -> None:
    from drivers.files.rtl import RtlFormat

    async def main(cell: Cell) -> None:
        path = cell.write_result_file("X1", tmp_path / "x.rtl")
        found = RtlFormat().read(path)
        assert found.deviations.shape == (21, 5, 2)
        mean = np.nanmedian(found.deviations, axis=(1, 2))
        at = found.targets - 400.0
        true = (cell.raw_deviation("X1", at, 1, 0.0) + cell.raw_deviation("X1", at, -1, 0.0)) / 2.0
        np.testing.assert_allclose(mean - mean[0], true - true[0], atol=1.0)

    trueflank_cell.in_memory(main)


def asked(url: str, question: dict[str, Any]) -> dict[str, Any]:
    host, port = url.removeprefix("tcp://").split(":")
    with socket.create_connection((host, int(port)), 10.0) as wire:
        wire.sendall(json.dumps(question).encode() + b"\n")
        answer: dict[str, Any] = json.loads(wire.makefile("rb").readline())
        return answer


def test_a_cell_on_wires_answers_its_parent_and_ends_with_its_pipe(trueflank_cell: CellStarter) -> None:
    cell = trueflank_cell("demo", speed=100.0, seed=3)
    assert load_site(cell.site).controller.serial == load_cell("demo").machine.serial
    assert cell.ready["speed"] == 100.0
    assert asked(cell.ready["judge"], {"ask": "status"})["channel"] == 0
    assert cell.deviation("C1", [0.0], 1, "raw") == pytest.approx(cell.deviation("C1", [0.0], 1), abs=0.1)
    with pytest.raises(ValueError, match="E-CELL-ASK"):
        cell.set("sunshine")
    cell.set("operator", options={"auto": False})
    assert cell.stop() == 0
    judgement = json.loads(cell.site.with_suffix(".judgement.json").read_text())
    assert judgement["C1"]["raw"]["M"] > 10.0


def test_a_cell_on_wires_ends_when_its_stop_file_appears(tmp_path: Path) -> None:
    cell = WireCell(
        tmp_path / "cell", "zero", ["--speed", "50", "--ignore-stdin", "--stop-file", str(tmp_path / "end")]
    )
    (tmp_path / "end").touch()
    assert cell.stop() == 0


def test_a_wrong_cell_is_refused_with_its_reason(trueflank_cell: CellStarter, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="E-CELL-READ"):
        trueflank_cell(tmp_path / "nothing.toml")
