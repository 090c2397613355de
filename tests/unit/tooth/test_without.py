"""A table whose sign is not proved is left out; the run goes on with what still helps, and says what it costs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.message import Message
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.gear.flank import flank_grid
from gateway.gear.process_drift import set_right
from gateway.tooth import FlankMap, FlankPrediction, SetupValues, ToothProposal
from gateway.workflow.control import signs
from gateway.workflow.run import stages
from gateway.workflow.tooth import ablation
from gateway.workflow.tooth.proposal import PROFILE, WIDTH
from tests.unit.gear.machines import DISC
from tests.unit.tooth.test_remaining import MODEL, WORK, cross, own, spoiling

NAMES = {letter: letter for letter in "XZC"}
TRIED = ablation.TableTrial(MODEL, WORK, NAMES)


def every() -> tuple[TableChange, ...]:
    return (*own(), *cross())


def no_proof(axis: str) -> VerifyError:
    return VerifyError("E-PUSH-NO-PROOF", axis, axis=axis, unit="um", mean=1.0, u=0.7, peak=3.0, count=6)


class Store(dict[str, Any]):
    """A run folder of these records."""

    run_id = "a run"

    def has(self, stage: str) -> bool:
        return stage in self

    def get(self, stage: str, _kind: object) -> Any:  # type: ignore[override]
        return self[stage]

    def put(self, stage: str, record: object, _parents: tuple[str, ...]) -> None:
        self[stage] = record

    def parents(self, _stage: str) -> tuple[str, ...]:
        return ()


class Said:
    """What a bench says and what it keeps."""

    def __init__(self, **records: object) -> None:
        self.codes: list[str] = []
        self.fields: list[dict[str, object]] = []
        axes = [SimpleNamespace(name=letter, letter=letter) for letter in "XZC"]
        self.bench: Any = SimpleNamespace(
            folder=Store(records), site=SimpleNamespace(axes=axes), site_path=None, say=self.say
        )

    def say(self, code: str, **fields: object) -> None:
        self.codes.append(code)
        self.fields.append(fields)


@pytest.fixture(autouse=True)
def kept(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """What the audit log was told; the work of the site file is the disc."""
    told: list[tuple[str, str]] = []
    monkeypatch.setattr(ablation, "work_of", lambda _site, _path: WORK)
    monkeypatch.setattr(signs, "record_left_out", lambda _at, change, why: told.append((change.name, why)))
    return told


@cache
def rms_um(*names: str) -> float:
    return TRIED.right([one for one in every() if one.name in names]).rms_um


def test_an_axis_of_its_own_goes_on_without_another(kept: list[tuple[str, str]]) -> None:
    """Nothing was asked for the tooth: each axis table was predicted for its axis alone."""
    said = Said()
    found = signs._without_unproved(said.bench, own(), {("X", "axis"): no_proof("X")})
    assert [one.name for one in found] == [one.name for one in own()]
    assert {one.name: bool(one.skipped) for one in found} == {one.name: one.axis == "X" for one in own()}
    assert said.codes == ["P-PUSH-WITHOUT"]
    ((name, why),) = kept
    assert name == "X"
    assert why.startswith("E-PUSH-NO-PROOF")


def test_without_any_table_left_it_is_an_error() -> None:
    with pytest.raises(VerifyError, match="E-PUSH-NO-PROOF"):
        signs._without_unproved(Said().bench, own()[:1], {(own()[0].axis, "axis"): no_proof("X")})


def test_a_sign_holds_for_all_cross_tables_of_its_axis() -> None:
    several = [one for one in cross() if one.axis == "X"]
    assert len(several) > 1
    found = signs._without_unproved(Said().bench, every(), {("X", "cross"): no_proof("X")})
    assert [one.name for one in found if one.skipped] == [one.name for one in several]


def test_half_of_a_reversal_takes_the_other_with_it() -> None:
    plain = own()[0]
    turned = replace(plain, new=replace(plain.new, kind="reversal"))
    up = replace(plain, new=replace(plain.new, kind="cross", index=4, input_axis=plain.axis, direction=1))
    down = replace(up, new=replace(up.new, index=5, direction=-1))
    changes = (plain, turned, up, down)
    found = signs._without_unproved(Said().bench, changes, {(plain.axis, "cross"): no_proof(plain.axis)})
    assert [bool(one.skipped) for one in found] == [False, True, True, True]
    found = signs._without_unproved(Said().bench, (plain, turned), {(plain.axis, "reversal"): no_proof(plain.axis)})
    assert [bool(one.skipped) for one in found] == [False, True]


def test_of_tables_for_a_tooth_the_better_rest_goes_on_and_the_flank_is_said() -> None:
    said = Said(**{stages.TOOTH: None, stages.ERRORS: MODEL})
    lost = cross()[0]
    found = signs._without_unproved(said.bench, every(), {(lost.axis, "cross"): no_proof(lost.axis)})
    assert said.codes[0] == "P-PUSH-WITHOUT-FLANK"
    going = [one.name for one in found if not one.skipped]
    figures = said.fields[0]
    assert figures["rest"].value == pytest.approx(rms_um(*going), abs=0.006)
    assert figures["all"].value == pytest.approx(rms_um(*(one.name for one in every())), abs=0.006)
    assert figures["none"].value == pytest.approx(rms_um(), abs=0.006)
    assert rms_um(*going) <= rms_um() + 1e-6


def test_what_spoils_without_the_lost_table_goes_too() -> None:
    rest = ablation.best_remaining_tables(TRIED, (*every(), spoiling()), (*own(), spoiling()))
    assert [one.name for one in rest.changes] == [one.name for one in own()]
    worse = [
        replace(one, new=replace(one.new, deviations=tuple(-5.0 * d for d in one.new.deviations))) for one in own()
    ]
    assert ablation.best_remaining_tables(TRIED, every(), worse).changes == ()


def test_the_prediction_becomes_that_of_the_tables_that_were_pushed() -> None:
    changes = every()
    acting = [one for one in changes if one.axis != "X" or one.layer == "axis"]
    whole, plain = TRIED.right(changes), TRIED.flank(own())
    told = FlankPrediction(TRIED.flank(()), plain, whole, 0.1, 0.2, np.zeros(whole.deviation_um.shape), 0.5, 0.1)
    found = ablation.revise_prediction(ToothProposal(SetupValues(), told), TRIED, changes, acting)
    wanted = TRIED.right(acting)
    assert found.prediction.after.deviation_um == pytest.approx(wanted.deviation_um, abs=1e-9)
    doubt = 0.5**2 - whole.rms_um**2
    assert found.prediction.rms_um == pytest.approx((wanted.rms_um**2 + max(doubt, 0.0)) ** 0.5)
    assert found.prediction.with_own.deviation_um == pytest.approx(plain.deviation_um)
    assert "not pushed" in str(found.said[0])
    grid = flank_grid(DISC, profile=PROFILE, width=WIDTH)
    assert whole.deviation_um.shape == grid.shape
    assert set_right(whole, DISC).rms_um == pytest.approx(whole.rms_um, rel=1e-6)


@pytest.mark.parametrize("larger_um", [0.2, 0.6, 2.0])
def test_the_spread_of_the_rms_follows_the_flank(larger_um: float) -> None:
    """Held against drawn doubts: patterns without a preference, 0.23 um in all."""
    rng, u = np.random.default_rng(3), 0.23
    thetas, zs = np.linspace(-1.0, 1.0, 6), np.linspace(-5.0, 5.0, 4)
    plain, more = (size * rng.standard_normal((5, 6, 4)) for size in (0.13, larger_um))

    def drawn(map_um: np.ndarray) -> tuple[float, float]:
        found = np.sqrt(np.mean((map_um + u * rng.standard_normal((20_000, 5, 6, 4))) ** 2, axis=(1, 2, 3)))
        return float(np.mean(found)), float(np.std(found))

    flank = FlankMap(thetas, zs, plain)
    rms_um, rms_u_um = drawn(plain)
    told = FlankPrediction(flank, flank, flank, 0.1, u, np.full(plain.shape, u), rms_um, rms_u_um)
    found, wanted = ablation._move_flank(told, more), drawn(plain + more)
    assert (found.rms_um, found.rms_u_um) == pytest.approx(wanted, rel=0.05)


def test_the_stored_prediction_is_revised_once_and_says_why() -> None:
    changes, lost = every(), cross()[0]
    whole = TRIED.right(changes)
    told = FlankPrediction(TRIED.flank(()), TRIED.flank(own()), whole, 0.1, 0.2, whole.deviation_um, 0.5, 0.1)
    said = Said(**{stages.TOOTH: ToothProposal(SetupValues(), told), stages.ERRORS: MODEL})
    folder = said.bench.folder
    proposal: Any = SimpleNamespace(changes=changes)
    folder[stages.PROPOSAL] = proposal
    folder |= {stages.push(one.name): PushRecord(1, one.axis, "committed", (), "") for one in changes}
    ablation.predict_without(said.bench, proposal)
    assert folder[stages.TOOTH].prediction is told
    folder[stages.push(lost.name)] = PushRecord(
        0, lost.axis, "skipped", (), "", reasons=(Message.stored("E-PUSH-NO-PROOF: too small"),)
    )
    ablation.predict_without(said.bench, proposal)
    found = folder[stages.TOOTH]
    assert str(found.said[0]) == f"{lost.name}: E-PUSH-NO-PROOF: too small"
    wanted = TRIED.right([one for one in changes if one.name != lost.name])
    assert found.prediction.after.deviation_um == pytest.approx(wanted.deviation_um, abs=1e-9)
