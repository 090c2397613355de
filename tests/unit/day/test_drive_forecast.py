"""What a day says of the drive: figures before and after by the full model, and the error to measure for it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import trueflank as tf
from gateway.cli.files.day import _tell_tooth
from gateway.correct.plan.plan import AxisGrid
from gateway.gear.cycloid import CycloidGear
from gateway.model.error_model import ErrorModel, UnmeasuredError
from gateway.reducer.goal import goal_of
from gateway.reducer.records import DiscPlace, for_gear
from gateway.workflow.day.making import forecast
from gateway.workflow.tooth.messages import drive_forecast_messages
from gateway.workflow.tooth.proposal import ToothWork
from tests.unit.reducer.drives import coarse

GEAR = CycloidGear(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, drrp=0.006)
GRIDS = (
    AxisGrid("X", -200.0, 0.0, 20.0),
    AxisGrid("Z", -10.0, 10.0, 5.0),
    AxisGrid("C", 0.0, 360.0, 15.0, modulo=True),
)


def _work() -> ToothWork:
    drive = replace(for_gear(GEAR, "crank-holes"), discs=(DiscPlace(),))
    return ToothWork("disc", GEAR, 120.0, 0.0, goal=goal_of("transmission", drive))


def _model() -> ErrorModel:
    at = np.linspace(0.0, 360.0, 25)
    noise = 0.05 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    curve = 4.0 * np.cos(np.deg2rad(2.0 * at))
    read = tf.Measured(at, curve[:, None, None] + noise, "deg", name="ECC")
    return ErrorModel(
        motions=(tf.fit(read).component,),
        unknown=(UnmeasuredError("EXC", 3.0, "um"), UnmeasuredError("EZC", 3.0, "um")),
    )


def test_a_day_forecasts_the_drive_and_names_what_costs_it_most(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    coarse(monkeypatch)
    found = forecast(_model(), _work(), GRIDS)
    assert found.drive is not None
    rows = {row.name: row.transmission_arcsec for row in found.drive.rows}
    assert rows["this goal: transmission"] < rows["present state"]
    assert found.drive.doubts[0].error == "EXC"
    lines = list(map(str, drive_forecast_messages(found.drive)))
    assert "measure EXC next" in lines[-1]
    assert "without friction" in lines[0]
    assert found.as_data()["drive"]["doubts"][0]["cost_arcsec"] == found.drive.doubts[0].cost_arcsec
    _tell_tooth(SimpleNamespace(forecast=found, proposal=None))
    shown = " ".join(capsys.readouterr().out.split())
    assert "measure EXC next" in shown
    assert forecast(_model(), replace(_work(), goal=None), GRIDS).drive is None
