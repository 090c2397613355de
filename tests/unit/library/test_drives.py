"""Drives from the library: the figures are the full model's, parts are named, wrong input is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import trueflank as tf
from gateway.reducer.figures import transmission
from gateway.reducer.records import for_gear
from gateway.study.inputs import gear_of
from gateway.tooth import FlankMap
from tests.unit.reducer.drives import COARSE, coarse

GEAR = tf.Gear.of(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, centre_distance=120.0)


@pytest.fixture(scope="module")
def part() -> tf.Flank:
    return tf.flank(tf.Machine({"EXC": 0.5, "ECC": {"type": "fourier", "a": [0.0, 3.0]}}), GEAR)


def test_the_library_s_drive_is_the_full_model_s(part: tf.Flank, monkeypatch: pytest.MonkeyPatch) -> None:
    coarse(monkeypatch)
    drive = tf.Reducer.of(GEAR, datum="bore")
    found = tf.transmission(drive, part, steps=COARSE)
    plain = transmission(
        for_gear(gear_of(GEAR.data), "bore"),
        [FlankMap(np.deg2rad(part.angle), part.height, part.deviation)] * 2,
        steps=COARSE,
    )
    assert found.error == pytest.approx(plain.error_arcsec, rel=1e-9)
    told = json.loads(json.dumps(found.to_dict()))
    assert told["lost_motion_arcsec"] == found.lost_motion
    assert found.curve(-1).shape == (COARSE * 11,)
    assert "without friction" in repr(found)


def test_a_drive_is_changed_by_what_differs() -> None:
    drive = tf.Reducer.shipped("RV-40E-like", datum="bore", marks=(0, 20), output={"clearance_um": 2.0}, rated_nm=400.0)
    assert [place.mark for place in drive.data.discs] == [0, 20]
    assert drive.data.output.clearance_um == 2.0
    assert drive.but(pins={"radius_um": [0.1] * 40}).data.pins.radius_um == (0.1,) * 40
    assert json.dumps(drive.to_dict())


def test_what_is_no_part_or_datum_is_refused(part: tf.Flank) -> None:
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        tf.Reducer.shipped("RV-40E-like", datum="bore", colour="red")
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        tf.Reducer.shipped("RV-40E-like", datum="bore", output={"stiffness": 1.0})
    with pytest.raises(tf.TrueflankError, match="E-REDUCER-DATUM"):
        tf.Reducer.of(GEAR, datum="table")
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        tf.transmission(GEAR, part)  # type: ignore[arg-type]
    with pytest.raises(tf.TrueflankError, match="E-REDUCER-FLANK"):
        tf.transmission(tf.Reducer.shipped("RV-40E-like", datum="bore"), part)


def test_two_discs_are_matched_in_their_best_position(part: tf.Flank, monkeypatch: pytest.MonkeyPatch) -> None:
    coarse(monkeypatch)
    other = tf.flank(tf.Machine({"ECC": {"type": "fourier", "a": [3.0]}}), GEAR)
    found = tf.match(tf.Reducer.of(GEAR, datum="bore"), [part, other], marks=[1, 6], steps=COARSE)
    assert len(found.pairs) == 1
    assert found.to_dict()["worth_arcsec"] >= 0.0
