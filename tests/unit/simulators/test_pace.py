"""A cell's loop that was not given its time goes on where it was, a little later."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.cell.paced_loop import TURN_S, PacedLoop, PacedTime


@dataclass
class Wall:
    now: float = 100.0

    def __call__(self) -> float:
        return self.now

    def passes(self, seconds: float) -> None:
        self.now += seconds


def test_a_turn_that_takes_long_counts_little() -> None:
    wall = Wall()
    loop = PacedLoop(wall)
    try:
        began = loop.time()
        loop.call_soon(wall.passes, 30.0)
        loop.call_soon(loop.stop)
        loop.run_forever()
        assert began < loop.time() <= began + 2.0 * TURN_S
    finally:
        loop.close()


@pytest.mark.parametrize(("asked", "took", "counts"), [(10.0, 10.0, 10.0), (10.0, 4.0, 4.0), (None, 7.0, 7.0)])
def test_a_wait_counts_as_long_as_it_took(asked: float | None, took: float, counts: float) -> None:
    wall = Wall()
    pace = PacedTime(wall)
    pace.count_wait(lambda _timeout: wall.passes(took), asked)
    assert pace.now() == pytest.approx(100.0 + counts)


def test_a_wait_that_overslept_counts_as_asked() -> None:
    wall = Wall()
    pace = PacedTime(wall)
    pace.count_wait(lambda _timeout: wall.passes(25.0), 1.0)
    assert pace.now() == pytest.approx(101.0 + TURN_S)


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 50.0), st.floats(0.0, 2.0)), max_size=30))
def test_time_never_goes_back_and_never_runs_ahead(steps: list[tuple[bool, float, float]]) -> None:
    wall = Wall()
    pace = PacedTime(wall)
    seen = [pace.now()]
    for waits, took, asked in steps:
        if waits:
            pace.count_wait(lambda _timeout, took=took: wall.passes(took), asked)  # type: ignore[misc]
        else:
            wall.passes(took)
        seen.append(pace.now())
    assert seen == sorted(seen)
    assert seen[-1] <= wall.now + 1e-9
