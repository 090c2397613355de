"""Control charts over seeded histories: in time where something drifts, quiet where nothing does."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.process.charts import BASE, PartFigures, ProcessAnswer, judge_process
from tests.sizes import few

TOLERANCE_UM = 2.0
NOISE = {
    "wheel": 0.05, "dresser": 0.3, "x zero": 0.3, "wear": 0.1, "axes over C": 0.08, "axes over Z": 0.05,
    "dressing offset": 0.2, "clamping": 0.2,
}  # fmt: skip
LEVEL = {"wheel": 0.6, "axes over C": 0.7, "axes over Z": 0.3, "clamping": 0.4}
SHOWN = ("wheel", "axes over C", "axes over Z", "clamping")  # shares that make the whole


def history(seed: int, drift: dict[str, float], parts: int = 60, dress_every: int = 0) -> list[PartFigures]:
    """Parts with noise; ``drift`` in um per part sets in after the fifteenth."""
    rng, found = np.random.default_rng(seed), []
    for n in range(parts):
        dressed = n % dress_every + 1 if dress_every else n + 1
        worn = max(n - 15, 0)
        values = {
            name: LEVEL.get(name, 0.0) + drift.get(name, 0.0) * worn + float(rng.normal(0.0, size))
            for name, size in NOISE.items()
        }
        total = float(np.sqrt(sum(values[name] ** 2 for name in SHOWN)))
        found.append(PartFigures(f"part {n}", "", {**values, "total": total}, {**NOISE, "total": 0.1}, dressed))
    return found


def first_warning(parts: list[PartFigures]) -> tuple[int, ProcessAnswer] | None:
    for n in range(BASE + 1, len(parts) + 1):
        seen = judge_process(parts[:n], TOLERANCE_UM)
        if seen.answer != "valid":
            return n, seen
    return None


CAUSES = (("wheel", 0.06, "dress"), ("axes over C", 0.06, "measure C only"), ("axes over Z", 0.06, "cannot tell"))


@pytest.mark.parametrize("seeds", few([range(4), range(20)], 1, 2))
def test_drifting_machines_are_warned_in_time_by_what_drifts(seeds: range) -> None:
    """In time: before the whole deviation itself is out of tolerance. Sixty histories in all in the long form."""
    late, wrong, count = 0, 0, 0
    for name, rate, answer in CAUSES:
        for seed in seeds:
            parts = history(seed, {name: rate})
            out = next(n for n, one in enumerate(parts) if n > 15 and one.values["total"] > TOLERANCE_UM)
            warned = first_warning(parts[:out])
            count += 1
            late += warned is None
            if warned is not None and warned[0] > 15:
                wrong += warned[1].answer not in (answer, "cannot tell")
    assert late <= 0.05 * count
    assert wrong <= 0.1 * count


@pytest.mark.parametrize("seeds", few([range(8), range(60)], 1, 2))
def test_quiet_processes_are_left_alone(seeds: range) -> None:
    false, judged = 0, 0
    for seed in seeds:
        parts = history(1000 + seed, {}, dress_every=12)
        for n in range(BASE + 1, len(parts) + 1):
            judged += 1
            false += judge_process(parts[:n], TOLERANCE_UM).answer != "valid"
    assert false < 0.01 * judged


def test_the_chance_of_the_next_part_follows_its_distance_from_the_tolerance() -> None:
    parts = history(3, {})
    assert judge_process(parts, 2.0).probability > 0.999
    total = float(np.mean([one.values["total"] for one in parts[-8:]]))
    assert 0.2 < judge_process(parts, total).probability < 0.8
    assert judge_process(parts, 0.5).probability < 0.001
    assert judge_process(parts[:BASE], 2.0).answer == "cannot tell"


def test_an_ewma_chart_is_the_one_of_the_standard() -> None:
    """By hand: five parts at 1, then 2 and 3; weight 0.25, and the limit's square by its closed form."""
    values = [1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0]
    parts = [
        PartFigures(str(n), "", {"axes over C": v, "total": v}, {"axes over C": 0.1, "total": 0.1}, n + 1)
        for n, v in enumerate(values)
    ]
    chart = next(one for one in judge_process(parts, 10.0).charts if one.name == "axes over C")
    assert chart.ewma == pytest.approx(0.25 * 3.0 + 0.75 * (0.25 * 2.0 + 0.75))
    variance = 6.0 * 0.01 / 10.0
    assert chart.limit == pytest.approx(3.6 * np.sqrt(variance * (0.25 / 1.75 * (1.0 - 0.75**4) + 0.2)))
    assert chart.signals
