"""Charts and the gear in three dimensions: zoom, keys, legend, files; what a picked point tells; every width fits."""

from __future__ import annotations

import csv
import io
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from gateway.domain.outcomes import Verdict
from gateway.store import Store
from tests.browser.person import CHROMIUM, LAYOUT, PICTURES, SCREENS
from tests.browser.stage import Look, Stage, kept_run, staged
from tests.unit.components.site import site_of
from tests.unit.report import closing
from tests.unit.report.synthetic import axis_material
from tests.unit.web.test_daemon import SITE
from tests.unit.web.test_model import GEAR, WORK

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
FLAT = """() => {
  const own = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind.startsWith('webgl') ? null : own.call(this, kind, ...more);
  };
}"""
WIDTHS = ((390, 844, 1.0), (768, 1024, 1.0), (1024, 768, 1.0), (1280, 800, 1.0), (1920, 1080, 1.0), (1280, 1024, 2.0))


def chart_of(stage: Stage, what: str) -> Any:
    """Something of the first chart on the screen."""
    return stage.page.evaluate(f"() => {{ const now = document.querySelector('.chart').chart; return {what}; }}")


def saved(stage: Stage, kind: str) -> str:
    with stage.page.expect_download() as told:
        stage.page.locator(f".chart [data-save={kind}]").first.click()
    assert told.value.suggested_filename.endswith(f".{kind}")
    return Path(told.value.path()).read_bytes().decode("utf-8", "replace")


def test_a_chart_can_be_zoomed_read_hidden_fitted_and_saved(browser: Browser, tmp_path: Path) -> None:
    kept_run(tmp_path)
    before = axis_material("X1", "mm").before
    with staged(browser, tmp_path, SITE) as stage:
        page = stage.page
        stage.go("evaluate")
        page.wait_for_function("() => document.querySelector('.chart')?.chart.plot?.status === 1")
        low, high = chart_of(stage, "[now.plot.scales.x.min, now.plot.scales.x.max]")
        assert (low < 0.0, high > 400.0) == (True, True)
        page.locator(".chart").focus()
        page.keyboard.press("ArrowRight")
        expect(page.locator(".chart-legend .at")).to_contain_text("0.000 mm")
        wanted = f"{before.mean_up[0]:+.2f}".replace("-", "−")
        expect(page.locator("button.curve", has_text="approach +").last).to_contain_text(wanted)
        page.keyboard.press("+")
        assert chart_of(stage, "now.plot.scales.x.max - now.plot.scales.x.min") == pytest.approx(0.8 * (high - low))
        page.keyboard.press("Home")
        assert chart_of(stage, "now.plot.scales.x.max") == pytest.approx(high)
        rows = list(csv.reader(io.StringIO(saved(stage, "csv"))))
        up = [float(row[3]) for row in rows if row[0] == "approach +"]
        assert up == pytest.approx(before.mean_up.tolist()), "every number of the record"
        assert saved(stage, "svg").count("<polyline") == 3
        assert saved(stage, "png").startswith("\ufffdPNG")
        page.locator("button.curve", has_text=re.compile("mean of both")).click()
        assert chart_of(stage, "now.plot.series.at(-1).show") is False
        page.locator("select.fit").select_option("without_ends")
        page.wait_for_function("() => Math.abs(document.querySelector('.chart').chart.data.at(-1)[0]) < 1e-9")
        ends = chart_of(stage, "now.data.at(-1).filter((one) => one !== null)")
        assert (ends[0], ends[-1]) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert stage.errors == []


def test_a_single_value_is_a_bar_and_an_axis_has_three_ticks(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE) as stage:
        told = stage.page.evaluate("""async () => {
          const { ticks } = await import(modulePath('charts.js'));
          const spans = [[0, 1], [-3e-4, 2e-4], [99.2, 100.1], [0, 0], [-400, 12], [1e6, 1e6 + 3]];
          return spans.map(([low, high]) => ticks(low, high, 1).at.length);
        }""")
        assert min(told) >= 3, told
        stage.page.evaluate("""async () => {
          const { chart } = await import(modulePath('chart.js'));
          const curve = { name: 'reversal', look: 'new', x: [0], y: [1.5] };
          const names = { xName: 'X', xUnit: 'mm', yName: 'B', yUnit: 'um' };
          document.querySelector('main').prepend(chart({ title: 'one', ...names, curves: [curve] }));
        }""")
        stage.page.wait_for_function("() => document.querySelector('.chart')?.chart.plot?.status === 1")
        filled = """() => {
          const { plot } = document.querySelector('.chart').chart;
          const { left, width } = plot.bbox;
          const row = plot.ctx.getImageData(left, plot.valToPos(0.7, 'y', true), width, 1).data;
          const filled = Array.from({ length: row.length / 4 }, (_one, at) => row[4 * at] !== 255);
          return filled.filter(Boolean).length / filled.length;
        }"""
        part = stage.page.evaluate(filled)
        assert 0.05 < part < 0.7, "a bar that stands in the plot and does not fill it"


