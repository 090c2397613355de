"""Who may write what, and when: rights, enabled tables, memory, options, and what follows."""

from __future__ import annotations

import pytest

from simulators.nck import NckRefusal
from tests.unit.nck.bench import eec_lines, enable, load_eec, on_bench

TABLE = [0.0, 0.005, 0.0]


async def test_an_enabled_table_is_write_protected_and_stays_whole() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", TABLE, 0.0, 100.0)
        await bench.run("R1=1\n$AA_ENC_COMP[0,1,X1]=0.5\nR1=2\nM30")
        assert bench.numbers() == [17070]
        assert bench.r(1) == 1.0
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.005
        with pytest.raises(NckRefusal) as caught:
            bench.nck.set("$AA_ENC_COMP_STEP[0,X1]", 1.0, 0)
        assert caught.value.number == 17070
        bench.nck.channel_reset()
        await bench.run("$MA_ENC_COMP_ENABLE[0,X1]=0\n$AA_ENC_COMP[0,1,X1]=0.5\nM30")
        assert bench.numbers() == [17070], "switched off in the datum, but not yet in effect"
        bench.nck.channel_reset()
        await bench.run(enable("X1", 0) + "$AA_ENC_COMP[0,1,X1]=0.5\nM30")
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.5


async def test_cec_is_protected_by_its_output_axis() -> None:
    async with on_bench() as bench:
        await bench.run(
            "$AN_CEC_OUTPUT_AXIS[0]=(X1)\n$AN_CEC_INPUT_AXIS[0]=(Z1)\n$MA_CEC_ENABLE[X1]=1\nNEWCONF\n$AN_CEC[1,0]=0.1\n$AN_CEC[0,0]=1\nM30"
        )
        assert bench.numbers() == [17070]
        assert bench.nck.get("$AN_CEC[1,0]") == 0.1
        assert bench.nck.get("$AN_CEC[0,0]") == 0.0
        assert bench.nck.get("$AN_CEC_OUTPUT_AXIS[0]") == "X1"
        bench.nck.channel_reset()
        await bench.run("$AN_CEC_OUTPUT_AXIS[1]=(X1)\nM30")
        assert bench.numbers() == [17070]


async def test_axis_names_of_tables() -> None:
    async with on_bench() as bench:
        await bench.run(
            'DEF AXIS WHICH=(Z1)\n$AN_CEC_INPUT_AXIS[0]=WHICH\n$AN_CEC_INPUT_AXIS[1]="X1"\n'
            "$AN_CEC_INPUT_AXIS[2]=(AX4)\nM30"
        )
        assert [bench.nck.get(f"$AN_CEC_INPUT_AXIS[{t}]") for t in range(3)] == ["Z1", "X1", "C1"]
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,AX1]") == 0.0


async def test_a_program_without_rights_runs_on_with_the_old_value() -> None:
    async with on_bench() as bench:
        bench.nck.set_access_level(4)
        await bench.run("$MA_ENC_COMP_ENABLE[0,X1]=1\n$MA_BACKLASH[0,X1]=0.01\nR1=5\nNEWCONF\nM30")
        assert bench.numbers() == [4075]
        assert bench.r(1) == 5.0
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert bench.nck.get("$MA_BACKLASH[0,X1]") == 0.0
        assert bench.nck.channel_status == 0
        with pytest.raises(NckRefusal) as caught:
            bench.nck.set("$MA_BACKLASH[0,X1]", 0.01, 4)
        assert caught.value.number == 4075
        bench.nck.acknowledge_alarms()
        assert bench.numbers() == [4076]
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        assert not bench.nck.nc_start()
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        await bench.warm_up()
        assert bench.nck.nc_start()


async def test_setting_data_and_r_parameters_need_no_rights() -> None:
    async with on_bench() as bench:
        bench.nck.set("$SN_CEC_TABLE_WEIGHT[0]", 0.5, 7)
        bench.nck.set("R[80]", 3, 7)
        assert bench.nck.get("$SN_CEC_TABLE_WEIGHT[0]") == 0.5
        assert bench.r(80) == 3.0


async def test_r_parameters_can_be_closed_from_outside() -> None:
    async with on_bench(r_writable=False) as bench:
        with pytest.raises(NckRefusal):
            bench.nck.set("R[80]", 3, 0)
        await bench.run("R80=4\nM30")
        assert bench.r(80) == 4.0


async def test_memory_data_wipe_everything_at_the_next_boot() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", TABLE, 0.0, 100.0)
        bench.nck.set("R[5]", 1.5, 7)
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 500, 2)
        assert bench.numbers() == [4400]
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 900, 2)
        assert bench.numbers() == []
        bench.nck.set("$MN_MM_CEC_MAX_POINTS[0]", 7, 2)
        assert bench.numbers() == [4400]
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.005
        await bench.reset_and_reference()
        assert bench.numbers() == [6020]
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.0
        assert bench.nck.selected == ""
        assert bench.nck.files.list("/_N_MPF_DIR") == []
        assert bench.r(5) == 0.0
        with pytest.raises(NckRefusal) as caught:
            bench.nck.get("$AN_CEC[0,7]")
        assert caught.value.number == 17030


async def test_memory_that_does_not_fit_falls_back_to_standard_data() -> None:
    async with on_bench(table_memory_bytes=20_000) as bench:
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 5000, 0)
        await bench.reset_and_reference()
        assert set(bench.numbers()) == {6000, 6020}
        assert bench.nck.get("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]") == 900


@pytest.mark.parametrize(
    ("name", "value", "number"),
    [
        ("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 5001, 17090),
        ("$MA_BACKLASH_FACTOR[0,X1]", 0.0, 17080),
        ("$MA_ENC_COMP_ENABLE[0,X1]", 2, 12160),
        ("$MA_ENC_COMP_ENABLE[0,X1]", "on", 12150),
        ("$MA_ENC_COMP_ENABLE[2,X1]", 1, 17020),
        ("$MA_ENC_COMP_ENABLE[0,Q1]", 1, 12550),
        ("$MA_NOTHING[X1]", 1, 12550),
        ("$MA_BACKLASH[0,X1]", float("inf"), 12160),
        ("R[0]", float("nan"), 12160),
        ("R[0]", "text", 12150),
        ("R[0]", b"x", 12150),
        ("no name at all!", 1, 12550),
        ("$AA_ENC_COMP[0,X1]", 1, 12400),
        ("$AA_ENC_COMP[0,+-1,X1]", 1, 12150),
    ],
)
async def test_bad_writes_from_outside_change_nothing(name: str, value: object, number: int) -> None:
    async with on_bench() as bench:
        with pytest.raises(NckRefusal) as caught:
            bench.nck.set(name, value, 0)  # type: ignore[arg-type]
        assert caught.value.number == number
        assert bench.numbers() == []


async def test_mains_cut_between_the_points_leaves_a_mixed_table_and_no_compensation() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.001] * 5, 0.0, 10.0)
        bench.nck.cut_power_after(3 + 2 + 3)
        bench.press_start(enable("X1", 0) + eec_lines("X1", [0.002] * 5, 0.0, 20.0) + enable("X1", 1) + "M30")
        await bench.sleep(20.0)
        assert not bench.nck.booting
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(5)] == [0.002] * 3 + [0.001] * 2
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,X1]") == 20.0
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert not bench.nck.axis_state("X1").referenced
        await bench.warm_up()
        assert bench.nck.axis_state("X1").eec_value == 0.0
