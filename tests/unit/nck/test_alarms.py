"""Each alarm the double knows: when it comes, what it does, what clears it."""

from __future__ import annotations

import pytest

from simulators.nck import AxisSpec, NckRefusal
from tests.unit.nck.bench import SPEC, eec_lines, enable, load_eec, on_bench
from tests.unit.nck.test_cec import encoder, load, move, table


async def test_4070_scaling_data_changed() -> None:
    async with on_bench() as bench:
        bench.nck.set("$MN_SCALING_SYSTEM_IS_METRIC", 0, 2)
        assert bench.numbers() == [4070]
        assert bench.nck.spec.unit_system == "metric", "acts after the next boot only"
        bench.nck.set("$MN_SCALING_SYSTEM_IS_METRIC", 1, 2)
        assert bench.numbers() == []


async def test_4075_once_and_the_value_stays() -> None:
    async with on_bench() as bench:
        bench.nck.set_access_level(5)
        await bench.run("$MA_BACKLASH[0,X1]=1\n$MA_BACKLASH[0,Z1]=1\nR1=1\nM30")
        assert (bench.numbers(), bench.r(1), bench.nck.get("$MA_BACKLASH[0,Z1]")) == ([4075], 1.0, 0.0)


async def test_4076_locks_nc_start_until_power_on() -> None:
    async with on_bench() as bench:
        bench.nck.set_access_level(5)
        await bench.run("$MA_BACKLASH[0,X1]=1\nM30")
        bench.nck.acknowledge_alarms()
        bench.nck.acknowledge_alarms()
        bench.nck.channel_reset()
        assert bench.numbers() == [4076]
        assert not bench.nck.nc_start()
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        assert bench.numbers() == []


@pytest.mark.parametrize(
    "name", ["$MA_MM_ENC_COMP_MAX_POINTS[1,X1]", "$MN_MM_CEC_MAX_POINTS[2]", "$MA_MM_QEC_MAX_POINTS[0,Z1]"]
)
async def test_4400_at_once_and_gone_when_set_back(name: str) -> None:
    async with on_bench() as bench:
        before = bench.nck.get(name)
        bench.nck.set(name, 5, 2)
        assert bench.numbers() == [4400]
        bench.nck.acknowledge_alarms()
        assert bench.numbers() == [4400]
        bench.nck.set(name, before, 2)
        assert bench.numbers() == []


async def test_6020_after_the_boot_that_lost_the_data() -> None:
    async with on_bench() as bench:
        bench.nck.set("$MN_MM_CEC_MAX_POINTS[2]", 5, 2)
        await bench.reset_and_reference()
        assert bench.numbers() == [6020]
        bench.nck.nck_reset()
        await bench.sleep(6.0)
        assert bench.numbers() == []


async def test_6000_when_it_does_not_fit() -> None:
    async with on_bench(table_memory_bytes=20_000) as bench:
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 5000, 2)
        await bench.reset_and_reference()
        assert set(bench.numbers()) == {6000, 6020}
        assert bench.nck.get("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]") == 900


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("$AA_ENC_COMP[0,900,X1]=1", 17030),
        ("$AN_CEC[3,20]=1", 17030),
        ("$AA_ENC_COMP[2,0,X1]=1", 17020),
        ("$AN_CEC[4,0]=1", 17020),
        ("GUDLIST[3]=1", 17020),
        ("$VA_CEC_COMP_VAL[X1]=1", 17070),
        ("$AA_ENC_KOMP[0,0,X1]=1", 12550),
        ("$AA_ENC_COMP[0,0,Q1]=1", 12550),
        ('EXTOPEN(R1,"LOCAL_DRIVE/OUT")', 12550),
    ],
)
async def test_17030_17020_17070_12550_stop_the_program(line: str, number: int) -> None:
    async with on_bench(gud=(("GUDLIST", 3),)) as bench:
        await bench.run(f"R1=1\n{line}\nR1=2\nM30")
        assert (bench.numbers(), bench.nck.channel_status, bench.r(1)) == ([number], 2, 1.0)
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        assert bench.numbers() == []


async def test_17070_while_the_table_is_enabled() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "Z1", [0.001] * 3, 0.0, 10.0)
        await bench.run("$AA_ENC_COMP[0,0,Z1]=1\nM30")
        assert bench.numbers() == [17070]
        assert bench.nck.get("$AA_ENC_COMP[0,0,Z1]") == 0.001


async def test_8040_without_the_option() -> None:
    async with on_bench(option_cec=False) as bench:
        await bench.run("$MA_CEC_ENABLE[X1]=1\nR1=1\nM30")
        assert (bench.numbers(), bench.nck.get("$MA_CEC_ENABLE[X1]"), bench.r(1)) == ([8040], False, 1.0)
        with pytest.raises(NckRefusal, match="8040"):
            bench.nck.set("$MA_CEC_ENABLE[X1]", 1, 0)


