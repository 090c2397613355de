"""The commands `inspect`, `guard --gear` and `correct --gear` from files, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drivers.errors import TrueflankError
from drivers.types.gears import GearInspection
from gateway.cli import app
from gateway.correct.part.inspected import inspected_flank
from simulators.cell.site import section
from tests.unit.components.test_command import written
from tests.unit.correct.test_inspected import ABOUT, HEIGHTS, measured
from tests.unit.gear.machines import RV40E

GEAR = {"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}
COLUMNS = ("space=1", "flank=2", "x=3", "y=4", "z=5", "probe_u_um=0")


def site(folder: Path, **work: Any) -> Path:
    path = written(folder)
    gear = "\n".join(('name = "disc"\n', section("gear", GEAR), section("grinding", {"centre_distance_mm": 160.0})))
    (folder / "gear.toml").write_text(gear, encoding="utf-8")
    text = path.read_text(encoding="utf-8") + section("work", {"gear": "gear.toml", "height_mm": 0.0, **work})
    path.write_text(text, encoding="utf-8")
    return path


def table(path: Path, found: GearInspection, infeed_mm: float = 0.0) -> Path:
    """A file of flank points; ``infeed_mm`` of surplus along each space."""
    turn = 2.0 * np.pi * found.space / 39.0
    xyz = found.points_mm + infeed_mm * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(found))])
    rows = [
        f"{k};{'left' if side > 0 else 'right'};{x:.7f};{y:.7f};{z:.7f}"
        for k, side, (x, y, z) in zip(found.space, found.flank, xyz, strict=True)
    ]
    path.write_text("\n".join(["space;flank;x;y;z", *rows]), encoding="utf-8")
    return path


def called(*words: str) -> Result:
    return CliRunner().invoke(app, list(words))


def test_a_file_is_inspected_and_guards_its_machine(tmp_path: Path) -> None:
    path = site(tmp_path)
    columns = [word for column in COLUMNS for word in ("--column", column)]
    first = table(tmp_path / "first.csv", measured(1))
    told = called("inspect", str(path), "--part", "P1", "--file", str(first), *columns, "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.output)
    assert found["rms_um"] == pytest.approx(inspected_flank(RV40E, measured(1), ABOUT).fitted.rms_um, abs=1e-3)
    assert set(found["figures"]) >= {"F_alpha", "f_Hbeta", "F_p", "F_r"}
    assert Path(found["picture"]).read_bytes()[1:4] == b"PNG"
    told = called("inspect", str(path), "--file", str(first))
    assert "flank RMS" in told.output
    assert "F_alpha" in told.output

    def guarded(name: str, inspection: GearInspection, infeed_mm: float = 0.0) -> Any:
        file = table(tmp_path / name, inspection, infeed_mm)
        run = Path(found["run_folder"]).name
        told = called("guard", str(path), "--gear", "--run", run, "--file", str(file), "--json")
        answer = json.loads(told.output)
        assert told.exit_code == answer["exit_code"]
        return answer

    same = guarded("same.csv", measured(2))
    assert (same["answer"], same["exit_code"], same["gear"]) == ("still valid", 0, "P1")
    assert guarded("deeper.csv", measured(3), -0.004)["exit_code"] == 20
    other = guarded("few.csv", measured(4, HEIGHTS, 7))
    assert (other["answer"], other["exit_code"]) == ("cannot tell", 21)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("inspect",), "E-INSPECT-INSPECTOR"),
        (("inspect", "--run", "nothing"), "E-STORE-EMPTY"),
        (("guard", "--gear", "--run", "nothing"), "E-STORE-EMPTY"),
        (("correct", "--gear", "nothing"), "E-STORE-EMPTY"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_opened(tmp_path: Path, words: tuple[str, ...], code: str) -> None:
    path = site(tmp_path, inspector="nobody")
    told = called(words[0], str(path), *words[1:])
    assert isinstance(told.exception, TrueflankError)
    assert told.exception.code == code
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("guard", "--run", "x"),
        ("guard", "--run", "x", "--axis", "C1", "--gear"),
        ("correct",),
        ("correct", "--run", "x", "--gear", "y"),
    ],
)
def test_one_way_must_be_chosen(tmp_path: Path, words: tuple[str, ...]) -> None:
    told = called(words[0], str(site(tmp_path)), *words[1:])
    assert told.exit_code == 2


def test_a_run_without_the_part_says_which_there_are(tmp_path: Path) -> None:
    path = site(tmp_path)
    columns = [word for column in COLUMNS for word in ("--column", column)]
    first = table(tmp_path / "first.csv", measured(1))
    run = json.loads(called("inspect", str(path), "--file", str(first), *columns, "--json").output)["run_folder"]
    told = called("correct", str(path), "--gear", Path(run).name, "--part", "after")
    assert isinstance(told.exception, TrueflankError)
    assert told.exception.code == "E-INSPECT-WHICH"
    assert told.exception.fields["known"] == "part"
    wrong = table(tmp_path / "wrong.csv", measured(1), infeed_mm=2.0)
    told = called("inspect", str(path), "--file", str(wrong), "--heights", "middle")
    assert isinstance(told.exception, TrueflankError)
    assert told.exception.code == "E-GEAR-POINT"
