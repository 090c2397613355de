"""Every switch of the double changes what it says, and nothing is a switch without a test."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from simulators.cell.control import spec_of
from simulators.cellfile import load_cell
from simulators.nck import OPEN, NckRefusal, Switches
from tests.unit.nck.bench import Bench, eec_lines, enable, load_eec, on_bench
from tests.unit.nck.test_cec import encoder, load, move, table

READ = "/_N_MPF_DIR/_N_OUT_MPF"


def test_every_switch_is_named_in_a_test_and_in_its_description() -> None:
    files = [*Path(__file__).parent.glob("test_*.py"), Path(__file__).parents[2] / "contract" / "test_identity.py"]
    tests = "".join(path.read_text() for path in files)
    described = Switches.__doc__ or ""
    for entry in fields(Switches):
        assert f"{entry.name}=" in tests.replace(f'"{entry.name}"', f"{entry.name}="), entry.name
        assert f"``{entry.name}``" in described or entry.name in ("strict_activation",), entry.name
    assert all(getattr(Switches(), name) == choices[0] for name, choices in OPEN.items())


@pytest.mark.parametrize(
    "changes",
    [{"cec_sign": 2}, {"activation": "never"}, {"preprocess_ahead": -1}, {"writes_late_s": -1.0}, {"unit_system": "?"}],
)
async def test_a_value_that_means_nothing_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"is one of|negative|unit_system"):
        async with on_bench(**changes):
            pass


def test_a_cell_file_draws_open_switches_by_its_seed_and_refuses_unknown_ones() -> None:
    cell = load_cell("demo")

    def with_switches(**switches: object) -> object:
        return cell.model_copy(update={"machine": cell.machine.model_copy(update={"switches": switches})})

    drawn = {spec_of(with_switches(activation="seed"), seed).activation for seed in range(20)}  # type: ignore[arg-type]
    assert drawn == set(OPEN["activation"])
    again = spec_of(with_switches(activation="seed"), 3), spec_of(with_switches(activation="seed"), 3)  # type: ignore[arg-type]
    assert again[0] == again[1]
    listed = spec_of(with_switches(hmi_writes=[["R[1]", 2.0]]), 1)  # type: ignore[arg-type]
    assert listed.hmi_writes == (("R[1]", 2.0),)
    for bad in ({"nonsense": 1}, {"float32_tables": "seed"}, {"cec_direction_at_start": 5}):
        with pytest.raises(Exception, match="E-CELL-VALUE"):
            spec_of(with_switches(**bad), 1)  # type: ignore[arg-type]


# -- not settled publicly --------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1, -1])
async def test_cec_sign(sign: int) -> None:
    async with on_bench(cec_sign=sign) as bench:
        await load(bench, table(0, "Z1", "X1", [0.01] * 2, 0.0, 100.0), "X1")
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(-sign * 0.01, abs=1e-9)


@pytest.mark.parametrize(("count", "expected"), [(False, 0.03 * 0.5), (True, 0.03 * 0.5 + 0.03 + 0.5)])
async def test_cec_factor_tables_count(count: bool, expected: float) -> None:
    text = table(0, "Z1", "X1", [0.03] * 2, 0.0, 100.0, mult_by_table=2) + table(1, "Z1", "X1", [0.5] * 2, 0.0, 100.0)

    async with on_bench(cec_factor_tables_count=count) as bench:
        await load(bench, text, "X1")
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(expected)


@pytest.mark.parametrize(("first", "value"), [(1, 0.002), (-1, 0.007), (0, 0.0)])
async def test_cec_direction_at_start(first: int, value: float) -> None:
    text = table(0, "Z1", "X1", [0.002] * 2, 0.0, 100.0, direction=1)
    text += table(1, "Z1", "X1", [0.007] * 2, 0.0, 100.0, direction=-1)

    async with on_bench(cec_direction_at_start=first) as bench:
        await load(bench, text, "X1")
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(value), "nothing has moved since power on"
        standing = bench.nck.core.standing(0, np.array([0.0]), 1)
        assert standing[0] == pytest.approx(-value, abs=1e-9)
        await move(bench, "Z10")
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.002)


UNEVEN = "$AA_ENC_COMP_MAX[0,X1]=280\n"  # points at 0, 100 and 200: 2.8 intervals


@pytest.mark.parametrize(
    ("reading", "at_240", "at_280"),
    [("floor", 4, 4), ("stretched", 2 + 2 * 140 / 180, 4), ("ceil", 5.6, 7.2), ("idle", 0, 0)],
)
async def test_a_step_that_does_not_divide(reading: str, at_240: float, at_280: float) -> None:
    lines = eec_lines("X1", [0.0, 0.002, 0.004, 0.008], 0.0, 100.0) + UNEVEN

    async with on_bench(uneven_step=reading) as bench:
        await bench.run(enable("X1", 0) + lines + enable("X1", 1) + "M30")
        await bench.reset_and_reference()
        seen = []
        for place in (100.0, 240.0, 280.0):
            await move(bench, f"X{place}")
            seen.append(1000.0 * bench.nck.axis_state("X1").eec_value)
        assert seen == pytest.approx([0.0 if reading == "idle" else 2.0, at_240, at_280], abs=1e-6)


@pytest.mark.parametrize("reading", ["floor", "stretched", "ceil", "idle"])
async def test_a_cross_table_with_such_a_step(reading: str) -> None:
    text = table(0, "Z1", "X1", [0.0, 0.002, 0.004, 0.008], 0.0, 100.0).replace("MAX[0]=300", "MAX[0]=280")

    async with on_bench(uneven_step=reading) as bench:
        await load(bench, text, "X1")
        await move(bench, "Z250")
        expected = {"floor": 4.0, "stretched": 2.0 + 2.0 * 150.0 / 180.0, "ceil": 6.0, "idle": 0.0}[reading]
        assert 1000.0 * bench.nck.axis_state("X1").cec_value == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("kept", [True, False])
async def test_cec_direction_at_standstill(kept: bool) -> None:
    async with on_bench(cec_direction_at_standstill=kept) as bench:
        await load(bench, table(0, "Z1", "X1", [0.002] * 2, 0.0, 100.0, direction=1), "X1")
        bench.press_start("G1 Z100 F3000\nM30")
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.002)
        await bench.until_idle()
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.002 if kept else 0.0)


@pytest.mark.parametrize(
    ("changes", "acts"),
    [
        ({"activation": "newconf"}, "newconf"),
        ({"strict_activation": False}, "newconf"),
        ({"activation": "nck_reset"}, "reset"),
        ({"activation": "power_on"}, "power"),
    ],
)
async def test_activation(changes: dict[str, object], acts: str) -> None:
    async with on_bench(**changes) as bench:
        await bench.run(enable("X1", 0) + eec_lines("X1", [0.01] * 3, 0.0, 100.0) + enable("X1", 1) + "M30")
        values = [bench.nck.axis_state("X1").eec_value]
        await bench.reset_and_reference()
        values.append(bench.nck.axis_state("X1").eec_value)
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        await bench.warm_up()
        values.append(bench.nck.axis_state("X1").eec_value)
        first = ("newconf", "reset", "power").index(acts)
        assert values == [0.0] * first + [0.01] * (3 - first)


async def test_locked_alarm() -> None:
    async with on_bench(locked_alarm=17180) as bench:
        await load_eec(bench, "X1", [0.001] * 3, 0.0, 10.0)
        await bench.run("$AA_ENC_COMP[0,0,X1]=1\nM30")
        assert bench.numbers() == [17180]


@pytest.mark.parametrize("allowed", [True, False])
async def test_fetch_while_waiting(allowed: bool) -> None:
    async with on_bench(fetch_while_waiting=allowed) as bench:
        await bench.run('WRITE(R1,"OUT","LINE")\nM0\nM30')
        if allowed:
            assert bench.nck.files.read(READ) == b"LINE\n"
        else:
            with pytest.raises(NckRefusal, match="fetched"):
                bench.nck.files.read(READ)


@pytest.mark.parametrize("writable", [True, False])
async def test_r_writable(writable: bool) -> None:
    async with on_bench(r_writable=writable) as bench:
        if writable:
            bench.nck.set("R[5]", 2.0, 7)
        else:
            with pytest.raises(NckRefusal, match="R parameters"):
                bench.nck.set("R[5]", 2.0, 0)
        assert bench.r(5) == (2.0 if writable else 0.0)


@pytest.mark.parametrize("reacts", [True, False])
async def test_backlash_reacts_to_cec(reacts: bool) -> None:
    async with on_bench(backlash_reacts_to_cec=reacts) as bench:
        text = table(0, "Z1", "X1", [0.0, 0.010], 0.0, 100.0)
        await load(bench, text, "X1", extra="$MA_BACKLASH[0,X1]=0.008\n")
        await move(bench, "X50")
        await move(bench, "Z100")
        assert encoder(bench, "X1") == pytest.approx(49.99 + (-0.004 if reacts else 0.004), abs=1e-9)


@pytest.mark.parametrize(("stored", "maximum"), [(False, 1000.0), (True, 590.0)])
async def test_shortened_max_is_stored(stored: bool, maximum: float) -> None:
    async with on_bench(shortened_max_is_stored=stored) as bench:
        await bench.run("$AA_ENC_COMP_STEP[0,Z1]=10 $AA_ENC_COMP_MAX[0,Z1]=1000\nM30")
        assert bench.nck.get("$AA_ENC_COMP_MAX[0,Z1]") == 1000.0
        await bench.reset_and_reference()
        assert bench.nck.get("$AA_ENC_COMP_MAX[0,Z1]") == maximum


@pytest.mark.parametrize("cleared", [True, False])
async def test_enable_cleared_at_boot(cleared: bool) -> None:
    async with on_bench(enable_cleared_at_boot=cleared) as bench:
        await load_eec(bench, "X1", [0.008] * 2, 0.0, 10.0)
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is not cleared
        assert bench.nck.axis_state("X1").eec_value == (0.0 if cleared else 0.008)


@pytest.mark.parametrize(("shared", "ahead", "behind"), [(True, 0.002, -0.002), (False, 0.0, -0.004)])
async def test_encoder_lead_shared(shared: bool, ahead: float, behind: float) -> None:
    async with on_bench(encoder_lead_shared=shared) as bench:
        await bench.run("$MA_BACKLASH[0,X1]=0.004\nNEWCONF\nG0 X10\nG4 F1\nM30")
        assert encoder(bench, "X1") == pytest.approx(10.0 + ahead, abs=1e-9)
        await move(bench, "X5")
        assert encoder(bench, "X1") == pytest.approx(5.0 + behind, abs=1e-9)
        assert bench.nck.core.standing(0, np.array([5.0]), -1)[0] == pytest.approx(5.0 + behind, abs=1e-9)


@pytest.mark.parametrize("activation", ["newconf", "nck_reset"])
async def test_backlash_sign_and_activation(activation: str) -> None:
    async with on_bench(backlash_sign=-1, backlash_activation=activation) as bench:
        await bench.run("$MA_BACKLASH[0,X1]=0.004\nNEWCONF\nG0 X10\nG4 F1\nM30")
        lead = -0.002 if activation == "newconf" else 0.0
        assert encoder(bench, "X1") == pytest.approx(10.0 + lead, abs=1e-9)


# preprocess_ahead= and system_reads_stop= have their tests in test_preprocess.py.


# -- what a control does that nobody asked of it ---------------------------------------------------------

ENABLE = "$MA_ENC_COMP_ENABLE[0,X1]"
POINTS = tuple(f"$AA_ENC_COMP[0,{place},X1]" for place in range(4))


async def switched_off(bench: Bench) -> None:
    """A small table of X1, loaded and off; no program has run since."""
    for name, value in zip(POINTS, (0.0, 0.001, 0.002, 0.003), strict=True):
        bench.nck.set(name, value, 0)
    for part, value in (("STEP", 10.0), ("MIN", 0.0), ("MAX", 30.0)):
        bench.nck.set(f"$AA_ENC_COMP_{part}[0,X1]", value, 0)


def points(bench: Bench) -> list[float]:
    return [float(bench.nck.get(name)) for name in POINTS]


async def test_swaps_points_at_reset() -> None:
    async with on_bench(swaps_points_at_reset=1) as bench:
        await switched_off(bench)
        before = points(bench)
        bench.nck.nck_reset()
        await bench.sleep(30.0)
        assert points(bench) == [before[0], before[2], before[1], before[3]]
        assert bench.nck.core.injected_faults == ["swap"]


async def test_enables_again_s() -> None:
    async with on_bench(enables_again_s=5.0) as bench:
        await switched_off(bench)
        for value in (1, 0):
            bench.nck.set(ENABLE, value, 0)
        assert not bench.nck.get(ENABLE)
        await bench.sleep(6.0)
        assert bench.nck.get(ENABLE)


async def test_enables_at_block() -> None:
    async with on_bench(enables_at_block=2) as bench:
        await switched_off(bench)
        await bench.run("G4 F1\nG4 F1\nM30")
        assert bench.nck.get(ENABLE)
        assert "enable" in bench.nck.core.injected_faults


@pytest.mark.parametrize("what", ["words", "memory", "switch"])
async def test_forgets_at_block(what: str) -> None:
    async with on_bench(forgets_at_block=1, forgets=what) as bench:
        await switched_off(bench)
        bench.nck.set("R[7]", 7.0, 0)
        bench.nck.set(ENABLE, 1, 0)
        kept = {"words": bench.nck.get("R[7]"), "memory": points(bench)[1], "switch": bench.nck.get(ENABLE)}
        bench.nck.forget(what)  # type: ignore[arg-type]
        now = {"words": bench.nck.get("R[7]"), "memory": points(bench)[1], "switch": bench.nck.get(ENABLE)}
        assert [name for name in kept if kept[name] != now[name]] == [what]
        bench.nck.set("R[7]", 7.0, 0)
        bench.nck.set(ENABLE, 1, 0)
        await bench.run("G4 F1\nM30")
        assert bench.nck.core.injected_faults.count(f"forget {what}") == 2
