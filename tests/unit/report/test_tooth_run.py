"""From a run folder to the report: whatever stages are stored, before, between and after."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.message import prose, render
from gateway.cli import app
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.model.error_model import ErrorModel, UnmeasuredError
from gateway.store import RunFolder, Store
from gateway.tooth import GearProposal, SetupValues
from gateway.workflow.results.endings import lines_of
from gateway.workflow.results.report import material_of, outcome_of, part_names, write_report
from gateway.workflow.run import stages
from tests.unit.report import closing, synthetic

AXIS = """
[[axes]]
name = "{name}1"
letter = "{name}"
kind = "{kind}"
travel = [0.0, 360.0]
modulo = {modulo}
[axes.measure]
component = "E{name}{name}"
feed = 1000.0
stable = 1.0
file = "x.csv"
file_datum = 0.0
[axes.table]
minimum = 0.0
maximum = 360.0
step = 45.0
"""
SITE = """
[site]
name = "mill"
store = "runs"
[controller]
url = "opc.tcp://127.0.0.1:1"
serial = "SN-1"
[work]
gear = "gear.toml"
height_mm = 0.0
"""
GEAR = Path(__file__).parents[3] / "examples" / "gears" / "eleven-lobes.toml"


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    """A new run of a site that grinds the eleven-lobed disc."""
    axes = [("X", "linear", "false"), ("Z", "linear", "false"), ("C", "rotary", "true")]
    text = SITE + "".join(AXIS.format(name=name, kind=kind, modulo=modulo) for name, kind, modulo in axes)
    (tmp_path / "site.toml").write_text(text)
    (tmp_path / "gear.toml").write_text(GEAR.read_text())
    return Store(tmp_path / "runs").create("mill", {"site_file": str(tmp_path / "site.toml")})


def fill(run: RunFolder) -> None:
    """Every stage of a closing run."""
    tooth, axes = closing.tooth(), synthetic.material().axes
    known = closing.errors()
    assert tooth.proposal is not None
    assert tooth.verdict is not None
    run.put(stages.ERRORS, replace(known, motions=known.motions[:2]))
    for axis in axes:
        assert axis.before is not None
        assert axis.after is not None
        run.put(stages.evaluation(axis.axis, "before"), axis.before)
        run.put(stages.evaluation(axis.axis, "after"), axis.after)
    changes = tuple(one.change for one in tooth.tables)
    run.put(stages.PROPOSAL, Proposal(synthetic.MACHINE, (*changes[3:], *changes[:3]), (), "2026-03-02T08:00:00+00:00"))
    run.put(stages.TOOTH, tooth.proposal)
    for one in tooth.tables:
        assert one.push is not None
        run.put(stages.push(one.change.name), one.push)
    verdicts = tuple(axis.verdict for axis in axes if axis.verdict is not None)
    proofs = tuple(axis.sign_proof for axis in axes if axis.sign_proof is not None)
    run.put(stages.VERDICT, Verdict(verdicts, "better", proofs))
    for part in reversed(tooth.parts):
        assert part.ground is not None
        assert part.flank is not None
        run.put(stages.ground(part.part), part.ground)
        run.put(stages.inspected(part.part), part.flank)
    run.put(stages.TOOTH_VERDICT, tooth.verdict)


def test_a_whole_closing_run_comes_out_of_its_folder_as_it_went_in(run: RunFolder) -> None:
    fill(run)
    paths, tooth = write_report(run), closing.tooth()
    assert tooth.verdict is not None
    data = json.loads(paths.json.read_text())
    assert data["summary"]["tooth"]["after_um"] == tooth.verdict.after_um
    assert data["summary"]["missing"] == []
    assert data["tooth"]["gear_name"] == "11-lobe disc"
    assert [one["part"] for one in data["tooth"]["records"]["parts"]] == ["before", "trial", "after"]
    assert [one["key"] for one in data["tooth"]["flank"]][:2] == ["before", "before-set-right"]
    # The axis' own table is its EEC table, also where cross tables of the same axis come first.
    assert [axis["change"]["new"]["kind"] for axis in data["axes"]] == ["axis", "axis", "axis"]
    assert data["ended_utc"] == "2026-03-02T14:38:00+00:00"
    named = ["flank-maps.png", "flank-charts.png", "tooth-before-after.png", "ranking.png", "errors.png"]
    assert [path.name for path in paths.pictures] == named
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (paths.picture, *paths.pictures))
    assert prose(tooth.verdict.words).replace(" um", " µm") in paths.html.read_text()
    figure = f"{tooth.verdict.before_set_right_um:.2f} µm -> {tooth.verdict.after_um:.2f} µm"
    assert render(lines_of(material_of(run))[-1]) == (
        f"tooth: flank RMS {figure} (predicted 0.21 +- 0.08 µm, k = 2), set-up values not counted"
    )


def test_the_command_shows_a_measure_run_and_what_to_measure_next(run: RunFolder) -> None:
    run.put(stages.ERRORS, ErrorModel(unknown=(UnmeasuredError("EXC", 5.0, "um"),)))
    shown = CliRunner().invoke(app, ["report", str(run.path)])
    assert shown.exit_code == 0, shown.output
    assert "0 of 1 errors were measured. Only assumed within a span: EXC." in " ".join(shown.output.split())
    told = json.loads(CliRunner().invoke(app, ["report", str(run.path), "--json"]).output)
    assert told["summary"]["outcome"] == "measured"
    assert told["picture"].endswith("errors.png")
    data = json.loads(Path(told["json"]).read_text())
    assert [one["name"] for one in data["tooth"]["open"]] == ["EXC"]
    assert data["tooth"]["open"][0]["change_um"] > 0.01
    assert data["axes"] == []
    assert "What next" in Path(told["html"]).read_text()


def test_a_gear_file_that_is_gone_takes_nothing_else_with_it(run: RunFolder) -> None:
    part = closing.tooth().parts[0]
    assert part.flank is not None
    run.put(stages.inspected("before"), part.flank)
    run.put(stages.inspected("before-raw"), part.flank)
    asks = GearProposal("before", SetupValues(1.0), part.flank.fitted, part.flank.fitted, 0.1)
    run.put(stages.FROM_GEAR, asks)
    (run.path.parent.parent / "gear.toml").unlink()
    assert part_names(run) == ("before",)
    material = material_of(run)
    assert material.tooth is not None
    assert (material.outcome, material.tooth.gear) == ("inspected", None)
    assert material.tooth.from_gear is not None
    assert material.tooth.from_gear.setup == asks.setup
    assert render(lines_of(material_of(run))[-1]).startswith("tooth: part before, flank RMS ")


def test_one_word_says_how_far_a_run_came() -> None:
    tooth = closing.tooth()
    better, worse = (Verdict((), outcome) for outcome in ("better", "worse"))
    assert outcome_of(better, tooth) == "better"
    assert outcome_of(worse, tooth) == "worse"
    assert outcome_of(None, closing.measured().tooth) == "measured"
    assert outcome_of(None, closing.part_alone().tooth) == "inspected"
    assert outcome_of(None, None) == "not-pushed"
