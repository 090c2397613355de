"""A run's error model as the page asks for it: the record's figures, and a flank that adds up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.message import Message
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.gear.cycloid import CycloidGear
from gateway.model.error_model import TWENTY_ONE, ErrorModel
from gateway.store import Store
from tests.unit.components.site import axis, site_of
from tests.unit.report import closing
from tests.unit.web.client import Client
from tests.unit.web.services import TOKEN, offered

GEAR = """
name = "small"
[gear]
rp = 64.0
rrp = 3.0
a = 1.3
zp = 40
zc = 39
b = 10.0
[grinding]
centre_distance_mm = 160.0
"""
WORK = {"gear": "gear.toml", "height_mm": 5.0}
RUN = "/api/v1/sites/grinder/runs"


def asking(folder: Path, model: ErrorModel, **more: Any) -> tuple[Client, str]:
    """A service with one run that holds this model, and the path of that run."""
    (folder / "gear.toml").write_text(GEAR, encoding="utf-8")
    offer = offered(folder, site_of([], **more))
    run = Store(folder).create("grinder")
    run.put("errors", model)
    return Client(offer.app, headers={"Authorization": f"Bearer {TOKEN}"}), f"{RUN}/{run.run_id}"


def flank(client: Client, run: str, sizes: str) -> Any:
    answer = client.get(f"{run}/flank?sizes={sizes}")
    assert answer.status_code == 200, answer.text
    return np.array(answer.json()["deviation_um"])


def test_every_error_has_its_range_its_u_its_place_and_its_cure(tmp_path: Path) -> None:
    model = closing.errors()
    client, run = asking(tmp_path, model, work=WORK)
    told = client.get(f"{run}/model").json()
    rows = {one["name"]: one for one in told["errors"]}
    assert set(rows) >= set(TWENTY_ONE)
    located = {one.name: one for one in model.locations}["B0Z"]
    assert (rows["B0Z"]["low"], rows["B0Z"]["U"], rows["B0Z"]["curve"]) == (located.value, 2 * located.u, None)
    curve = rows["EXC"]["curve"]
    assert (min(curve["value"]), max(curve["value"])) == pytest.approx(
        (rows["EXC"]["low"], rows["EXC"]["high"]), abs=0.02
    )
    assert max(curve["U"]) <= rows["EXC"]["U"] + 1e-3
    assert {one["error"] for one in told["tooth"]["ranking"]} == {one["error"] for one in told["tooth"]["cures"]}
    assert told["tooth"]["sizes"]["EXC"] == {"low": 0.0, "high": 2.0, "at": 1.0}
    assert told["tooth"]["sizes"]["EAZ"] == {"low": -1.0, "high": 1.0, "at": 0.0}, "only assumed: within its span"
    assert [one["name"] for one in told["tooth"]["next"] if not one["measured"]] == ["EAZ"]


def test_a_flank_follows_the_sizes_that_are_asked_for(tmp_path: Path) -> None:
    """Nothing leaves nothing, halves add up, and an index error of 1 arcsec moves the flank by its lever."""
    model = closing.errors()
    client, run = asking(tmp_path, model, work=WORK)
    names = [name for name in model.measured if name in TWENTY_ONE]
    none = ",".join(f"{name}:0" for name in names)
    assert np.max(np.abs(flank(client, run, none))) < 1e-3
    whole, half = flank(client, run, ""), flank(client, run, ",".join(f"{name}:0.5" for name in names))
    assert np.max(np.abs(whole)) > 1.0
    assert half == pytest.approx(whole / 2.0, abs=0.02)
    alone = ",".join(f"{name}:{2.0 if name == 'ECC' else 0.0}" for name in names)
    turned = flank(client, run, alone)
    component = model.motion("ECC")
    assert component is not None
    largest = np.sum(np.abs(component.coefficients)) * arcsec_to_rad(2.0) * mm_to_um(64.0)
    assert 0.0 < np.max(np.abs(turned)) < largest


def spaced_site() -> Any:
    """Travels that the errors are known over: 240 mm, 120 mm, a turn."""
    axes = [
        axis("X1", "linear", [-240.0, 0.0], "EXX"),
        axis("Z1", "linear", [-60.0, 60.0], "EZZ"),
        axis("C1", "rotary", [0.0, 360.0], "ECC"),
    ]
    return {"work": WORK, "axes": axes}


def test_tables_leave_less_and_their_spacing_moves_the_flank_at_once(tmp_path: Path) -> None:
    """Coarse tables leave more than the site's, and where there is no error they leave none."""
    model = closing.errors()
    client, run = asking(tmp_path, model, **spaced_site())
    spacings = {one["axis"]: one for one in client.get(f"{run}/model").json()["tooth"]["spacings"]}
    assert {name: (one["unit"], one["step"]) for name, one in spacings.items()} == {
        "X": ("mm", 24.0),
        "Z": ("mm", 12.0),
        "C": ("deg", 36.0),
    }
    assert {120.0, 80.0, 24.0, 9.6} < set(spacings["X"]["steps"])
    assert all((240.0 / step) % 1.0 < 1e-9 or (240.0 / step) % 1.0 > 1 - 1e-9 for step in spacings["X"]["steps"])
    assert max(spacings["C"]["steps"]) == 120.0, "a harmonic needs three points to the turn"

    def left(steps: str, sizes: str = "") -> Any:
        answer = client.get(f"{run}/flank?sizes={sizes}&tables=true&steps={steps}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    own, coarse = left(""), left("X:120,Z:60,C:120")
    assert own["tables"]["rms_um"] < own["rms_um"] == pytest.approx(coarse["rms_um"])
    assert coarse["tables"]["rms_um"] > own["tables"]["rms_um"]
    assert (own["tables"]["points"], coarse["tables"]["points"]["X"]) == ({"X": 11, "Z": 11, "C": 11}, 3)
    none = ",".join(f"{name}:0" for name in model.measured if name in TWENTY_ONE)
    assert np.max(np.abs(left("C:36", none)["tables"]["deviation_um"])) < 0.15, "no error leaves rounding alone"
    assert "tables" not in client.get(f"{run}/flank?sizes=").json()
    for steps in ("X:25", "Q:10", "X:0", "X:nan", "C:180"):
        assert client.get(f"{run}/flank?tables=true&steps={steps}").status_code == 422, steps


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    client, run = asking(tmp_path, replace(closing.errors(), said=(Message.stored("one"),)))
    told = client.get(f"{run}/model").json()
    assert (told["tooth"], told["why"]["code"]) == (None, "E-CLOSE-WORK")
    assert told["said"] == [Message.stored("one").as_data()]
    (tmp_path / "b").mkdir()
    client, run = asking(tmp_path / "b", closing.errors(), work=WORK)
    for sizes in ("EXC:2.01", "EQQ:1", "EXC", "EXC:nan", "EXC:inf"):
        assert client.get(f"{run}/flank?sizes={sizes}").status_code == 422, sizes
    other = Store(tmp_path / "b").create("grinder").run_id
    assert client.get(f"{RUN}/{other}/model").status_code == 404


def test_a_work_beyond_the_measured_travel_leaves_the_errors_and_names_the_one_unknown(tmp_path: Path) -> None:
    client, run = asking(tmp_path, closing.errors(), work={**WORK, "height_mm": 150.0})
    answer = client.get(f"{run}/model")
    assert answer.status_code == 200
    told = answer.json()
    assert {one["name"] for one in told["errors"]} >= set(TWENTY_ONE)
    assert (told["tooth"], told["why"]["code"], told["why"]["where"]) == (None, "E-MODEL-RANGE", "EXZ")
    assert client.get(f"{run}/flank?sizes=").status_code == 409, "nothing is out of order: the work is out of reach"


def test_the_form_of_a_space_is_where_the_map_has_its_points(tmp_path: Path) -> None:
    """Normals are unit and across the profile: by differences of the profile at neighbouring angles."""
    client, path = asking(tmp_path, closing.errors(), work=WORK)
    run = Store(tmp_path).open(path.rsplit("/", 1)[1])
    flank = closing._left(1.0, 3)
    run.put("inspected-before", closing.inspected("before", flank))
    form = client.get(f"{path}/form?stage=inspected-before").json()
    points, normals = np.array(form["points_mm"]), np.array(form["normals"])
    assert np.hypot(*normals.T) == pytest.approx(1.0, abs=1e-5)
    gear, step = CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0), 1e-6
    along = gear.section(flank.theta_rad + step).xy - gear.section(flank.theta_rad - step).xy
    assert np.sum(along * normals, axis=1) / np.hypot(*along.T) == pytest.approx(0.0, abs=1e-4)
    assert np.hypot(*points.T) == pytest.approx(64.0, abs=6.0), "about the pin circle less the pins"
    assert form["angle_deg"] == pytest.approx(np.degrees(flank.theta_rad), abs=1e-3)
    assert form["spaces"] == 11
    assert client.get(f"{path}/form?stage=errors").status_code == 422
    assert client.get(f"{path}/form?stage=inspected-after").status_code == 404
