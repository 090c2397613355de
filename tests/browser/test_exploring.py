"""Over a run: other runs and standards, air and material, the machine as it moves; what if, on the flank at once."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from gateway.store import Store
from tests.browser.person import CHROMIUM
from tests.browser.stage import Stage, idle, kept_run, staged
from tests.browser.test_true import EMPTY, RUN
from tests.unit.components.site import axis, site_of
from tests.unit.report import closing
from tests.unit.report.synthetic import axis_material
from tests.unit.web.test_daemon import SITE
from tests.unit.web.test_model import GEAR, WORK

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
DRAWN = "() => document.querySelector('.chart')?.chart.plot?.status === 1"
AXES = [
    axis("X1", "linear", [-240.0, 0.0], "EXX"),
    axis("Z1", "linear", [-60.0, 60.0], "EZZ"),
    axis("C1", "rotary", [0.0, 360.0], "ECC"),
]


def curve(stage: Stage, name: str) -> list[list[float]]:
    """The ordinates of every curve of that name in the first chart."""
    wanted = (
        "(name) => document.querySelector('.chart').chart.curves.filter((one) => one.name === name).map((c) => c.y)"
    )
    found: list[list[float]] = stage.page.evaluate(wanted, name)
    return found


def test_runs_and_standards_lie_over_one_another(browser: Browser, tmp_path: Path) -> None:
    kept_run(tmp_path)
    kept_run(tmp_path)
    material = axis_material("X1", "mm")
    with staged(browser, tmp_path, SITE) as stage:
        page = stage.page
        stage.go("evaluate")
        page.wait_for_function(DRAWN)
        page.locator("#overlay").click()
        boxes = page.locator(".over [data-over$=after]")
        expect(boxes).to_have_count(2)
        for number in (1, 2):
            boxes.nth(number - 1).check()
            expect(page.locator("#overlay")).to_contain_text(f"({number})")
        page.locator("[data-over=':VDI/DGQ 3441:1977']").check()
        expect(page.locator("button.curve", has_text="VDI/DGQ 3441:1977")).to_have_count(1)
        page.wait_for_function(DRAWN)
        low, high = curve(stage, "VDI/DGQ 3441:1977")
        x = material.capture_before.deviations
        means, s = x.mean(axis=1), x.std(axis=1, ddof=1)
        half = (abs(means[:, 0] - means[:, 1]) + 6 * s.mean(axis=1)) / 2
        assert high == pytest.approx((means.mean(axis=1) + half).tolist()), "by hand from the readings"
        assert low == pytest.approx((means.mean(axis=1) - half).tolist())
        names = page.locator("button.curve", has_text=re.compile(r"\d\d:\d\d · after"))
        assert names.count() in (1, 2), "runs of one minute have one name"
        ups = curve(stage, str(names.first.get_attribute("data-curve")))
        assert ups[0] == pytest.approx(material.after.mean_up.tolist())
        page.keyboard.press("Escape")
        expect(page.locator("details.over[open]")).to_have_count(0)
        page.locator("#overlay").click()
        page.locator("#overlay-clear").click()
        expect(page.locator("button.curve", has_text="VDI")).to_have_count(0)
        stage.go("report")
        page.locator("#overlay").click()
        page.locator(".over [data-over$=before]").first.check()
        expect(page.locator("#overlay")).to_contain_text("(1)")
        assert stage.errors == []


def test_air_and_material_are_charts_that_grow(browser: Browser, tmp_path: Path) -> None:
    kept_run(tmp_path)
    material = axis_material("X1", "mm").capture_before
    airs = [
        {"utc": f"2026-03-02T09:0{minute}:00+00:00", "air_degc": 20.0 + minute / 10, "material_degc": [20.1, 20.2]}
        for minute in range(3)
    ]
    with staged(browser, tmp_path, SITE, instead={"/air": airs}) as stage:
        page = stage.page
        stage.go("capture")
        page.locator("#environment").click()
        page.wait_for_function("() => document.querySelector('dialog .chart')?.chart.plot?.status === 1")
        expect(page.locator("dialog .chart")).to_have_count(1), "nothing measures pressure or humidity here"
        chart = "document.querySelector('dialog .chart').chart"
        assert page.evaluate(f"() => {chart}.curves.map((one) => one.y.length)") == [3, 3, 3]
        stage.tell("ambient", {"utc": "2026-03-02T09:03:00+00:00", "air_degc": 20.3, "material_degc": [20.1, 20.2]})
        page.wait_for_function(f"() => {chart}.curves[0].y.length === 4")
        assert page.evaluate(f"() => {chart}.curves[0].x.at(-1)") == pytest.approx(3.0)
        page.locator("#yes").click()
        stage.go("evaluate")
        page.locator("#environment").click()
        page.wait_for_function("() => document.querySelector('dialog .chart')?.chart.plot?.status === 1")
        ends = [material.ambient_start.air_degc, material.ambient_end.air_degc]
        shown = page.evaluate("() => document.querySelector('dialog .chart').chart.curves[0].y")
        assert shown[:2] == pytest.approx(ends), "as the record has it"
        assert stage.errors == []


def test_the_machine_moves_in_its_drawing_as_the_axes_do(browser: Browser, tmp_path: Path) -> None:
    site = site_of(None, axes=AXES)
    shifted = "() => new DOMMatrix(getComputedStyle(document.querySelector('[data-moves=X]')).transform).e"
    with staged(browser, tmp_path, site, size=(1280, 1024), instead={"/taken": []}) as stage:
        page = stage.page
        stage.go("capture")
        with page.expect_response("**/taken"):
            stage.change(run=RUN, positions={"X1": -240.0, "Z1": 0.0, "C1": 0.0})
        page.wait_for_function(EMPTY)
        stands = page.locator(".machine-now .stands")
        expect(stands).to_contain_text("X1 −240.000 mm")
        first = page.evaluate(shifted)
        stage.tell("stands", {"positions": {"X1": 0.0, "Z1": 0.0, "C1": 90.0}})
        expect(stands).to_contain_text("X1 0.000 mm")
        expect(stands).to_contain_text("C1 90.000 °")
        last = page.evaluate(shifted)
        assert (first, last) == (pytest.approx(-46.0), pytest.approx(46.0)), "from one end of its room to the other"
        light = page.locator(".machine-now .light")
        reflector = page.locator(".machine-now path.optic")
        beam, optic = light.bounding_box(), reflector.bounding_box()
        assert beam is not None
        assert optic is not None
        assert abs(beam["x"] + beam["width"] - optic["x"]) < 6.0, "the beam ends at the reflector, wherever it stands"
        assert stage.errors == []


def asked_flank(stage: Stage) -> dict[str, Any]:
    """What the newest answer of the flank was asked for."""
    return dict(stage.page.evaluate("() => ({ ...document.querySelector('.panel.flank').dataset })"))


def test_sliders_of_errors_and_of_table_spacing_move_the_flank(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(GEAR, encoding="utf-8")
    run = Store(tmp_path).create("grinder")
    run.put("errors", closing.errors())
    run.set_state("measured")
    site = site_of(None, work=WORK, axes=AXES)
    with staged(browser, tmp_path, site) as stage:
        page = stage.page
        stage.change(last_runs=replace(idle(stage.offer)).last_runs)
        stage.go("model")
        rms = page.locator("#flank-rms")
        expect(rms).to_have_text(re.compile(r"\d"))
        plain = float(rms.inner_text())
        assert asked_flank(stage)["steps"] == "none"
        page.locator("#flank-with").click()
        expect(rms).not_to_have_text(f"{plain:.2f}")
        tables = float(rms.inner_text())
        assert tables < plain
        for letter in ("X", "Z", "C"):
            slider = page.locator(f"[data-spacing={letter}]")
            slider.fill(str(slider.get_attribute("max")))
        expect(page.locator(".panel.flank")).to_have_attribute("data-steps", "X:120,Z:60,C:120")
        expect(page.locator(".spacing").first).to_contain_text("every 120 mm · 3 points")
        assert float(rms.inner_text()) > tables, "coarser tables leave more"
        page.locator("[data-try=EXC]").fill("0")
        expect(page.locator(".panel.flank")).to_have_attribute("data-sizes", "EXC:0")
        page.locator("#as-measured").click()
        expect(rms).to_have_text(f"{plain:.2f}")
        assert stage.errors == []
