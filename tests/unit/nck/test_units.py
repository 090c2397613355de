"""Inch and metric: programs, data, tables and what a change of the basic system makes of them."""

from __future__ import annotations

import pytest

from tests.unit.nck.bench import Bench, eec_lines, load_eec, on_bench
from tests.unit.nck.test_cec import encoder, load, move, table


async def test_programs_speak_the_basic_system_unless_told_otherwise() -> None:
    async def metric(bench: Bench) -> None:
        await bench.run("G70 G0 X1\nG91 X1\nG71 X1\nG90 G700 G1 Z1 F60\nC90\nM30")
        assert bench.nck.axis_state("X1").set_position == pytest.approx(51.8)
        assert bench.nck.axis_state("Z1").set_position == pytest.approx(25.4)
        assert bench.nck.axis_state("C1").set_position == pytest.approx(90.0)

    async def inch(bench: Bench) -> None:
        begin = bench.clock.now()
        await bench.run("G1 X2 F60\nM30")
        assert 2.0 < bench.clock.now() - begin < 2.5, "60 inches a minute"
        await bench.run("G71 G0 X25.4\nR1=$P_EP[X1]\nC=IC(10)\nM30")
        assert (bench.r(1), encoder(bench, "X1")) == (pytest.approx(1.0), pytest.approx(25.4, abs=0.01))
        assert bench.nck.axis_state("C1").set_position == pytest.approx(10.0)

    async with on_bench() as on:
        await metric(on)
    async with on_bench(unit_system="inch") as on:
        await inch(on)


async def test_machine_data_of_linear_axes_are_inches_then() -> None:
    async with on_bench(unit_system="inch") as bench:
        assert bench.nck.get("$MA_POS_LIMIT_PLUS[X1]") == pytest.approx(700.0 / 25.4)
        assert bench.nck.get("$MA_MAX_AX_VELO[C1]") == 7200.0
        bench.load("G0 X28\nM30")
        await bench.run("G0 X28\nM30")
        assert bench.numbers() == [10720]
        bench.nck.channel_reset()
        await bench.run("$MA_BACKLASH[0,X1]=0.001\nNEWCONF\nG0 X1\nG4 F1\nM30")
        assert encoder(bench, "X1") == pytest.approx(25.4 + 0.0127, abs=1e-6)
        assert bench.nck.axis_state("X1").backlash_value == pytest.approx(0.0005)


@pytest.mark.parametrize(("metric", "value"), [(1, 0.010), (0, 0.254)])
async def test_cec_has_its_own_datum_for_units(metric: int, value: float) -> None:
    async with on_bench() as bench:
        bench.nck.set("$MA_CEC_SCALING_SYSTEM_METRIC[X1]", metric, 2)
        await load(bench, table(0, "Z1", "X1", [0.0, 0.010], 0.0, 1.0), "X1")
        await move(bench, "Z25.4")
        assert encoder(bench, "X1") == pytest.approx(-value, abs=1e-9)


@pytest.mark.parametrize(("convert", "position"), [(1, 100.0), (0, 2540.0)])
async def test_a_change_of_the_basic_system_converts_only_when_asked_to(convert: int, position: float) -> None:
    async with on_bench() as bench:
        await load_eec(bench, "Z1", [0.0, 0.0254, 0.0], 0.0, 100.0)
        await bench.run(eec_lines("C1", [0.0, 0.01, 0.0], 0.0, 180.0, modulo=1) + "M30")
        bench.nck.set("$MN_CONVERT_SCALING_SYSTEM", convert, 2)
        bench.nck.set("$MN_SCALING_SYSTEM_IS_METRIC", 0, 2)
        assert bench.numbers() == [4070]
        await bench.reset_and_reference()
        assert bench.numbers() == []
        assert bench.nck.spec.unit_system == "inch"
        step = bench.nck.get("$AA_ENC_COMP_STEP[0,Z1]")
        assert step == pytest.approx(100.0 / 25.4 if convert else 100.0)
        assert bench.nck.get("$AA_ENC_COMP[0,1,Z1]") == pytest.approx(0.001 if convert else 0.0254)
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,C1]") == 180.0
        curve = bench.nck.core.axis("Z1").curve
        assert curve is not None
        assert curve.nodes[1] == pytest.approx(position), "without it every number means 25.4 times as much"
        bench.nck.set("$MN_SCALING_SYSTEM_IS_METRIC", 1, 2)
        await bench.reset_and_reference()
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,Z1]") == pytest.approx(100.0)
