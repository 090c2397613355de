"""The operator does what MSG says; result files and site files say what they must."""

from __future__ import annotations

import tomllib
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv
from gateway.config import load_site
from simulators.cell import Cell
from simulators.cell.setup_files import write_setup_file
from simulators.cell.site import quoted, site_text
from simulators.cellfile import CellFile, load_cell, packaged_cells, with_plan
from simulators.cellfile import OperatorSection as OperatorSpec
from simulators.operator import Operator
from simulators.optics import OpticsBench
from simulators.result_files import FileContent, result_text
from simulators.truth import Truth, Weather
from tests.unit.simulators.motion import Motion, plain_cell


class Screen:
    """A control's screen and buttons: what was pressed is kept."""

    def __init__(self) -> None:
        self.channel_status = 0
        self.message = ""
        self.selections = 0
        self.pressed: list[str] = []
        self.ready = True
        self.in_alarm, self.selected = False, ""
        self.axes: set[str] = set()

    def nc_start(self) -> None:
        self.pressed.append("NC START")
        self.channel_status = 1

    def channel_reset(self) -> None:
        self.pressed.append("RESET")
        self.channel_status = 0

    def nck_reset(self) -> None:
        self.pressed.append("NCK RESET")
        self.channel_status = 0

    def reference_axis(self, name: str) -> None:
        self.pressed.append(f"REF {name}")
        self.axes.add(name)

    def referenced(self, name: str) -> bool:
        return name in self.axes

    def set_mode(self, mode: str) -> None:
        self.pressed.append(mode)


class Table:
    """A work place that says what was done at it."""

    def __init__(self, blanks: int) -> None:
        self.blanks = blanks
        self.on_it = False

    def load(self) -> bool:
        self.blanks, self.on_it = self.blanks - 1, self.blanks > 0
        return self.on_it

    def unload(self) -> bool:
        was, self.on_it = self.on_it, False
        return was


def scene(
    message: str, status: int = 2, table: Table | None = None, **options: object
) -> tuple[Screen, OpticsBench, list[str]]:
    """What an operator does within 15 minutes before a screen."""
    screen = Screen()
    bench = OpticsBench(Truth(CellFile.model_validate(plain_cell())), Motion())
    spec = OperatorSpec.model_validate(options)
    log: list[str] = []

    async def main() -> None:
        clock = LoopClock()
        operator = Operator(spec, screen, bench, clock, ["X1", "C1"], None, table)
        operator.start()
        screen.channel_status, screen.message = status, message
        screen.selections += status == 0
        await clock.sleep(900.0)
        await operator.stop()
        log.extend(operator.log)

    run_virtual(main)
    return screen, bench, log


def test_a_newly_selected_program_is_started_once() -> None:
    assert scene("", status=0)[0].pressed == ["NC START"]


def test_nothing_is_started_by_itself() -> None:
    assert scene("", status=0, auto=False)[0].pressed == []
    assert scene("SOMETHING ELSE")[0].pressed == []


def test_a_set_up_is_mounted_and_confirmed() -> None:
    screen, bench, _ = scene("TRUEFLANK SETUP ECC ON C")
    assert screen.pressed == ["NC START"]
    mounting = bench.mounted("calibrator")
    assert mounting is not None
    assert mounting.optics == "rotary"


def test_an_unknown_set_up_is_not_confirmed() -> None:
    screen, _, log = scene("TRUEFLANK SETUP EYX ON X")
    assert screen.pressed == []
    assert log == ["nothing to mount for EYX on X"]


def test_a_blank_is_clamped_and_the_part_taken_off_when_asked() -> None:
    table = Table(blanks=1)
    screen, _, log = scene("TRUEFLANK LOAD BLANK RV-40E-LIKE", table=table)
    assert (screen.pressed, log[0], table.on_it) == (["NC START"], "clamped a blank", True)
    screen, _, log = scene("TRUEFLANK UNLOAD PART", table=table)
    assert (screen.pressed, log[0], table.on_it) == (["NC START"], "took the part off", False)
    assert scene("TRUEFLANK UNLOAD PART", table=table)[0].pressed == []
    screen, _, log = scene("TRUEFLANK LOAD BLANK", table=table)
    assert (screen.pressed, log) == ([], ["no blank to clamp"])
    assert scene("TRUEFLANK LOAD BLANK")[0].pressed == []


def test_the_part_makes_room_for_an_instrument() -> None:
    table = Table(blanks=1)
    table.load()
    screen, _, log = scene("TRUEFLANK SETUP ECC ON C", table=table)
    assert log[:2] == ["took the part off", "mounted ECC on C"]
    assert screen.pressed == ["NC START"]


