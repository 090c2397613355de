"""Doubts about readings reach every figure and table, and only a person's word with a reason lets them pass."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import trueflank as tf
from drivers.errors import TrueflankError
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import AxisUnit
from gateway.cli import app
from gateway.errors import InDoubt
from gateway.evaluate.behaviour.doubts import blocking_doubts, doubts_of, gap_across
from gateway.evaluate.optics.rotary_calibration import closure, rotary_deviations
from gateway.store import RunFolder
from gateway.table.conversion import FileDatum, TableRequest, convert

RUNNER = CliRunner()
CLOSED = (0.0, 3.0, 5.0, 4.0, 1.0, -2.0, -4.0, -1.0, 0.0)
REVERSALS = (0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
ACCEPT = "S-EVAL-CLOSURE-FAR=the belt slipped on the way back"
TO_TABLE = ("--to", "eec", "--axis", "C1", "--reference", "0", "--datum", "0=0", "--modulo")


def gap_of(at: object, x: object) -> float:
    found = closure(at, x)  # type: ignore[arg-type]
    assert found is not None
    return found.gap


def typed(*words: object) -> Result:
    return RUNNER.invoke(app, [str(word) for word in words])


def turn(folder: Path, gap: float) -> Path:
    """Two bidirectional passes over a turn in steps of 45 deg, the last place ``gap`` arcsec above the first."""
    rows = ["target_deg,direction,repetition,deviation_arcsec"]
    for run in (1, 2):
        for way, sign in (("+", 1.0), ("-", -1.0)):
            for step, value in enumerate(CLOSED):
                read = value + sign * REVERSALS[step] + (gap if step == 8 else 0.0) + 0.01 * run
                rows.append(f"{45 * step},{way},{run},{read:.3f}")
    path = folder / f"turn{gap:g}.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def codes(doubts: tuple[Doubt, ...]) -> list[str]:
    return [one.code for one in doubts if one.blocking]


def test_a_turn_that_does_not_close_stops_the_verdict_until_a_person_answers_for_it(tmp_path: Path) -> None:
    path = turn(tmp_path, 6.0)
    refused = typed("evaluate", path, "--limit", "A=100", "--json")
    assert refused.exit_code == 21
    told = json.loads(refused.stdout)[0]
    assert told["verdicts"][0]["verdict"] == "not decidable"
    assert [one["code"] for one in told["doubts"] if one["blocking"]] == ["S-EVAL-CLOSURE-FAR"]
    allowed = typed("evaluate", path, "--limit", "A=100", "--accept-doubt", ACCEPT, "--json")
    assert allowed.exit_code == 0
    told = json.loads(allowed.stdout)[0]
    assert told["verdicts"][0]["verdict"] == "pass"
    assert [one["accepted"] for one in told["doubts"] if one["accepted"]] == ["the belt slipped on the way back"]


def test_no_table_comes_of_a_turn_that_does_not_close(tmp_path: Path) -> None:
    path, out = turn(tmp_path, 6.0), tmp_path / "c.spf"
    for to in ("eec", "linuxcnc"):
        refused = typed("tables", "convert", path, *("--to", to), *TO_TABLE[2:], "-o", out)
        assert isinstance(refused.exception, InDoubt)
        assert "--accept-doubt S-EVAL-CLOSURE-FAR=" in refused.exception.hint
        assert not out.exists()
    assert typed("tables", "convert", path, *TO_TABLE, "-o", out, "--accept-doubt", ACCEPT).exit_code == 0
    assert "S-EVAL-CLOSURE-FAR accepted: the belt slipped" in out.read_text(encoding="ascii")
    for wrong in ("S-EVAL-CLOSURE-FAR", "S-EVAL-CLOSURE-FAR=", "CLOSURE=because"):
        answer = typed("tables", "convert", path, *TO_TABLE, "-o", out, "--accept-doubt", wrong)
        assert isinstance(answer.exception, TrueflankError)
        assert answer.exception.code == "E-DOUBT-ACCEPT"
    assert typed("tables", "convert", turn(tmp_path, 0.0), *TO_TABLE, "-o", tmp_path / "d.spf").exit_code == 0


def test_a_record_in_doubt_is_refused_below_every_command() -> None:
    at = np.arange(0.0, 361.0, 45.0)
    found = MeasuredSet(at, np.zeros((9, 1, 2)), "deg", doubts=(Doubt("S-EVAL-CLOSURE-FAR", blocking=True),))
    with pytest.raises(InDoubt, match="E-COMP-DOUBT"):
        convert(found, TableRequest("axis", "C1", 0.0, FileDatum(0.0), modulo=True))


def test_the_report_of_a_file_in_doubt_passes_nothing(tmp_path: Path) -> None:
    path = turn(tmp_path, 6.0)
    made = typed("report", path, "--out", tmp_path, "--json")
    assert made.exit_code == 21
    assert json.loads(made.stdout)["doubts"] == ["turn6 S-EVAL-CLOSURE-FAR"]


def test_the_library_refuses_to_fit_what_is_in_doubt(tmp_path: Path) -> None:
    path = turn(tmp_path, 6.0)
    found = tf.read(path)
    assert tf.evaluate(found, limits={"A": 100.0}).verdicts == {"A": "not decidable"}
    with pytest.raises(TrueflankError, match="E-DOUBT-OPEN"):
        tf.fit(found, "ECC")
    allowed = tf.read(path, accepted={"S-EVAL-CLOSURE-FAR": "slipped"})
    assert tf.evaluate(allowed, limits={"A": 100.0}).verdicts == {"A": "pass"}
    assert tf.fit(allowed, "ECC").unit == "arcsec"
    closed = tf.evaluate(tf.read(turn(tmp_path, 0.0)))
    assert (closed["E"], closed["M"], closed["B"]) == pytest.approx((9.2, 9.0, 0.2), abs=1e-6)
    # Typed, not from a file: the same doubts.
    turned = np.array([[[0.0, 0.0]], [[1.0, 1.0]], [[2.0, 2.0]], [[1296001.0, 3.0]]])
    by_hand = tf.Measured(np.array([0.0, 90.0, 180.0, 270.0]), turned, "deg")
    with pytest.raises(TrueflankError, match="E-DOUBT-OPEN"):
        tf.fit(by_hand, "ECC")


@pytest.mark.parametrize(
    ("targets", "deviations"),
    [
        # A gauge of 25 mm probed at five places of an axis: reading less target.
        ([10.0, 35.0, 60.0, 85.0, 110.0], [15000.0, -10000.0, -35000.0, -60000.0, -85000.0]),
        # Two stops at which the counter had no reading.
        ([5.0, 10.0, 15.0, 20.0, 25.0], [-5000.0, -10000.0, 1.7, -1.1, 4.0]),
        ([5.0, 10.0, 15.0, 20.0, 25.0], [9994000.0, 0.3, 1.7, -1.1, 4.0]),
    ],
)
def test_deviations_of_the_size_of_the_travel_are_in_doubt(targets: list[float], deviations: list[float]) -> None:
    x = np.array(deviations).reshape(-1, 1, 1) + np.array([0.0, np.nan])
    assert codes(doubts_of(targets, x, "mm")) == ["S-EVAL-SPREAD"]
    assert codes(doubts_of(targets, x / 2000.0, "mm")) == [] or max(map(abs, deviations)) > 100000.0


def test_a_coarse_axis_and_a_shifted_zero_are_no_doubt() -> None:
    at = np.linspace(0.0, 300.0, 11)
    coarse = (0.4 * at)[:, None, None] + np.zeros((11, 1, 2))  # 0.4 um/mm: a hobbyist's screw
    assert codes(doubts_of(at, coarse, "mm")) == []
    assert codes(doubts_of(at, coarse + 5000.0, "mm")) == []
    # Straightness as read along a straightedge, and pitch in arcsec, by their own limits.
    assert codes(doubts_of(at, 3.0 * coarse, "mm", "um")) == []
    assert codes(doubts_of(at, 10.0 * coarse, "mm", "arcsec")) == []
    assert codes(doubts_of(at, 40.0 * coarse, "mm", "arcsec")) == ["S-EVAL-SPREAD"]


def test_an_axis_measured_across_zero_is_not_joined_the_long_way_round(tmp_path: Path) -> None:
    at = np.array([0.0, 10.0, 20.0, 340.0, 350.0])
    assert gap_across(at) == (20.0, 340.0)
    assert codes(doubts_of(at, np.zeros((5, 2, 2)), "deg")) == ["S-EVAL-ARC"]
    for whole in ([0.0, 120.0, 240.0], [0.0, 10.0, 20.0, 30.0], [340.0, 350.0, 360.0, 370.0, 380.0], [0.0, 360.0]):
        assert gap_across(np.array(whole)) is None
    path = tmp_path / "arc.csv"
    rows = [f"{place:g},{way},1,{0.1 * place % 7:.2f}" for place in at for way in "+-"]
    path.write_text("\n".join(["target_deg,direction,repetition,deviation_arcsec", *rows]) + "\n", encoding="utf-8")
    # Read from a file, the arc is arranged as it was measured, and nothing of it is known on the way round.
    told = typed("evaluate", path)
    assert told.exit_code == 0
    assert "340" in told.output
    refused = typed("tables", "convert", path, *TO_TABLE[:-1], "--modulo", "-o", tmp_path / "arc.spf")
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == "E-COMP-TURN"
    found = tf.read(path)
    assert found.targets.tolist() == [-20.0, -10.0, 0.0, 10.0, 20.0]
    np.testing.assert_allclose(found.deviations[:, 0, 0], [34.0 % 7, 35.0 % 7, 0.0, 1.0, 2.0])
    assert tf.fit(found, "ECC", modulo=True).range == (-20.0, 20.0)
    with pytest.raises(TrueflankError, match="E-DOUBT-OPEN"):
        tf.fit(tf.Measured(at, np.zeros((5, 2, 2)), "deg"), "ECC", modulo=True)


def test_a_closing_error_is_found_among_any_targets_whole_turns_apart() -> None:
    at = np.array([0.0, 120.0, 240.0, 360.0, 480.0, 720.0])
    x = np.array([0.0, 1.0, 2.0, 0.2, 6.0, 0.3])
    assert gap_of(at, x) == pytest.approx(5.0)  # 480 less 120 deg
    both = np.stack([x, x + 8.0], axis=1)[:, None, :]
    both[0, :, 1] = np.nan  # one approach is missing there: its reversal of 8 arcsec is no closing error
    assert gap_of(at, both) == pytest.approx(5.0)
    assert closure([0.0, 90.0, 180.0], [0.0, 1.0, 2.0]) is None


def closing(gaps: list[float], *, device: float = 1.0, sign: float = 1.0) -> list[str]:
    """Codes of a turn read once for each gap; coming back it closes with ``sign`` times the gap."""
    at, x = np.arange(0.0, 361.0, 24.0), np.zeros((16, len(gaps), 2))
    x[-1, :, 0], x[-1, :, 1] = gaps, sign * np.asarray(gaps)
    return [one.code for one in doubts_of(at, x, "deg", device_arcsec=device) if "CLOSURE" in one.code]


def test_a_turn_closes_within_what_its_instrument_and_its_runs_can_tell() -> None:
    """Limit = hypot(U of the instrument, 2 s / sqrt(n) of the runs' own gaps), by hand for each case."""
    far, near = ["S-EVAL-CLOSURE-FAR"], ["S-EVAL-CLOSURE"]
    assert closing([1.01]) == far
    assert closing([0.99]) == near
    assert closing([1.8], device=2.0) == near  # a calibrator of 2 arcsec cannot tell
    assert closing([0.5], device=0.2) == near  # of a single run nobody knows the scatter
    assert closing([0.5, 0.5, 0.52], device=0.2) == far
    assert closing([-3.0, 0.0, 6.0]) == near  # mean 1.0, s 4.58, u 2.65: limit 5.4
    assert closing([6.0, 6.1, 5.9, 6.0, 6.0]) == far  # a slip of every turn is no scatter
    assert closing([6.0, 6.1, 5.9], sign=-1.0) == far  # a drift closes with opposite signs: no mean hides it
    x = np.zeros((5, 1, 2))
    x[0, :, 1], x[-1, :, 0], x[-1, :, 1] = np.nan, 0.4, 9.0
    assert gap_of(np.array([0.0, 90.0, 180.0, 270.0, 360.0]), x) == pytest.approx(0.4)


def test_a_step_far_wider_than_the_others_is_a_doubt() -> None:
    def gaps(at: list[float], unit: AxisUnit = "deg", *, modulo: bool = False) -> list[tuple[float, float]]:
        found = doubts_of(np.array(at), np.zeros((len(at), 1, 2)), unit, modulo=modulo)
        return [(one.numbers["low"], one.numbers["high"]) for one in found if one.code == "S-EVAL-GAP"]

    part = [float(one) for one in range(0, 241, 15)]
    assert gaps(part) == []  # an arc: nothing is joined beyond it
    assert gaps(part, modulo=True) == [(240.0, 360.0)]  # an endless axis: the curve goes round through 120 deg
    assert gaps([one for one in range(0, 361, 15) if not 90 < one < 180]) == [(90.0, 180.0)]
    assert gaps([float(one) for one in range(0, 360, 15)], modulo=True) == []
    assert gaps([0.0, 10.0, 20.0, 30.0, 40.0, 400.0], "mm") == [(40.0, 400.0)]
    assert gaps([0.0, 7.0, 23.0, 31.0, 55.0, 61.0], "mm") == []  # targets off an even grid, as the standard asks
    at = np.array(part)
    kept = tf.Measured(at, np.zeros((17, 1, 2)), "deg", name="ECC")
    assert "S-EVAL-GAP" in [one.code for one in tf.fit(kept, modulo=True).doubts]
    assert "S-EVAL-GAP" not in [one.code for one in tf.fit(kept).doubts]


def test_readings_over_several_turns_have_their_datum_at_the_reference() -> None:
    at = np.array([0.0, 180.0, 360.0, 540.0, 720.0])
    slip = np.array([0.0, 1.0, 2.0, 3.0, 4.0])  # arcsec, growing from turn to turn
    read = rotary_deviations(np.zeros(5), at + slip / 3600.0, at, reference_deg=720.0)
    np.testing.assert_allclose(read, slip - 4.0, atol=1e-7)
    read = rotary_deviations(np.zeros(5), np.mod(at + slip / 3600.0, 360.0), at, reference_deg=360.0)
    np.testing.assert_allclose(read, slip - 2.0, atol=1e-7)


def test_one_function_states_u_for_command_and_library(tmp_path: Path) -> None:
    rows = [
        f"{place},{way},{run},{place / 100 + run / 10 + (way == '-'):.2f}"
        for place in (0, 90, 250)
        for way in "+-"
        for run in (1, 2)
    ]
    path = tmp_path / "x.csv"
    path.write_text("\n".join(["target_mm,direction,repetition,deviation_um", *rows]) + "\n", encoding="utf-8")
    for material in (None, 20.5):
        option = () if material is None else ("--material-degc", material)
        command = json.loads(typed("evaluate", path, "--json", *option).stdout)[0]
        library = tf.evaluate(tf.read(path), material_degc=material)
        assert pytest.approx(command["U"]) == library.U
        assert dict(library.contributions) == pytest.approx(command["contributions"])
        # ISO/TR 230-9: 0.6 |T - 20| L R(alpha), L in m, R(alpha) 2 ppm/K; unknown counts as 15 K.
        off = 15.0 if material is None else 0.5
        assert library.contributions["expansion"] == pytest.approx(0.6 * off * 0.25 * 2.0)
        assert any("--material-degc" in line for line in library.supposed) == (material is None)
        assert any(line.startswith("U contains (k = 2, ") for line in library.supposed)
    register = tf.evaluate(tf.read(path), material_degc=20.0, equipment={"um_per_m": 2.0})
    assert register.contributions["device"] == pytest.approx(0.5)


def test_what_blocks_is_first_and_named() -> None:
    at = np.arange(0.0, 361.0, 45.0)
    x = np.zeros((9, 2, 2))
    x[-1] = 2e6
    found = doubts_of(at, x, "deg")
    assert [one.code for one in found[:2]] == ["S-EVAL-SPREAD", "S-EVAL-CLOSURE-FAR"]
    assert all(one.remedy for one in blocking_doubts(found))


def test_an_import_keeps_its_doubts_and_what_a_person_said_of_them(tmp_path: Path) -> None:
    path, store = turn(tmp_path, 6.0), tmp_path / "runs"
    told = json.loads(typed("import", path, "--store", store, "--json", "--accept-doubt", ACCEPT).stdout)[0]
    assert "S-EVAL-CLOSURE-FAR accepted: the belt slipped" in " ".join(told["notes"])
    kept = RunFolder(Path(told["folder"])).get("measured", MeasuredSet)
    assert [one.settled for one in kept.doubts if one.code == "S-EVAL-CLOSURE-FAR"] == [
        "the belt slipped on the way back"
    ]


def test_the_other_kinds_decide_nothing_of_readings_in_doubt(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    rows = [f"{10 * at},+,1,{9999000 if at == 2 else at % 2}" for at in range(5)]
    path.write_text("\n".join(["target_mm,direction,repetition,deviation_um", *rows]) + "\n", encoding="utf-8")
    result = typed("evaluate", path, "--kind", "straightness", "--limit", "s.csv lsq=1e9", "--json")
    assert result.exit_code == 21, result.output
    assert "S-EVAL-SPREAD" in {one["code"] for one in json.loads(result.stdout)["doubts"]}


def smooth(repetitions: int) -> tuple[np.ndarray, np.ndarray]:
    """Targets (m,) and readings (m, n, 2) of a quiet axis, um."""
    at = np.arange(0.0, 481.0, 40.0)
    scatter = np.random.default_rng(7).normal(0.0, 0.3, (at.size, repetitions, 2))
    return at, 4.0 * np.sin(at / 90.0)[:, None, None] + scatter + np.array([0.5, -0.5])


@pytest.mark.parametrize("repetitions", [1, 2, 3, 5])
@pytest.mark.parametrize("place", [0, 1, 6, 12])
@pytest.mark.parametrize("off", [1000.0, -500.0, 150.0])
def test_a_reading_that_no_axis_has_stops_the_verdict_with_and_without_repetitions(
    repetitions: int, place: int, off: float
) -> None:
    """1000 for "no reading" stays below the share of the travel that a whole set is doubted by."""
    at, x = smooth(repetitions)
    assert "S-EVAL-OUT-FAR" not in codes(doubts_of(at, x, "mm"))
    x[place, 0, 1] += off
    (found,) = [one for one in doubts_of(at, x, "mm") if one.code == "S-EVAL-OUT-FAR"]
    assert found.blocking
    assert found.names["at"] == f"{at[place]:g}"
    assert found.numbers["off"] == pytest.approx(off, abs=5.0)


def test_a_smaller_jump_is_said_and_a_steady_curve_is_not_doubted() -> None:
    at, x = smooth(2)
    x[6, 0, 0] += 60.0
    assert [one.names["at"] for one in doubts_of(at, x, "mm") if one.code == "S-EVAL-JUMP"] == ["240"]
    steep = np.broadcast_to((0.3 * at + 0.5 * (at % 80))[:, None, None], x.shape)  # a wrong scale and a pitch error
    for honest in (smooth(2)[1], steep, np.zeros_like(x)):
        assert not [one.code for one in doubts_of(at, honest, "mm") if one.code in ("S-EVAL-JUMP", "S-EVAL-OUT-FAR")]


def test_a_table_leaves_out_what_a_run_leaves_out_and_says_so(tmp_path: Path) -> None:
    at, x = smooth(3)

    def converted(name: str, values: np.ndarray, *more: str) -> tuple[list[float], str]:
        rows = [f"{at[i]:g},{'+-'[w]},{j + 1},{values[i, j, w]:.4f}" for i, j, w in np.ndindex(values.shape)]
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(["target_mm,direction,repetition,deviation_um", *rows]) + "\n", encoding="utf-8")
        out = tmp_path / f"{name}.ini"
        told = typed(
            "tables", "convert", path, "--to", "eec", "--axis", "X1", "--reference", 0, "--datum", "0=0", "-o", out
        )
        assert told.exit_code == 0, told.output
        values = [float(line.split("=")[1]) for line in out.read_text().splitlines() if "ENC_COMP[" in line]
        return values, " ".join(told.output.split())

    plain, said = converted("plain", x)
    assert "out of line" not in said
    x[6, 0, 0] += 45.0
    cured, said = converted("bump", x)
    assert "out of line: at 240, approach +, reading 1 by +4" in said
    assert "the table leaves readings out of line out" in said
    assert max(abs(a - b) for a, b in zip(plain, cured, strict=True)) < 0.4e-3  # 15 um / 2 with the reading in it


def test_deviations_smaller_than_any_machines_stop_the_verdict(tmp_path: Path) -> None:
    """Millimetres under a heading of um: 8 um were 0.008 um, and PASS."""
    at, x = smooth(3)
    rows = [f"{at[i]:g},{'+-'[w]},{j + 1},{x[i, j, w] / 1000.0:.6f}" for i, j, w in np.ndindex(x.shape)]
    path = tmp_path / "x.csv"
    for unit, code in (("um", 21), ("mm", 0)):
        path.write_text("\n".join([f"target_mm,direction,repetition,deviation_{unit}", *rows]) + "\n", encoding="utf-8")
        told = typed("evaluate", path, "--json", "--limit", "A=20", "--material-degc", 20)
        assert told.exit_code == code, told.output
        found = [one["code"] for one in json.loads(told.stdout)[0]["doubts"] if one["blocking"]]
        assert found == (["S-EVAL-TINY"] if code else [])
    assert not [one for one in doubts_of(at, x / 1000.0, "mm") if one.code == "S-EVAL-TINY"], "proved when captured"


def test_an_axis_that_turns_by_its_letter_gets_no_table_of_lengths(tmp_path: Path) -> None:
    at, x = smooth(2)
    rows = [f"{at[i]:g},{'+-'[w]},{j + 1},{x[i, j, w]:.4f}" for i, j, w in np.ndindex(x.shape)]
    (tmp_path / "x.csv").write_text("\n".join(["target_mm,direction,repetition,deviation_um", *rows]) + "\n")
    words = ("--to", "eec", "--reference", 0, "--datum", "0=0", "-o", tmp_path / "x.ini", "--force")
    refused = typed("tables", "convert", tmp_path / "x.csv", *words, "--axis", "C1").exception
    assert isinstance(refused, TrueflankError)
    assert refused.code == "E-CLI-AXIS-UNIT"
    for axis in ("X1", "AX1", "V"):
        assert typed("tables", "convert", tmp_path / "x.csv", *words, "--axis", axis).exit_code == 0
