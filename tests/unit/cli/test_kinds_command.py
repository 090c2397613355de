"""evaluate --kind as a user types it: figures of made files that are known beforehand, pictures, refusals."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app

RUNNER = CliRunner()
KEPT = Path(__file__).parents[2] / "golden" / "older" / "runs"
ARCSEC = math.pi / 648_000.0
PLACES = tuple(range(0, 401, 50))
ANGLES = tuple(range(0, 360, 15))


def table(
    path: Path, over: str, of: str, places: tuple[int, ...], value: Callable[[float, str, int], float], ways="+-"
):
    rows = [f"target_{over},direction,repetition,deviation_{of}"]
    rows += [f"{at},{way},{turn},{value(at, way, turn):.6f}" for turn in (1, 2, 3) for way in ways for at in places]
    path.write_text("\n".join(rows) + "\n")
    return path


def answer(*words: object) -> dict[str, float]:
    result = RUNNER.invoke(app, ["evaluate", *map(str, words), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    found = json.loads(result.output)
    return {one["name"]: one["value"] for one in found["figures"]}


def refused(*words: object) -> str:
    result = RUNNER.invoke(app, ["evaluate", *map(str, words)])
    assert isinstance(result.exception, TrueflankError), result.output
    assert "<" not in result.exception.what
    return result.exception.code


def test_straightness_about_three_lines(tmp_path: Path) -> None:
    # a tent of 4 um on a slope of 10 um/m: its zone is 4, the end-point line leaves the whole tent
    tent = table(tmp_path / "y.csv", "mm", "um", PLACES, lambda x, way, turn: 4.0 - abs(x - 200) / 50.0 + 0.01 * x)
    picture = tmp_path / "y.svg"
    found = answer(tent, "--kind", "straightness", "--plot", picture)
    assert found["y.csv minimum-zone"] == pytest.approx(4.0)
    assert found["y.csv end-point"] == pytest.approx(4.0)
    assert found["y.csv slope taken off"] == pytest.approx(1e-5 / ARCSEC)
    assert picture.read_text().startswith("<?xml")


def test_squareness_and_its_reversal(tmp_path: Path) -> None:
    def run(name: str, slope_urad: float) -> Path:
        return table(tmp_path / name, "mm", "um", PLACES, lambda x, way, turn: slope_urad * 1e-3 * x)

    first, second = run("x.csv", -20.0), run("y.csv", -10.0)
    assert answer(first, second, "--kind", "squareness", "--senses", "in,in")["EC0Y"] == pytest.approx(30e-6 / ARCSEC)
    assert answer(first, second, "--kind", "squareness", "--plane", "XZ", "--senses", "in,in")["EB0Z"] == pytest.approx(
        -30e-6 / ARCSEC
    )
    # the square's own +8 urad shows in the first pair with one sign, turned over with the other
    reversed_pair = run("xr.csv", -28.0), run("yr.csv", -18.0)
    both = answer(first, second, *reversed_pair, "--kind", "squareness", "--senses", "in,in")
    assert both["EC0Y"] == pytest.approx(38e-6 / ARCSEC)
    apart = answer(first, second, "--kind", "parallelism", "--senses", "same")
    assert apart["parallelism"] == pytest.approx(-10e-6 / ARCSEC)
    assert apart["over 400 mm"] == pytest.approx(4.0)


FIRST = (-0.3, 0.9, 1.5, 2.5, 2.9, 3.6, 4.2, 5.1, 5.9, 7.2)
SECOND = (-0.5, -1.2, -2.5, -3.8, -4.0, -4.8, -5.9, -6.2, -7.4, -8.8)


def test_the_printed_example_of_a_maker_by_its_senses_and_by_others(tmp_path: Path) -> None:
    # HP 5528A user's guide, section 21: readings in um at 0 to 0.9 m and 0 to 0.45 m, optical square without error.
    def run(name: str, step: int, readings: tuple[float, ...]) -> Path:
        rows = [f"{step * at},+,1,{value}" for at, value in enumerate(readings)]
        (tmp_path / name).write_text("\n".join(("target_mm,direction,repetition,deviation_um", *rows, "")))
        return tmp_path / name

    pair = run("x.csv", 100, FIRST), run("z.csv", 50, SECOND)
    assert refused(*pair, "--kind", "squareness") == "E-KIND-SENSES"
    assert refused(*pair, "--kind", "squareness", "--senses", "in") == "E-KIND-SENSES"
    assert refused(*pair, "--kind", "parallelism") == "E-KIND-SIDES"
    maker = answer(*pair, "--kind", "squareness", "--senses", "in,out")
    assert maker["EC0Y"] == pytest.approx(-5.17, abs=0.01)  # printed -5.2
    assert maker["EC0Y by end points"] == pytest.approx(-5.52, abs=0.01)  # printed -5.5
    assert answer(*pair, "--kind", "squareness", "--senses", "in,in")["EC0Y"] == pytest.approx(2.01, abs=0.01)
    # A travel towards the corner turns the slope once more; the square's own angle adds.
    turned = answer(*pair, "--kind", "squareness", "--senses", "in,in-corner", "--artefact", "1.5")
    assert turned["EC0Y"] == pytest.approx(-5.17 + 1.5, abs=0.01)
    told = RUNNER.invoke(
        app, ["evaluate", *map(str, pair), "--kind", "squareness", "--plane", "XZ", "--senses", "in,in"]
    )
    assert "the angle between +X and +Z is larger than 90 deg by 2.01 arcsec: Z leans to -X" in " ".join(
        told.output.split()
    )


def test_angles_over_millimetres(tmp_path: Path) -> None:
    pitch = table(
        tmp_path / "p.csv", "mm", "arcsec", PLACES, lambda x, way, turn: x / 100.0 + (0.5 if way == "+" else 0)
    )
    found = answer(pitch, "--kind", "angular", "--axis", "x", "--angle", "pitch")
    assert found["p.csv B"] == pytest.approx(0.5)
    assert found["p.csv M"] == pytest.approx(4.0)
    assert refused(pitch, "--kind", "angular", "--axis", "Z", "--angle", "pitch") == "E-EVAL-ANGULAR"
    assert refused(pitch, "--kind", "straightness") == "E-FILE-LINE"


def test_reversal_that_depends_on_the_position(tmp_path: Path) -> None:
    lag = table(tmp_path / "r.csv", "mm", "um", PLACES, lambda x, way, turn: -2.0 - x / 200.0 if way == "+" else 0.0)
    found = answer(lag, "--kind", "reversal", "--plot", tmp_path / "r.png")
    assert found["r.csv B"] == pytest.approx(4.0)
    assert found["r.csv mean"] == pytest.approx(-3.0)
    one_way = table(tmp_path / "one.csv", "mm", "um", PLACES, lambda x, way, turn: 1.0, ways="+")
    assert refused(one_way, "--kind", "reversal") == "E-KIND-ONE-WAY"


def test_a_turning_axis(tmp_path: Path) -> None:
    def radial(angle: float, way: str, turn: int) -> float:
        return 5.0 * math.cos(math.radians(angle - 30)) + 1.0 * math.cos(math.radians(3 * angle)) + 0.1 * turn

    runout = table(tmp_path / "c.csv", "deg", "um", ANGLES, radial, ways="+")
    found = answer(runout, "--kind", "rotary-motion", "--plot", tmp_path / "c.png")
    assert found["once per turn"] == pytest.approx(5.0)
    assert found["synchronous"] == pytest.approx(2.0)
    assert found["asynchronous"] == pytest.approx(0.2)
    assert refused(runout, runout, "--kind", "rotary-motion", "--motion", "tilt") == "E-KIND-DISTANCE"
    assert refused(runout, "--kind", "rotary-motion", "--motion", "odd") == "E-KIND-MOTION"
    wave = table(tmp_path / "w.csv", "deg", "arcsec", ANGLES, lambda at, way, turn: 3 * math.sin(math.radians(4 * at)))
    spectrum = answer(wave, "--kind", "harmonics", "--order", 1, "--order", 4)
    assert spectrum["order 4 amplitude"] == pytest.approx(3.0, abs=1e-5)
    assert spectrum["order 1 amplitude"] == pytest.approx(0.0, abs=1e-5)
    assert spectrum["range that is left"] == pytest.approx(0.0, abs=1e-5)


def test_the_lean_of_a_rotary_axis_is_free_of_the_bars_own(tmp_path: Path) -> None:
    def run(name: str, slope_urad: float) -> Path:
        return table(tmp_path / name, "mm", "um", PLACES, lambda x, way, turn: slope_urad * 1e-3 * x)

    found = answer(run("a.csv", 30.0), run("b.csv", 10.0), "--kind", "axis-location", "--axis", "C")
    assert found["EB0C"] == pytest.approx(20e-6 / ARCSEC)
    assert found["the bar's own lean along X"] == pytest.approx(10e-6 / ARCSEC)


def test_what_cannot_be_evaluated_is_said(tmp_path: Path) -> None:
    plain = table(tmp_path / "x.csv", "mm", "um", PLACES, lambda x, way, turn: 0.01 * x)
    assert refused(plain, "--kind", "odd") == "E-KIND-NAME"
    assert refused(plain, "--kind", "squareness") == "E-KIND-FILES"
    assert refused(plain, "--kind", "harmonics") == "E-KIND-UNIT"
    assert refused("--kind", "straightness") == "E-CLI-NO-FILES"


def test_a_picture_changes_no_figure_and_no_uncertainty(tmp_path: Path) -> None:
    """Drawn or not, positioning is judged with the whole budget of its file."""
    made = table(tmp_path / "x.csv", "mm", "um", PLACES, lambda x, way, turn: 0.02 * x + 0.1 * turn)
    plain = RUNNER.invoke(app, ["evaluate", str(made), "--json"], catch_exceptions=False)
    drawn = RUNNER.invoke(app, ["evaluate", str(made), "--plot", str(tmp_path / "x.svg"), "--json"])
    assert drawn.output == plain.output
    assert "<svg" in (tmp_path / "x.svg").read_text()
    (alone,) = json.loads(plain.output)
    assert alone["U"]["M"] > 1.0
    older = RUNNER.invoke(app, ["evaluate", str(made), "--standard", "1997", "--plot", str(tmp_path / "y.png")])
    assert "ISO 230-2:1997" in older.output
    assert "picture:" in older.output


def test_a_run_is_evaluated_by_its_short_name_axis_and_phase(tmp_path: Path) -> None:
    """The harmonics of a stored rotary axis are those of its capture, `latest` or by a beginning of the id."""
    shutil.copytree(KEPT, tmp_path / "runs")
    here = ("--store", tmp_path / "runs", "--axis", "C1", "--phase")
    capture = next((tmp_path / "runs").glob("*/capture-C1-before.json"))
    run = capture.parent.name
    before = answer(run[:20], *here, "before", "--kind", "harmonics")
    after = answer(run[:20], *here, "after", "--kind", "harmonics", "--plot", tmp_path / "c.svg")
    assert before["range"] > 3.0 * after["range"]
    assert (
        answer(run[:20], "--store", tmp_path / "runs", "--axis", "C", "--phase", "after", "--kind", "harmonics")
        == after
    )
    (latest,) = (one.name for one in (tmp_path / "runs").glob("*-import-*"))
    found = RUNNER.invoke(app, ["evaluate", "latest", "--store", str(tmp_path / "runs"), "--json"])
    assert latest in json.loads(found.stdout)[0]["file"]
    assert latest in found.stderr
    assert refused(run[:20], "--store", tmp_path / "runs", "--kind", "harmonics") == "E-KIND-FILES"
    assert refused("nonsense", *here, "before", "--kind", "harmonics") == "E-STORE-RUN"


def test_limits_of_any_kind_are_decided(tmp_path: Path) -> None:
    made = table(tmp_path / "s.csv", "mm", "um", PLACES, lambda x, way, turn: 3.0 * (x == 200) + 0.1 * turn)
    kind = ("--kind", "straightness")
    found = RUNNER.invoke(app, ["evaluate", str(made), *kind, "--limit", "lsq=1"])
    assert "s.csv lsq <= 1 µm: NOT DECIDABLE (U of s.csv lsq is not known)" in found.output
    assert found.exit_code == 21
    both = table(tmp_path / "r.csv", "mm", "um", PLACES, lambda x, way, turn: (6.0 if way == "+" else 0.0) + 0.1 * turn)
    for limit, code in (("9", 0), ("2", 13)):
        told = RUNNER.invoke(app, ["evaluate", str(both), "--kind", "reversal", "--limit", f"B={limit}", "--json"])
        assert told.exit_code == code
        (one,) = json.loads(told.output)["verdicts"]
        assert (one["parameter"], one["limit"]) == ("r.csv B", float(limit))
    assert refused(made, *kind, "--limit", "A=1") == "E-EVAL-LIMIT-NAME"


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_a_picture_of_what_a_double_measured_bears_the_stamp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    words: list[str] = []
    text = Figure.text

    def heard(figure: Figure, x: float, y: float, word: str, **more: object) -> object:
        words.append(word)
        return text(figure, x, y, word, **more)

    monkeypatch.setattr(Figure, "text", heard)
    run = table(tmp_path / "x.csv", "mm", "um", PLACES, lambda x, way, turn: 0.01 * x)
    picture = tmp_path / f"x.{ending}"
    RUNNER.invoke(app, ["evaluate", str(run), "--plot", str(picture)], catch_exceptions=False)
    assert "SIMULATED" not in words
    run.write_text("# TITLE: EXX SIMULATED\n" + run.read_text())
    told = RUNNER.invoke(app, ["evaluate", str(run), "--plot", str(picture)], catch_exceptions=False)
    assert "SIMULATED" in words
    assert "SIMULATED: a simulated device took part" in told.output


def test_a_site_whose_limits_no_kind_decides_is_refused_and_never_ignored(tmp_path: Path) -> None:
    found = table(tmp_path / "a.csv", "mm", "um", PLACES, lambda at, way, turn: 0.001 * at)
    site = tmp_path / "site.toml"
    site.write_text("")
    assert refused(found, "--kind", "straightness", "--site", site) == "E-CLI-SITE-KIND"
