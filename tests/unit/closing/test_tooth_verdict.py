"""Before against after on the tooth: set-up values are no merit, and what nobody predicted is said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from drivers.message import prose
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.process_drift import set_right
from gateway.tooth import FlankMap, FlankPrediction, FloatArray, InspectedFlank
from gateway.workflow.tooth.verdict import eccentric_share, judge_tooth

GEAR = CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0)
GRID = flank_grid(GEAR, profile=11, width=5)
POINTS = 39 * 5 * 22


def made(of: Callable[[FlankGrid], FloatArray]) -> FlankMap:
    return FlankMap(GRID.thetas, GRID.zs, np.asarray(np.broadcast_to(of(GRID), GRID.shape), dtype=np.float64))


def wave(size: float) -> Callable[[FlankGrid], FloatArray]:
    return lambda grid: size * np.cos(2.0 * np.pi * 3.0 * grid.k / 39.0) * grid.section.nx


def inspected(flank: FlankMap, u: float = 0.05, points: int = 0) -> InspectedFlank:
    empty, seen, places = np.zeros((0, 3)), np.zeros(points), np.zeros(points // 22)
    return InspectedFlank("p", "test", "", seen, seen, seen, seen, 0.2, places, places, empty, empty, flank, u)


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
    assert f"{verdict.after_um:.2f} µm" in prose(verdict.words)


def test_a_flank_elsewhere_than_predicted_is_said_even_when_it_is_better() -> None:
    before, end = made(wave(4.0)), made(wave(1.0))
    verdict = judge_tooth(inspected(before), inspected(end), predicted(made(wave(0.0)), 0.1), GEAR)
    assert (verdict.outcome, verdict.within_prediction) == ("better", False)
    assert "does not agree with the prediction" in prose(verdict.words)


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


CLAMPING_UM = 0.25


def seen(of: Callable[[FlankGrid], FloatArray], rng: np.random.Generator) -> InspectedFlank:
    """A flank as one clamping and one probe show it, and what the record says of both."""
    x, y = rng.normal(0.0, CLAMPING_UM, 2)
    turn = 2.0 * np.pi * GRID.k / 39.0
    nx, ny = GRID.section.nx, GRID.section.ny
    off = x * (np.cos(turn) * nx - np.sin(turn) * ny) + y * (np.sin(turn) * nx + np.cos(turn) * ny)
    noisy = made(of).deviation_um + off + rng.normal(0.0, 0.2, GRID.shape)
    design = np.stack([nx[:, 0], ny[:, 0], GRID.section.h[:, 0]], axis=1)
    fitted = np.einsum("ts,ksz->ktz", design @ np.linalg.pinv(design), noisy)
    u = CLAMPING_UM * float(np.sqrt(np.mean(nx**2 + ny**2)))
    return inspected(FlankMap(GRID.thetas, GRID.zs, fitted), u, POINTS)


def test_the_uncertainty_of_a_change_is_what_clampings_and_probes_make_of_none() -> None:
    rng = np.random.default_rng(8)
    still = [(seen(wave(0.3), rng), seen(wave(0.3), rng)) for _ in range(40)]
    told = [judge_tooth(first, last, predicted(made(wave(0.3))), GEAR) for first, last in still]
    assert sum(one.outcome != "unchanged" for one in told) <= 4
    clear = [(one.after_clear_um - one.before_clear_um) / one.clear_U_um for one in told]
    assert max(abs(one) for one in clear) < 1.2
    moved = np.array([2.0 * one.change_um / one.change_U_um for one in told])
    assert 0.4 < float(np.sqrt(np.mean(moved**2))) < 1.4


def test_unchanged_hides_no_gain_that_no_clamping_can_make() -> None:
    """The clamping may be off by more than the gain, but not in the third harmonic."""
    before = inspected(made(lambda grid: eccentric(0.8)(grid) + wave(0.5)(grid)), 0.6, POINTS)
    after = inspected(made(lambda grid: eccentric(0.8)(grid) + wave(0.1)(grid)), 0.6, POINTS)
    verdict = judge_tooth(before, after, predicted(made(wave(0.1)), 0.3), GEAR)
    assert abs(verdict.change_um) < verdict.change_U_um
    assert verdict.outcome == "better"
    assert verdict.before_clear_um == pytest.approx(made(wave(0.5)).rms_um, rel=0.02)
    assert f"from {verdict.before_clear_um:.2f} to {verdict.after_clear_um:.2f} µm" in prose(verdict.words)


@pytest.mark.parametrize(
    ("last", "said"),
    [
        (lambda grid: wave(0.2)(grid) + eccentric(0.25)(grid), "no difference beyond its uncertainty"),
        (lambda grid: wave(0.2)(grid) + eccentric(1.2)(grid), "an eccentricity makes that difference"),
        (wave(0.9), "something changed between the two"),
        (wave(0.15), ""),
    ],
)
def test_a_trial_part_that_was_better_is_explained(last: Callable[[FlankGrid], FloatArray], said: str) -> None:
    before, trial = inspected(made(wave(2.0)), 0.3, POINTS), inspected(made(wave(0.2)), 0.3, POINTS)
    verdict = judge_tooth(before, inspected(made(last), 0.3, POINTS), predicted(trial.fitted), gear=GEAR, trial=trial)
    assert said in prose(verdict.words)
    assert ("The trial part had" in prose(verdict.words)) == bool(said)
    assert verdict.trial_um == pytest.approx(trial.fitted.rms_um)
