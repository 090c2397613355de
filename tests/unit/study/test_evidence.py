"""What a run measured in the paper's figures: its readings and its inspected parts, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import trueflank as tf
from drivers.types.sensing import Ambient
from gateway.domain.captures import Capture, Corrections
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder, Store
from gateway.study import paper
from gateway.study.calculate import Study
from gateway.study.evidence import Evidence, evidence_of, inspected_chart, part_rows
from gateway.study.inputs import errors_from
from gateway.tooth import FlankMap, InspectedFlank

ROOT = Path(__file__).parents[3]
AT = np.array([0.0, 50.0, 100.0])
TAPER, HOLLOW, TURN = 3.0, 2.0, 40.0  # um over the half face, um over the profile, arcsec


def _capture(slope: float, component: str = "EXX") -> Capture:
    scatter = np.array([-0.3, 0.0, 0.3])[None, :, None]
    reversal = np.array([-0.5, 0.5])
    return Capture(
        axis="X1", component=component, axis_unit="mm", targets=AT,
        deviations=slope * AT[:, None, None] + scatter + reversal, reading_u=0.1, ambient_start=Ambient(),
        ambient_end=Ambient(), corrections=Corrections(), live=None, sense=None,
    )  # fmt: skip


def _part(gear: CycloidGear, name: str, size: float) -> InspectedFlank:
    """Points of six heights on ten spaces: a taper over the face, a slope over the profile, and the gear turned."""
    grid = flank_grid(gear)
    near = np.linspace(0.5, 5.0, 7)
    theta = gear.theta_at(np.concatenate([-near[::-1], near]))
    k, z, t = (one.ravel() for one in np.meshgrid(np.arange(0.0, 39.0, 4.0), np.linspace(-5, 5, 6), theta))
    turned = 1000.0 * np.deg2rad(TURN / 3600.0) * gear.section(t).h
    e = size * (TAPER * z / 5.0 + HOLLOW * np.abs(gear.arc(t))) + turned
    height, judged = np.unique(z), np.broadcast_to(size * np.cos(2.0 * np.pi * grid.k / 39.0), grid.shape)
    return InspectedFlank(
        part=name, source="gear", serial="7", k=k, theta_rad=t, z_mm=z, deviation_um=e, u_um=0.2,
        place_k=np.repeat(np.unique(k), height.size), place_z_mm=np.tile(height, np.unique(k).size),
        abg=np.zeros((60, 3)), abg_u=np.zeros((60, 3)), fitted=FlankMap(grid.thetas, grid.zs, judged), rms_u_um=0.25,
        figures={"F_p": 2.0 * size}, turned_arcsec=TURN,
    )  # fmt: skip


@pytest.fixture
def run(tmp_path: Path, found: Study) -> RunFolder:
    gear, folder = found.grinding.gear, Store(tmp_path).create("cell")
    folder.put("errors", ErrorModel((), ()))
    for stage, slope in (("capture-X1-before", 0.2), ("capture-X1-after", 0.001)):
        folder.put(stage, _capture(slope))
    folder.put("setup-EXX-X1", _capture(0.2))
    folder.put("setup-EYX-X1", _capture(-0.1, "EYX"))
    for name, size in (("before", 1.0), ("after", 0.1)):
        folder.put(f"inspected-{name}", _part(gear, name, size))
    return folder


def _evidence(run: RunFolder) -> Evidence:
    got = evidence_of(run.path)
    assert got is not None
    return got


def test_a_run_s_readings_are_drawn_with_their_scatter(run: RunFolder, found: Study) -> None:
    got = _evidence(run)
    assert [(one.title, one.after is not None) for one in got.readings] == [("EXX of X1", True), ("EYX of X1", False)]
    sheets = {one.name: one for one in paper.sheets(found, got)}
    figure = Figure(figsize=sheets["figure-8-measured"].size)
    sheets["figure-8-measured"].paint(figure)
    both, alone = figure.axes
    means = [line.get_ydata() for line in both.lines if line.get_label() in ("before, forward", "after, reverse")]
    np.testing.assert_allclose(means, [0.2 * AT - 0.5, 0.001 * AT + 0.5])
    assert [line.get_label() for line in alone.lines if line.get_label()[:1] != "_"] == [
        "after, forward", "after, reverse",
    ]  # fmt: skip
    band = alone.collections[0].get_paths()[0].vertices[:, 1]  # 2 s of -0.3, 0, 0.3 about the forward mean
    assert (band.min(), band.max()) == pytest.approx((-0.5 - 0.6, 0.1 - 0.5 + 0.6))
    assert "calculates" in sheets["figure-8-axes-after"].said
    assert "figure-7-measured" not in {one.name for one in paper.sheets(found)}


def test_a_part_s_chart_is_that_of_its_probed_points(run: RunFolder, found: Study) -> None:
    gear, got = found.grinding.gear, _evidence(run)
    chart = inspected_chart(gear, got.parts["before"], (0, 10, 20), "before")
    for side in (0, 1):
        assert chart.lead[side].spaces == (0, 8, 20)  # 10 was not inspected: its neighbour
        np.testing.assert_allclose(1000.0 * chart.lead[side].values.f_H, 2.0 * TAPER, atol=1e-9)
        np.testing.assert_allclose(1000.0 * chart.profile[side].values.f_H, HOLLOW * 4.5, atol=0.02)
        np.testing.assert_allclose(1000.0 * chart.profile[side].values.f_f, 0.0, atol=0.03)
    # e = cos in all points of a space: the fitted flank's runout is a cosine of 1 / n_x
    assert chart.chart.runout.eccentricity > 0.001
    assert "inspected: gear 7" in chart.note
    assert part_rows(got)[0][:3] == ("RMS normal deviation", "0.707", "0.071")
    assert ("F_p", "2.000", "0.200", "um") in part_rows(got)


def test_few_points_give_the_fitted_flank_and_another_gear_s_part_is_not_shown(run: RunFolder, found: Study) -> None:
    gear, got = found.grinding.gear, _evidence(run)
    one = got.parts["before"]
    thin = np.abs(gear.arc(one.theta_rad)) < 1.5
    few = replace(one, **{key: getattr(one, key)[thin] for key in ("k", "theta_rad", "z_mm", "deviation_um")})
    assert "too few" in inspected_chart(gear, few, (0, 20), "before").note
    said = [text for _, text in paper.pages_of(found, got)]
    assert said == ["as the part was inspected."] * 2
    wide = replace(one, fitted=replace(one.fitted, z_mm=1.2 * one.fitted.z_mm))
    other = replace(got, parts={"before": wide})
    pages = paper.pages_of(found, other)
    assert all("calculated" in page.title and "another gear" in text for page, text in pages)


def test_a_run_s_site_says_where_the_face_stands(run: RunFolder) -> None:
    assert not errors_from(run.path).machine.chain
    run.write_text("site.toml", (ROOT / "examples" / "sites" / "opcua-grinder.toml").read_text(encoding="utf-8"))
    assert "150.0" in str(errors_from(run.path).machine.chain)
    assert "90.0" in str(errors_from(run.path, 90.0).machine.chain)
    machine = tf.Machine.load(run.path)
    assert machine.run == run.path
    assert set(machine.to_dict()["tables"]) == {"X", "Z", "C"}, "the grids of its control"
    run.write_text("site.toml", "[work]\nheight_mm = 150.0\n")
    with pytest.raises(tf.TrueflankError, match=r"E-CFG-VALUE"):
        tf.Machine.load(run.path)
    assert tf.Machine({"EXX": 1.0}).run is None
