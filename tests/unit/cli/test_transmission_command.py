"""evaluate --kind transmission as a user types it, on the simulated bench's record and on made ones; the library."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trueflank as tf
from drivers.errors import TrueflankError
from gateway.cli import app
from simulators.reducer.bench import Bench, EncoderSection, load_bench

RUNNER = CliRunner()
HEAD = "time_s,input_angle_deg,output_angle_deg,torque_Nm,temperature_degC"


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One disc of eleven lobes, both ways and a loop, with perfect encoders and a stated U."""
    spec = load_bench("single")
    stated = EncoderSection(once_arcsec=0.5)
    bench = Bench(spec.model_copy(update={"input_encoder": EncoderSection(), "output_encoder": stated}))
    made = bench.running(steps=24, torque_nm=30.0).and_then(bench.hysteresis(steps=24))
    path = tmp_path_factory.mktemp("bench") / "record.csv"
    path.write_text(made.text(), encoding="utf-8", newline="")
    return path


def made(path: Path, *head: str, order: int = 40, size: float = 10.0, steps: int = 24) -> Path:
    """A turn of a reducer of 40 pins with one wave."""
    angle = np.arange(0.0, 362.0, 360.0 / (39 * steps))
    seen = angle + size / 3600.0 * np.cos(np.deg2rad(order * angle))
    rows = [f"{k},{121.0 * at:.9f},{see:.12f},5.0,21.0" for k, (at, see) in enumerate(zip(angle, seen, strict=True))]
    path.write_text("\n".join([*head, HEAD, *rows, ""]))
    return path


def run(*words: object) -> tuple[int, dict[str, object]]:
    result = RUNNER.invoke(app, ["evaluate", *map(str, words), "--kind", "transmission", "--json"])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, json.loads(result.output)


def refused(*words: object) -> str:
    result = RUNNER.invoke(app, ["evaluate", *map(str, words), "--kind", "transmission"])
    assert isinstance(result.exception, TrueflankError), result.output
    assert "<" not in result.exception.what
    return result.exception.code


