"""The demo on the screen: time left over all stages, the tooth as strips, its end, and where it stops."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from drivers.clock import LoopClock
from gateway.cli import app, demo
from gateway.cli.demo import DemoDuration, show_demo_result, strip_cells, tooth_strips
from gateway.cli.progress_state import ProgressState
from gateway.errors import CaptureError
from gateway.remaining import RemainingTime, Work
from gateway.store import RunFolder, Store
from gateway.tooth import FlankMap
from gateway.workflow import complete_run
from gateway.workflow.results import document, report
from gateway.workflow.run import stages as names
from tests.unit.programs.sites import site_file
from tests.unit.report import closing

DAY = (
    Work("measure", "EXX-X1", 100.0), Work("measure", "EZZ-Z1", 100.0), Work("part", "before", 50.0),
    Work("sign proofs", "trial tables", 30.0), Work("sign proofs", "X1", 40.0),
    Work("sign proofs", "previous tables", 30.0),
    Work("push", "axis tables and reversals", 60.0), Work("measure again", "X1", 90.0), Work("part", "after", 50.0),
)  # fmt: skip
TOLD = (
    ("P-SETUP-PLAN", {"setup": "EXX-X1", "number": 1, "total": 2}),
    ("P-SETUP-PLAN", {"setup": "EZZ-Z1", "number": 2, "total": 2}),
    ("P-PART", {"part": "before"}),
    ("P-PUSH-TRIALS", {}),
    ("P-PUSH-START", {}),
    ("P-SIGN", {"axis": "X1"}),
    ("P-PUSH-START", {}),
    ("P-PUSH-START", {}),
    ("P-MEASURE", {"axis": "X1", "phase": "after"}),
    ("P-PART", {"part": "after"}),
)


def test_the_time_left_is_that_of_all_stages() -> None:
    """By hand: half of the foreseen speed. 100 s took 50, so 450 s more take 225; the last set-up is not the end."""
    scene = ProgressState(began=0.0, stages=RemainingTime(DAY))
    assert scene.stages is not None
    scene.told(*TOLD[0], 0.0)
    assert scene.stages.left_s(40.0) is None
    scene.told(*TOLD[1], 50.0)
    assert scene.stages.left_s(50.0) == pytest.approx(225.0)
    assert scene.stages.left_s(70.0) == pytest.approx(205.0)
    assert scene.stages.left_s(900.0) == pytest.approx(175.0), "one that lasts longer takes nothing from the others"
    assert (scene.stages.number, scene.stages.total) == (1, 6)


def test_every_stage_begins_with_what_is_said_of_it() -> None:
    stages, seen = RemainingTime(DAY), []
    for number, (code, fields) in enumerate(TOLD):
        stages.told(code, fields, 10.0 * number)
        seen.append((stages.number, stages.said))
    assert seen[3:8] == [
        (3, "sign proofs: trial tables"),
        (3, "sign proofs: trial tables"),
        (3, "sign proofs: X1"),
        (3, "sign proofs: previous tables"),
        (4, "push: axis tables and reversals"),
    ]
    assert seen[-1] == (6, "part: after")
    stages.told("P-MEASURE", {"axis": "X1", "phase": "after"}, 200.0)
    assert stages.said == "part: after", "what is done again belongs to the stage under way"
    assert stages.left_s(1e6) == 0.0


def flank(left: float, right: float, spaces: int = 4) -> FlankMap:
    deviation = np.zeros((spaces, 6, 2))
    deviation[:, :3], deviation[:, 3:] = left, right
    return FlankMap(np.linspace(0.1, 1.0, 6), np.array([-1.0, 1.0]), deviation)


def test_a_strip_shows_left_flanks_above_right_on_one_scale() -> None:
    named = [("before", flank(4.0, -2.0)), ("after", flank(0.4, -1.0))]
    plain = [line.plain for line in tooth_strips(named, 30, colours=False)]
    assert plain == ["before ################ 3.16", "after  ---------------- 0.76"]
    assert all(len(line) <= 30 for line in plain)
    console = Console(force_terminal=True, color_system="256", width=40, record=True)
    with console.capture() as shown:
        for line in tooth_strips(named, 30, colours=True):
            console.print(line)
    first, second = shown.get().splitlines()
    assert "\x1b[38;5;160;48;5;147m▀" in first, "surplus red, missing half as far blue"
    assert "\x1b[38;5;231;48;5;189m▀" in second
    assert strip_cells(flank(1.0, 2.0, spaces=9), 4).shape == (2, 4)


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines of a demo that went well, of a closing run's material."""

    def paper(_material: Any, folder: Path, _written: Any) -> Any:
        made = folder / "calibration-report.pdf"
        made.write_bytes(b"%PDF")
        return SimpleNamespace(files=(made,), pdf=made)

    folder = Store(tmp_path).create("demo-grinder", {})
    (folder.path / "tooth-before-after.png").write_bytes(b"png")
    monkeypatch.setattr(report, "material_of", lambda _folder: closing.material())
    monkeypatch.setattr(document, "write_document", paper)
    outcome = SimpleNamespace(run_folder=str(folder.path))
    show_demo_result(outcome, "measured: 11 of 28 set-ups", DemoDuration(61.0, 55.0), LoopClock())
    return [str(folder.path), *capsys.readouterr().out.splitlines()]


