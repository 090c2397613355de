"""`match` from files of flank points: pairs as an own search finds them, u of the inspection, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import trueflank as tf
from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.correct.part.inspected import inspection_patterns
from gateway.gear.cycloid import CycloidGear
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import crank_angles
from gateway.study.drive import reducer_of
from gateway.study.inputs import load_gear
from gateway.tooth import InspectedFlank
from gateway.workflow.tooth.pairing import DiscFile, read_disc
from simulators.cell.site import section
from tests.unit.reducer.drives import coarse

DATA = {"rp": 36.0, "rrp": 2.5, "a": 1.5, "zp": 12, "zc": 11, "b": 10.0, "drrp": 0.006}
GEAR = CycloidGear(**DATA)  # type: ignore[arg-type]
COLUMNS = ("space=1", "flank=2", "x=3", "y=4", "z=5", "probe_u_um=0.1")
WORDS = [word for column in COLUMNS for word in ("--column", column)]
NOISE_UM = 0.1


def gear_file(folder: Path, reducer: str = 'datum = "crank-holes"') -> Path:
    path = folder / "gear.toml"
    text = 'name = "disc"\n' + section("gear", DATA) + section("grinding", {"centre_distance_mm": 120.0})
    path.write_text(text + (f"[reducer]\n{reducer}\n" if reducer else ""), encoding="utf-8")
    return path


def disc(path: Path, depth_um: np.ndarray, seed: int, noise_um: float = NOISE_UM) -> Path:
    """Points at three heights of both flanks, each space as deep as is said."""
    rng, half = np.random.default_rng(seed), np.pi / GEAR.zc
    theta = np.array([-0.85, -0.6, -0.35, -0.12, 0.12, 0.35, 0.6, 0.85]) * half
    rows = ["space;flank;x;y;z"]
    for k in range(GEAR.zc):
        for z in (0.5, 5.0, 9.5):
            at = GEAR.space(theta, k)
            local = GEAR.section(theta)
            e = 1e-3 * (depth_um[k] * local.nx + rng.normal(0.0, noise_um, theta.size))
            for t, x, y in zip(theta, at.x + e * at.nx, at.y + e * at.ny, strict=True):
                rows.append(f"{k};{'left' if t > 0 else 'right'};{x:.7f};{y:.7f};{z}")
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def called(*words: object) -> Result:
    return CliRunner().invoke(app, ["study", "match", *map(str, words)])


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """An eighth of the crank angles: both searches take the same."""
    coarse(monkeypatch)


@pytest.fixture(scope="module")
def discs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    folder = tmp_path_factory.mktemp("discs")
    k = 2.0 * np.pi * np.arange(GEAR.zc) / GEAR.zc
    waves = [2.0 * np.cos(k), 2.0 * np.cos(2 * k), -2.0 * np.cos(2 * k + 0.3)]
    return gear_file(folder), [disc(folder / f"d{n}.csv", wave, n) for n, wave in enumerate(waves)]


def test_discs_are_paired_as_an_own_search_pairs_them(discs: tuple[Path, list[Path]]) -> None:
    gear, files = discs
    told = called(gear, *files, "--mark", 0, "--mark", 5, *WORDS, "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.output)
    drive = reducer_of(load_gear(gear).reducer, GEAR)  # type: ignore[arg-type]
    maps = [read_disc(path, gear, _how()).fitted for path in files]
    alpha = crank_angles(drive)

    def error(i: int, j: int, mark: int) -> float:
        assembly = Assembly(drive.with_marks((0, mark)), [maps[i], maps[j]], slices=3)
        curves = [np.degrees(assembly.solve(alpha, s * drive.rated_nm).psi) * 3600.0 for s in (1.0, -1.0)]
        return float(max(np.ptp(curve) for curve in curves))

    (pair,) = found["pairs"]
    i, j = (int(pair[name][1:]) for name in ("first", "second"))
    assert pair["transmission_arcsec"] == pytest.approx(error(i, j, pair["mark"]), rel=0.02)
    others = [error(a, b, m) for a in range(3) for b in range(a + 1, 3) for m in (0, 5)]
    assert pair["transmission_arcsec"] <= 1.1 * min(others)
    assert found["left_over"] == [f"d{n}" for n in {0, 1, 2} - {i, j}]
    assert pair["mark_deg"] == pytest.approx((360.0 * pair["mark"] - 180.0) / GEAR.zc % 360.0)
    assert found["worth_arcsec"] >= 0.0
    built = Assembly(drive.with_marks((0, pair["mark"])), [maps[i], maps[j]], slices=3)

    turned: dict[float, float] = {}  # mean output angle in arcsec by share of rated torque, each from the larger one
    for sense in (1.0, -1.0):
        pose = None
        for share in (1.0, 0.5, 0.03, 3e-3, 3e-4):
            pose = built.solve(alpha, sense * share * drive.rated_nm, pose)
            turned[sense * share] = float(np.mean(np.degrees(pose.psi))) * 3600.0
    assert pair["backlash_arcsec"] == pytest.approx(turned[3e-4] - turned[-3e-4], rel=1e-3)
    assert pair["lost_motion_arcsec"] == pytest.approx(turned[0.03] - turned[-0.03], rel=1e-3)
    risen = [sense * (turned[sense] - turned[0.5 * sense]) / 60.0 for sense in (1.0, -1.0)]
    assert pair["stiffness_nm_arcmin"] == pytest.approx(np.mean(0.5 * drive.rated_nm / np.array(risen)), rel=0.02)


def _how() -> DiscFile:
    columns: dict[str, Any] = {"space": 1, "flank": 2, "x": 3, "y": 4, "z": 5, "probe_u_um": 0.1}
    return DiscFile(columns=columns)


def test_the_drawn_flanks_scatter_as_repeated_inspections_do(tmp_path: Path) -> None:
    gear, depth = gear_file(tmp_path), np.zeros(GEAR.zc)
    found: list[InspectedFlank] = [
        read_disc(disc(tmp_path / f"r{n}.csv", depth, 100 + n), gear, _how()) for n in range(24)
    ]
    places, patterns = inspection_patterns(GEAR, found[0], clamping_um=0.0)
    spread = np.einsum("gis,gjs->gij", patterns, patterns)
    u = 1e3 * np.sqrt(np.einsum("ni,nij,nj->n", places.form, spread[places.of], places.form))
    seen = np.std([one.fitted.deviation_um for one in found], axis=0).ravel()
    assert float(np.sqrt(np.mean(u**2))) == pytest.approx(float(np.sqrt(np.mean(seen**2))), rel=0.1)
    # The clamping: 0.5 um (k = 2) each way, as the record states it too.
    whole = inspection_patterns(GEAR, found[0])[1]
    terms = np.einsum("gis,gjs->gij", whole, whole)
    rms = 1e3 * np.sqrt(np.mean(np.einsum("ni,nij,nj->n", places.form, terms[places.of], places.form)))
    assert rms == pytest.approx(found[0].rms_u_um, rel=0.15)


def test_an_inspected_disc_in_the_library_carries_the_inspection_s_uncertainty(
    discs: tuple[Path, list[Path]],
) -> None:
    gear_path, files = discs
    gear = tf.Gear.load(gear_path)
    parts = [tf.read_flank(path, gear, columns=dict(_how().columns or {})) for path in files[:2]]
    again = [read_disc(path, gear_path, _how()) for path in files[:2]]
    for part, record in zip(parts, again, strict=True):
        np.testing.assert_array_equal(part.deviation, record.fitted.deviation_um)
        assert part.u is not None
        assert 0.05 < float(np.sqrt(np.mean(part.u**2))) < 0.5
    found = tf.match(tf.Reducer.of(gear, datum="crank-holes"), parts, marks=[0, 5])
    assert found.found.pairs[0].error_arcsec > 0.0


@pytest.mark.long
def test_what_is_expected_of_a_pair_is_wider_by_a_worse_inspection(tmp_path: Path) -> None:
    gear, depth = gear_file(tmp_path), 2.0 * np.cos(4.0 * np.pi * np.arange(GEAR.zc) / GEAR.zc)
    wide = []
    for noise in (0.05, 2.0):
        files = [disc(tmp_path / f"n{noise}-{n}.csv", depth, n, noise) for n in range(2)]
        told = called(gear, *files, "--mark", 0, *WORDS, "--uncertainty", "--json")
        wide.append(json.loads(told.output)["pairs"][0]["expected"]["error_arcsec"]["u"])
    assert wide[1] > wide[0]


def test_the_screen_says_pairs_worth_and_what_is_left_out(discs: tuple[Path, list[Path]]) -> None:
    gear, files = discs
    told = called(gear, *files[:2], "--mark", 0, *WORDS)
    assert told.exit_code == 0, told.output
    assert "pairing gains" in told.output
    assert "stiffness" in told.output
    assert "without friction" in told.output
    assert "d0" in told.output


def test_a_pair_that_cannot_be_assembled_is_named_with_its_surplus_by_command_and_library(tmp_path: Path) -> None:
    """6 um of clearance, 3 um that assembly may squeeze: spaces 15 um too narrow all round leave surplus, 1 um none."""
    gear, files = gear_file(tmp_path), []
    for name, depth in (("wide", 0.0), ("wide2", 1.0), ("narrow", 15.0), ("narrow2", 15.0)):
        files.append(disc(tmp_path / f"{name}.csv", np.full(GEAR.zc, depth), 7))
    said = " ".join(called(gear, *files[2:], "--mark", 0, *WORDS).output.split())
    assert "narrow with narrow2 in position 0 cannot be assembled" in said
    assert "may squeeze 3 µm" in said
    (pair,) = json.loads(called(gear, *files[2:], "--mark", 0, *WORDS, "--json").output)["pairs"]
    assert pair["assembles"] is False
    # 15 - 6 um where nothing moves; the normals all point to the pitch point, so the disc moves, by less than that
    assert 15.0 - 6.0 - 1.0 < pair["interference_um"] < 2.0 * (15.0 - 6.0)
    assert "cannot be assembled" not in called(gear, *files[:2], "--mark", 0, *WORDS).output
    gear_given = tf.Gear.load(gear)
    parts = [tf.read_flank(path, gear_given, columns=dict(_how().columns or {})) for path in files]
    drive = tf.Reducer.of(gear_given, datum="crank-holes")
    tight, loose = (tf.match(drive, two, marks=[0]) for two in (parts[2:], parts[:2]))
    assert tight.pairs[0]["assembles"] is False
    assert tight.pairs[0]["interference_um"] == pytest.approx(pair["interference_um"], rel=0.1)
    assert "1 cannot be assembled" in repr(tight)
    assert loose.pairs[0]["assembles"] is True
    allowed = tf.match(drive.but(interference_um=20.0), parts[2:], marks=[0])
    assert allowed.pairs[0]["assembles"] is True


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda folder, gear, files: (gear_file(folder, ""), *files), "E-MATCH-REDUCER"),
        (lambda folder, gear, files: (gear, files[0], files[0]), "E-MATCH-TWICE"),
        (lambda folder, gear, files: (gear, files[0]), "E-REDUCER-MATCH"),
        (lambda folder, gear, files: (gear, *files[:2], "--mark", 11), "E-MATCH-MARK"),
        (lambda folder, gear, files: (gear, files[0], folder / "nothing.csv"), "E-FILE-READ"),
        (lambda folder, gear, files: (folder / "no.toml", *files), "E-STUDY-READ"),
    ],
)
def test_what_cannot_be_paired_is_refused(make: Any, code: str, discs: tuple[Path, list[Path]], tmp_path: Path) -> None:
    gear, files = discs
    result = called(*make(tmp_path, gear, files), *WORDS)
    assert isinstance(result.exception, TrueflankError), result.output
    assert result.exception.code == code
