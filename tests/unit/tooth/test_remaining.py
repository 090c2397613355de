"""When one table of a layer fails: the flank is predicted with what would stay, and worse than none goes back whole."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from drivers.types.values import Sense
from gateway.correct.outlook.prediction import flank_map
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange, torn
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.error_model import chain_of_errors
from gateway.workflow.control import push
from gateway.workflow.run import stages
from gateway.workflow.tooth import ablation
from gateway.workflow.tooth.proposal import PROFILE, WIDTH, ToothWork
from tests.unit.correct.test_prediction import HEIGHT, PLAN, known
from tests.unit.gear.machines import DISC

NOTHING = np.zeros(0)
WORK = ToothWork("disc", DISC, 190.0, HEIGHT)
MODEL = known(())


@cache
def corrected() -> LayeredCorrection:
    machine = Grinding(chain_of_errors(MODEL, height_mm=HEIGHT), DISC, 190.0)
    return correct(machine, flank_grid(DISC, profile=PROFILE, width=WIDTH), PLAN)


def change(table: CompensationTable) -> TableChange:
    """A table where none was before."""
    old = CompensationTable(table.kind, table.input_axis, table.output_axis, 0.0, 0.0, 0.0, (0.0,), index=table.index)
    return TableChange(table.output_axis, old, table, False, "", NOTHING, NOTHING, NOTHING)


def own() -> tuple[TableChange, ...]:
    return tuple(change(one) for one in corrected().own)


def cross() -> tuple[TableChange, ...]:
    return tuple(change(one) for one in corrected().cross)


def spoiling() -> TableChange:
    """A table that bends every stroke by 8 um, as one does whose failed partner took that away again."""
    at = np.arange(0.0, 301.0, 5.0)
    values = tuple(float(value) for value in 8.0 * np.cos(at / 6.0))
    return change(CompensationTable("cross", "Z", "X", 0.0, 300.0, 5.0, values, index=7))


class Run:
    """A run folder that holds these records."""

    def __init__(self, **records: object) -> None:
        self.records = records

    def has(self, stage: str) -> bool:
        return stage in self.records

    def get(self, stage: str, _kind: object) -> object:
        return self.records[stage]


def bench(said: list[str], changes: tuple[TableChange, ...], pushed: tuple[str, ...] = (), **more: object) -> Any:
    """A bench whose run proposed these changes and pushed some of them."""
    records: dict[str, object] = {stages.PROPOSAL: SimpleNamespace(changes=changes), **more}
    records |= {stages.push(name): PushRecord(1, name, "committed", (), "") for name in pushed}
    axes = [SimpleNamespace(name=letter, letter=letter) for letter in "XZC"]
    return SimpleNamespace(
        folder=Run(**records),
        site=SimpleNamespace(axes=axes),
        site_path=None,
        say=lambda code, **_fields: said.append(code),
    )


@pytest.fixture(autouse=True)
def disc(monkeypatch: pytest.MonkeyPatch) -> None:
    """The work of the site file, without one."""
    monkeypatch.setattr(ablation, "work_of", lambda _site, _path: WORK)


TOLD: dict[str, Any] = {stages.TOOTH: None, stages.ERRORS: MODEL}


def test_all_tables_of_both_layers_leave_what_the_proposal_said() -> None:
    """The same flank from the correction's own machine, worked out by another road."""
    found = ablation.residual_after_partial_push(bench([], own(), tuple(one.name for one in own()), **TOLD), cross())
    assert found is not None
    grid = flank_grid(DISC, profile=PROFILE, width=WIDTH)
    machines = corrected().machine_with_own, corrected().unmoved
    alone, everything = (set_right(flank_map(one, grid), DISC).rms_um for one in machines)
    assert found.without_um == pytest.approx(alone, rel=1e-6)
    assert found.with_them_um == pytest.approx(everything, rel=0.02)
    assert found.with_them_um < 0.5 * found.without_um


def test_what_cures_alone_stays_and_what_spoils_alone_goes_back() -> None:
    said: list[str] = []
    stays = push._partial_commit_policy(bench(said, own(), **TOLD))
    assert stays(cross())
    assert not stays((spoiling(),))
    assert said == ["P-PUSH-REST-FLANK"] * 2


def test_what_cannot_be_predicted_goes_back_and_an_axis_of_its_own_stays() -> None:
    said: list[str] = []
    product = replace(spoiling(), new=replace(spoiling().new, multiply_by=3))
    assert not push._partial_commit_policy(bench(said, own(), **TOLD))((product,))
    assert not push._partial_commit_policy(bench(said, own(), **dict[str, Any]({stages.TOOTH: None})))(cross())
    assert push._partial_commit_policy(bench(said, own()))(own())
    assert said == []


def test_tables_that_acted_before_are_taken_off_first() -> None:
    """A table that only comes back as it was changes no flank."""
    acted = replace(spoiling(), old=spoiling().new, old_enabled=True)
    found = ablation.residual_after_partial_push(bench([], own(), **TOLD), (acted,))
    assert found is not None
    assert found.with_them_um == pytest.approx(found.without_um, abs=1e-9)
    assert found.harmless


def test_a_reversal_and_its_pair_go_together() -> None:
    plain = own()[0]
    ways: tuple[tuple[int, Sense], ...] = ((4, 1), (5, -1))
    up, down = (
        replace(plain, new=replace(plain.new, kind="cross", index=index, input_axis=plain.axis, direction=way))
        for index, way in ways
    )
    turned = replace(plain, new=replace(plain.new, kind="reversal"))
    every = (plain, turned, up, down)
    stays = push._partial_commit_policy(bench([], every))
    assert stays(every)
    assert stays((plain,))
    assert not stays((plain, up))
    assert not stays((plain, turned))
    assert not stays((up, down))
    assert torn((turned, up), every) == (down.name,)
    assert torn((turned,), (plain, turned)) == ()
