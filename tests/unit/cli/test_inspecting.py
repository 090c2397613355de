"""The commands `inspect`, `guard --gear` and `correct --gear` from files, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drivers.errors import TrueflankError
from drivers.types.gearfiles import GearContour
from drivers.types.gears import GearInspection
from gateway.cli import app
from gateway.correct.part.inspected import inspected_flank
from gateway.gear.traces import inspection_of_contour, located_contour
from simulators.cell.site import section
from tests.unit.components.test_command import written
from tests.unit.correct.test_inspected import ABOUT, HEIGHTS, measured
from tests.unit.drivers.test_gear_measuring_files import mka
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


def scanned(path: Path, xyz: np.ndarray, centre: tuple[float, float], turn: float) -> Path:
    """A contour scan of points (n, 3): a section for each height, the part clamped beside the axis and turned."""
    cos, sin = np.cos(turn), np.sin(turn)
    xy = xyz[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + centre
    lines: list[str] = []
    for number, z in enumerate(np.unique(xyz[:, 2])):
        lines.append(f"[{'ABCDEFGH'[number]}]")
        lines += [f"{row}; {x:.7f}; {y:.7f}; {z:.4f};" for row, (x, y) in enumerate(xy[xyz[:, 2] == z], 1)]
    path.write_text("\n".join([*lines, ""]), encoding="latin-1")
    return path


def contour_of(points: GearInspection) -> GearContour:
    return GearContour(points.points_mm, np.zeros(len(points), dtype=np.int64))


def test_contour_scans_of_the_whole_disc_are_inspected_wherever_it_was_clamped(tmp_path: Path) -> None:
    path, points = site(tmp_path, inspection_clamping_um=0.0), measured(1)
    scan = scanned(tmp_path / "disc.dat", points.points_mm, (0.08, -0.05), 0.7)
    told = called("inspect", str(path), "--part", "P1", "--file", str(scan), "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.output)
    # A scan hides the part's own eccentricity: clamped on its axis it shows the same, and less than the points do.
    centred = inspected_flank(RV40E, inspection_of_contour(RV40E, contour_of(points)), ABOUT)
    assert found["rms_um"] == pytest.approx(centred.fitted.rms_um, abs=2e-3)
    assert found["rms_um"] <= inspected_flank(RV40E, points, ABOUT).fitted.rms_um + 1e-6
    assert any("eccentricity and turn" in line for line in found["said"])


def test_figures_of_a_partial_scan_and_what_it_needs(tmp_path: Path) -> None:
    path = site(tmp_path)
    theta = np.linspace(-3.0, 3.0, 1090) * RV40E.half_pitch
    space = np.round(theta / (2.0 * RV40E.half_pitch))
    s = RV40E.space(theta - 2.0 * space * RV40E.half_pitch, space % 39)
    e = 0.002 + 0.0001 * np.random.default_rng(5).normal(size=theta.size)
    xyz = np.column_stack([s.x + e * s.nx, s.y + e * s.ny, np.full(theta.size, 87.572)])
    scan = scanned(tmp_path / "disc.dat", xyz, (0.03, -0.058), 1.234)
    told = called("evaluate", str(scan), "--kind", "gear", "--site", str(path), "--json")
    assert told.exit_code == 0, told.output
    figures = {one["name"]: one for one in json.loads(told.output)["figures"]}
    for name, true in (("axis x", 30.0), ("axis y", -58.0)):
        assert abs(figures[name]["value"] - true) <= 2.0 * figures[name]["U"]
        assert figures[name]["U"] < 0.2
    assert figures["mean surplus"]["value"] == pytest.approx(2.0, abs=0.05)
    assert sum(name.endswith("f_falpha") for name in figures) == 7  # six flanks, and the largest
    assert figures["largest f_falpha"]["value"] < 1.0
    assert "E-GEARFILE-SITE" in str(called("evaluate", str(scan), "--kind", "gear").exception)
    missing = called("inspect", str(path), "--file", str(scan), "--heights", "middle")
    assert isinstance(missing.exception, TrueflankError)
    assert missing.exception.code == "E-INSPECT-HEIGHT"


def test_traces_by_radius_lie_on_the_nominal_flank(tmp_path: Path) -> None:
    theta = RV40E.theta_at(np.linspace(0.3, 5.4, 9))
    k, flank, z = (one.ravel() for one in np.meshgrid(np.arange(39), [-1, 1], [1.0, 5.0, 9.0], indexing="ij"))
    lines = ["tooth;flank;radius;z;dev"]
    for space, side, height in zip(k, flank, z, strict=True):
        section = RV40E.section(side * theta)
        radii = np.hypot(section.x, section.y)
        # 4 um of A: material along the space, so n_x of it along the normal
        lines += [f"{space};{side:+d};{r:.9f};{height};{4.0 * n:.6f}" for r, n in zip(radii, section.nx, strict=True)]
    file = tmp_path / "traces.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    columns = ("space=1", "flank=2", "radius=3", "z=4", "deviation=5")
    words = [word for column in columns for word in ("--column", column)]
    told = called("inspect", str(site(tmp_path)), "--part", "P1", "--file", str(file), *words, "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.output)
    assert found["figures"]["F_p"] == pytest.approx(0.0, abs=0.02)
    section = RV40E.section(theta)
    assert found["largest_um"] == pytest.approx(4.0 * float(np.max(np.abs(section.nx))), abs=0.5)


def test_curves_of_an_involute_have_figures_and_say_nothing_of_a_disc(tmp_path: Path) -> None:
    file = tmp_path / "gear.mka"
    file.write_text(mka(), encoding="utf-8")
    told = called("evaluate", str(file), "--kind", "gear", "--limit", "f_Halpha=9", "--json")
    assert told.exit_code == 21  # no U is stated: beyond the limit cannot be decided
    figures = {one["name"]: one["value"] for one in json.loads(told.output)["figures"]}
    assert figures["profile 44 left f_Halpha"] == pytest.approx(10.0, abs=2e-3)
    assert figures["lead 44 left f_Hbeta"] == pytest.approx(-6.0, abs=2e-3)
    assert figures["lead 44 left F_beta"] == pytest.approx(4.8, abs=0.05)  # over the judged 12 of 15 mm
    assert figures["profile 44 left f_falpha"] == pytest.approx(0.0, abs=2e-3)
    assert (figures["left f_p"], figures["left F_p"], figures["left F_r"]) == (2.5, 2.5, 4.0)
    involute = called("inspect", str(site(tmp_path)), "--file", str(file))
    assert isinstance(involute.exception, TrueflankError)
    assert involute.exception.code == "E-GEARFILE-INVOLUTE"
    assert "E-GEARFILE-KIND" in called("evaluate", str(file)).output


@pytest.mark.parametrize("waves", [2.0, 6.0, 11.0])
def test_form_that_is_no_noise_is_in_the_uncertainty_of_the_axis(waves: float) -> None:
    theta = np.linspace(-3.0, 3.0, 1090) * RV40E.half_pitch
    space = np.round(theta / (2.0 * RV40E.half_pitch))
    s = RV40E.space(theta - 2.0 * space * RV40E.half_pitch, space % 39)
    far = []
    for phase in np.linspace(0.0, np.pi, 7):
        e = 0.001 * np.sin(waves * theta / RV40E.half_pitch + phase)
        xyz = np.column_stack([s.x + e * s.nx, s.y + e * s.ny, np.zeros(theta.size)])
        found = located_contour(RV40E, GearContour(xyz, np.zeros(theta.size, dtype=np.int64)))
        far += list(np.abs(found.centre_mm) / (2.0 * found.centre_u_mm))
    assert np.mean(np.asarray(far) <= 1.0) >= 0.95
