"""The paper's figures: what each panel shows against closed forms written here, and all of them into one folder."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure
from typer.testing import CliRunner

from gateway.cli import app
from gateway.gear.flank import FlankGrid
from gateway.sensitivity.screening import sigma_intervals
from gateway.study import paper
from gateway.study.calculate import Study
from gateway.study.export import space_angles
from gateway.study.inputs import load_errors, load_gear
from gateway.study.machine import grinding_of
from gateway.study.plots.charts import new_sheet, screening_bars
from gateway.study.plots.laboratory import Traces
from gateway.study.relative_errors import relative_sweep

EXAMPLES = Path(__file__).parents[3] / "examples"
GEAR, ERRORS = EXAMPLES / "gears" / "rv-40e-like.toml", EXAMPLES / "errors" / "seeded-machine.toml"
E, STEP, TILT = 160.0, 0.005, float(np.deg2rad(0.01))


def _near(one: Study) -> FlankGrid:
    gear = one.grinding.gear
    return FlankGrid(gear, np.zeros(1), space_angles(gear, 45), np.linspace(-5.0, 5.0, 5))


def test_figure_3_shows_what_each_error_does_to_a_spur_flank(found: Study) -> None:
    """e = A n_x + B n_y + G h at height z, by hand; x = -E is where X stands, so ECZ has the lever E - x."""
    grid = _near(found)
    s, z = grid.section, grid.zs
    x, y, nx, ny = s.x, s.y, s.nx, s.ny
    h, none = x * ny - y * nx, np.zeros_like(x * z)
    wheel = (x - E) * ny - y * nx  # lever of a turn about the wheel's own z
    six = {"dx": STEP * nx, "dy": STEP * ny, "dz": none, "ea": none, "eb": none, "ec": TILT * wheel}
    for name, e in paper.relative_cases(found.grinding, grid):
        np.testing.assert_allclose(e, np.broadcast_to(six[name], none.shape), atol=6e-5, err_msg=name)
    wanted = {
        "EXX": -STEP * nx, "EXZ": STEP * nx, "EXC": -STEP * nx, "EYX": -STEP * ny, "EYZ": STEP * ny,
        "EYC": -STEP * ny, "EZX": none, "EZZ": none, "EZC": none, "EAZ": none, "EBZ": none,
        "EAX": TILT * z * ny, "EAC": TILT * z * ny, "EBX": -TILT * z * nx, "EBC": -TILT * z * nx,
        "ECX": -TILT * h, "ECC": -TILT * h, "ECZ": TILT * wheel,
        "B0Z": TILT * z * nx, "A0C": TILT * z * ny, "B0C": -TILT * z * nx,
    }  # fmt: skip
    cases = dict(paper.error_cases(found.grinding, grid, found.names))
    assert set(cases) == set(wanted)
    for name, e in cases.items():
        np.testing.assert_allclose(e, np.broadcast_to(wanted[name], none.shape), atol=6e-5, err_msg=name)


def test_figure_5_has_both_measures_with_their_intervals(found: Study) -> None:
    rows = paper.screening_rows(found)
    effects = found.equal.effects[..., 0]
    for row in rows:
        own = effects[:, found.names.index(str(row["name"]))] * 1000.0
        assert row["mu_star_um"] == pytest.approx(np.mean(np.abs(own)))
        assert row["sigma_um"] == pytest.approx(np.std(own, ddof=1))
        assert row["mu_star_low_um"] <= row["mu_star_um"] <= row["mu_star_high_um"]
    assert sum(row["sigma_share"] for row in rows) == pytest.approx(1.0)
    sheet = new_sheet((9.0, 5.0), lambda figure: screening_bars(figure, rows, "RMS"))
    bars = [one.get_width() for one in sheet.axes[0].patches]
    assert bars == pytest.approx([row["mu_star_um"] / sum(one["mu_star_um"] for one in rows) for row in rows])


def test_the_interval_of_sigma_holds_that_of_normal_effects() -> None:
    effects = 2.0 * np.random.default_rng(3).normal(size=(400, 5))
    low, high = sigma_intervals(effects, seed=2)
    own = effects.std(axis=0, ddof=1)
    assert np.all((low < own) & (own < high))
    np.testing.assert_allclose(high - low, 0.28, atol=0.06)  # chi-square of 400 values: 2 -+ 0.14


def test_traces_have_the_line_and_values_of_a_laboratory() -> None:
    along = np.linspace(0.0, 4.0, 101)
    wave = 0.001 * np.sin(2.0 * np.pi * along)  # four whole waves
    traces = Traces.of((0,), along, (0.02 + 0.0005 * along + wave)[None])
    plain = Traces.of((0,), along, (0.02 + 0.0005 * along)[None])
    assert plain.values.f_H[0] == pytest.approx(0.002)
    assert plain.values.F[0] == pytest.approx(0.002)
    assert traces.values.f_f[0] == pytest.approx(0.002, rel=0.4)  # the wave, less what the line takes of it
    np.testing.assert_allclose(plain.level, plain.lines, atol=1e-15)


def test_figures_11_and_12_have_four_spaces_and_the_charts_of_table_2(found: Study) -> None:
    before = paper.chart_of(found, found.grinding, found.before, "before")
    assert before.profile[0].spaces == (0, 10, 20, 29)
    assert before.profile[0].along[0] < before.profile[0].along[-1] < 5.81
    rows = {name: (old, new) for name, old, new, _ in paper.result_rows(found)}
    largest = max(float(np.max(one.values.F)) for one in before.profile) * 1000.0
    assert 0.5 * float(rows["profile F_a"][0]) < largest < 1.3 * float(rows["profile F_a"][0])
    assert float(rows["RMS normal deviation"][1]) < float(rows["RMS normal deviation"][0])


def test_relative_errors_of_a_study_are_those_of_a_constant_shift() -> None:
    plain = load_errors(EXAMPLES / "errors" / "equal-steps.toml")
    only = plain.model_copy(update={"errors": {"EXZ": 5.0}})
    sweep = relative_sweep(grinding_of(load_gear(GEAR), only))
    turn = np.deg2rad(sweep.turn)[:, None]
    # The work turns under the wheel: a shift along X is told in the turned work.
    np.testing.assert_allclose(sweep.values["dx"], np.broadcast_to(5.0 * np.cos(turn), (39, 21)), atol=1e-9)
    np.testing.assert_allclose(sweep.values["dy"], np.broadcast_to(5.0 * np.sin(turn), (39, 21)), atol=1e-9)
    assert max(sweep.missed.values()) < 1e-9


def test_the_command_prints_and_draws_the_relative_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(app, ["study", str(GEAR), str(ERRORS), "--relative", "--json"])
    assert told.exit_code == 0, told.output
    shown = json.loads(told.output)
    assert np.shape(shown["dx_um"]) == (39, 21)
    for name in shown["pictures"]:
        pixels = image.imread(tmp_path / name)
        assert float(np.mean(pixels[..., :3].min(axis=-1) < 0.9)) > 0.005, "something is drawn"


def test_the_paper_is_not_asked_with_the_relative_errors_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(app, ["study", str(GEAR), str(ERRORS), "--relative", "--paper", "paper"])
    assert told.exit_code == 2
    assert "--paper" in told.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_one_command_makes_the_whole_paper(tmp_path: Path) -> None:
    folder = tmp_path / "paper"
    told = CliRunner().invoke(app, ["study", str(GEAR), str(ERRORS), "--trajectories", "4", "--paper", str(folder)])
    assert told.exit_code == 0, told.output
    made = {path.name for path in folder.iterdir()}
    page = (folder / "paper.md").read_text(encoding="utf-8")
    pictures = {name for name in made if name.endswith(".png")}
    assert len(pictures) == 13
    assert {name for name in pictures if f"]({name})" not in page} == set()
    assert {"table-1.csv", "table-2.csv", "figure-5.csv", "gear.csv", "gear.dxf", "wheel.csv"} <= made
    for name in pictures:
        assert float(np.mean(image.imread(folder / name)[..., :3].min(axis=-1) < 0.9)) > 0.005, name
    with (folder / "table-2.csv").open(encoding="utf-8") as file:
        assert all(float(row["after"]) < float(row["before"]) for row in csv.DictReader(file))


def test_every_sheet_of_the_paper_has_its_caption(found: Study) -> None:
    sheets = paper.sheets(found)
    numbered = {one.name.split("-")[1] for one in sheets if one.name.startswith("figure")}
    assert numbered == {"3", "4", "5", "7", "8", "11", "12"}
    assert all(one.said.endswith(".") for one in sheets)
    drawn = Figure(figsize=(9.0, 11.0))
    next(one for one in sheets if one.name == "figure-11-before").paint(drawn)
    texts = {one.get_text() for panel in drawn.axes for one in panel.texts}
    assert any("space 10" in one and "f_Ha" in one for one in texts)
