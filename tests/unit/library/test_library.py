"""The library as a scientist uses it: its page runs, its numbers are the commands' numbers, wrong input is said."""

from __future__ import annotations

import ast
import io
import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image
from typer.testing import CliRunner

import trueflank as tf
from gateway.cli import app

ROOT = Path(__file__).parents[3]
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)
GEAR = ROOT / "examples" / "gears" / "rv-40e-like.toml"
ERRORS = ROOT / "examples" / "errors" / "seeded-machine.toml"
FILE = ROOT / "tests" / "golden" / "files" / "basic.rtl"


def _blocks() -> list[tuple[str, str]]:
    """Every Python block of README and handbook, with its page."""
    pages = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    return [(page.name, block) for page in pages for block in BLOCK.findall(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize(("page", "block"), _blocks())
def test_every_python_block_of_the_handbook_runs(page: str, block: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(block, page, "exec"), {})  # noqa: S102  the page is ours


def _notebooks() -> list[Any]:
    """Every notebook by its name; that of the paper works out a whole study."""
    found = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
    long = {"the-paper": pytest.mark.long}
    return [pytest.param(one, id=one.stem, marks=long.get(one.stem, ())) for one in found]


def _run(source: str, name: str, known: dict[str, object]) -> object:
    """Run a cell; what its last line shows, if that is an expression."""
    tree = ast.parse(source, name)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), known)  # noqa: S102  ours
    return eval(compile(ast.Expression(last.value), name, "eval"), known) if last else None  # noqa: S307  ours


@pytest.mark.parametrize("notebook", _notebooks())
def test_every_notebook_runs_from_above_to_below(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("examples", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    known: dict[str, object] = {}
    for cell in (one for one in cells if one["cell_type"] == "code"):
        assert cell["outputs"] == [], "stored without what it printed"
        shown = _run("".join(cell["source"]), f"{notebook.name}:{cell['id']}", known)
        if hasattr(shown, "_repr_png_"):
            pixels = image.imread(io.BytesIO(shown._repr_png_()))
            assert float(np.mean(pixels[..., :3].min(axis=-1) < 0.9)) > 0.005, f"{cell['id']} shows an empty picture"
    pages = list(tmp_path.glob("out/report.html"))
    assert len(pages) == (notebook.stem == "from-a-file-to-a-report")
    assert all("B" in page.read_text(encoding="utf-8") for page in pages)


def test_it_is_the_commands_numbers() -> None:
    told = CliRunner().invoke(app, ["study", str(GEAR), str(ERRORS), "--trajectories", "2", "--json"])
    shown = json.loads(told.output)
    machine, gear = tf.Machine.load(ERRORS), tf.Gear.load(GEAR)
    assert tf.flank(machine, gear).rms == pytest.approx(shown["by_tooth"]["before"]["RMS normal deviation"])
    best = tf.correct(machine, gear)
    assert json.loads(json.dumps(best.to_dict()["tables"])) == shown["tables"]
    assert best.rms_after == pytest.approx(shown["by_tooth"]["after"]["RMS normal deviation"])
    told = CliRunner().invoke(app, ["evaluate", str(FILE), "--json"])
    figures = tf.evaluate(tf.read(FILE))
    assert {name: figures[name] for name in "EBM"} == {name: json.loads(told.output)[0][name] for name in "EBM"}


def test_the_three_orders_agree_on_small_errors_and_a_constant_turns_out() -> None:
    gear = tf.Gear.of(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, centre_distance=160.0)
    bow = tf.Machine({"EYX": ([-250.0, -160.0, -70.0], [0.0, 5.0, 0.0])})
    first, second, exact = (tf.flank(bow, gear, order=order) for order in ("first", "second", "exact"))
    np.testing.assert_allclose(first.deviation, exact.deviation, atol=5e-3)
    np.testing.assert_allclose(second.deviation, exact.deviation, atol=1e-4)
    assert tf.flank(tf.Machine({"ECC": 30.0}), gear).rms == pytest.approx(0.0, abs=0.02)  # a rotation of the whole gear
    assert exact.to_pandas()["deviation_um"].abs().max() == pytest.approx(exact.largest)


def test_a_fitted_motion_goes_into_a_machine() -> None:
    motion = tf.fit(tf.read(FILE), "EXX")
    again = tf.Machine({"EXX": motion}).to_dict()["errors"]["EXX"]
    np.testing.assert_allclose(np.interp([-20.0, 30.0], again["q"], again["v"]), motion([-20.0, 30.0]), atol=1e-3)
    assert len(motion.to_pandas()) == 51
    assert "EXX" in repr(motion)
    frame = tf.read(FILE).to_pandas()
    assert list(frame.columns) == ["target_mm", "approach", "repetition", "deviation_um"]


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda: tf.read("no-such-file.rtl"), "E-FILE-READ"),
        (lambda: tf.Machine({"EXX": {"type": "odd"}}), "E-STUDY-VALUE"),
        (lambda: tf.Gear.of(rp=64, rrp=3, a=9.0, zp=40, zc=39, centre_distance=160), "E-GEAR"),
        (lambda: tf.flank(tf.Machine(seed=1), tf.Gear.load(GEAR), order="odd"), "E-SENS-ORDER"),
        (lambda: tf.rank(tf.Machine(seed=1), tf.Gear.load(GEAR), output="odd"), "E-SENS-OUTPUT"),
        (lambda: tf.flank(tf.Machine({"EQX": 1.0}), tf.Gear.load(GEAR)), "E-CHAIN"),
    ],
)
def test_wrong_input_is_said(wrong, code: str) -> None:
    with pytest.raises(tf.TrueflankError) as refused:
        wrong()
    assert refused.value.code.startswith(code)


