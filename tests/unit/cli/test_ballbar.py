"""Circular tests: causes and figures against made-up circles written here from the printed definitions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app

RADIUS, FEED = 150.0, 1000.0
TRUTH = {
    "scale mismatch": 40.0,  # ppm
    "squareness": -25.0,  # um/m
    "servo mismatch": 0.35,  # ms
    "backlash first axis": -4.0,
    "backlash second axis": -2.5,
}


def path(sense: int, angles: Any, truth: dict[str, float], *, spikes: bool = True) -> Any:
    """Outward deviation, um, by moving the point itself: each axis gets its error, then the distance is taken."""
    t = np.deg2rad(angles)
    x, y = RADIUS * np.cos(t), RADIUS * np.sin(t)
    vx, vy = -sense * np.sin(t) * FEED / 60.0, sense * np.cos(t) * FEED / 60.0  # mm/s
    sx = sy = 0.5e-6 * truth.get("scale mismatch", 0.0)
    dx = sx * x - 1e-3 * truth.get("lag x", 0.0) * vx
    dy = -sy * y - 1e-3 * truth.get("lag y", 0.0) * vy
    dx = dx + 0.5e-3 * truth.get("backlash first axis", 0.0) * np.sign(vx)
    dy = dy + 0.5e-3 * truth.get("backlash second axis", 0.0) * np.sign(vy)
    dx = dx - 1e-6 * truth.get("squareness", 0.0) * y  # angle above 90 deg: the second axis leans to minus first
    dx = dx + 1e-3 * truth.get("cyclic", 0.0) * np.sin(2 * np.pi * x / 10.0)
    r = np.hypot(x + dx + 0.011, y + dy - 0.007)
    found = 1e3 * (r - RADIUS)
    if spikes:
        since = (sense * (np.asarray(angles) - 90.0)) % 360.0  # the second axis turns round at its + end
        found = found + truth.get("spike", 0.0) * np.exp(-since / 3.0)
    return found


def lags(truth: dict[str, float]) -> dict[str, float]:
    """A servo mismatch in ms as the lags of the axes: with s (v/2)(tx - ty) sin 2t outwards."""
    return truth | {"lag x": 0.0, "lag y": -truth["servo mismatch"]}


def table(
    name: str, senses: tuple[int, ...], truth: dict[str, float], *, noise: float = 0.15, span: float = 400.0
) -> Path:
    """Angle, measured radius and sense; 20 deg of overshoot at both ends."""
    rng = np.random.default_rng(4)
    lines = [f"# Radius mm,{RADIUS}", f"# Feed mm/min,{FEED}", "# Plane,XY", "angle_deg,radius_mm,sense"]
    for sense in senses:
        angles = sense * np.arange(-20.0, span - 20.0, 0.5)
        radial = path(sense, angles, truth) + rng.normal(0.0, noise, angles.size)
        word = "ccw" if sense > 0 else "cw"
        lines += [f"{a:.3f},{RADIUS + d * 1e-3:.6f},{word}" for a, d in zip(angles, radial, strict=True)]
    Path(name).write_text("\n".join([*lines, ""]), encoding="utf-8")
    return Path(name)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test's circles lie in a folder of its own."""
    monkeypatch.chdir(tmp_path)


def told(*words: str) -> Any:
    result = CliRunner().invoke(app, ["evaluate", *words, "--kind", "ballbar", "--json"])
    assert result.exit_code == 0, (result.output, result.exception)
    return json.loads(result.stdout)


def figures(found: Any) -> dict[str, tuple[float, float | None]]:
    return {one["name"]: (one["value"], one["U"]) for one in found["figures"]}


def code(*words: str) -> str:
    result = CliRunner().invoke(app, ["evaluate", *words, "--kind", "ballbar", "--json"])
    assert isinstance(result.exception, TrueflankError), result.output
    return result.exception.code


def test_both_senses_separate_every_cause_within_its_uncertainty() -> None:
    truth = lags(TRUTH) | {"spike": 3.0, "cyclic": 0.8}
    table("both.csv", (1, -1), truth)
    got = figures(told("both.csv", "--column", "pitch_first_mm=10"))
    for name, wanted in {**TRUTH, "reversal spike second axis +": 3.0, "cyclic first axis": 0.8}.items():
        value, U = got[name]
        assert U is not None
        assert abs(value - wanted) <= 1.5 * U + 0.02 * abs(wanted), (name, value, U)
        assert abs(wanted) > 4.0 * U, (name, U)
    for name in ("reversal spike first axis +", "reversal spike first axis -", "reversal spike second axis -"):
        value, U = got[name]
        assert U is not None
        assert abs(value) <= 2.0 * U
    # By the letter of the error model: -25 um/m is -5.157 arcsec.
    assert got["EC0Y"][0] == pytest.approx(-5.157, abs=0.1)


def test_figures_of_the_circle_are_those_of_its_definition() -> None:
    # Mismatch alone bends the circle by R (sx - sy) / 2 cos 2t: G = R (sx - sy) = 6 um, equal in both senses.
    table("oval.csv", (1, -1), {"scale mismatch": 40.0}, noise=0.0)
    got = figures(told("oval.csv"))
    assert got["G ccw"][0] == pytest.approx(6.0, abs=0.01)
    assert got["G(b)"][0] == pytest.approx(6.0, abs=0.01)
    assert got["H"][0] == pytest.approx(0.0, abs=0.01)
    # A constant lost motion of one axis: the senses differ by it where that axis stands across: H = |B|.
    table("lost.csv", (1, -1), {"backlash first axis": -5.0}, noise=0.0)
    assert figures(told("lost.csv"))["H"][0] == pytest.approx(5.0, rel=0.02)


