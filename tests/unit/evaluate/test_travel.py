"""The range over the whole travel: judged by the truth between the targets, on seeded machines of several kinds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.domain.captures import Between
from gateway.evaluate.behaviour.fine_structure import over_travel
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from tests.sizes import few
from tests.steps import said
from tests.unit.evaluate.hostile import Captured, captured

SMOOTH, SCREW, SAG, WORM = "smooth", "screw", "sag", "worm"


def machine(kind: str, seed: int) -> Captured:
    place = np.random.default_rng(seed).uniform(40.0, 360.0)
    extra: dict[str, Any] = {
        SMOOTH: None,
        SCREW: lambda q: 3.0 * np.cos(2.0 * np.pi * q / (8.0 + 2.0 * (seed % 2))),
        SAG: lambda q: -8.0 * np.exp(-0.5 * ((q - place) / 12.0) ** 2),
        WORM: lambda q: 3.0 * np.cos(np.radians((36.0, 72.0)[seed % 2] * q)),
    }
    return captured(seed, extra=extra[kind], rotary=kind == WORM, count=24 if kind == WORM else 21)


def judged(one: Captured) -> tuple[float, float]:
    """Normalised errors (true - said) / u of the range over the travel and of M, the range at the targets."""
    capture: Any = SimpleNamespace(
        targets=one.targets,
        deviations=one.deviations,
        between=one.between,
        unit="um",
        axis_unit="deg" if one.rotary else "mm",
    )
    found = over_travel(evaluate_iso230_2(one.targets, one.deviations, "um"), capture)
    end = one.targets[0] + 360.0 if one.rotary else one.targets[-1]
    true = float(np.ptp(one.truth(np.linspace(one.targets[0], end, 4001))))
    assert found.M is not None
    assert found.M_travel is not None
    return 2.0 * (true - found.M_travel) / found.U["M_travel"], 2.0 * (true - found.M) / found.U["M"]


@pytest.mark.parametrize("count", few([8, 60]))
def test_the_truth_over_the_travel_lies_within_u(count: int) -> None:
    machines = [machine(kind, seed) for kind in (SMOOTH, SCREW, SAG, WORM) for seed in range(count)]
    travel, targets = np.array([judged(one) for one in machines]).T
    assert np.mean(np.abs(travel) > 2.0) <= 0.1
    assert np.mean(np.abs(targets) > 2.0) > 0.4
    assert 0.4 < float(np.sqrt(np.mean(travel**2))) < 1.5


def test_a_smooth_machine_is_not_made_worse_than_it_is() -> None:
    one = machine(SMOOTH, 1)
    capture: Any = SimpleNamespace(
        targets=one.targets, deviations=one.deviations, between=one.between, unit="um", axis_unit="mm"
    )
    found = over_travel(evaluate_iso230_2(one.targets, one.deviations, "um"), capture)
    assert found.M_travel == pytest.approx(found.M, abs=0.3)
    assert found.U["M_travel"] < 0.6


def test_without_anything_between_the_targets_there_is_no_figure() -> None:
    one = machine(SMOOTH, 2)
    blind = Between(one.between.targets, np.full_like(one.between.deviations, np.nan))
    capture: Any = SimpleNamespace(
        targets=one.targets, deviations=one.deviations, between=blind, unit="um", axis_unit="mm"
    )
    found = over_travel(evaluate_iso230_2(one.targets, one.deviations, "um"), capture)
    assert found.M_travel is None
    assert any("whole travel" in flag for flag in said(found))