GEAR_READ = tf.Gear.load(GEAR)
READ = tf.read(FILE)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda: tf.read(None), "E-LIBRARY-KIND"),
        (lambda: tf.evaluate(str(FILE)), "E-LIBRARY-KIND"),
        (lambda: tf.evaluate(np.zeros((3, 2, 2))), "E-LIBRARY-KIND"),
        (lambda: tf.fit(READ), "E-LIBRARY-NAME"),
        (lambda: tf.fit(READ, "B0Z"), "E-LIBRARY-NAME"),
        (lambda: tf.fit(READ, "EXX")([0.0, np.nan]), "E-LIBRARY-KIND"),
        (lambda: tf.fit(READ, "EXX").u(np.inf), "E-LIBRARY-KIND"),
        (lambda: tf.fit(READ, "EBX"), "E-LIBRARY-UNIT"),
        (lambda: tf.fit(READ, "EXC"), "E-LIBRARY-UNIT"),
        (lambda: tf.fit(READ, "EXX", kind="rotary"), "E-LIBRARY-KIND"),
        (lambda: tf.Machine({"ECC": tf.fit(READ, "EXX")}), "E-LIBRARY-UNIT"),
        (lambda: tf.Machine({"EXX": ([0.0], [1.0], [2.0])}), "E-LIBRARY-KIND"),
        (lambda: tf.Machine({"EXX": ([0.0, 1.0], [1.0])}), "E-CHAIN-MOTION-DATA"),
        (lambda: tf.Machine(["EXX"]), "E-LIBRARY-KIND"),
        (lambda: tf.flank(GEAR_READ, tf.Machine()), "E-LIBRARY-KIND"),
        (lambda: tf.rank(tf.Machine(), "gear.toml"), "E-LIBRARY-KIND"),
        (lambda: tf.correct({"EXX": 1.0}, GEAR_READ), "E-LIBRARY-KIND"),
        (lambda: tf.study(tf.Machine(), None), "E-LIBRARY-KIND"),
        (lambda: tf.report(None), "E-LIBRARY-KIND"),
        (lambda: tf.evaluate(READ, monte_carlo=True, seed="x"), "E-LIBRARY-KIND"),
        (lambda: tf.rank(tf.Machine(), GEAR_READ, trajectories=2.5), "E-LIBRARY-KIND"),
        (lambda: tf.study(tf.Machine(), GEAR_READ, seed=-1), "E-LIBRARY-KIND"),
        (lambda: tf.Measured([0.0, 1.0], np.zeros((3, 2, 2)), "mm"), "E-EVAL-SHAPE"),
        (lambda: tf.Measured([0.0], np.zeros((1, 2, 2)), "inch"), "E-LIBRARY-KIND"),
    ],
)
def test_what_is_given_to_the_wrong_call_is_said(wrong, code: str) -> None:
    with pytest.raises(tf.TrueflankError) as refused:
        wrong()
    assert refused.value.code == code
    assert "{" not in str(refused.value).replace("tf.Machine({...})", "").replace('{"EXX": 5.0}', "")