async def test_8041_when_the_option_does_not_go_that_far() -> None:
    async with on_bench(option_cec_axes=1) as bench:
        await bench.run("$MA_CEC_ENABLE[X1]=1\n$MA_CEC_ENABLE[Z1]=1\nM30")
        assert bench.numbers() == [8041]
        assert (bench.nck.get("$MA_CEC_ENABLE[X1]"), bench.nck.get("$MA_CEC_ENABLE[Z1]")) == (True, False)


async def test_20124_clips_and_the_program_goes_on() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.0, 0.5], 0.0, 100.0), "X1", extra="$MA_CEC_MAX_SUM[X1]=0.1\n")
        await move(bench, "Z100")
        assert bench.numbers() == [20124]
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.1)
        assert bench.nck.channel_status == 0


async def test_20125_limits_the_rate_and_makes_it_up() -> None:
    async with on_bench() as bench:
        text = table(0, "Z1", "X1", [0.0, 0.9], 0.0, 10.0)
        await load(bench, text, "X1", extra="$MA_CEC_MAX_VELO[X1]=1\n")
        await bench.run("G1 Z10 F6000\nM30")
        assert bench.numbers() == [20125]
        assert bench.nck.axis_state("X1").cec_value < 0.7
        await bench.sleep(1.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.9)


@pytest.mark.parametrize(("offset", "refused"), [(0.05, False), (0.15, True)])
async def test_25100_when_the_encoders_are_too_far_apart(offset: float, refused: bool) -> None:
    axes = (AxisSpec("X1", "X", eec_points=(10, 10), encoder2_offset=offset), *SPEC.axes[1:])

    async with on_bench(axes=axes) as bench:
        bench.nck.core.axis("X1").encoders_referenced[1] = True
        assert bench.nck.select_encoder("X1", 1) is not refused
        assert bench.numbers() == ([25100] if refused else [])
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(0.0 if refused else -offset, abs=1e-9)
        assert bench.nck.get("$VA_ENC2_COMP_VAL[X1]") == 0.0
        assert not bench.nck.select_encoder("X1", 2)


async def test_25100_counts_the_tables_of_both_encoders() -> None:
    async with on_bench() as bench:
        second = eec_lines("X1", [0.15] * 3, 0.0, 100.0).replace("[0,", "[1,")
        await bench.run(second + "$MA_ENC_COMP_ENABLE[1,X1]=1\nNEWCONF\nM30")
        await bench.reset_and_reference()
        bench.nck.core.axis("X1").encoders_referenced[1] = True
        assert not bench.nck.select_encoder("X1", 1)
        assert bench.numbers() == [25100]
        await bench.run("$MA_ENC_CHANGE_TOL[X1]=0.2\nNEWCONF\nM30")
        assert bench.nck.select_encoder("X1", 1)


async def test_26030_takes_reference_and_compensation_away() -> None:
    axes = (AxisSpec("X1", "X", eec_points=(10, 0), absolute_encoder=True), *SPEC.axes[1:])

    async with on_bench(axes=axes) as bench:
        await load_eec(bench, "X1", [0.004] * 3, 0.0, 100.0)
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        assert bench.nck.axis_state("X1").referenced, "an adjusted absolute encoder needs no reference run"
        assert encoder(bench, "X1") == pytest.approx(-0.004, abs=1e-9)
        bench.nck.lose_absolute_position("X1")
        assert (bench.numbers(), bench.nck.get("$MA_ENC_REFP_STATE[0,X1]")) == ([26030], 1)
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(0.0, abs=1e-9)
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        assert not bench.nck.axis_state("X1").referenced


async def test_22062_refuses_nc_start_until_referenced() -> None:
    async with on_bench() as bench:
        bench.nck.lose_reference("Z1")
        bench.load("R1=1\nM30")
        bench.nck.select("/_N_MPF_DIR/_N_TEST_MPF")
        assert not bench.nck.nc_start()
        assert bench.numbers() == [22062]
        bench.nck.set("$MC_REFP_NC_START_LOCK", 0, 2)
        bench.nck.channel_reset()
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.r(1) == 1.0


async def test_enabling_what_is_disabled_raises_nothing() -> None:
    async with on_bench() as bench:
        await bench.run(enable("X1", 1) + enable("X1", 0) + "M30")
        assert bench.numbers() == []


async def test_700016_when_the_dressers_axis_is_moved_while_the_wheel_runs() -> None:
    async with on_bench(dresser="Y1") as bench:
        await bench.run("SUPA G1 Y=5.0 F=3000.0\nS1500 M3\nSUPA G1 X=5.0\nM5\nSUPA G1 Y=0.0\nM30")
        assert bench.numbers() == []
        for start in ("M3", "M1=3", "M4"):
            await bench.run(f"{start}\nSUPA G1 X=1.0 F=3000.0\nSUPA G1 Y=1.0\nM30")
            assert bench.numbers() == [700016]
            assert bench.nck.axis_state("Y1").set_position == 0.0
            bench.nck.channel_reset()
            assert bench.numbers() == []
