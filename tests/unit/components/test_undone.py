"""After a partial plan: which set-up would change the proposal for the tooth most, and what is worth none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.message import prose
from gateway.correct.outlook.flank_uncertainty import THRESHOLD_UM, OpenDoubt, ToothSpec, what_next
from gateway.correct.plan.plan import AxisGrid
from gateway.evaluate.geometry.error_model import error_model
from gateway.gear.cycloid import CycloidGear
from gateway.model.error_model import ErrorModel, UnmeasuredError
from gateway.workflow.errors21.measurement import advise
from gateway.workflow.errors21.setups import PlannedSetup, plan_setups
from tests.unit.components.machine import Machine
from tests.unit.components.site import site_of
from tests.unit.components.test_errormodel import whole_plan

TOOTH = ToothSpec(CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0), 160.0, 150.0)
GRIDS = (
    AxisGrid("X", -400.0, 0.0, 10.0),
    AxisGrid("Z", 0.0, 300.0, 10.0),
    AxisGrid("C", 0.0, 360.0, 5.0, modulo=True),
)


@pytest.fixture(scope="module")
def whole() -> ErrorModel:
    return error_model(whole_plan(Machine(3)), {})


def without(model: ErrorModel, name: str, span: float, unit: str) -> ErrorModel:
    """The same model as if one error had not been measured."""
    unknown = UnmeasuredError(name, span, unit)  # type: ignore[arg-type]
    motions = tuple(one for one in model.motions if one.name != name)
    locations = tuple(one for one in model.locations if one.name != name)
    return replace(model, motions=motions, locations=locations, unknown=(unknown,))


def ranked(model: ErrorModel) -> dict[str, OpenDoubt]:
    return {one.name: one for one in what_next(model, TOOTH, GRIDS)}


@pytest.mark.parametrize(("name", "span"), [("EBC", 5.0), ("EXC", 5.0), ("ECZ", 30.0), ("EYZ", 30.0)])
def test_an_error_that_the_tooth_feels_comes_first_when_it_alone_is_unknown(
    whole: ErrorModel, name: str, span: float
) -> None:
    found = what_next(without(whole, name, span, "um" if name[1] in "XYZ" else "arcsec"), TOOTH, GRIDS)
    assert found[0].name == name
    assert not found[0].measured
    assert found[0].change_um > THRESHOLD_UM
    assert found[0].share > 0.5


@pytest.mark.parametrize("name", ["EZX", "EZZ", "EZC", "EBZ"])
def test_what_cancels_on_the_flank_is_not_worth_a_set_up(whole: ErrorModel, name: str) -> None:
    found = ranked(without(whole, name, 20.0, "um" if name[1] in "XYZ" else "arcsec"))
    assert found[name].change_um < 1e-3


def test_heights_count_a_tilt_of_the_table_150_mm_below_the_work_moves_it(whole: ErrorModel) -> None:
    """1 arcsec of EBC at 150 mm is 0.73 um of infeed; at the table itself next to nothing."""
    model = without(whole, "EBC", np.sqrt(3.0), "arcsec")
    high, low = (
        {one.name: one for one in what_next(model, replace(TOOTH, height_mm=h), GRIDS)}["EBC"] for h in (150.0, 5.0)
    )
    assert high.change_um + high.beyond_um > 0.3
    assert high.change_um > 10.0 * low.change_um


def test_once_a_bar_showed_the_table_against_z_the_square_is_worth_nothing(whole: ErrorModel) -> None:
    assert "B0Z" not in ranked(whole)
    assert "B0Z" not in ranked(without(whole, "B0Z", 10.0, "arcsec"))


def opened(*pairs: tuple[str, float, bool]) -> tuple[OpenDoubt, ...]:
    return tuple(OpenDoubt(name, change, 0.0, 0.5, measured) for name, change, measured in pairs)


def plan() -> tuple[PlannedSetup, ...]:
    return plan_setups(site_of())


def _advice(*given: Any, asked: bool) -> str:
    return prose(advise(*given, asked=asked))


def test_the_advice_names_the_set_up_or_says_that_none_matters() -> None:
    left = ("EYX-X1", "EAX-X1")
    said = _advice(plan(), left, opened(("EXX", 3.0, True), ("EAX", 0.4, False), ("EYX", 0.2, False)), asked=True)
    assert said.startswith("Next: EAX-X1. To measure EAX would change the proposal most, by 0.40 µm RMS")
    none = _advice(plan(), left, opened(("EAX", 0.04, False), ("EYX", 0.02, False)), asked=True)
    assert none == "Set-ups left: 2. None of them would change the proposal by more than 0.1 µm RMS of the flank."
    other = _advice(plan(), left, opened(("ECZ", 2.0, False), ("EAX", 0.04, False)), asked=True)
    assert other.startswith("Set-ups left: 2. None")
    assert "No set-up of the plan measures ECZ" in other
    assert "names no gear" in _advice(plan(), left, (), asked=False)
    assert _advice(plan(), (), (), asked=False) == "Every set-up of the plan is measured."
    assert _advice(plan(), (), opened(("EAX", 0.04, True)), asked=True) == "Every set-up of the plan is measured."
