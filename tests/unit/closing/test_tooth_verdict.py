"""Before against after on the tooth: set-up values are no merit, and what nobody predicted is said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.setright import set_right
from gateway.tooth import FlankMap, FlankPrediction, FloatArray, InspectedFlank
from gateway.workflow.tooth.verdict import eccentric_share, judge_tooth

GEAR = CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0)
GRID = flank_grid(GEAR, profile=11, width=5)
NOTHING = np.zeros(0)


def made(of: Callable[[FlankGrid], FloatArray]) -> FlankMap:
    return FlankMap(GRID.thetas, GRID.zs, np.asarray(np.broadcast_to(of(GRID), GRID.shape), dtype=np.float64))


def wave(size: float) -> Callable[[FlankGrid], FloatArray]:
    return lambda grid: size * np.cos(2.0 * np.pi * 3.0 * grid.k / 39.0) * grid.section.nx


def inspected(flank: FlankMap, u: float = 0.05) -> InspectedFlank:
    empty = np.zeros((0, 3))
    return InspectedFlank(
        "p", "test", "", NOTHING, NOTHING, NOTHING, NOTHING, 0.2, NOTHING, NOTHING, empty, empty, flank, u
    )


def predicted(after: FlankMap, u: float = 0.1) -> FlankPrediction:
    return FlankPrediction(after, after, after, 0.0, u, np.full(GRID.shape, u), after.rms_um, 0.05)


def test_infeed_dresser_and_one_rotation_are_taken_and_nothing_else() -> None:
    shape = made(wave(1.0))
    moved = made(lambda grid: wave(1.0)(grid) - 12.0 * grid.section.nx + 7.0 * grid.section.ny + 0.02 * grid.section.h)
    assert np.allclose(set_right(moved, GEAR).deviation_um, shape.deviation_um, atol=1e-9)
    assert moved.rms_um > 8.0 * shape.rms_um


@pytest.mark.parametrize(("after", "outcome"), [(0.2, "better"), (2.0, "unchanged"), (2.6, "worse")])
def test_the_flank_before_counts_with_its_set_up_values_right(after: float, outcome: str) -> None:
    before = made(lambda grid: wave(2.0)(grid) - 12.0 * grid.section.nx)
    end = made(wave(after))
    verdict = judge_tooth(inspected(before), inspected(end), predicted(end), GEAR)
    assert verdict.outcome == outcome
    assert verdict.before_um > 5.0 > verdict.before_set_right_um == pytest.approx(made(wave(2.0)).rms_um)
    assert verdict.within_prediction
    assert f"{verdict.after_um:.2f} um" in verdict.words


def test_a_flank_elsewhere_than_predicted_is_said_even_when_it_is_better() -> None:
    before, end = made(wave(4.0)), made(wave(1.0))
    verdict = judge_tooth(inspected(before), inspected(end), predicted(made(wave(0.0)), 0.1), GEAR)
    assert (verdict.outcome, verdict.within_prediction) == ("better", False)
    assert "does not lie where it was predicted" in verdict.words


def eccentric(size: float) -> Callable[[FlankGrid], FloatArray]:
    return lambda grid: (
        size
        * (
            grid.section.nx * np.cos(2.0 * np.pi * grid.k / 39.0)
            - grid.section.ny * np.sin(2.0 * np.pi * grid.k / 39.0)
        )
    )


def test_a_clamping_that_may_be_off_hides_only_what_looks_like_it() -> None:
    """A third harmonic is none of its doing; an eccentricity of the flank may be all its doing."""
    still = inspected(made(wave(0.1)), 0.3)
    told = judge_tooth(inspected(made(wave(0.6)), 0.3), still, predicted(made(wave(0.1))), GEAR)
    hidden = judge_tooth(inspected(made(eccentric(0.6)), 0.3), still, predicted(made(wave(0.1))), GEAR)
    assert (told.outcome, hidden.outcome) == ("better", "unchanged")
    assert told.before_set_right_um < hidden.before_set_right_um


def test_what_an_eccentricity_takes_is_told_apart() -> None:
    both = made(lambda grid: eccentric(0.5)(grid) + wave(0.2)(grid))
    off, rest = eccentric_share(both, GEAR)
    assert off == pytest.approx(made(eccentric(0.5)).rms_um, rel=1e-9)
    assert rest == pytest.approx(made(wave(0.2)).rms_um, rel=1e-9)