def test_wrong_optics_are_mounted_when_the_operator_errs() -> None:
    _, bench, _ = scene("TRUEFLANK SETUP EXX ON X", mounts_wrong=["EXX"])
    mounting = bench.mounted("laser")
    assert mounting is not None
    assert mounting.optics == "angular"


def test_activation_resets_references_and_goes_back_to_auto() -> None:
    screen, _, _ = scene("TRUEFLANK ACTIVATE NCK RESET AND REFERENCE X1")
    assert screen.pressed == ["NCK RESET", "REF X1", "REF C1", "AUTO"]


WEATHER = Weather(20.337280, 990.39005, 46.954897, 20.203292)


def content(rotary: bool) -> FileContent:
    deviations = np.arange(12.0).reshape(3, 2, 2)
    deviations[1, 1, 1] = np.nan
    moment = datetime(2024, 5, 3, 10, 46, tzinfo=UTC)
    factors = (0.31641096, 0.31641067)
    targets = np.asarray([0.0, 10.0, 20.0])
    return FileContent(targets, deviations, rotary, WEATHER, WEATHER, moment, moment, 8.0, factors)


def test_a_linear_file_has_the_makers_layout() -> None:
    text = result_text(content(rotary=False))
    assert text.startswith("HEADER::\r\nFile type  : rtl\r\n")
    assert text.endswith("EOF::\r\n")
    assert "\n" not in text.replace("\r\n", "")
    assert "Run-count:4\r\n" in text
    rows = [line.split() for line in text.split("Run Target Data:\r\n")[1].split("\r\n\r\n")[0].split("\r\n")]
    assert [row[:2] for row in rows[:6]] == [["1", "1"], ["1", "2"], ["1", "3"], ["2", "3"], ["2", "2"], ["2", "1"]]
    assert [float(row[2]) for row in rows[:6]] == [0.0, 4.0, 8.0, 9.0, 5.0, 1.0]
    assert len(rows) == 11
    assert "Air press  : 99.039005 99.039005" in text
    assert "Mat temp 2 : -10.000000 -10.000000" in text
    assert '"10:46 May 03 2024"' in text


def test_a_rotary_file_is_in_milliradian() -> None:
    text = result_text(content(rotary=True))
    assert f"{8.0 / 206.26480624709636:.6f}" in text


@pytest.mark.parametrize("name", packaged_cells())
def test_the_site_file_of_a_packaged_cell_is_valid(name: str, tmp_path: Path) -> None:
    cell = load_cell(name)
    controller = {"url": "opc.tcp://127.0.0.1:4840", "settings": {"user": "u", "r_first": 80}}
    urls = {"laser": "socket://127.0.0.1:9000", "calibrator": "tcp://127.0.0.1:9001"}
    path = tmp_path / "site.toml"
    path.write_text(site_text(cell, cell.machine.serial, controller, urls), encoding="utf-8")
    site = load_site(path)
    assert [axis.name for axis in site.axes] == ["X1", "Z1", "C1"]
    assert site.axes[0].measure.instrument == "laser"
    assert site.axes[0].measure.dead_path_mm == 180.0
    assert site.controller.serial == cell.machine.serial
    assert site.axes[2].modulo
    assert [axis.encoder for axis in site.axes] == [axis.encoder for axis in cell.axes if axis.measure is not None]
    table = cell.axis("C").table or {}
    assert (site.axes[2].table.maximum, site.axes[2].table.step) == (360.0, table["step"])


@pytest.mark.parametrize("text", ["plain", 'with "quotes"', "C:\\cells\\a", "new\nline", "Grad \u00b0"])
def test_text_survives_the_site_file(text: str) -> None:
    assert tomllib.loads(f"key = {quoted(text)}") == {"key": text}


@pytest.mark.parametrize(
    ("component", "axis", "unit"), [("EYX", "X1", "um"), ("EAX", "X1", "arcsec"), ("A0C", "Z1", "um")]
)
async def test_the_table_of_a_set_up_names_its_unit_so_that_it_is_read_however_small_its_readings_are(
    tmp_path: Path, component: str, axis: str, unit: str
) -> None:
    cell = Cell(with_plan(load_cell("demo")), tmp_path, LoopClock())
    heading, *rows = write_setup_file(cell, component, axis, tmp_path / "table.csv").read_text().splitlines()
    small = [f"{row.rpartition(',')[0]},0.0001" for row in rows]
    read = parse_csv("\n".join([heading, *small]), ColumnMap(), "table.csv", mixed=True)
    assert read.deviations == pytest.approx(0.0001)
    with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT"):
        parse_csv("\n".join([heading.removesuffix(f"_{unit}"), *small]), ColumnMap(), "table.csv", mixed=True)
