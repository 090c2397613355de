"""What `inspect redress` and `inspect separate` refuse by the command: diamond, limit, units, mixed dressings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.gear.cycloid import CycloidGear
from gateway.process.wheel import SenseProof
from gateway.study.dresser import load_dresser
from simulators.cell.site import section
from tests.unit.cli.test_match import DATA, GEAR, WORDS, gear_file
from tests.unit.cli.test_process_commands import DRESSER, THETA, part, wave

STEEP = {"rp": 36.0, "rrp": 3.5, "a": 0.94 * 36.0 / 16.0, "zp": 16, "zc": 15, "b": 10.0}
DEVIATIONS = ("space=1", "flank=2", "x=3", "y=4", "z=5", "deviation=6", "probe_u_um=0.1")


def refused(*words: object, columns: tuple[str, ...] = ()) -> str:
    said = [word for one in columns for word in ("--column", one)] or WORDS
    found: Result = CliRunner().invoke(app, ["inspect", *map(str, words), *said])
    assert isinstance(found.exception, TrueflankError), found.output
    return found.exception.code


def dresser(folder: Path, old: str = "", new: str = "") -> Path:
    """A dresser whose sense is proved."""
    path = folder / "dresser.toml"
    path.write_text(DRESSER.format(sign=1).replace(old, new) if old else DRESSER.format(sign=1), encoding="utf-8")
    load_dresser(path).keep(SenseProof(1.0, 0.0, 0.05, "proved"))
    return path


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("diamond_radius_mm = 0.4", "diamond_radius_mm = 12.0", "E-WHEEL-UNDERCUT"),
        ("diamond_radius_mm = 0.4", "diamond_radius_mm = 0.4\nlimit_um = 0.5", "E-WHEEL-LIMIT"),
    ],
)
def test_a_diamond_wider_than_a_hollow_and_a_correction_beyond_its_limit(
    tmp_path: Path, old: str, new: str, code: str
) -> None:
    """Neither the correction nor the known step is written."""
    gear, one = gear_file(tmp_path), part(tmp_path / "a.csv")
    for step in ((), ("--step",)):
        words = ("redress", gear, one, "--dresser", dresser(tmp_path, old, new), "--out", tmp_path / "wheel", *step)
        assert refused(*words) == code
    assert not (tmp_path / "wheel").exists()


def test_a_diamond_that_touches_a_steep_profile_twice(tmp_path: Path) -> None:
    """The same diamond is narrower than every hollow of this gear: what fails is its way in between the flanks."""
    gear = CycloidGear(**STEEP)  # type: ignore[arg-type]
    path = tmp_path / "gear.toml"
    path.write_text('name = "steep"\n' + section("gear", STEEP) + section("grinding", {"centre_distance_mm": 120.0}))
    rng, rows = np.random.default_rng(3), ["space;flank;x;y;z"]
    half = gear.theta_at(np.linspace(0.05, 0.95, 19) * gear.limits().half_lobe_arc)
    theta = np.concatenate((-half[::-1], half))
    shape = 1.2 * np.cos(2.0 * np.pi * gear.arc(theta) / gear.limits().half_lobe_arc)
    for k in range(gear.zc):
        at = gear.space(theta, k)
        for z in (0.5, 5.0, 9.5):
            e = 1e-3 * (shape + rng.normal(0.0, 0.1, theta.size))
            for t, x, y in zip(theta, at.x + e * at.nx, at.y + e * at.ny, strict=True):
                rows.append(f"{k};{'left' if t > 0 else 'right'};{x:.7f};{y:.7f};{z}")
    one = tmp_path / "a.csv"
    one.write_text("\n".join(rows), encoding="utf-8")
    small = dresser(tmp_path, "diamond_radius_mm = 0.4", "diamond_radius_mm = 0.455")
    assert refused("redress", path, one, "--dresser", small, "--out", tmp_path / "wheel") == "E-WHEEL-OVERLAP"
    assert not (tmp_path / "wheel").exists()


def test_deviations_in_mm_are_not_taken_for_micrometres(tmp_path: Path) -> None:
    gear, rng, rows = CycloidGear(**DATA), np.random.default_rng(5), ["space;flank;x;y;z;d"]  # type: ignore[arg-type]
    for k in range(gear.zc):
        at = gear.space(THETA, k)
        for z in (0.5, 5.0, 9.5):
            d = 1e-3 * (wave(gear.arc(THETA)) + rng.normal(0.0, 0.1, THETA.size))  # mm, read as um
            for t, x, y, e in zip(THETA, at.x, at.y, d, strict=True):
                rows.append(f"{k};{'left' if t > 0 else 'right'};{x:.7f};{y:.7f};{z};{e:.7f}")
    one = tmp_path / "a.csv"
    one.write_text("\n".join(rows), encoding="utf-8")
    gear_path = gear_file(tmp_path)
    assert refused("separate", gear_path, one, columns=DEVIATIONS) == "E-PROCESS-UNIT"
    words = ["inspect", "separate", str(gear_path), str(one)]
    said = [word for column in (*DEVIATIONS, "deviation_unit=mm") for word in ("--column", column)]
    done = CliRunner().invoke(app, [*words, *said])
    assert done.exit_code == 0, done.output


def test_a_part_before_a_dressing_with_one_after_it(tmp_path: Path) -> None:
    gear = gear_file(tmp_path)
    before, after = part(tmp_path / "a.csv"), part(tmp_path / "b.csv", 0.3 * wave(GEAR.arc(THETA)), seed=2)
    assert refused("separate", gear, before, after) == "E-PROCESS-MIXED"
    words = ("redress", gear, before, after, "--dresser", dresser(tmp_path), "--out", tmp_path / "wheel")
    assert refused(*words) == "E-PROCESS-MIXED"
    assert refused("redress", gear, before, "--dresser", dresser(tmp_path), "--before", before) == "E-WHEEL-SAME"
