"""The wheel of a separated part as the page and the report show it: the record's figures, points, files, refusals."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.domain.grinding_process import CorrectionOrder, CorrectionStep, Separation, WheelVerdict
from gateway.gear.cycloid import CycloidGear
from gateway.process.separation import separate
from gateway.process.wheel import wheel_correction
from gateway.process.wheel_form import ProcessPart
from gateway.report.document.content import TableBlock
from gateway.report.document.teeth import wheel
from gateway.report.document.words import LANGUAGES, Tongue
from gateway.store import RunFolder, Store
from gateway.workflow.results.report import tooth_of
from tests.unit.cli.test_match import DATA, GEAR, gear_file
from tests.unit.cli.test_process_commands import DRESSER, THETA, wave
from tests.unit.components.site import site_of
from tests.unit.report import closing
from tests.unit.web.client import Client
from tests.unit.web.services import TOKEN, offered

WORK = {"gear": "gear.toml", "height_mm": 5.0}
BEARER = {"Authorization": f"Bearer {TOKEN}"}
ORDER = CorrectionOrder(
    "p1",
    (
        CorrectionStep("as ground", 3.2, 0.3, 91.0, 4.0),
        CorrectionStep("wheel", 2.4, 0.31, 60.0, 5.0),
        CorrectionStep("set-up", 1.1, 0.4, 44.0, 5.0),
        CorrectionStep("tables", 0.4, 0.5, 21.0, 6.0),
    ),
    0.3,
    0.9,
)
HELD = WheelVerdict(0.9, 0.0, 0.04, 0.05, 0.04, held=True)


def separated(seed: int = 1) -> Separation:
    """A disc with a form of 1.2 um and an eccentricity of 3 um."""
    gear, rng = CycloidGear(**DATA), np.random.default_rng(seed)  # type: ignore[arg-type]
    k, z, theta = (one.ravel() for one in np.meshgrid(np.arange(11.0), [-4.5, 0.0, 4.5], THETA, indexing="ij"))
    local, angle = gear.section(theta), 2.0 * np.pi * k / gear.zc
    e = wave(gear.arc(theta)) + 3.0 * (np.cos(angle) * local.nx - np.sin(angle) * local.ny)
    return separate(gear, [ProcessPart("p1", k, theta, z, e + rng.normal(0.0, 0.1, e.size))])


def run_of(folder: Path) -> RunFolder:
    """A run with a part that was separated, and what a closing run says of the wheel."""
    gear_file(folder)
    (folder / "dresser.toml").write_text(DRESSER.format(sign=1), encoding="utf-8")
    run = Store(folder).create("grinder")
    run.put("separated-p1", separated())
    run.put("corrections", ORDER)
    run.put("wheel-verdict", HELD)
    run.set_state("inspected")
    return run


def told(folder: Path, run: RunFolder, more: str = "", **work: Any) -> Any:
    client = Client(offered(folder, site_of([], work={**WORK, **work})).app, headers=BEARER)
    return client.get(f"/api/v1/sites/grinder/runs/{run.run_id}/wheel/{more or 'p1'}")


def test_causes_profile_and_points_are_the_records(tmp_path: Path) -> None:
    run, found = run_of(tmp_path), separated()
    answer = told(tmp_path, run, dresser_file="dresser.toml")
    assert answer.status_code == 200, answer.text
    seen = answer.json()
    assert seen["separation"]["shares"]["wheel"] == {
        "rms_um": found.share("wheel").rms_um,
        "u_um": found.share("wheel").u_um,
    }
    wanted = wheel_correction(GEAR, 120.0, found, diamond_mm=0.4)
    assert seen["points"]["correction_um"] == pytest.approx(wanted.correction_um.tolist())
    assert seen["points"]["radius_mm"] == pytest.approx(wanted.radius_mm.tolist())
    old, new = (np.array(seen[one]["um"]) for one in ("old", "new"))
    assert new == pytest.approx(old - wanted.correction_um)
    assert [one["name"] for one in seen["order"]["steps"]] == ["as ground", "wheel", "set-up", "tables"]
    assert seen["verdict"]["held"] is True
    rows = list(csv.reader(io.StringIO(told(tmp_path, run, "p1/points.csv", dresser_file="dresser.toml").text)))
    assert len(rows) == 1 + wanted.theta_rad.size
    assert float(rows[1][rows[0].index("radius_mm")]) == pytest.approx(wanted.radius_mm[0])
    drawing = told(tmp_path, run, "p1/points.dxf", dresser_file="dresser.toml")
    assert b"CORRECTION_X1000" in drawing.content


def test_why_there_are_no_points_is_said(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    seen = told(tmp_path, run).json()
    assert (seen["points"], seen["why"]["code"]) == (None, "E-WEB-NO-DRESSER")
    text = (DRESSER.format(sign=1)).replace("diamond_radius_mm = 0.4", "diamond_radius_mm = 0.4\nlimit_um = 0.5")
    (tmp_path / "dresser.toml").write_text(text, encoding="utf-8")
    seen = told(tmp_path, run, dresser_file="dresser.toml").json()
    assert seen["why"]["code"] == "E-WHEEL-LIMIT"
    assert told(tmp_path, run, "p2").json()["code"] == "E-WEB-WHEEL"


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_report_has_the_same_figures(tmp_path: Path, language: str) -> None:
    run = run_of(tmp_path)
    run.put("errors", closing.errors())
    told = tooth_of(run, site_of([], work=WORK), tmp_path / "site.toml")
    blocks = wheel(replace(closing.material(), tooth=told), Tongue(language))
    shares, order = (one for one in blocks if isinstance(one, TableBlock))
    found = separated()
    assert [row[1] for row in shares.rows] == [f"{one.rms_um:.2f}" for one in found.shares]
    assert [row[1] for row in order.rows] == ["3.20", "2.40", "1.10", "0.40"]
    assert [row[3] for row in order.rows] == ["91.0", "60.0", "44.0", "21.0"]
    assert all(not row[0].startswith("share_") for row in (*shares.rows, *order.rows))
