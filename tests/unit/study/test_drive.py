"""The drive in a study: rows, data, picture, and figures that the full model and hand calculation vouch for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from drivers.errors import ConfigError
from gateway.errors import ModelError
from gateway.reducer.contact import Assembly
from gateway.study import drawing
from gateway.study.calculate import Study, study
from gateway.study.drive import drive_data, drive_rows, flank_map, reducer_of, state_rows
from gateway.study.inputs import ErrorFile, GearFile, gear_of, validate_file
from gateway.study.pictures import write_pictures
from gateway.study.plots import charts
from tests.unit.reducer.drives import coarse

GEAR = {
    "name": "twelve pins",
    "gear": {"rp": 36.0, "rrp": 2.5, "a": 1.5, "zp": 12, "zc": 11, "b": 10.0, "drrp": 0.008},
    "grinding": {"centre_distance_mm": 120.0},
    "flank": {"profile": 5, "width": 2},
    "reducer": {"datum": "crank-holes", "rated_nm": 100.0, "marks": (0,), "crank_phases_deg": (0.0,)},
}
ERRORS = {
    "name": "eccentric",
    "errors": {"EXC": {"type": "fourier", "a": [0.0, 2.0]}, "EXX": 1.0, "EZX": 5.0},
}


@pytest.fixture(scope="module")
def found() -> Study:
    with pytest.MonkeyPatch.context() as patch:
        coarse(patch)  # what is judged here are the study's own ways
        return study(validate_file(GEAR, GearFile, "gear"), validate_file(ERRORS, ErrorFile, "errors"), r=2)


def test_the_states_are_the_full_model_s_and_a_correction_helps(found: Study) -> None:
    assert found.drive is not None
    before, after = found.drive.states["before"], found.drive.states["after"]
    part = flank_map(found.grid, found.before.deviation)
    psi = Assembly(found.drive.reducer, [part]).solve(before.crank_rad, 100.0).psi
    assert before.loaded[0].peak_to_peak_arcsec == pytest.approx(np.ptp(np.degrees(psi)) * 3600.0, rel=1e-6)
    assert after.error_arcsec < before.error_arcsec
    assert abs(found.drive.missed_arcsec) < 0.3 * before.error_arcsec


def test_what_changes_round_the_table_makes_the_error_and_a_constant_the_lost_motion(found: Study) -> None:
    assert found.drive is not None
    alone = {one.name: one for one in found.drive.alone}
    ranked = found.drive.ranking.rankings["transmission"]
    assert ranked[0].name == "EXC"
    assert alone["EZX"].here_error_arcsec == pytest.approx(0.0, abs=1e-6)
    gear = found.grinding.gear
    least = 2.0 * 0.005 * np.sqrt(1.0 - gear.K**2) / (gear.a * gear.zc) * 180 * 3600 / np.pi
    assert 0.8 * least < abs(alone["EXX"].lost_motion_arcsec) < 2.0 * least


def test_rows_data_and_picture_tell_it(found: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert found.drive is not None
    assert len(drive_rows(found.drive)) == 21
    assert next(row[0] for row in state_rows(found.drive)) == "transmission error"
    told = json.loads(json.dumps(drive_data(found.drive)))
    assert told["datum"] == "crank-holes"
    assert told["predicted_not_tested"] is True
    costs = [one["cost_arcsec"] for one in told["doubts"]]
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > 0.0
    monkeypatch.setattr(charts, "DPI", 40)
    for other in ("one_at_a_time", "flank_maps", "draw_ranking", "pitch", "axes_before_after"):
        monkeypatch.setattr(drawing, other, lambda figure, *_: figure.clear())  # judged in tests of their own
    picture = next(path for path in write_pictures(found, tmp_path) if path.stem == "transmission")
    pixels = image.imread(picture)
    assert np.std(pixels[..., :3]) > 0.05


def test_a_reducer_without_datum_or_with_a_wrong_part_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"reducer\.datum"):
        validate_file({**GEAR, "reducer": {}}, GearFile, "gear")
    file = validate_file({**GEAR, "reducer": {"datum": "bore", "marks": (0, 1, 2)}}, GearFile, "gear")
    assert file.reducer is not None
    with pytest.raises(ModelError, match="E-REDUCER-COUNT"):
        reducer_of(file.reducer, gear_of(file))
    one = validate_file(
        {**GEAR, "reducer": {"datum": "bore", "crank_phases_deg": (0.0,), "cranks": 3}}, GearFile, "gear"
    )
    assert one.reducer is not None
    drive = reducer_of(one.reducer, gear_of(one))
    assert (len(drive.discs), drive.output.number) == (1, 3)
