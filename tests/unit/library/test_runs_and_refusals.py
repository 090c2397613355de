"""A machine from a run, and what looks like an error or a gear and is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trueflank as tf
from gateway.cli import app
from gateway.gear.first_order import judged
from gateway.gear.flank import flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.known import ErrorModel, LocationError, Unknown, chain_of_errors
from gateway.store import records
from gateway.study.machine import gear_of, grid_of

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
        unknown=(Unknown("EYX", 5.0, "um"),),
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
    e = np.broadcast_to(judged(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
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
        (lambda: tf.fit(READ, "EXX")(MASKED), "a masked array"),
        (lambda: tf.Machine().matrix("X", "bed", X=MASKED), "a masked array"),
        (lambda: tf.Machine(seed=1).u("EXX"), "uncertainty"),
        (lambda: tf.Gear.of(rp=0.064, rrp=0.003, a=0.0013, zp=40, zc=39, centre_distance=0.16), "lengths are in mm"),
        (lambda: tf.Gear.of(rp=64e3, rrp=3e3, a=1.3e3, zp=40, zc=39, centre_distance=160e3), "lengths are in mm"),
    ],
)
def test_what_looks_like_an_error_or_a_gear_is_refused(wrong, said: str) -> None:
    with pytest.raises(tf.TrueflankError) as refused:
        wrong()
    assert said in str(refused.value)


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
