"""Axes in time: the servo's lag, exact stop, modulo targets, stops, limits, and what instruments see."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import run_virtual
from simulators.nck.machine.motion import LaggedPath
from tests.unit.nck.bench import on_bench


def stepped(pieces: list[tuple[float, float, float]], lag: float, until: float) -> float:
    """The response by small steps, as an oracle for the exact one."""
    value, time, step = pieces[0][1], pieces[0][0], 1e-4
    while time < until - step / 2:
        start, begin, slope = max((piece for piece in pieces if piece[0] <= time + 1e-12), key=lambda p: p[0])
        demand = begin + slope * (time + step / 2 - start)
        value += (demand - value) * (1.0 - math.exp(-step / lag))
        time += step
    return value


def test_response_agrees_with_small_steps() -> None:
    pieces = [(0.0, 0.0, 0.0), (0.1, 0.0, 20.0), (0.3, 4.0, 0.0), (0.5, 3.0, -5.0), (0.6, 2.5, 0.0)]
    path = LaggedPath(0.03, 0.0, 0.0)
    for piece in pieces[1:]:
        path.add(*piece)
    times = np.array([0.05, 0.12, 0.29, 0.31, 0.45, 0.52, 0.58, 0.7, 2.0])
    expected = [stepped(pieces, 0.03, time) for time in times]
    np.testing.assert_allclose(path.responses(times), expected, atol=2e-3)
    np.testing.assert_allclose([path.response(time) for time in times], path.responses(times), atol=1e-12)


def test_history_is_kept_for_the_last_minute_and_memory_is_bounded() -> None:
    path = LaggedPath(0.02, 0.0, 0.0)
    for place in range(20000):
        path.add(0.05 * place, float(place % 7))
    assert len(path.upcoming(0.0)) < 4000
    now = 0.05 * 19999
    times = np.linspace(now - 60.0, now, 500)
    assert np.all(np.isfinite(path.responses(times)))


@given(
    st.floats(min_value=0.0, max_value=359.0),
    st.floats(min_value=0.0, max_value=360.0),
    st.sampled_from(["ACP", "ACN", "DC"]),
)
@settings(max_examples=25, deadline=None)
def test_modulo_targets_are_met_from_the_right_side(start: float, target: float, mode: str) -> None:
    start, target = round(start, 3), round(target, 3)

    async def main() -> float:
        async with on_bench() as bench:
            await bench.run(f"G0 C=DC({start})\nM30")
            before = bench.nck.core.axis("C").end_point
            await bench.run(f"G0 C={mode}({target})\nM30")
            return bench.nck.core.axis("C").end_point - before

    moved = run_virtual(main)
    away = (moved - (target - start)) % 360.0
    assert min(away, 360.0 - away) < 1e-6
    if mode == "ACP":
        assert -1e-6 <= moved < 360.0
    elif mode == "ACN":
        assert -360.0 < moved <= 1e-6
    else:
        assert abs(moved) <= 180.0 + 1e-6


async def test_zero_and_360_are_one_target() -> None:
    async with on_bench() as bench:
        for block in ("C=ACP(0)", "C=ACP(360)", "C=ACN(360)", "C=ACN(0)", "C=DC(360)"):
            begin = bench.clock.now()
            await bench.run(f"G1 F100 {block}\nM30")
            assert bench.nck.core.axis("C").end_point == 0.0
            assert bench.clock.now() - begin < 0.5


async def test_many_turns_leave_no_rounding_behind() -> None:
    async with on_bench() as bench:
        await bench.run("G0 C=IC(7.3)\nFOR R1=1 TO 300\nC=ACP(33.3)\nC=ACP(7.3)\nENDFOR\nM30", 4000.0)
        assert bench.nck.axis_state("C").set_position == pytest.approx(7.3, abs=1e-9)
        assert bench.nck.core.axis("C").end_point == pytest.approx(7.3 + 300 * 360.0, abs=1e-9)


async def test_feed_sets_the_time_and_exact_stop_waits_for_the_servo() -> None:
    async with on_bench() as bench:
        await bench.run(
            "$AC_TIMER[1]=0\nG1 X60 F600\nSTOPRE\nR1=$AC_TIMER[1]\nR2=$AA_STAT[X1]\n"
            "G91 G1 X6 Z8\nSTOPRE\nR3=$AC_TIMER[1]\nM30"
        )
        assert bench.r(1) == pytest.approx(6.0 + 0.03 * math.log(10.0 * 0.03 / 0.002), abs=0.03)
        assert bench.r(2) == 4.0
        assert bench.r(3) - bench.r(1) == pytest.approx(1.0 + 0.15, abs=0.05)
        assert bench.nck.axis_state("Z1").set_position == 8.0


async def test_instruments_see_lag_settling_and_direction() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X20 F1200\nG4 F1\nX10\nG4 F1\nM30")
        begin = bench.clock.now()
        await bench.until_idle()
        times = begin + np.array([0.5, 1.05, 1.2, 1.9, 2.35, 3.4])
        position, direction = bench.nck.encoder("X1", times)
        assert position[0] == pytest.approx(10.0 - 20.0 * 0.03, abs=0.02)
        assert 1e-5 < 20.0 - position[1] < 0.3
        assert position[3] == pytest.approx(20.0, abs=1e-6)
        assert position[5] == pytest.approx(10.0, abs=1e-6)
        assert direction.tolist() == [1.0, 1.0, 1.0, 1.0, -1.0, -1.0]


async def test_nc_stop_holds_in_mid_motion_and_start_goes_on() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X100 F600\nG4 F2\nR1=1\nM30")
        await bench.sleep(4.0)
        bench.nck.nc_stop()
        await bench.sleep(1.0)
        held = bench.nck.axis_state("X1").set_position
        assert (bench.nck.channel_status, bench.nck.program_status) == (2, 2)
        assert 35.0 < held < 45.0
        await bench.sleep(5.0)
        assert bench.nck.axis_state("X1").set_position == held
        assert bench.nck.axis_state("X1").aa_stat == 4
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.nck.axis_state("X1").set_position == 100.0
        assert bench.r(1) == 1.0


async def test_reset_stops_motion_where_it_is() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X100 F600\nM30")
        await bench.sleep(4.0)
        bench.nck.channel_reset()
        await bench.sleep(1.0)
        held = bench.nck.axis_state("X1").set_position
        assert 35.0 < held < 45.0
        await bench.run("G91 G0 X1\nM30")
        assert bench.nck.axis_state("X1").set_position == pytest.approx(held + 1.0)


async def test_states_of_a_moving_axis() -> None:
    async with on_bench() as bench:
        bench.press_start("G64 G1 X50 F3000\nM30")
        await bench.sleep(0.5)
        assert bench.nck.axis_state("X1").aa_stat == 1
        seen = set()
        for _ in range(300):
            await bench.sleep(0.004)
            seen.add(bench.nck.axis_state("X1").aa_stat)
        assert seen == {1, 2, 3, 4}
        assert bench.nck.axis_state("X1").aa_stat == 4


async def test_positions_for_every_laser_sample_are_quick() -> None:
    async with on_bench() as bench:
        bench.nck.set("$MA_BACKLASH[0,X1]", 0.004, 0)
        bench.nck.channel_reset()
        await bench.run("FOR R1=1 TO 20\nG1 X=R1 F3000\nG4 F1\nX=R1-0.5\nENDFOR\nM30")
        times = bench.clock.now() - np.linspace(60.0, 0.0, 100_000)
        best = min(_seconds_of(lambda: bench.nck.encoder("X1", times)) for _ in range(5))
        print(f"1e5 positions in {best * 1e3:.1f} ms")
        assert best < 0.5


def _seconds_of(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