def test_the_benchs_record_gives_what_an_own_reckoning_of_its_rows_gives(record: Path) -> None:
    code, answer = run(record)
    assert code == 0
    figures = {one["name"]: one for one in answer["figures"]}
    rows = [line.split(",") for line in record.read_text().splitlines() if line[0].isdigit()]
    _, inputs, outputs, torque, _ = np.asarray(rows, dtype=float).T
    error = (outputs + inputs / 11.0) * 3600.0
    runs = torque == 30.0
    middle = np.flatnonzero(runs)
    ahead = middle[: len(middle) // 2]
    over = (len(ahead) - 24 * 11) // 2
    turn = error[ahead][over : over + 24 * 11]
    assert figures["forwards p-p"]["value"] == pytest.approx(np.ptp(turn), rel=1e-6)
    assert figures["forwards RMS"]["value"] == pytest.approx(turn.std(), rel=1e-6)
    by_hand = abs(np.sum(turn * np.exp(-12j * np.deg2rad(outputs[ahead][over : over + 24 * 11])))) * 2.0 / len(turn)
    wave = next(one for one in answer["orders"] if one["sense"] == "forwards" and one["order"] == 12)
    assert wave["amplitude"] == pytest.approx(by_hand, rel=2e-3)
    assert wave["cause"].startswith("disc, 1 a turn")
    assert figures["transmission error"]["U"] == pytest.approx(0.5 * np.sqrt(2.0), rel=1e-3)
    twist, load = error[~runs], torque[~runs]
    turning = [0, *(np.flatnonzero(np.diff(np.sign(np.diff(load)))) + 1).tolist(), len(load) - 1]
    down, up = slice(turning[1], turning[2] + 1), slice(turning[2], turning[3] + 1)
    small = 0.03 * 60.0
    middles = [
        0.5 * (np.interp(x, load[up], twist[up]) + np.interp(x, load[down][::-1], twist[down][::-1]))
        for x in (-small, small)
    ]
    assert figures["lost motion"]["value"] == pytest.approx(middles[1] - middles[0], rel=1e-6)
    assert answer["simulated"] is True
    assert len(answer["loop"]["torque_nm"]) == np.count_nonzero(~runs)


def test_limits_decide_with_the_exit_codes_of_the_other_kinds(record: Path, tmp_path: Path) -> None:
    picture = tmp_path / "drive.png"
    code, answer = run(record, "--limit", "transmission error=1000", "--limit", "lost motion=1000", "--plot", picture)
    assert code == 0
    assert [one["verdict"] for one in answer["verdicts"]] == ["pass", "pass"]
    assert picture.stat().st_size > 10_000
    code, answer = run(record, "--limit", "transmission error=1")
    assert code != 0
    assert answer["verdicts"][0]["verdict"] == "fail"
    wave = made(tmp_path / "wave.csv", "# Pins,40", "# Ratio,121")
    code, answer = run(wave, "--limit", "transmission error=1000")
    assert answer["verdicts"][0]["verdict"] == "not decidable"
    assert code != 0
    code, answer = run(wave, "--encoder-U", 1, "--limit", "transmission error=20.5")
    assert answer["verdicts"][0]["verdict"] == "not decidable"
    assert refused(record, "--limit", "torsional stiffness=3") == "E-DRIVE-LOWER"
    assert refused(record, "--limit", "beauty=3") == "E-EVAL-LIMIT-NAME"


def test_what_file_and_person_say_of_the_drive_must_agree_and_suffice(tmp_path: Path) -> None:
    bare = made(tmp_path / "bare.csv")
    assert refused(bare) == "E-DRIVE-UNKNOWN"
    assert run(bare, "--pins", 40, "--ratio", 121)[0] == 0
    assert refused(bare, "--pins", 40, "--ratio", 81) == "E-DRIVE-RATIO"
    stated = made(tmp_path / "stated.csv", "# Pins,40", "# Ratio,121")
    assert refused(stated, "--ratio", 81) == "E-DRIVE-DIFFERS"
    other = made(tmp_path / "other.csv", "# Pins,30", "# Ratio,121")
    assert refused(stated, other) == "E-DRIVE-DIFFERS"
    assert refused(made(tmp_path / "few.csv", "# Pins,40", "# Ratio,121", steps=10)) == "E-DRIVE-ALIAS"
    assert refused() == "E-CLI-NO-FILES"
    declared = ("--column", "input=2", "--column", "input_unit=arcmin")
    assert refused(stated, *declared) == "E-DRIVE-RATIO"


def test_files_of_one_drive_are_repeats(tmp_path: Path) -> None:
    sizes = (10.0, 10.2, 9.8)
    head = ("# Pins,40", "# Ratio,121", "# Output encoder U arcsec,0.1")
    files = [made(tmp_path / f"{k}.csv", *head, size=size) for k, size in enumerate(sizes)]
    figures = {one["name"]: one for one in run(*files)[1]["figures"]}
    # Student for three repeats at 95.45 %: 4.53; their p-p scatter by 0.4
    assert figures["forwards p-p"]["U"] == pytest.approx(np.hypot(0.1 * np.sqrt(2), 4.527 * 0.4 / np.sqrt(3)), rel=0.01)


def test_the_screen_names_orders_and_notes(record: Path) -> None:
    shown = RUNNER.invoke(app, ["evaluate", str(record), "--kind", "transmission"]).output
    assert "orders forwards" in shown
    assert "SIMULATED" in shown
    assert "lost motion" in shown


def test_the_library_gives_the_commands_numbers(record: Path) -> None:
    test = tf.read_bench(record)
    found = tf.evaluate(test, limits={"transmission error": 1000.0})
    assert isinstance(found, tf.EvaluatedDrive)
    figures = {one["name"]: one["value"] for one in run(record)[1]["figures"]}
    assert found.values == figures
    assert found["lost motion"] == figures["lost motion"]
    assert found.verdicts == {"transmission error": "pass"}
    assert len(repr(test)) < 200
    json.dumps(found.to_dict())
    assert list(found.to_pandas()["figure"]) == list(figures)
    with pytest.raises(TrueflankError, match="E-LIBRARY-KIND"):
        _ = found["beauty"]
