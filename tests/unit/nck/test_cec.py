"""CEC, backlash and temperature: sums, weight, direction, products, limits, and signs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from simulators.nck.machine.compensation import follow
from tests.unit.nck.bench import Bench, on_bench


def table(number: int, source: str, output: str, values: list[float], minimum: float, step: float, **more: int) -> str:
    """Lines of one CEC table, switched on by its setting datum."""
    front = f"$AN_CEC_INPUT_AXIS[{number}]=({source}) $AN_CEC_OUTPUT_AXIS[{number}]=({output})\n"
    top = minimum + step * (len(values) - 1)
    front += f"$AN_CEC_STEP[{number}]={step} $AN_CEC_MIN[{number}]={minimum} $AN_CEC_MAX[{number}]={top}\n"
    for name, value in more.items():
        front += f"$AN_CEC_{name.upper()}[{number}]={value}\n"
    front += "".join(f"$AN_CEC[{number},{place}]={value}\n" for place, value in enumerate(values))
    return front + f"$SN_CEC_TABLE_ENABLE[{number}]=1\n"


async def load(bench: Bench, text: str, *outputs: str, extra: str = "") -> None:
    enables = "".join(f"$MA_CEC_ENABLE[{axis}]=1\n" for axis in outputs)
    await bench.run(text + enables + extra + "NEWCONF\nM30")
    assert bench.numbers() == []
    await bench.reset_and_reference()


async def move(bench: Bench, block: str) -> None:
    await bench.run(f"G0 {block}\nG4 F1\nM30")


def encoder(bench: Bench, axis: str) -> float:
    return float(bench.nck.encoder(axis, np.array([bench.clock.now()]))[0][0])


@pytest.mark.parametrize("sign", [1, -1])
async def test_sum_of_tables_on_the_base_setpoint(sign: int) -> None:
    text = table(0, "Z1", "X1", [0.0, 0.010, 0.0], 0.0, 100.0) + table(1, "X1", "X1", [0.0, 0.004], 0.0, 100.0)

    async with on_bench(cec_sign=sign) as bench:
        await load(bench, text, "X1", extra="$SN_CEC_TABLE_WEIGHT[1]=0.5\n")
        await move(bench, "Z100 X50")
        view = bench.nck.axis_state("X1")
        assert view.cec_value == pytest.approx(0.011, abs=1e-9)
        assert bench.nck.get("$VA_CEC_COMP_VAL[X1]") == pytest.approx(0.011, abs=1e-9)
        assert encoder(bench, "X1") == pytest.approx(50.0 - sign * 0.011, abs=1e-9)
        assert view.set_position == 50.0
        assert view.actual_position == pytest.approx(50.0, abs=1e-9)
        assert encoder(bench, "Z1") == pytest.approx(100.0, abs=1e-9)
        await bench.run("$SN_CEC_TABLE_WEIGHT[0]=2 G4 F1\nM30")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.021, abs=1e-9)
        await bench.run("$SN_CEC_TABLE_ENABLE[0]=0\nG4 F1\nM30")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.001, abs=1e-9)


async def test_value_follows_the_base_axis_on_its_way() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.0, 0.010, 0.0, 0.006, 0.0], 0.0, 50.0), "X1")
        bench.press_start("G1 Z200 F3000\nM30")
        begin = bench.clock.now()
        await bench.until_idle()
        times = begin + np.linspace(0.2, 3.9, 60)
        base = bench.nck.encoder("Z1", times)[0]
        expected = np.interp(base, [0, 50, 100, 150, 200], [0, 0.010, 0, 0.006, 0])
        np.testing.assert_allclose(bench.nck.encoder("X1", times)[0], -expected, atol=1e-3)
        assert abs(expected).max() > 0.009


async def test_direction_tables_by_the_travel_of_the_base() -> None:
    text = table(0, "X1", "X1", [0.002, 0.002], 0.0, 100.0, direction=1)
    text += table(1, "X1", "X1", [-0.003, -0.003], 0.0, 100.0, direction=-1)

    async with on_bench() as bench:
        await load(bench, text, "X1")
        await move(bench, "X50")
        assert encoder(bench, "X1") == pytest.approx(49.998, abs=1e-9)
        await move(bench, "X40")
        assert encoder(bench, "X1") == pytest.approx(40.003, abs=1e-9)
        await move(bench, "X50")
        assert encoder(bench, "X1") == pytest.approx(49.998, abs=1e-9)


@pytest.mark.parametrize(("count", "expected"), [(False, 0.02 * 0.5), (True, 0.02 * 0.5 + 0.02 + 0.5)])
async def test_product_of_two_tables(count: bool, expected: float) -> None:
    text = table(0, "Z1", "X1", [0.0, 0.04], 0.0, 200.0, mult_by_table=2)
    text += table(1, "X1", "X1", [0.0, 1.0], 0.0, 100.0)

    async with on_bench(cec_factor_tables_count=count) as bench:
        await load(bench, text, "X1")
        await move(bench, "Z100 X50")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(expected, abs=1e-9)
        assert encoder(bench, "X1") == pytest.approx(50.0 - expected, abs=1e-9)


async def test_modulo_base_axis() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "C1", "X1", [0.0, 0.01, 0.0, 0.0, 0.0], 0.0, 90.0, is_modulo=1), "X1")
        for _ in range(2):
            await move(bench, "C=ACP(45)")
            await move(bench, "C=ACP(90)")
            assert encoder(bench, "X1") == pytest.approx(-0.01, abs=1e-9)
            await move(bench, "C=ACP(300)")
            assert encoder(bench, "X1") == pytest.approx(0.0, abs=1e-9)


async def test_sum_above_the_limit_is_clipped_with_an_alarm_and_goes_on() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.0, 0.5], 0.0, 100.0), "X1", extra="$MA_CEC_MAX_SUM[X1]=0.1\n")
        await bench.run("G0 Z100\nG4 F1\nR1=7\nM30")
        assert bench.r(1) == 7.0
        assert 20124 in bench.numbers()
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.1)


async def test_too_fast_a_change_is_held_back_and_made_up() -> None:
    async with on_bench() as bench:
        text = table(0, "Z1", "X1", [0.0, 0.9, 0.9], 0.0, 10.0)
        await load(bench, text, "X1", extra="$MA_CEC_MAX_VELO[X1]=0.1\n")
        await bench.run("R1=1\nG0 Z20\nM30")
        assert 20125 in bench.numbers()
        assert bench.nck.axis_state("X1").cec_value < 0.5
        await bench.sleep(10.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.9)
        assert encoder(bench, "X1") == pytest.approx(-0.9, abs=1e-6)


def test_follow_never_exceeds_its_rate_and_arrives() -> None:
    times, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 5.0, -1.0, 0.5])
    pieces, held_back = follow(times, values, 0.0, 2.0, 0.01)
    assert held_back
    assert all(abs(slope) <= 2.0 for _, _, slope in pieces)
    _, value, slope = pieces[-1]
    assert value == pytest.approx(0.5)
    assert slope == 0.0
    for (t0, v0, s0), (t1, v1, _) in itertools.pairwise(pieces):
        assert v1 == pytest.approx(v0 + s0 * (t1 - t0))


async def test_missing_option_resets_the_datum() -> None:
    async with on_bench(option_cec=False) as bench:
        await bench.run("$MA_CEC_ENABLE[X1]=1\nR1=$MA_CEC_ENABLE[X1]\nR2=5\nM30")
        assert 8040 in bench.numbers()
        assert (bench.r(1), bench.r(2)) == (0.0, 5.0)


async def test_cylinder_error_adds_setting_data_to_the_first_points() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.001, 0.002], 0.0, 100.0, type=1), "X1")
        await bench.run("$SN_CEC_0[0]=0.010 $SN_CEC_1[0]=0.030\nG0 Z100\nG4 F1\nM30")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.032)


async def test_nothing_acts_while_the_base_axis_is_not_referenced() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.005, 0.005], 0.0, 100.0), "X1")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.005)
        bench.nck.lose_reference("Z1")
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == 0.0


async def test_backlash_leads_the_encoder_in_each_direction() -> None:
    async with on_bench() as bench:
        await bench.run("$MA_BACKLASH[0,X1]=0.008 $MA_BACKLASH_FACTOR[0,X1]=0.5\nNEWCONF\nM30")
        await move(bench, "X50")
        forth = encoder(bench, "X1")
        await move(bench, "X60")
        await move(bench, "X50")
        back = encoder(bench, "X1")
        assert forth - back == pytest.approx(0.004, abs=1e-9)
        assert forth + back == pytest.approx(100.0, abs=1e-9)
        assert bench.nck.axis_state("X1").backlash_value == pytest.approx(-0.002)


@pytest.mark.parametrize(("mode", "taken_up"), [(0, True), (2, False)])
async def test_compensation_takes_up_backlash_unless_told_not_to(mode: int, taken_up: bool) -> None:
    async with on_bench() as bench:
        extra = f"$MA_BACKLASH[0,X1]=0.008\n$MA_BACKLASH_MODE[0,X1]={mode}\n"
        await load(bench, table(0, "Z1", "X1", [0.0, 0.01], 0.0, 100.0), "X1", extra=extra)
        await move(bench, "X10")
        await move(bench, "Z100")
        expected = 10.0 - 0.01 + (-0.004 if taken_up else 0.004)
        assert encoder(bench, "X1") == pytest.approx(expected, abs=1e-9)


async def test_temperature_moves_the_axis_negative_and_no_faster_than_allowed() -> None:
    async with on_bench() as bench:
        await bench.run(
            "$MA_TEMP_COMP_TYPE[X1]=3\nNEWCONF\n$SA_TEMP_COMP_SLOPE[X1]=0.0001\n"
            "$SA_TEMP_COMP_REF_POSITION[X1]=100\nG0 X300\nG4 F1\nM30"
        )
        assert encoder(bench, "X1") == pytest.approx(300.0 - 0.02, abs=1e-9)
        assert bench.nck.get("$VA_TEMP_COMP_VAL[X1]") == pytest.approx(0.02, abs=1e-9)
        await bench.run("$SA_TEMP_COMP_ABS_VALUE[X1]=2\nM30")
        await bench.sleep(0.5)
        moved = 299.98 - encoder(bench, "X1")
        assert 0.3 < moved < 100.0 / 60.0 * 0.7
        await bench.sleep(3.0)
        assert encoder(bench, "X1") == pytest.approx(297.98, abs=1e-6)
        assert bench.numbers() == []