def test_a_demo_ends_in_two_strips_and_eight_lines(told: list[str]) -> None:
    path, *lines = told
    assert len(lines) <= 2 + 8
    assert [line.split()[0] for line in lines[:2]] == ["before", "after"]
    assert re.search(r"C1 [\d.]+ → [\d.]+ arcsec", "\n".join(lines))
    assert any(line.startswith("tooth: flank RMS") for line in lines)
    assert f"calibration report: {path}/calibration-report.pdf" in lines
    assert lines[-3].endswith(f"{path}/index.html")
    assert lines[-1].startswith("next: trueflank runs show ")
    assert not any("\x1b" in line for line in lines), "no colours in a pipe"


def test_a_run_s_page_begins_with_picture_figures_and_report(told: list[str]) -> None:
    page = (Path(told[0]) / "index.html").read_text(encoding="utf-8")
    picture, table, report = (
        page.index(one) for one in ("tooth-before-after.png", "<table>", "calibration-report.pdf")
    )
    assert picture < table < report
    assert page.count("<tr>") <= 4
    assert "<tr><th>flank RMS" in page


def test_a_busy_computer_is_told_by_wall_and_work() -> None:
    assert DemoDuration(100.0, 50.0).busy
    assert not DemoDuration(100.0, 80.0).busy
    assert not DemoDuration(60.0, 20.0).busy


@pytest.fixture
def stopping(monkeypatch: pytest.MonkeyPatch) -> None:
    """A demo whose run stops at its second set-up; in the folder "proposed" after its proposal."""

    @contextmanager
    def cell(asked: Any) -> Iterator[None]:
        asked.site.parent.mkdir(parents=True)
        site_file(asked.site.parent, "demo")
        yield

    async def close(site: Any, site_path: Path, *, say: Any, wanted: Any, **_rest: Any) -> Any:
        folder = Store(site_path.parent / "runs").create(site.site.name, {})
        say("P-RUN", folder=str(folder.path))
        if site_path.parent.name == "proposed":
            folder.put(names.PROPOSAL, closing.proposal())
        for number in (1, 2):
            say("P-SETUP-PLAN", setup=wanted[number - 1], number=number, total=len(wanted))
        raise CaptureError("E-CAP-UNSTABLE", "calibrator", scatter="9", limit="1", unit="um")

    monkeypatch.setattr(demo, "cell_process", cell)
    monkeypatch.setattr(demo, "run_self_test", lambda *_given, **_asked: None)
    monkeypatch.setattr(demo, "warn_if_busy", lambda: None)
    monkeypatch.setattr(complete_run, "close_site", close)


@pytest.mark.parametrize(("folder", "goes_on"), [("fresh", True), ("proposed", False)])
def test_a_demo_that_stops_names_stage_folder_and_the_line_to_go_on(
    tmp_path: Path, stopping: None, folder: str, goes_on: bool
) -> None:
    place = tmp_path / folder
    done = CliRunner().invoke(app, ["demo", "--folder", str(place), "--seed", "7"])
    run = RunFolder(next((place / "runs").glob("*-demo-grinder-*")))
    assert done.exit_code != 0
    assert re.search(r"stopped in stage 1 of \d, measure: ", done.output)
    assert f"what was done lies in {run.path}" in done.output
    line = f"next: trueflank demo --folder {place} --seed 7"
    assert (f"{line} --resume {run.run_id}" if goes_on else f"{line}\n") in done.output
    again = CliRunner().invoke(app, ["demo", "--folder", str(place), "--seed", "7", "--resume", run.run_id])
    assert ("E-DEMO-RESUME" in str(again.exception) + again.output) == (not goes_on)