def tooth_run(folder: Path) -> Any:
    """A run with errors, a proposal for the tooth and its inspections, at a site with a gear."""
    (folder / "gear.toml").write_text(GEAR, encoding="utf-8")
    material = axis_material("X1", "mm")
    run = Store(folder).create("grinder")
    run.put("capture-X1-before", material.capture_before)
    run.put("evaluation-X1-before", material.before)
    run.put("verdict", Verdict((material.verdict,), "better"))
    run.put("inspected-before", closing.inspected("before", closing._left(4.0, 1)))
    run.put("inspected-after", closing.inspected("after", closing._left(0.4, 2)))
    return site_of([], work=WORK)


def test_the_gear_turns_and_a_picked_point_tells_before_and_after(browser: Browser, tmp_path: Path) -> None:
    site = tooth_run(tmp_path)
    with staged(browser, tmp_path, site) as stage:
        page = stage.page
        assert not [path for _method, path, _body in stage.asked if "three" in path]
        stage.go("report")
        page.locator("#tooth").click()
        page.locator(".solid[data-ready='3d']").wait_for()
        assert [path for _method, path, _body in stage.asked if path.endswith("three.core.min.js")]
        box = page.locator("canvas.gear").bounding_box()
        assert box is not None
        for across, down in itertools.product((0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65), np.arange(0.55, 0.97, 0.02)):
            page.mouse.click(box["x"] + box["width"] * across, box["y"] + box["height"] * float(down))
            if re.search(r"\d", page.locator("#picked").inner_text()):
                break
        told = page.locator("#picked").inner_text()
        found = re.search(r"Space (\d+), angle (−?[\d.]+)°, height (−?[\d.]+) mm: before ([+−][\d.]+) µm · after", told)
        assert found is not None, told
        flank = closing._left(4.0, 1)
        space, angle, height, um = (float(one.replace("−", "-")) for one in found.groups())
        near = np.argmin(np.abs(np.degrees(flank.theta_rad) - angle)), np.argmin(np.abs(flank.z_mm - height))
        assert um == pytest.approx(flank.deviation_um[int(space) - 1][near], abs=0.006), "the record's figure"
        page.locator("#solid-which").select_option("after")
        page.locator("#solid-times").fill("50")
        expect(page.locator(".solid .num").first).to_have_text("× 50")
        PICTURES.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=PICTURES / "gear.png")
        assert stage.errors == []


def test_without_three_dimensions_the_maps_remain(browser: Browser, tmp_path: Path) -> None:
    site = tooth_run(tmp_path)
    with staged(browser, tmp_path, site) as stage:
        stage.page.evaluate(FLAT)
        stage.go("report")
        stage.page.locator("#tooth").click()
        stage.page.locator(".solid[data-ready='2d']").wait_for()
        expect(stage.page.locator("canvas.flank")).to_have_count(2)


@pytest.mark.parametrize(("wide", "high", "scale"), WIDTHS)
def test_every_screen_fits_its_width(browser: Browser, tmp_path: Path, wide: int, high: int, scale: float) -> None:
    kept_run(tmp_path)
    look: Look = "dark" if wide == 768 else "light"
    with staged(browser, tmp_path, SITE, size=(wide, high), scale=scale, look=look) as stage:
        faults = []
        for screen in SCREENS:
            stage.go(screen)
            stage.page.locator("main .panel h2, main .panel tr, main .empty").first.wait_for()
            faults += [f"{screen}: {one}" for one in stage.page.evaluate(LAYOUT)]
            PICTURES.mkdir(parents=True, exist_ok=True)
            stage.page.screenshot(path=PICTURES / f"fit-{screen}-{wide}-{scale:g}.png")
        assert faults == [], "\n".join(faults)
        assert stage.errors == []


def test_the_keyboard_reaches_everything_and_escape_closes(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE) as stage:
        page = stage.page
        page.keyboard.press("Tab")
        expect(page.locator(".skip")).to_be_focused()
        page.keyboard.press("Enter")
        expect(page.locator("#screen")).to_be_focused()
        page.locator("#who").focus()
        page.keyboard.press("Enter")
        expect(page.locator("details.menu")).to_have_attribute("open", "")
        page.keyboard.press("Escape")
        expect(page.locator("details.menu[open]")).to_have_count(0)
        expect(page.locator("#who")).to_be_focused()
        page.keyboard.press("Enter")
        page.locator("main").click(position={"x": 5, "y": 5})
        expect(page.locator("details.menu[open]")).to_have_count(0)