def test_one_sense_alone_states_the_sum_and_says_so() -> None:
    truth = lags({"squareness": -25.0, "servo mismatch": 0.35})
    table("ccw.csv", (1,), truth)
    found = told("ccw.csv")
    got = figures(found)
    assert "squareness" not in got
    assert "EC0Y" not in got
    assert "servo mismatch" not in got
    # -(R/2) e + (v/2) t = -(R/2) e': 150 mm and 16.67 mm/s.
    together = -25.0 - FEED / 60.0 * 0.35 / (RADIUS * 1e-3)
    assert got["squareness and servo mismatch"][0] == pytest.approx(together, rel=0.02)
    assert any("one sense alone cannot" in note for note in found["notes"])
    # The other sense in a second file: both are told.
    table("cw.csv", (-1,), truth)
    both = figures(told("ccw.csv", "cw.csv"))
    assert both["squareness"][0] == pytest.approx(-25.0, rel=0.02)
    assert both["servo mismatch"][0] == pytest.approx(0.35, rel=0.05)
    assert code("ccw.csv", "ccw.csv") == "E-CIRCLE-FILES"


def test_an_arc_has_no_circular_deviation_and_says_so() -> None:
    table("arc.csv", (1, -1), lags(TRUTH), span=260.0)
    found = told("arc.csv")
    got = figures(found)
    assert not any(name.startswith(("G", "H")) for name in got)
    assert any("less than a full turn" in note for note in found["notes"])
    assert abs(got["squareness"][0] + 25.0) <= (got["squareness"][1] or 0.0) * 1.5
    table("short.csv", (1,), {}, span=45.0)
    assert code("short.csv") == "E-CIRCLE-ARC"


def test_samples_over_time_and_of_two_positions_give_the_same_circle() -> None:
    angles = np.arange(0.0, 360.0, 0.5)
    radial = path(1, angles, {"scale mismatch": 40.0})
    seconds = np.deg2rad(angles) * RADIUS / (FEED / 60.0)
    rows = [f"{t:.6f};{d:.4f}".replace(".", ",") for t, d in zip(seconds, radial, strict=True)]
    Path("time.csv").write_text("\n".join(("Zeit [s];Abweichung [um]", *rows, "")), encoding="utf-8")
    said = [w for one in ("radius_mm=150", "feed_mm_min=1000", "start_deg=0", "way=ccw") for w in ("--column", one)]
    assert figures(told("time.csv", *said))["scale mismatch"][0] == pytest.approx(40.0, rel=0.01)
    assert code("time.csv", *said[:-2]) == "E-CIRCLE-SENSE"
    assert code("time.csv", *said[2:]) == "E-CIRCLE-STATED"
    # Where the pass begins is demanded: an eighth of a turn away, the same samples are squareness in place of scale
    assert code("time.csv", *said[:4], *said[6:]) == "E-CIRCLE-STATED"
    turned = [*said[:4], "--column", "start_deg=45", *said[6:]]
    assert abs(figures(told("time.csv", *turned))["scale mismatch"][0]) < 1.0
    t, r = np.deg2rad(angles), RADIUS + radial * 1e-3
    rows = [f"{a:.6f},{b:.6f}" for a, b in zip(r * np.cos(t), r * np.sin(t), strict=True)]
    Path("grid.csv").write_text("\n".join(("# Radius mm,150", "x_mm,y_mm", *rows, "")), encoding="utf-8")
    assert figures(told("grid.csv"))["scale mismatch"][0] == pytest.approx(40.0, rel=0.01)
    Path("bare.csv").write_text("\n".join(("angle,radius", *rows, "")), encoding="utf-8")
    assert code("bare.csv") == "E-CIRCLE-UNIT"
    Path("none.csv").write_text("\n".join(("this,that", *rows, "")), encoding="utf-8")
    assert code("none.csv") == "E-CIRCLE-HEADING"


def test_a_makers_file_gives_its_own_figures_and_no_entity_is_read() -> None:
    text = (
        '<?xml version="1.0"?><R><TEST><PLANE TEST_PLANE="XY"/><MACHINE_TESTED NAME="Mill 7"/>'
        '<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM">8.3</FEATURE>'
        '<FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS">-12.5</FEATURE>'
        '<FEATURE NAME="AF_SCALE" DT="UT_LENGTH_MM">0.004</FEATURE></TEST></R>'
    )
    Path("t.b5r").write_text(text, encoding="utf-8")
    found = told("t.b5r")
    got = {one["name"]: (one["value"], one["unit"]) for one in found["figures"]}
    assert got == {
        "AF_CIRCULARITY": (8.3, "um"),
        "AF_SQUARENESS": (-12.5, "um/m"),
        "AF_SCALE": (pytest.approx(4.0), "um"),
    }
    assert found["standard"] == "the maker's program"
    assert any("maker's own result figures" in note for note in found["notes"])
    assert code("t.b5r", "--plot", "p.png") == "E-CIRCLE-PLOT"
    bomb = '<!DOCTYPE R [<!ENTITY a "b">]>' + text.partition("?>")[2].replace("8.3", "&a;")
    Path("t.b5r").write_text(bomb, encoding="utf-8")
    assert code("t.b5r") == "E-FILE-XML-DTD"


def test_the_picture_shows_both_senses_and_its_scale() -> None:
    table("both.csv", (1, -1), lags(TRUTH))
    told("both.csv", "--plot", "p.svg", "--limit", "H=50")
    drawn = Path("p.svg").read_text(encoding="utf-8")
    assert len(drawn) > 20_000
    refused = CliRunner().invoke(app, ["evaluate", "both.csv", "--kind", "ballbar", "--limit", "H=1"])
    assert refused.exit_code == 13
    assert "the angle between the positive axes is smaller than 90 deg" in " ".join(refused.output.split())
