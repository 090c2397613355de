"""The judge of uncertainties judged: honest ones pass, ones too small or too large are found, few machines are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.closing.honestpage import document
from tests.closing.honesty import FAMILY, broken, normalised, of_expanded, of_values, spreads
from tests.closing.kept import JUDGES, Kept, state_of_code
from tests.closing.record import MachineResult, Normalised
from tests.closing.trials import Trial, harmed, of_trials


def machines(kind: str, scale: float, count: int = 20) -> list[MachineResult]:
    """Machines whose truth lies ``scale`` times as far from what was said as its u says."""
    rng = np.random.default_rng(len(kind))
    plain = MachineResult(kind, 1, "disc", 11, False, "2026-01-01", predicted_um=0.2, rms_u_um=0.05)
    return [
        replace(
            plain,
            after_um=0.2 + 0.05 * scale * float(rng.normal()),
            points=Normalised.of(scale * rng.normal(size=500)),
        )
        for _ in range(count)
    ]


def test_honest_families_pass_and_each_wrong_one_is_named() -> None:
    good = {"worn": machines("worn", 1.0), "noisy": machines("noisy", 1.0)}
    assert broken(spreads(good)) == []
    small = broken(spreads({**good, "drifting": machines("drifting", 2.2)}))
    assert [line.split(":")[0] for line in small if "drifting" in line] == ["points of drifting", "RMS of drifting"]
    large = broken(spreads({**good, "Abbe": machines("Abbe", 0.4)}))
    assert any("points of Abbe" in line for line in large)
    assert not any("worn" in line for line in small + large)


def test_few_machines_are_told_and_not_judged() -> None:
    found = spreads({"short": machines("short", 3.0, 3)})
    assert broken(found) == []
    assert "too few to be judged" in found[-1].words


def test_failed_runs_do_not_count() -> None:
    wild = [replace(one, failed="E-INT-INCOMPLETE") for one in machines("wild", 9.0)]
    assert broken(spreads({"mild": machines("mild", 1.0), "wild": wild})) == []


def test_figures_with_k_2_and_missing_ones() -> None:
    found = of_expanded(np.array([3.0, 1.0]), np.array([2.0, 1.0]), np.array([1.0, 0.0]))
    assert found[0] == pytest.approx(2.0)
    assert np.isnan(found[1])
    assert normalised(np.array([3.0]), np.array([2.0]), np.array([0.5]))[0] == pytest.approx(2.0)
    spread = of_values("M over the travel", "periodic", [*found, 0.0])
    assert (spread.machines, spread.mean, spread.limits) == (2, pytest.approx(1.0), FAMILY)


def test_the_page_tells_every_family_and_what_breaks_it() -> None:
    found = {"mild": machines("mild", 1.0), "Abbe": machines("Abbe", 0.3)}
    text = document(found, "make families N=20", 60)
    assert "40 of 60 machines so far" in text
    assert text.count("| broken |") == 2
    assert "Broken: points of Abbe" in text
    assert "| points | mild | 20 |" in text
    assert sum(line.startswith("| mild |") for line in text.splitlines()) == 20


def test_what_a_machine_gave_is_kept_exactly_and_for_the_same_code_only(tmp_path: Path) -> None:
    one = machines("mild", 1.0, 1)[0]
    one = replace(one, u_um=float("inf"), axes={"X1": (1.0, 0.1)})
    kept = Kept(tmp_path / "kept", MachineResult)
    assert kept.get("mild-1") is None
    kept.put("mild-1", one)
    assert kept.get("mild-1") == one
    assert kept.all() == [one]
    for folder in ("gateway", "drivers", "simulators", "tests/closing"):
        (tmp_path / folder).mkdir(parents=True)
    for name in JUDGES:
        (tmp_path / f"tests/closing/{name}.py").write_text("", encoding="utf-8")
    before = state_of_code(tmp_path)
    assert state_of_code(tmp_path) == before
    (tmp_path / "gateway/a.py").write_text("x = 1", encoding="utf-8")
    assert state_of_code(tmp_path) != before


def test_trials_are_judged_by_what_acts_in_them_and_by_what_they_harm() -> None:
    fair = [Trial(f"fair-{n}", 1.0, 0.2, 0.1, 0.5, 0.1, {"X1": (2.0, 0.3)}) for n in range(12)]
    unsure = [replace(one, name=one.name.replace("fair", "unsure"), acting_u_um=0.3) for one in fair]
    assert broken(of_trials({"fair": fair})) == []
    assert [line.split(":")[0] for line in broken(of_trials({"unsure": unsure}))] == [
        "errors alone of all",
        "errors alone of unsure",
    ]
    assert harmed(fair[0]) == []
    worse = Trial("bad-1", 1.0, 1.2, 1.0, 0.2, 0.1, {"X1": (2.0, 2.5)})
    assert len(harmed(worse)) == 3
    assert harmed(Trial("bad-2", failed="E-INT-INCOMPLETE X1")) == ["bad-2: E-INT-INCOMPLETE X1"]
    text = document({}, "make families N=20", 9, [*fair, *unsure, worse])
    assert "25 machines, 0 ended with an error; the flank of 24 got better" in text
    assert "Broken: bad-1: flank from 1.00 to 1.20 um." in text
    assert "| fair-3 | 1.00 | 0.20 | 0.10 | 0.10 | 0.50 | 1.00 | 2.0 -> 0.3 |" in text
