"""EEC as the manual states it: sign, clamp, modulo, left-overs, activation, reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.nck.machine.compensation import TableShape, curve_of
from tests.unit.nck.bench import Bench, eec_lines, enable, load_eec, on_bench

TRIANGLE = [0.0, 0.003, 0.010, 0.004, 0.0]


def encoder_now(bench: Bench, axis: str) -> float:
    return float(bench.nck.encoder(axis, np.array([bench.clock.now()]))[0][0])


async def move(bench: Bench, block: str) -> None:
    await bench.run(f"G0 {block}\nG4 F1\nM30")


# -- the curve itself ----------------------------------------------------------------------------------


def test_manual_example_has_801_points() -> None:
    points = [0.0] * 900
    points[:3] = [0.003, 0.01, 0.012]
    points[850] = 9.0
    curve = curve_of(points, TableShape(-200.0, 600.0, 1.0))
    assert curve is not None
    assert len(curve.nodes) == 801
    assert curve.one(-200.0) == 0.003
    assert curve.one(-199.5) == pytest.approx(0.0065)
    assert curve.one(650.0) == 0.0


def test_max_is_shortened_when_memory_ends_first() -> None:
    curve = curve_of([0.0, 1.0, 2.0], TableShape(0.0, 100.0, 10.0))
    assert curve is not None
    assert curve.nodes.tolist() == [0.0, 10.0, 20.0]
    assert curve.one(90.0) == 2.0


@pytest.mark.parametrize("shape", [(0.0, 0.0, 0.0), (0.0, 10.0, 0.0), (10.0, 0.0, 1.0), (0.0, 1e300, 1e-300)])
def test_parameters_that_are_no_table(shape: tuple[float, float, float]) -> None:
    minimum, maximum, step = shape
    assert curve_of([1.0, 2.0], TableShape(minimum, maximum, step)) is None


values = st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=30)


@given(values, st.floats(-500, 500), st.floats(0.1, 50.0), st.floats(-3000, 3000))
def test_curve_stays_between_its_neighbours_and_holds_its_ends(
    points: list[float], minimum: float, step: float, position: float
) -> None:
    curve = curve_of(points, TableShape(minimum, minimum + step * (len(points) - 1), step))
    assert curve is not None
    value = curve.one(position)
    assert min(points) - 1e-12 <= value <= max(points) + 1e-12
    if position <= curve.nodes[0]:
        assert value == points[0]
    if position >= curve.nodes[-1]:
        assert value == points[len(curve.nodes) - 1]
    np.testing.assert_allclose(curve.at(curve.nodes), points[: len(curve.nodes)], atol=1e-9)


@given(values, st.floats(-2000, 2000), st.integers(-5, 5))
def test_modulo_curve_repeats_every_turn(points: list[float], position: float, turns: int) -> None:
    closed = [*points, points[0]]
    curve = curve_of(closed, TableShape(0.0, 360.0, 360.0 / (len(closed) - 1), is_modulo=True))
    assert curve is not None
    assert curve.one(position) == pytest.approx(curve.one(position + 360.0 * turns), abs=1e-9)


# -- on the machine ------------------------------------------------------------------------------------


async def test_a_positive_value_moves_the_axis_negative() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", TRIANGLE, 0.0, 100.0)
        for position, value in ((0.0, 0.0), (200.0, 0.010), (150.0, 0.0065), (350.0, 0.002)):
            await move(bench, f"X{position}")
            view = bench.nck.axis_state("X1")
            assert view.eec_value == pytest.approx(value, abs=1e-9)
            assert view.encoder_position == pytest.approx(position - value, abs=1e-9)
            assert view.actual_position == pytest.approx(position, abs=1e-9)
            assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == pytest.approx(value, abs=1e-9)
            assert encoder_now(bench, "X") == pytest.approx(position - value, abs=1e-9)


async def test_end_values_hold_outside() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.004, 0.0, -0.006], -50.0, 50.0)
        await move(bench, "X-200")
        assert encoder_now(bench, "X1") == pytest.approx(-200.004, abs=1e-9)
        await move(bench, "X400")
        assert encoder_now(bench, "X1") == pytest.approx(400.006, abs=1e-9)


async def test_modulo_table_acts_alike_in_every_turn() -> None:
    table = [0.0, 0.002, 0.0, -0.001, 0.0]

    async with on_bench() as bench:
        await load_eec(bench, "C1", table, 0.0, 90.0, modulo=1)
        for _ in range(3):
            await move(bench, "C=ACP(90)")
            view = bench.nck.axis_state("C1")
            assert view.encoder_position == pytest.approx(89.998, abs=1e-9)
            await move(bench, "C=ACP(315)")
            assert bench.nck.axis_state("C1").eec_value == pytest.approx(-0.0005, abs=1e-9)
        assert encoder_now(bench, "C") == pytest.approx(2 * 360.0 + 315.0005, abs=1e-9)


async def test_points_not_written_again_stay_live() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.01, 0.01, 0.01, 0.01, 0.01], 0.0, 10.0)
        await bench.run(enable("X1", 0) + "$AA_ENC_COMP[0,1,X1]=0\n" + enable("X1", 1) + "M30")
        await bench.reset_and_reference()
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(3)] == [0.01, 0.0, 0.01]
        await move(bench, "X10")
        assert bench.nck.axis_state("X1").eec_value == 0.0
        await move(bench, "X25")
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.01)


async def test_changed_content_waits_for_the_nck_reset() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.0, 0.005, 0.0], 0.0, 100.0)
        await move(bench, "X100")
        await bench.run(enable("X1", 0) + eec_lines("X1", [0.0, 0.009, 0.0], 0.0, 100.0) + enable("X1", 1) + "M30")
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.009
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.005)
        bench.nck.channel_reset()
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.005)
        await bench.reset_and_reference()
        await move(bench, "X100")
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.009)


async def test_lenient_activation_takes_content_at_newconf() -> None:
    async with on_bench(strict_activation=False) as bench:
        await bench.run(
            enable("X1", 0) + eec_lines("X1", [0.0, 0.009, 0.0], 0.0, 100.0) + enable("X1", 1) + "G0 X100\nM30"
        )
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.009)
        assert encoder_now(bench, "X1") == pytest.approx(99.991, abs=1e-9)


async def test_enable_acts_at_newconf_and_the_axis_moves_at_once() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", TRIANGLE, 0.0, 100.0)
        await bench.run(
            "G0 X200\nG4 F1\n$MA_ENC_COMP_ENABLE[0,X1]=0\nSTOPRE\nR1=$VA_ENC1_COMP_VAL[X1]\nM0\nNEWCONF\nM0\nM30"
        )
        assert bench.r(1) == pytest.approx(0.010)
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert encoder_now(bench, "X1") == pytest.approx(199.99, abs=1e-9)
        bench.nck.nc_start()
        begin = bench.clock.now()
        await bench.sleep(0.02)
        assert bench.nck.axis_state("X1").aa_stat == 1
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").aa_stat == 4
        assert encoder_now(bench, "X1") == pytest.approx(200.0, abs=1e-9)
        rising = bench.nck.encoder("X1", begin + np.linspace(0.01, 0.2, 20))[0]
        assert np.all(np.diff(rising) > 0.0)
        assert 199.99 < rising[3] < 200.0


async def test_switching_fast_to_and_fro_never_overshoots() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.0, 0.01, 0.0], 0.0, 100.0)
        toggles = "".join(f"$MA_ENC_COMP_ENABLE[0,X1]={n % 2}\nNEWCONF\nG4 F0.01\n" for n in range(9))
        begin = bench.clock.now()
        await bench.run("G0 X100\nG4 F1\n" + toggles + "G4 F1\nM30")
        position = bench.nck.encoder("X1", np.linspace(begin + 2.0, bench.clock.now(), 400))[0]
        assert position.min() > 99.99 - 1e-9
        assert position.max() < 100.0 + 1e-9
        assert np.abs(np.diff(position)).max() < 0.003


async def test_nothing_acts_until_referenced_and_lost_reference_takes_it_away() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.008, 0.008], -500.0, 1500.0)
        await bench.sleep(1.0)
        assert encoder_now(bench, "X1") == pytest.approx(-0.008, abs=1e-9)
        bench.nck.lose_reference("X1")
        await bench.sleep(1.0)
        assert encoder_now(bench, "X1") == pytest.approx(0.0, abs=1e-9)
        assert not bench.nck.axis_state("X1").referenced
        bench.nck.reference_axis("X1")
        await bench.sleep(2.0)
        assert encoder_now(bench, "X1") == pytest.approx(-0.008, abs=1e-9)
        bench.nck.nck_reset()
        await bench.sleep(1.0)
        assert encoder_now(bench, "X1") == pytest.approx(0.0, abs=1e-9)


async def test_hostile_manners() -> None:
    async def liar(bench: Bench) -> None:
        await load_eec(bench, "X1", [0.008, 0.008], -500.0, 1500.0)
        await bench.run(enable("X1", 0) + "M30")
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.008)

    async def cleared(bench: Bench) -> None:
        await load_eec(bench, "X1", [0.008, 0.008], -500.0, 1500.0)
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert bench.nck.axis_state("X1").eec_value == 0.0

    async def single(bench: Bench) -> None:
        await bench.run("$AA_ENC_COMP[0,0,X1]=0.0071\nM30")
        assert bench.nck.get("$AA_ENC_COMP[0,0,X1]") == float(np.float32(0.0071))

    async with on_bench(lies_about_disable=True) as on:
        await liar(on)
    async with on_bench(enable_cleared_at_boot=True) as on:
        await cleared(on)
    async with on_bench(float32_tables=True) as on:
        await single(on)
