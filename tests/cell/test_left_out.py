"""A sign that stays unknown costs its tables, not the run: the other axes are pushed and judged, the tooth too."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import pytest

from drivers.terms import TableKind
from drivers.types.orders import SignProof
from gateway import audit
from gateway.domain.outcomes import PushRecord
from gateway.errors import VerifyError
from gateway.push import sign_proof
from gateway.push.context import PushContext
from gateway.push.sign_proof_tables import Steps
from gateway.push.sign_proof_tables import judge_steps as judged_by
from gateway.store import RunFolder
from gateway.tooth import ToothProposal, ToothVerdict
from gateway.workflow.run import stages
from tests.cell.bench import main_job, short
from tests.closing.families import relative
from tests.closing.runs import quick, run_machine
from tests.closing.trials import FEW
from tests.steps import lines

pytestmark = pytest.mark.long


def unprovable(monkeypatch: pytest.MonkeyPatch, which: Collection[tuple[str, TableKind]]) -> None:
    """Make the signs of these axes and kinds impossible to prove."""

    def judged(context: PushContext, steps: Steps, kind: TableKind) -> SignProof:
        if (context.axis.name, kind) in which:
            told = {"axis": context.axis.name, "unit": "um", "mean": 1.9, "u": 0.7, "peak": 3.0, "count": 6}
            raise VerifyError("E-PUSH-NO-PROOF", context.axis.name, **told)
        return judged_by(context, steps, kind)

    monkeypatch.setattr(sign_proof, "judge_steps", judged)


def left_out(root: Path) -> list[str]:
    (folder,) = {path.parent.parent for path in root.rglob("audit/*.jsonl")}
    return [entry["details"]["table"] for entry in audit.read_entries(folder) if entry["action"] == "push-left-out"]


def test_a_run_pushes_the_other_axis_and_says_why_not_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unprovable(monkeypatch, {("X1", "axis")})
    found = main_job(tmp_path, edit=short(("X1", "C1"), 10, 4))
    assert found.after["C1"]["M"] < 0.5 * found.before["C1"]["M"]
    assert found.after["X1"]["M"] == pytest.approx(found.before["X1"]["M"], abs=0.05)
    assert found.outcome.data["outcome"] == "better"
    assert found.outcome.exit_code == 0
    run = RunFolder(Path(found.outcome.run_folder))
    record = run.get(stages.push("X1"), PushRecord)
    assert (record.outcome, lines(record)[0][:15]) == ("skipped", "E-PUSH-NO-PROOF")
    assert left_out(tmp_path) == ["X1"]
    assert "P-PUSH-WITHOUT" in {code for code, _ in found.said}


@pytest.mark.timeout(1800)
def test_a_closing_run_predicts_the_flank_of_what_was_pushed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unprovable(monkeypatch, {("C1", "cross")})
    file = relative("coarse", 2, FEW)
    found = run_machine(file, file.seed, tmp_path, short=True, edit=quick)
    assert found.outcome == "better"
    assert found.after_um < 0.5 * found.set_right_um
    (folder,) = (path.parent for path in tmp_path.rglob("run.json"))
    run = RunFolder(folder)
    assert run.get(stages.TOOTH_VERDICT, ToothVerdict).within_prediction
    names = left_out(tmp_path)
    assert names
    assert all(name.startswith("C1-") for name in names)
    told = run.get(stages.TOOTH, ToothProposal)
    assert any(line.startswith(f"{names[0]}: E-PUSH-NO-PROOF") for line in map(str, told.said))
    assert "C1" not in {one.axis for one in told.axes}
