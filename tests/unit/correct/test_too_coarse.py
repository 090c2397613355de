"""One measured but too coarse error dominates u: it is named, and the window advised cures it when measured so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.correct.flank.noise import noise_patterns
from gateway.correct.outlook.flank_uncertainty import doubts
from gateway.correct.outlook.prediction import DominantError, Prediction, diagnose_sampling, predict
from gateway.correct.plan.layers import correct
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.model.fit import fit_through
from gateway.workflow.tooth.messages import measure_better
from tests.sizes import few
from tests.unit.correct.test_prediction import E_MM, HEIGHT, PLAN, SHOP, known
from tests.unit.gear.machines import RV40E

COARSE = np.linspace(0.0, 300.0, 13)


def model_of(at: np.ndarray, wave_mm: float, noise: float = 0.03) -> ErrorModel:
    """The well measured machine, its EXZ a wave of 3 um read at these targets."""
    means = 3.0 * np.cos(2.0 * np.pi * at / wave_mm + 0.4) + np.random.default_rng(2).normal(0.0, noise, at.size)
    coarse = fit_through(at, means, noise, name="EXZ", axis="Z", axis_unit="mm")
    plain = known(())
    return replace(plain, motions=(*(one for one in plain.motions if one.name != "EXZ"), coarse))


def judged(model: ErrorModel) -> tuple[Prediction, DominantError | None]:
    chain = chain_of_errors(model, height_mm=HEIGHT)
    grinding, grid = Grinding(chain, RV40E, E_MM), flank_grid(RV40E, profile=5, width=3)
    plan = replace(PLAN, noise=noise_patterns(grinding, grid, doubts(model, chain, PLAN)))
    outlook = _predicted(grinding, grid, plan, model)
    return outlook, diagnose_sampling(grinding, grid, model, outlook.flank)


def _predicted(grinding: Grinding, grid: FlankGrid, plan: object, model: ErrorModel) -> Prediction:
    return predict(grinding, grid, plan, model=model, found=correct(grinding, grid, plan), shop=SHOP, draws=200)


@pytest.mark.parametrize("wave_mm", few([60.0, 45.0, 70.0]))
def test_the_error_is_named_and_its_window_cures_it(wave_mm: float) -> None:
    outlook, found = judged(model_of(COARSE, wave_mm))
    assert found is not None
    assert found.name == "EXZ"
    assert found.window is not None
    (told,) = measure_better(found)
    assert f"step = {found.window.step:.3g} (mm)" in str(told)
    assert found.window.first < HEIGHT - RV40E.b / 2.0 < HEIGHT + RV40E.b / 2.0 < found.window.last
    window = np.arange(found.window.first, found.window.last + 0.1, found.window.step)
    beside = COARSE[np.abs(COARSE - HEIGHT) > np.ptp(window) / 2.0 + 1.0]
    again, then = judged(model_of(np.sort(np.concatenate([beside, window])), wave_mm))
    assert again.flank.parts_um["EXZ"] < 0.5 * outlook.flank.parts_um["EXZ"]
    assert then is None or then.name != "EXZ"


def test_a_machine_without_a_worst_error_has_none_named() -> None:
    _, found = judged(known(()))
    assert found is None


def test_noise_is_not_cured_by_targets() -> None:
    _, found = judged(model_of(np.arange(100.0, 200.1, 2.5), 200.0, 1.0))
    assert found is not None
    assert (found.name, found.window) == ("EXZ", None)
    assert "more repetitions" in str(measure_better(found)[0])
