"""A machine from a run, and what looks like an error or a gear and is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trueflank as tf
from gateway.cli import app
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.plan.layers import correct
from gateway.gear.first_order import bounded_first_order
from gateway.gear.flank import flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, LocationError, UnmeasuredError, chain_of_errors
from gateway.reducer import figures, uncertainty
from gateway.reducer.goal import goal_of
from gateway.store import records
from gateway.study.calculate import prepare_study
from gateway.study.inputs import gear_of
from gateway.study.machine import grid_of
from gateway.tooth import FlankMap
from gateway.workflow.tooth.proposal import _Task
from trueflank.drives import _drawn

ROOT = Path(__file__).parents[3]
GEAR = tf.Gear.load(ROOT / "examples" / "gears" / "rv-40e-like.toml")
FILE = ROOT / "tests" / "golden" / "files" / "basic.rtl"


def _fitted(name: str, unit: str, low: float, high: float, size: float) -> Any:
    """A fit of readings that a person can check: half a wave over the travel, twice, with a known scatter."""
    at = np.linspace(low, high, 13)
    curve = size * np.sin(np.pi * (at - low) / (high - low)) if unit == "mm" else size * np.cos(np.deg2rad(at))
    noise = 0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return tf.fit(tf.Measured(at, curve[:, None, None] + noise, unit, name=name)).component  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def model() -> ErrorModel:
    return ErrorModel(
        motions=(
            _fitted("EXX", "mm", -300.0, 0.0, 6.0),
            _fitted("EBZ", "mm", 0.0, 200.0, 8.0),
            _fitted("ECC", "deg", 0.0, 360.0, 5.0),
        ),
        locations=(LocationError("B0Z", 12.0, 0.7, "arcsec"),),
        unknown=(UnmeasuredError("EYX", 5.0, "um"),),
        systematic={"EXX": 0.4},
    )


def test_a_machine_is_loaded_from_the_errors_of_a_run(model: ErrorModel, tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    path.write_bytes(records.encode(model))
    machine = tf.Machine.load(path, height_mm=120.0)
    assert set(machine.to_dict()["errors"]) == {"EXX", "EBZ", "ECC", "B0Z"}
    assert machine.to_dict()["errors"]["B0Z"] == 12.0
    # The same flank as a run works it out on its own chain.
    grinding = Grinding(chain_of_errors(model, height_mm=120.0), gear_of(GEAR.data), 160.0)
    grid = grid_of(GEAR.data, grinding.gear)
    e = np.broadcast_to(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    assert tf.flank(machine, GEAR).rms == pytest.approx(1000.0 * flank_figure(e, grid.section.h).rms, rel=1e-4)
    for name in ("EXX", "EBZ", "ECC"):
        one = next(it for it in model.motions if it.name == name)
        np.testing.assert_array_equal(machine.motions[name].covariance, one.covariance)
    assert (machine.u("B0Z"), machine.u("EYX")) == pytest.approx((0.7, 5.0 / 3.0**0.5))
    assert machine.u("EXX") > 0.4  # what repetition does not show counts
    with pytest.raises(tf.TrueflankError, match=r"(?s)E-STUDY-HEIGHT.*EBZ is known from 0 to 200.*height_mm"):
        tf.flank(tf.Machine.load(path), GEAR)  # without its height the work would lie below what was measured


def test_the_command_takes_the_same_errors(model: ErrorModel, tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    wide = ErrorModel((_fitted("EXX", "mm", -300.0, 0.0, 6.0),), model.locations)
    path.write_bytes(records.encode(wide))
    gear = str(ROOT / "examples" / "gears" / "rv-40e-like.toml")
    told = CliRunner().invoke(app, ["study", gear, str(path), "--relative", "--plots", str(tmp_path), "--json"])
    assert told.exit_code == 0, told.output
    machine = tf.Machine.load(path)
    at = machine.positions(GEAR, 0, 0.0)
    exx = float(machine.motions["EXX"](at["X"]))
    assert float(machine.relative(**at)["dx"]) == pytest.approx(-exx, abs=2e-3)
    with pytest.raises(tf.TrueflankError, match="no run lies there"):
        tf.Machine.load(tmp_path)


READ = tf.read(FILE)
MASKED = np.ma.masked_array([0.0, 1.0], [False, True])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: tf.Machine({"EXX": [1.0, 2.0]}), "2 plain numbers"),
        (lambda: tf.Machine({"EXX": (1.0, 2.0)}), "2 plain numbers"),
        (lambda: tf.Machine({"EXX": np.array([1.0, 2.0, 3.0])}), "3 plain numbers"),
        (lambda: tf.Machine({"EXX": True}), "True"),
        (lambda: tf.Machine({"EXX": 1.0 + 2.0j}), "complex numbers"),
        (lambda: tf.Machine({"EXX": ([0.0, 1.0], [1.0j, 2.0])}), "complex numbers"),
        (lambda: tf.Machine({"EXX": ([0.0, 100.0], MASKED)}), "a masked array"),
        (lambda: tf.Machine({"EYX": tf.fit(READ, "EXX")}), "a fit of EYX, not a fit of EXX"),
        (lambda: tf.Measured([0.0, 1.0], np.ma.masked_array(np.zeros((2, 2, 2)), True), "mm"), "a masked array"),
        (lambda: tf.Measured([0.0, 1.0], np.zeros((2, 2, 2), dtype=complex), "mm"), "complex numbers"),
        (lambda: tf.Measured([0.0, 1.0], np.zeros((2, 2, 2), dtype=bool), "mm"), "truth values"),
        (lambda: tf.Measured(np.zeros(2, dtype="m8[s]"), np.zeros((2, 2, 2)), "mm"), "times"),
        (lambda: tf.Measured([0.0, 5.0, 5.0], np.zeros((3, 2, 2)), "mm"), "target 5 2 times"),
        (lambda: tf.fit(READ, "EXX")(MASKED), "a masked array"),
        (lambda: tf.Machine().matrix("X", "bed", X=MASKED), "a masked array"),
        (lambda: tf.Machine(seed=1).u("EXX"), "uncertainty"),
        (lambda: tf.Gear.of(rp=0.064, rrp=0.003, a=0.0013, zp=40, zc=39, centre_distance=0.16), "lengths are in mm"),
        (
            lambda: tf.Gear.of(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, centre_distance=160.0, b=0.012),
            "lengths are in mm",
        ),
        (lambda: tf.Gear.of(rp=64.0, rrp=0.003, a=1.3, zp=40, zc=39, centre_distance=160.0), "lengths are in mm"),
        (lambda: tf.Gear.of(rp=64e3, rrp=3e3, a=1.3e3, zp=40, zc=39, centre_distance=160e3), "lengths are in mm"),
    ],
)
def test_what_looks_like_an_error_or_a_gear_is_refused(wrong, said: str) -> None:
    with pytest.raises(tf.TrueflankError) as refused:
        wrong()
    assert said in str(refused.value)


def test_one_number_may_come_as_an_array_without_dimensions() -> None:
    assert tf.Machine({"B0Z": np.array(10.0)}).data.errors == tf.Machine({"B0Z": 10.0}).data.errors


def test_a_list_of_plain_numbers_is_refused_in_an_error_file_too(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text('name = "x"\n[errors]\nEXX = [1.0, 2.0]\n', encoding="utf-8")
    with pytest.raises(tf.TrueflankError, match="EXX is a list of plain numbers"):
        tf.Machine.load(path)
    path.write_text('name = "x"\n[errors]\nEXX = [1.0, { type = "poly", c = [0.0, 2.0] }]\n', encoding="utf-8")
    assert float(tf.Machine.load(path).relative(X=3.0, Z=0.0, C=0.0).dx) == pytest.approx(-7.0, abs=1e-3)


def test_a_quarter_of_a_turn_is_no_full_turn() -> None:
    part = tf.Machine({"ECC": ([0.0, 90.0], [1.0, 2.0])})
    with pytest.raises(tf.TrueflankError, match=r"E-MODEL-RANGE.*known from 0 to 90 deg"):
        tf.flank(part, GEAR)
    assert float(part.relative(X=-160.0, Z=0.0, C=45.0).ec) == pytest.approx(-1.5, abs=1e-6)


def test_uncertainties_are_of_all_errors_of_a_run_together(model: ErrorModel, tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    path.write_bytes(records.encode(model))
    machine = tf.Machine.load(path, height_mm=120.0)
    at = {"X": -160.0, "Z": np.array([115.0, 120.0, 125.0]), "C": np.array([0.0, 90.0, 200.0])}
    found = machine.relative(frame="work", **at)
    assert found.u is not None
    # Drawn: every error's coefficients by its fit's covariance, and what was stated beside it, by its own shapes.
    one = next(it for it in model.motions if it.name == "ECC")
    fitted = machine.motions["ECC"]
    np.testing.assert_allclose(found.u["ec"], fitted.u(at["C"]), rtol=1e-6)
    assert one.covariance.shape == fitted.covariance.shape
    exx = machine.motions["EXX"].u(-160.0)
    assert found.u["dx"][1] > exx, "what repetition does not show, the lean and the pitch add to it"
    flank = tf.flank(machine, GEAR)
    assert flank.u is not None
    assert flank.rms_u is not None
    assert flank.u.shape == flank.deviation.shape
    rng = np.random.default_rng(5)
    assert flank.doubts is not None
    form, of, patterns = flank.doubts.places.form, flank.doubts.places.of, flank.doubts.patterns
    lever = form[:, 2]
    drawn = []
    for _ in range(4000):
        e = 1000.0 * np.einsum("ni,ni->n", form, (patterns @ rng.normal(size=patterns.shape[-1]))[of])
        drawn.append(e - lever * (lever @ e) / (lever @ lever))
    np.testing.assert_allclose(np.std(drawn, axis=0), flank.u.ravel(), rtol=0.08)
    rms = np.sqrt(np.mean((flank.deviation.ravel() + np.array(drawn)) ** 2, axis=1))
    assert float(np.std(rms)) == pytest.approx(flank.rms_u, rel=0.1)
    assert tf.flank(tf.Machine({"EXX": 1.0}), GEAR).u is None
    stated = tf.Machine({"EXX": 1.0}, uncertainty={"linear_um": 0.0, "angular_arcsec": 0.0, "each": {"EXX": 0.5}})
    assert float(stated.relative(X=0.0, Z=0.0, C=0.0).u["dx"]) == pytest.approx(0.5)  # type: ignore[index]


DISC = tf.Gear.of(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, centre_distance=120.0)
UNSURE = tf.Machine(
    {"EXC": 0.5}, uncertainty={"linear_um": 0.0, "angular_arcsec": 0.0, "each": {"EXC": 2.0, "ECC": 2.0}}
)


def test_the_discs_of_a_drive_are_drawn_by_the_errors_of_their_machine() -> None:
    flank, other = tf.flank(UNSURE, DISC), tf.flank(tf.Machine({"EXC": 0.5}), DISC)
    assert flank.doubts is not None
    parts = [FlankMap(np.deg2rad(one.angle), one.height, one.deviation) for one in (flank, other, flank)]
    draw = _drawn([*parts], [flank, other, flank])
    assert callable(draw)
    rng, drawn = np.random.default_rng(3), []
    for _ in range(2000):
        first, same, last = draw(rng)
        assert same is parts[1], "nobody said how its machine may be wrong"
        np.testing.assert_array_equal(first.deviation_um, last.deviation_um)  # type: ignore[union-attr]
        drawn.append(first.deviation_um - flank.deviation)  # type: ignore[union-attr]
    spread = np.einsum("gis,gjs->gij", flank.doubts.patterns, flank.doubts.patterns)
    form, of = flank.doubts.places.form, flank.doubts.places.of
    u = 1000.0 * np.sqrt(np.einsum("ni,nij,nj->n", form, spread[of], form))
    np.testing.assert_allclose(np.std(drawn, axis=0).ravel(), u, rtol=0.1)


@pytest.mark.long
def test_a_drive_s_expected_figures_are_those_that_a_run_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uncertainty, "BLOCK", 2)
    monkeypatch.setattr(uncertainty, "SHARE", np.inf)  # both stop after the fewest trials
    monkeypatch.setattr(figures, "FEW_PINS_STEPS", 24)
    # The fit follows one wave; what its targets did not show is another one in every space.
    unseen = replace(_fitted("ECC", "deg", 0.0, 360.0, 5.0), residual_rms=4.0)
    path = tmp_path / "errors.json"
    path.write_bytes(records.encode(ErrorModel(motions=(unseen,))))
    machine = tf.Machine.load(path, height_mm=0.0)
    drive, model = tf.Reducer.of(DISC, datum="crank-holes"), machine.known.model
    assert model is not None
    found = tf.transmission(drive, tf.correct(machine, DISC).flank, uncertainty=True)
    ready = prepare_study(DISC.data, machine.data, model)
    correction = correct(ready.grinding, ready.grid, ready.used)
    task = _Task(ready.grinding, ready.grid, ready.used, model, ProcessUncertainty(), (), (), {}, {})
    told = task.drive(ready.used, correction, goal_of("transmission", drive.data))
    assert found.u is not None
    error, lost = (found.u.figures[name] for name in ("error_arcsec", "lost_motion_arcsec"))
    assert found.u.trials == told.trials
    assert told.transmission_arcsec == pytest.approx(error.mean, rel=1e-4)
    assert told.transmission_u_arcsec == pytest.approx(error.u, rel=1e-4)
    assert told.lost_motion_arcsec == pytest.approx(lost.mean, rel=1e-4)
    assert told.lost_motion_u_arcsec == pytest.approx(lost.u, rel=1e-4)
    without = replace(model, motions=(replace(unseen, residual_rms=0.0),))
    less = replace(task, model=without).drive(ready.used, correction, goal_of("transmission", drive.data))
    assert less.transmission_arcsec != pytest.approx(told.transmission_arcsec, rel=0.02)
    assert less.doubts[0].cost_arcsec < 0.01 * told.doubts[0].cost_arcsec
