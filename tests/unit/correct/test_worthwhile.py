"""Cross tables that cure what is known well are proposed also where another one may do harm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from gateway.correct.flank.noise import noise_patterns
from gateway.correct.outlook.flank_uncertainty import doubts
from gateway.correct.outlook.prediction import CrossTableSelection, Prediction, predict, select_cross_tables
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import Plan
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from tests.unit.correct.test_prediction import HEIGHT, PLAN, SHOP, known
from tests.unit.gear.machines import DISC


def machine(structure_um: float, *, alone: bool = False) -> ErrorModel:
    """A machine known well but for what EXZ, large over the face, does between its targets; ``alone`` with EXZ only."""
    model = known(())
    worn = [
        replace(one, coefficients=np.array([0.0, 60.0, 0.0, 0.0, 0.0]), residual_rms=structure_um)
        for one in model.motions
        if one.name == "EXZ"
    ]
    others = [replace(one, coefficients=0.5 * one.coefficients) for one in model.motions if one.name != "EXZ"]
    return ErrorModel(motions=tuple(worn)) if alone else replace(model, motions=(*worn, *others))


@cache
def chosen(structure_um: float, *, alone: bool = False) -> CrossTableSelection:
    model = machine(structure_um, alone=alone)
    chain = chain_of_errors(model, height_mm=HEIGHT)
    grinding, grid = Grinding(chain, DISC, 190.0), flank_grid(DISC, profile=5, width=3)
    plan = replace(PLAN, noise=noise_patterns(grinding, grid, doubts(model, chain, PLAN)))

    def worked_out(tried: Plan) -> tuple[LayeredCorrection, Prediction]:
        found = correct(grinding, grid, tried)
        return found, predict(grinding, grid, tried, model, found, SHOP, draws=500)

    return select_cross_tables(plan, worked_out)


def names(one: CrossTableSelection) -> set[str]:
    return {table.grid.name for table in one.found.optimum.tables}


def test_only_the_table_that_may_do_harm_is_left_out() -> None:
    one = chosen(4.0)
    assert not one.whole.worth
    assert one.left_out == ("X(Z)",)
    assert names(one) == names(chosen(0.0)) - {"X(Z)"} != set()
    assert one.told is one.outlook
    assert one.outlook.worth


def test_where_all_are_worth_it_none_is_left_out() -> None:
    one = chosen(0.0)
    assert "X(Z)" in names(one)
    assert one.left_out == ()
    assert one.outlook is one.whole is one.told


def test_none_is_proposed_where_the_only_one_may_do_harm() -> None:
    one = chosen(4.0, alone=True)
    assert names(one) == set()
    assert one.left_out == ()
    assert one.told is one.whole
    assert not one.whole.worth
