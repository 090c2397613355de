"""Hostile manners of the double, and what happens from outside at a block of a program."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.nck.bench import SPEC, Bench, eec_lines, enable, load_eec, on_bench
from tests.unit.nck.test_cec import encoder, move

READ = "/_N_MPF_DIR/_N_OUT_MPF"


# -- hostile ---------------------------------------------------------------------------------------------


async def test_lies_about_disable() -> None:
    async with on_bench(lies_about_disable=True) as bench:
        await load_eec(bench, "X1", [0.008] * 2, 0.0, 10.0)
        await bench.run(enable("X1", 0) + "$AA_ENC_COMP[0,0,X1]=0.5\nM30")
        assert (bench.numbers(), bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]")) == ([], False)
        assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == pytest.approx(0.008), "off by its word, on by its deed"
        await bench.reset_and_reference()
        assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == 0.0


async def test_ignores_newconf() -> None:
    async with on_bench(ignores_newconf=True) as bench:
        await load_eec(bench, "X1", [0.008] * 2, 0.0, 10.0)
        await bench.run(enable("X1", 0) + "$AA_ENC_COMP[0,0,X1]=0.5\nM30")
        assert bench.numbers() == [17070], "still in effect, so still protected"
        bench.nck.channel_reset()
        assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == 0.0, "RESET takes the data over"


async def test_float32_tables() -> None:
    async with on_bench(float32_tables=True) as bench:
        await bench.run("$AA_ENC_COMP[0,0,X1]=0.0071 $AN_CEC[1,2]=0.1\nM30")
        assert bench.nck.get("$AA_ENC_COMP[0,0,X1]") == float(np.float32(0.0071)) != 0.0071
        assert bench.nck.get("$AN_CEC[1,2]") == float(np.float32(0.1))


async def test_accepts_nan() -> None:
    async with on_bench(accepts_nan=True) as bench:
        await bench.run(enable("X1", 0) + eec_lines("X1", [0.01] * 3, 0.0, 10.0) + "M30")
        bench.nck.set("$AA_ENC_COMP[0,1,X1]", math.nan, 0)
        found = bench.nck.get("$AA_ENC_COMP[0,1,X1]")
        assert isinstance(found, float)
        assert math.isnan(found)
        await bench.run(enable("X1", 1) + "M30")
        await bench.reset_and_reference()
        await move(bench, "X20")
        assert encoder(bench, "X1") == pytest.approx(19.99), "and the machine goes on"


async def test_accepts_points_beyond() -> None:
    async with on_bench(accepts_points_beyond=True) as bench:
        await bench.run("$AA_ENC_COMP[0,60,Z1]=0.5\nR1=$AA_ENC_COMP[0,60,Z1]+1\nM30")
        assert (bench.numbers(), bench.r(1)) == ([], 1.0), "swallowed, and reads as nothing"


async def test_loses_last_points() -> None:
    async with on_bench(loses_last_points=2) as bench:
        await bench.run(eec_lines("X1", [0.01] * 6, 0.0, 10.0) + "M30")
        assert bench.numbers() == []
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(6)] == [0.01] * 4 + [0.0] * 2


async def test_writes_late_s() -> None:
    async with on_bench(writes_late_s=2.0) as bench:
        await bench.run("$AA_ENC_COMP[0,1,X1]=0.01 $AN_CEC_MIN[0]=5\nM30")
        assert (bench.nck.get("$AA_ENC_COMP[0,1,X1]"), bench.nck.get("$AN_CEC_MIN[0]")) == (0.0, 0.0)
        await bench.sleep(3.0)
        assert (bench.nck.get("$AA_ENC_COMP[0,1,X1]"), bench.nck.get("$AN_CEC_MIN[0]")) == (0.01, 5.0)


@pytest.mark.parametrize("stale", [True, False])
async def test_stale_files(stale: bool) -> None:
    async with on_bench(stale_files=stale) as bench:
        for text in ("OLD", "NEW"):
            await bench.run(f'DELETE(R1,"OUT")\nWRITE(R1,"OUT","{text}")\nM30')
        assert bench.nck.files.read(READ) == (b"OLD\n" if stale else b"NEW\n")
        bench.nck.files.write(READ, b"NEWEST")
        assert bench.nck.files.read(READ) == (b"NEW\n" if stale else b"NEWEST")
        assert bench.nck.files.text(READ) == "NEWEST", "the control itself knows better"


async def test_reads_another_axis() -> None:
    async with on_bench(reads_another_axis=True) as bench:
        await bench.run("$AA_ENC_COMP[0,1,X1]=0.01 $AA_ENC_COMP[0,1,Z1]=0.02\n$AA_ENC_COMP_STEP[0,C1]=5\nM30")
        read = [bench.nck.get(f"$AA_ENC_COMP[0,1,{axis}]") for axis in ("X1", "Z1", "C1")]
        assert read == [0.02, 0.0, 0.01]
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,Z1]") == 5.0
        assert bench.nck.get("$AA_ENC_COMP[0,800,X1]") == 0.0
        assert bench.nck.core.memory.eec[0, 0].points[1] == 0.01, "written where it belongs"


# -- at a block ------------------------------------------------------------------------------------------

COUNT = "".join(f"R{n}={n}\n" for n in range(1, 9)) + "M30"


def done(bench: Bench) -> int:
    return sum(bench.r(n) != 0.0 for n in range(1, 9))


async def test_power_cut_at_block() -> None:
    async with on_bench(power_cut_at_block=3) as bench:
        bench.press_start(COUNT)
        await bench.sleep(1.0)
        assert (bench.nck.booting, bench.nck.channel_status, done(bench)) == (True, 0, 3)
        await bench.sleep(12.0)
        await bench.warm_up()
        await bench.run(COUNT)
        assert done(bench) == 8, "once only"


async def test_alarm_at_block() -> None:
    async with on_bench(alarm_at_block=5, block_alarm=300999) as bench:
        await bench.run(COUNT)
        assert (bench.numbers(), bench.nck.channel_status, done(bench)) == ([300999], 2, 5)
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        await bench.run(COUNT)
        assert (bench.numbers(), done(bench)) == ([], 8)


async def test_keyswitch_at_block() -> None:
    async with on_bench(keyswitch_at_block=1, block_access_level=4) as bench:
        await bench.run("$MA_BACKLASH[0,X1]=0.5\n$MA_BACKLASH[0,Z1]=0.5\nM30")
        assert (bench.nck.access_level, bench.numbers()) == (4, [4075])
        assert (bench.nck.get("$MA_BACKLASH[0,X1]"), bench.nck.get("$MA_BACKLASH[0,Z1]")) == (0.5, 0.0)


async def test_mode_change_at_block() -> None:
    async with on_bench(mode_change_at_block=6) as bench:
        await bench.run(COUNT)
        assert (bench.nck.mode, bench.nck.channel_status, done(bench)) == ("JOG", 0, 6)
        assert not bench.nck.nc_start()


async def test_hmi_writes_at_block() -> None:
    writes = (("$AA_ENC_COMP[0,1,X1]", 0.05), ("$AN_CEC[0,99]", 1.0), ("$MA_ENC_COMP_ENABLE[0,X1]", 1.0))

    async with on_bench(hmi_writes_at_block=4, hmi_writes=writes) as bench:
        await bench.run(eec_lines("X1", [0.01] * 4, 0.0, 10.0) + "M30")
        assert bench.numbers() == [17070], "enabled by another hand, so the next point is refused"
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(4)] == [0.01, 0.05, 0.0, 0.0]
        assert bench.nck.events.refused == [("$AN_CEC[0,99]", 17030)]


def test_the_defaults_are_polite() -> None:
    assert (SPEC.lies_about_disable, SPEC.float32_tables, SPEC.stale_files, SPEC.hmi_writes) == (
        False,
        False,
        False,
        (),
    )
    assert SPEC.preprocess_ahead > 0
