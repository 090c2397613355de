"""Figures of the tooth: worked out again from the records, shares that add up, reasons for what cannot be cured."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from drivers.message import Message, prose
from drivers.terms import shown as as_people_write
from drivers.types.values import FloatArray
from gateway.model.error_model import TWENTY_ONE
from gateway.report import ReportMaterial, ToothMaterial, as_json
from gateway.report.drawings.flank import flank_maps
from gateway.report.lines import axis_lines, details, tooth_lines
from gateway.report.missing import missing
from gateway.report.tooth.cured import shares
from gateway.report.tooth.flank import close_up, shown, states, top_of, traces
from gateway.report.tooth.rows import cure_rows, setup_rows
from gateway.report.tooth.why import tag, why
from gateway.tooth import CureRecord, FlankMap, FlankPrediction, GearProposal, SetupValues
from tests.unit.report import closing
from tests.unit.report.closing import GEAR, GRID, flank_of


@pytest.fixture(scope="module")
def material() -> ReportMaterial:
    return closing.material()


@pytest.fixture(scope="module")
def data(material: ReportMaterial) -> dict[str, Any]:
    return dict(json.loads(json.dumps(as_json(material), allow_nan=False)))


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, dtype=np.float64) ** 2)))


def test_every_figure_of_the_flank_follows_from_the_records_beside_it(data: dict[str, Any]) -> None:
    records, flank = data["tooth"]["records"], {one["key"]: one for one in data["tooth"]["flank"]}
    parts = {one["part"]: one["flank"] for one in records["parts"]}
    assert list(flank) == ["before", "before-set-right", "predicted", "part", "after"]
    for key, part in (("before", "before"), ("part", "trial"), ("after", "after")):
        values = np.asarray(parts[part]["fitted"]["deviation_um"])
        assert flank[key]["rms_um"] == pytest.approx(rms(values), rel=1e-12)
        assert flank[key]["largest_um"] == pytest.approx(float(np.max(np.abs(values))), rel=1e-12)
        assert flank[key]["U_um"] == pytest.approx(2.0 * parts[part]["rms_u_um"], rel=1e-12)
    prediction = records["proposal"]["prediction"]
    assert flank["predicted"]["rms_um"] == prediction["rms_um"]
    assert flank["predicted"]["U_um"] == pytest.approx(2.0 * prediction["rms_u_um"], rel=1e-12)
    assert flank["predicted"]["map_rms_um"] == pytest.approx(rms(prediction["after"]["deviation_um"]), rel=1e-12)
    right = np.asarray(flank["before-set-right"]["map"]["deviation_um"])
    ground = np.asarray(parts["before"]["fitted"]["deviation_um"])
    # What was taken off is the same in every space and at every height, and no part of nx, ny, h is left.
    off = ground - right
    assert float(np.max(np.ptp(off, axis=(0, 2)))) < 1e-9
    section = GEAR.section(GRID.thetas)
    for column in (section.nx, section.ny, section.h):
        assert abs(float(np.mean(right * column[None, :, None]))) < 1e-9 * float(np.max(np.abs(column)))


def test_the_summary_is_the_verdicts_and_the_change_its_own(material: ReportMaterial, data: dict[str, Any]) -> None:
    tooth, verdict = data["summary"]["tooth"], material.tooth.verdict if material.tooth else None
    assert verdict is not None
    assert (tooth["before_um"], tooth["after_um"]) == (verdict.before_um, verdict.after_um)
    change = 100.0 * (verdict.after_um - verdict.before_set_right_um) / verdict.before_set_right_um
    assert tooth["change_pct"] == pytest.approx(change, rel=1e-12)
    assert data["summary"]["outcome"] == data["outcome"] == "better"
    assert prose(verdict.words) in data["summary"]["words"]
    assert data["summary"]["missing"] == []


def test_rows_are_the_records(material: ReportMaterial, data: dict[str, Any]) -> None:
    tooth = material.tooth
    assert tooth is not None
    assert tooth.proposal is not None
    cures = {one.error: one for one in tooth.proposal.cures}
    assert [row["rms_um"] for row in data["tooth"]["cures"]] == sorted((c.rms_um for c in cures.values()), reverse=True)
    assert all(row["floor_um"] == cures[row["error"]].floor_um for row in data["tooth"]["cures"])
    assert {row["name"] for row in data["tooth"]["errors"]} == set(TWENTY_ONE)
    guessed = [row for row in data["tooth"]["errors"] if row["state"] == "assumed"]
    assert [(row["name"], row["low"], row["high"]) for row in guessed] == [("EAZ", -5.0, 5.0)]
    assert data["tooth"]["figures_um"]["F_p"]["after"] == pytest.approx(3.1 * tooth.part("after").flank.fitted.rms_um)
    tables = {row["row"]["name"]: row["row"]["table"] for row in data["tooth"]["tables"]}
    assert tables["X1"] == "X(X)"
    assert tables["X1-cec1"] == "X(C)"
    assert tables["C1-cec2"] == "C(Z)"
    last = setup_rows(tooth)[-1]
    assert (str(last.name), last.values) == ("changed from “before” to “after”", SetupValues(-4.2, 0.0, -1.4))


def _places() -> tuple[FloatArray, FloatArray, FloatArray]:
    shape = (GRID.ks.size, GRID.zs.size)
    turn = 2.0 * np.pi * GRID.ks[:, None] / shape[0]
    wave = np.broadcast_to(np.sin(turn), shape)
    return np.zeros(shape), np.broadcast_to(GRID.zs[None, :] / 7.5, shape), wave


CASES = {
    "set-up values: x zero": lambda none, z, k: (none + 1.0, none, none),
    "set-up values: dressing offset": lambda none, z, k: (none, none + 1.0, none),
    "table X(Z)": lambda none, z, k: (z, none, none),
    "table X(C)": lambda none, z, k: (k, none, none),
    "table C(Z)": lambda none, z, k: (none, none, 5.0 * z),
    "table C(C)": lambda none, z, k: (none, none, 5.0 * k),
    "no table over one axis": lambda none, z, k: (z * k, none, none),
}


@pytest.mark.parametrize("by", CASES)
def test_what_one_kind_of_correction_takes_is_counted_there_alone(by: str) -> None:
    none, z, k = _places()
    whole = flank_of(*CASES[by](none, z, k))
    nothing = replace(whole, deviation_um=np.zeros_like(whole.deviation_um))
    found = {one.by: one for one in shares(_prediction(whole, whole, nothing))}
    assert {name for name, one in found.items() if abs(one.taken_pct) > 1e-9} == {by}
    assert found[by].taken_pct == pytest.approx(100.0)
    assert found[by].left_pct == pytest.approx(0.0, abs=1e-12)


def test_shares_of_the_flank_set_right_count_without_the_set_up_values() -> None:
    made = closing.proposal().prediction
    found = shares(made)
    right = made.before.deviation_um - np.mean(made.before.deviation_um, axis=(0, 2), keepdims=True)
    end = made.after.deviation_um - np.mean(made.after.deviation_um, axis=(0, 2), keepdims=True)
    lost = 100.0 * (1.0 - float(np.mean(end**2) / np.mean(right**2)))
    told = [one.of_right_pct for one in found if one.of_right_pct is not None]
    assert sum(told) == pytest.approx(lost, rel=1e-9)
    assert [one.by for one in found if one.of_right_pct is None] == [by for by in CASES if by.startswith("set-up")]
    assert abs(sum(told)) > abs(sum(one.taken_pct for one in found if one.of_right_pct is not None))


def _prediction(before: FlankMap, eec: FlankMap, after: FlankMap) -> FlankPrediction:
    return FlankPrediction(before, eec, after, 0.0, 0.1, np.zeros_like(before.deviation_um), 0.1, 0.01)


def test_shares_add_up_to_what_the_flank_loses() -> None:
    made = closing.proposal().prediction
    found = shares(made)
    lost = 100.0 * (1.0 - (made.after.rms_um / made.before.rms_um) ** 2)
    assert sum(one.taken_pct for one in found) == pytest.approx(lost, rel=1e-12)
    left = sum(one.left_pct for one in found if one.left_pct is not None)
    assert left == pytest.approx(100.0 * (made.after.rms_um / made.before.rms_um) ** 2, rel=1e-12)
    crooked = replace(made.before, theta_rad=made.before.theta_rad + 1e-3)
    assert sum(one.taken_pct for one in shares(replace(made, before=crooked))) == pytest.approx(lost, rel=1e-12)
    zero = replace(made.before, deviation_um=np.zeros_like(made.before.deviation_um))
    assert shares(replace(made, before=zero)) == ()


def test_maps_that_stand_together_have_one_scale_and_zero_in_its_middle() -> None:
    found = shown(states(closing.tooth()))
    for some in (found, close_up(found)):
        figure = Figure()
        flank_maps(figure, some)
        maps = [one for panel in figure.axes for one in (*panel.images, *panel.collections)]
        meshes = [one for one in maps if isinstance(one, AxesImage | QuadMesh)]
        assert len(meshes) == len(some) + 1  # and the scale itself
        largest = max(float(np.max(np.abs(one.map.deviation_um))) for one in some if one.key != "before")
        limits = {(mesh.norm.vmin, mesh.norm.vmax) for mesh in meshes}
        assert limits == {(-top_of(some), top_of(some))}
        assert largest <= top_of(some) <= 2.0 * largest
        said = {panel.get_title(loc="left") for panel in figure.axes}
        beyond = [one for one in some if float(np.max(np.abs(one.map.deviation_um))) > top_of(some)]
        assert sum("beyond the scale" in text for text in said) == len(beyond)
    assert [one.key for one in found if np.max(np.abs(one.map.deviation_um)) > top_of(found)] == ["before"]
    assert top_of(close_up(found)) < 0.5 * top_of(found)
    assert [one.key for one in close_up(found)] == ["predicted", "after"]


def test_traces_are_means_of_the_map() -> None:
    none, z, k = _places()
    left, right = traces(flank_of(none, none, none + 5.0 * k)).pitch
    # A turn against the clock takes material off the left flank, which looks clockwise into the space.
    assert float(np.corrcoef(left, np.sin(2.0 * np.pi * GRID.ks / GRID.ks.size))[0, 1]) == pytest.approx(-1.0)
    assert np.allclose(left, -right)
    assert np.allclose(traces(flank_of(none, none, 5.0 * k)).runout, 0.0, atol=1e-12)
    tapered = traces(flank_of(z, none, none))
    assert np.allclose(tapered.lead[0], tapered.lead[1])
    assert np.ptp(tapered.lead[0]) > 0.5
    assert np.allclose(tapered.profile, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", TWENTY_ONE)
def test_every_error_that_cannot_be_cured_says_why(name: str) -> None:
    mechanical = CureRecord(name, 1.0, "mechanical only", 0.5)
    assert tag(mechanical) == "mech"
    said = why(mechanical)
    assert len(said) > 60
    assert said.endswith(".")
    if name[1:2] == "Y":
        assert "along its own axis" in said
    assert tag(CureRecord(name, 1.0, "C(Z) in part", 0.5)) == "part"
    assert tag(CureRecord(name, 0.0, "none needed", 0.0)) == "none"


@pytest.mark.parametrize(
    ("error", "by", "kind"),
    [
        ("ECC", "C(C)", "axis"),
        ("EXC", "X(C)", "cross"),
        ("EYX", "dressing offset", "set-up"),
        ("ECX", "C zero", "set-up"),
        ("EBC", "X(Z)*(C)", "product"),
        ("EXZ", "set-up values", "set-up"),
        ("B0Z", "X(Z), C(Z)", "cross"),
    ],
)
def test_cures_have_their_kind(error: str, by: str, kind: str) -> None:
    assert tag(CureRecord(error, 1.0, by, 0.0)) == kind


def test_only_what_stays_is_among_the_incurable() -> None:
    rows = {one.error: one for one in cure_rows(closing.tooth())}
    assert {name for name, row in rows.items() if row.why} == {"EAX", "EYZ", "EAZ", "EYC", "EAC", "EBC", "A0C"}
    assert rows["EYC"].rank_text == "2–4"


GONE: list[tuple[dict[str, Any], str]] = [
    ({"errors": None}, "The errors of the machine were not measured in this run."),
    ({"proposal": None}, "Nothing was proposed for the tooth"),
    ({"verdict": None}, "The tooth was not judged."),
    ({"parts": ()}, "Part “after” was neither ground nor inspected"),
]


@pytest.mark.parametrize(("without", "said"), GONE)
def test_a_stage_that_is_missing_is_said(without: dict[str, Any], said: str) -> None:
    whole = closing.material()
    assert whole.tooth is not None
    assert missing(whole) == ()
    found = tuple(map(str, missing(replace(whole, tooth=replace(whole.tooth, **without)))))
    assert [line for line in found if line.startswith(said)]


def test_parts_pushes_and_axes_that_are_missing_are_named(material: ReportMaterial) -> None:
    tooth = material.tooth
    assert tooth is not None
    ground_only = tuple(replace(one, flank=None) if one.part == "trial" else one for one in tooth.parts)
    pushed = tuple(replace(one, push=None) if one.change.layer == "cross" else one for one in tooth.tables)
    axes = (material.axes[0], replace(material.axes[1], after=None))
    found = tuple(
        map(str, missing(replace(material, axes=axes, tooth=replace(tooth, parts=ground_only, tables=pushed))))
    )
    assert found == (
        "Not measured again after the push: Z1.",
        "Proposed but not in the control: X1-cec0, X1-cec1, C1-cec2, C1-cec3.",
        "Part “trial” was ground but not inspected: the set-up values were not tried on a part.",
    )


def test_axes_that_improved_as_predicted_share_one_line_and_the_others_keep_every_word(
    material: ReportMaterial,
) -> None:
    first, second = (axis.verdict for axis in material.axes[:2])
    assert first is not None
    assert second is not None
    well, other = replace(first, improved=True, within_prediction=True), replace(second, within_prediction=False)
    told = tuple(map(str, axis_lines((well, replace(well, axis="C1"), other))))
    assert told == (
        f"{well.axis}, C1: improved by more than the uncertainty, as predicted at every target (k = 3)",
        f"{other.axis}: {as_people_write(prose(other.words))}",
    )
    assert tuple(map(str, details((well, other)))) == (f"{well.axis}: {as_people_write(prose(well.words))}",)


def test_the_last_line_is_the_tooths_figure(material: ReportMaterial) -> None:
    tooth = material.tooth
    assert tooth is not None
    verdict = tooth.verdict
    assert verdict is not None
    figures = f"flank RMS {verdict.before_set_right_um:.2f} µm -> {verdict.after_um:.2f} µm"
    assert (
        str(tooth_lines(material)[-1])
        == f"tooth: {figures} (predicted 0.21 +- 0.08 µm, k = 2), set-up values not counted"
    )
    proposed = ToothMaterial(errors=tooth.errors, proposal=tooth.proposal, gear=tooth.gear)
    assert str(tooth_lines(replace(material, tooth=proposed))[-1]).endswith(
        "set-up values not counted; not yet proved on a part"
    )
    assert str(tooth_lines(closing.part_alone())[-1]).startswith("tooth: part customer 7, flank RMS ")
    assert str(tooth_lines(closing.measured())[0]).startswith("20 of 21 errors were measured.")
    assert tooth_lines(replace(material, tooth=None)) == ()


def test_a_part_that_asks_for_tables_by_itself_shows_what_they_would_do() -> None:
    part = closing.part_alone().tooth
    assert part is not None
    flank = part.parts[0].flank
    assert flank is not None
    after = replace(flank.fitted, deviation_um=0.1 * flank.fitted.deviation_um)
    asks = GearProposal(
        "customer 7", SetupValues(1.0, 2.0, 3.0), flank.fitted, after, 0.05, said=(Message.stored("X(Z) only"),)
    )
    found = states(replace(part, from_gear=asks))
    assert [(one.key, round(one.rms / found[0].rms, 6)) for one in found] == [("part", 1.0), ("predicted", 0.1)]
    assert 2.0 * asks.u_um == found[1].U
    assert setup_rows(replace(part, from_gear=asks))[0].values == SetupValues(1.0, 2.0, 3.0)
