"""`separate` and `redress` from files of flank points: table, files, proof of the sense, and what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from typer.testing import CliRunner, Result

import trueflank as tf
from drivers.errors import TrueflankError
from gateway.cli import app
from tests.unit.cli.test_match import COLUMNS, GEAR, WORDS, gear_file

DRESSER = """[dresser]
columns = ["axial", "correction"]
headings = ["Y", "K"]
length_unit = "mm"
correction_unit = "um"
sign = {sign}
separator = ";"
decimal = ","
diamond_radius_mm = 0.4
"""
THETA = np.concatenate((-np.linspace(0.06, 0.93, 13)[::-1], np.linspace(0.06, 0.93, 13))) * np.pi / GEAR.zc


def wave(arc: np.ndarray) -> np.ndarray:
    """1.2 um, two half waves on each flank."""
    return 1.2 * np.cos(2.0 * np.pi * arc / GEAR.limits().half_lobe_arc)


def part(
    path: Path, form: np.ndarray | None = None, seed: int = 1, ball_mm: float = 0.0, mirrored: bool = False
) -> Path:
    """A disc with this form (T,) in um on every flank and an eccentricity of 3 um; points in mm."""
    rng, rows = np.random.default_rng(seed), ["space;flank;x;y;z"]
    local = GEAR.section(THETA)
    shape = wave(GEAR.arc(THETA)) if form is None else form
    for k in range(GEAR.zc):
        at, angle = GEAR.space(THETA, k), 2.0 * np.pi * k / GEAR.zc
        for z in (0.5, 5.0, 9.5):
            e = shape + 3.0 * (np.cos(angle) * local.nx - np.sin(angle) * local.ny) + rng.normal(0.0, 0.1, THETA.size)
            e = 1e-3 * e + ball_mm
            for t, x, y in zip(THETA, at.x + e * at.nx, at.y + e * at.ny, strict=True):
                side = "left" if (t > 0) != mirrored else "right"
                rows.append(f"{k};{side};{x:.7f};{y:.7f};{z}")
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def called(command: str, *words: object) -> Result:
    return CliRunner().invoke(app, [command, *map(str, words), *WORDS])


def dresser_file(folder: Path, sign: int = 1) -> Path:
    path = folder / "dresser.toml"
    path.write_text(DRESSER.format(sign=sign), encoding="utf-8")
    return path


def test_shares_are_printed_drawn_and_the_same_from_the_library(tmp_path: Path) -> None:
    gear, one = gear_file(tmp_path), part(tmp_path / "a.csv")
    shown = called("inspect", "separate", gear, one, "--plot", tmp_path / "causes.png")
    assert shown.exit_code == 0, shown.output
    assert "wheel" in shown.output
    assert (tmp_path / "causes.png").stat().st_size > 10_000
    data = json.loads(called("inspect", "separate", gear, one, "--json").output)
    columns = dict(word.split("=") for word in COLUMNS)
    told = {name: int(value) if value.isdigit() else float(value) for name, value in columns.items()}
    found = tf.separate(one, tf.Gear.load(gear), columns=told)
    assert found.to_dict()["shares"] == data["shares"]
    assert found.shares["clamping"][0] == pytest.approx(2.1, abs=0.3)  # 3 um along both normals
    assert np.ptp(found.form) == pytest.approx(2.2, abs=0.5)
    assert found.plot() is not None
    assert found.correction(0.4).correction_um == pytest.approx(found.form)


def dressed(files: Path, sense: float) -> np.ndarray:
    """What the next part shows after a person gave the dresser this file; + in it makes the wheel larger by sense."""
    with files.open(encoding="utf-8") as text:
        rows = [[float(cell.replace(",", ".")) for cell in row] for row in list(csv.reader(text, delimiter=";"))[1:]]
    axial, correction = np.array(rows).T
    return np.asarray(wave(GEAR.arc(THETA)) - sense * np.interp(GEAR.section(THETA).y, axial, correction))


def test_the_sense_is_proved_before_a_correction_is_written(tmp_path: Path) -> None:
    gear, before, dresser = gear_file(tmp_path), part(tmp_path / "a.csv"), dresser_file(tmp_path)
    out = tmp_path / "wheel"
    refused = called("inspect", "redress", gear, before, "--dresser", dresser, "--out", out)
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == "E-WHEEL-UNPROVED"
    step = called("inspect", "redress", gear, before, "--dresser", dresser, "--out", out, "--step")
    assert step.exit_code == 0, step.output
    after = part(tmp_path / "b.csv", dressed(out / "step-dresser.csv", 1.0), seed=2)
    proof = called("inspect", "redress", gear, after, "--dresser", dresser, "--before", before)
    assert proof.exit_code == 0, proof.output
    done = called("inspect", "redress", gear, after, "--dresser", dresser, "--out", out, "--dxf")
    assert done.exit_code == 0, done.output
    layers = {one.dxf.layer for one in ezdxf.readfile(out / "wheel.dxf").modelspace()}
    assert layers == {"WHEEL", "CORRECTION_X1000", "DIAMOND_CENTRE"}
    dresser_file(tmp_path, sign=-1)  # another table: its proof is not this one
    again = called("inspect", "redress", gear, after, "--dresser", dresser, "--out", out)
    assert isinstance(again.exception, TrueflankError)
    assert again.exception.code == "E-WHEEL-UNPROVED"


def test_a_reversed_table_is_found_and_nothing_is_written(tmp_path: Path) -> None:
    gear, before, dresser = gear_file(tmp_path), part(tmp_path / "a.csv"), dresser_file(tmp_path)
    called("inspect", "redress", gear, before, "--dresser", dresser, "--out", tmp_path, "--step")
    after = part(tmp_path / "b.csv", dressed(tmp_path / "step-dresser.csv", -1.0), seed=2)
    proof = called("inspect", "redress", gear, after, "--dresser", dresser, "--before", before, "--json")
    assert proof.exit_code == 1
    assert json.loads(proof.output)["verdict"] == "reversed"
    refused = called("inspect", "redress", gear, after, "--dresser", dresser, "--out", tmp_path)
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == "E-WHEEL-SENSE"
    assert not (tmp_path / "wheel-dresser.csv").exists()


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"ball_mm": 0.5}, "E-INSPECT-BALL"),
        ({"ball_mm": -0.25}, "E-INSPECT-BALL"),
        ({"mirrored": True}, "E-INSPECT-SIDES"),
    ],
)
def test_a_probe_left_in_the_points_and_exchanged_flanks_are_refused(
    tmp_path: Path, options: dict[str, float], code: str
) -> None:
    refused = called("inspect", "separate", gear_file(tmp_path), part(tmp_path / "a.csv", **options))  # type: ignore[arg-type]
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == code


def test_another_gear_and_the_other_hand_are_refused(tmp_path: Path) -> None:
    gear, one = gear_file(tmp_path), part(tmp_path / "a.csv")
    text = one.read_text(encoding="utf-8").splitlines()
    cells = [line.split(";") for line in text[1:]]
    other = tmp_path / "other.csv"  # spaces counted clockwise
    other.write_text("\n".join([text[0], *(";".join([str(-int(c[0]) % GEAR.zc), *c[1:]]) for c in cells)]))
    refused = called("inspect", "separate", gear, other)
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == "E-INSPECT-NUMBERS"
    gear.write_text(gear.read_text().replace("a = 1.5", "a = 1.45"))
    refused = called("inspect", "separate", gear, one)
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code in ("E-INSPECT-GEAR", "E-INSPECT-BALL")


def test_orders_and_dresser_files_that_say_nothing_are_refused(tmp_path: Path) -> None:
    gear, one, dresser = gear_file(tmp_path), part(tmp_path / "a.csv"), dresser_file(tmp_path)
    for words, code in (
        (("--order", "backwards"), "E-PROCESS-ORDER-TEXT"),
        (("--order", "0,1,2"), "E-PROCESS-ORDER"),
    ):
        refused = called("inspect", "separate", gear, one, *words)
        assert isinstance(refused.exception, TrueflankError)
        assert refused.exception.code == code
    for old, new in (("sign = 1", "sign = 2"), ('"correction"]', '"radius"]'), ('separator = ";"', 'separator = ","')):
        dresser.write_text(DRESSER.format(sign=1).replace(old, new))
        refused = called("inspect", "redress", gear, one, "--dresser", dresser, "--step", "--out", tmp_path)
        assert isinstance(refused.exception, TrueflankError)
        assert refused.exception.code == "E-STUDY-VALUE"