@pytest.mark.parametrize(
    ("table", "code"),
    [
        ("a;b\n1;1.001\n2;2.002\n", "E-LIBRARY-COLUMNS"),
        ("Position [mm];Run 1 [um];Run 2 [um]\n0;1;2\n10;2;3\n", "E-LIBRARY-WAYS"),
    ],
)
def test_what_a_table_leaves_open_is_answered_by_the_argument_that_is_named(
    table: str, code: str, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(table, encoding="utf-8")
    with pytest.raises(tf.TrueflankError) as asked:
        tf.read(path)
    assert asked.value.code == code
    assert "--column" not in str(asked.value)
    (said,) = re.findall(r"columns=dict\((.*?)\)", asked.value.hint)
    answers = {key: json.loads(value) for key, value in re.findall(r'(\w+)=("\w+"|\d+)', said)}
    found = tf.read(path, columns=answers if "passes" in answers else {**answers, "direction": "up"})
    assert found.targets.size == 2


def test_an_error_keeps_its_unit_from_the_file_to_the_tooth(tmp_path: Path) -> None:
    rows = (
        f"{at},{way},{turn},{at / 100 + turn / 100}" for turn in (1, 2) for way in "+-" for at in range(-250, -69, 30)
    )
    path = tmp_path / "pitch.csv"
    path.write_text("\n".join(("target_mm,direction,repetition,deviation_arcsec", *rows, "")))
    with pytest.raises(tf.TrueflankError, match="one is a length, one an angle"):
        tf.read(path)
    pitch = tf.read(path, name="EBX")
    assert (pitch.unit, pitch.axis_unit) == ("arcsec", "mm")
    with pytest.raises(tf.TrueflankError, match=r"EXC is in .m over deg, the readings are in arcsec over deg"):
        tf.read(path, name="EXC")
    with pytest.raises(tf.TrueflankError, match=r"the readings are in .m over mm"):
        tf.read(FILE, name="ECC")
    assert pitch.to_dict()["name"] == "EBX"
    assert "arcsec" in repr(tf.evaluate(pitch))
    motion = tf.fit(pitch)
    assert (motion.name, motion.unit) == ("EBX", "arcsec")
    assert tf.flank(tf.Machine({"EBX": motion}), GEAR_READ).rms < 5.0  # 2 arcsec and no micrometres: it stays small
    with pytest.raises(tf.TrueflankError, match=r"E-MODEL-RANGE.*EBX is known from -250 to -70 mm.* 500 mm"):
        motion([-100.0, 500.0])  # nothing is extrapolated


def test_lists_are_readings_too_and_a_figure_that_is_not_there_is_said() -> None:
    told = tf.evaluate(tf.Measured(READ.targets.tolist(), READ.deviations.tolist(), "mm"), 2014)
    assert told["B"] == tf.evaluate(READ)["B"]
    for wrong in ("Q", 3, None, ["B"]):
        with pytest.raises(tf.TrueflankError, match="give it one of B, B_mean"):
            _ = told[wrong]  # type: ignore[index]


@pytest.mark.parametrize("wrong", ["a", None, ["a", 1], [[0.0, 1.0], [2.0]], 1j, {}], ids=repr)
def test_what_is_no_position_is_refused_by_a_fitted_curve(wrong: Any) -> None:
    motion = tf.fit(READ, "EXX")
    for call in (motion, motion.u):
        with pytest.raises(tf.TrueflankError, match=r"takes positions, not .* a regular table of numbers, in mm"):
            call(wrong)
    assert motion([]).shape == (0,)


def test_a_report_of_no_run_says_what_was_asked_for(tmp_path: Path) -> None:
    with pytest.raises(tf.TrueflankError, match=r"takes a run's folder.* no such run"):
        tf.report(tmp_path / "none", tmp_path)


def test_every_name_says_its_units_and_shows_itself_shortly() -> None:
    names = [name for name in tf.__all__ if name not in ("TrueflankError", "__version__")]
    without = [name for name in names if not re.search(r"\b(um|mm|arcsec|deg)\b", getattr(tf, name).__doc__ or "")]
    assert without == []
    machine = tf.Machine(seed=1)
    shown = [READ, tf.evaluate(READ), tf.fit(READ, "EXX"), machine, GEAR_READ, tf.flank(machine, GEAR_READ)]
    shown += [tf.rank(machine, GEAR_READ, trajectories=1), tf.correct(machine, GEAR_READ)]
    assert [one for one in map(repr, shown) if len(one) > 200 or "\n" in one or "array" in one] == []
    for one in shown:
        json.dumps(one.to_dict())


def test_nothing_is_loaded_before_it_is_used() -> None:
    script = (
        "import sys, trueflank; print(sorted(set(sys.modules) & {'numpy', 'scipy', 'pydantic', 'pandas', 'gateway'}))"
    )
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert told.stdout.strip() == "[]"
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import trueflank"], cwd=ROOT, check=True)
    bare = time.perf_counter() - start
    assert bare < 3.0, "0.3 s where nothing else runs; here Python's own start is in it, and what runs beside"
    with pytest.raises(AttributeError, match="it has"):
        _ = tf.odd
    assert set(tf.__all__) <= set(dir(tf))


def test_what_a_file_says_of_itself_is_kept_and_handed_out(tmp_path: Path) -> None:
    head = "Machine;Mill 7\nSerial No;4711\nDate;3 May 2019\nInstrument;XL-80\nFeed;500 mm/min\nAxis;X\n"
    rows = "".join(f"{at};{way};{run};{at / 90}\n" for run in (1, 2) for way in "+-" for at in range(0, 91, 15))
    path = tmp_path / "x.csv"
    path.write_text(f"{head}target_mm;direction;run;deviation_um\n{rows}", encoding="utf-8")
    found = tf.read(path)
    said = {"machine": "Mill 7", "serial": "4711", "date": "3 May 2019", "feed": "500 mm/min", "instrument": "XL-80"}
    assert dict(found.stated) == said
    assert found.as_set().header["Axis"] == "X"
    for one in (found, tf.evaluate(found), tf.fit(found, "EXX")):
        assert dict(one.stated) == said
        assert one.to_dict()["stated"] == said
    rtl = tf.read(FILE.with_name("environment.rtl"))
    kept = rtl.as_set()
    assert rtl.conditions["air_degc"] == kept.ambient_start.air_degc
    assert rtl.conditions["pressure_hpa_end"] == kept.ambient_end.pressure_hpa
    assert rtl.conditions["material_degc"] == pytest.approx(np.mean(kept.ambient_start.material_degc))
    other = replace(rtl, material_degc=25.0).as_set()
    assert other.ambient_start == replace(kept.ambient_start, material_degc=(25.0,))
    assert tf.Measured([0.0, 1.0], np.zeros((2, 1, 2)), "mm").conditions == {}
