"""The operator's side: starting, stopping, resetting, referencing, selecting, and what is refused."""

from __future__ import annotations

import pytest

from tests.unit.nck.bench import MAIN, on_bench


async def test_as_switched_on_nothing_is_referenced_and_start_is_refused() -> None:
    async with on_bench(warm=False) as bench:
        assert bench.nck.mode == "JOG"
        bench.load("R1=1\nM30")
        assert bench.nck.select(MAIN) == 0
        assert not bench.nck.nc_start()
        bench.nck.set_mode("AUTO")
        assert not bench.nck.nc_start()
        assert bench.numbers() == [22062]
        assert bench.nck.reference_axis("X1")
        assert not bench.nck.axis_state("X1").referenced
        assert not bench.nck.nc_start()
        await bench.warm_up()
        assert bench.nck.nc_start()
        assert bench.numbers() == []


async def test_without_the_lock_unreferenced_axes_may_run() -> None:
    async with on_bench(warm=False) as bench:
        bench.nck.set("$MC_REFP_NC_START_LOCK", 0, 2)
        bench.nck.channel_reset()
        bench.nck.set_mode("AUTO")
        await bench.run("R1=1\nM30")
        assert bench.r(1) == 1.0


async def test_codes_of_select() -> None:
    async with on_bench() as bench:
        bench.load("M0\nM30")
        assert bench.nck.select(MAIN, 2) == 1
        assert bench.nck.select("/_N_MPF_DIR/_N_NONE_MPF") == 2
        assert bench.nck.select(MAIN.lower()) == 0
        assert bench.nck.selected == MAIN
        bench.nck.nc_start()
        assert bench.nck.select(MAIN) == 3
        await bench.until_idle()
        assert bench.nck.select(MAIN) == 3
        assert bench.nck.unselect() == 3
        bench.nck.nck_reset()
        assert bench.nck.select(MAIN) == 4
        await bench.sleep(6.0)
        assert bench.nck.select(MAIN) == 0
        assert bench.nck.unselect() == 0
        assert not bench.nck.nc_start()


async def test_start_is_refused_in_the_wrong_mode_and_while_running() -> None:
    async with on_bench() as bench:
        bench.load("G4 F5\nM0\nR1=1\nM30")
        bench.nck.select(MAIN)
        bench.nck.set_mode("JOG")
        assert not bench.nck.nc_start()
        bench.nck.set_mode("AUTO")
        assert bench.nck.nc_start()
        assert not bench.nck.nc_start()
        assert not bench.nck.set_mode("JOG")
        assert not bench.nck.reference_axis("X1")
        await bench.until_idle()
        assert bench.nck.set_mode("JOG")
        assert not bench.nck.nc_start()
        assert bench.nck.set_mode("AUTO")
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.r(1) == 1.0
        with pytest.raises(ValueError, match="mode"):
            bench.nck.set_mode("TEACH")  # type: ignore[arg-type]


async def test_m0_m1_m30_m17_and_skipped_blocks() -> None:
    text = "R1=1\n/R2=1\nM1\nSTOPRE\nR3=1\nM0\nSTOPRE\nR4=1\nM2\nR5=1"

    async with on_bench() as bench:
        await bench.run(text)
        assert [bench.r(n) for n in range(1, 6)] == [1.0, 1.0, 1.0, 0.0, 0.0]
        bench.nck.nc_start()
        await bench.until_idle()
        assert [bench.r(n) for n in range(1, 6)] == [1.0, 1.0, 1.0, 1.0, 0.0]
        bench.nck.set_skip(active=True)
        bench.nck.set_optional_stop(active=True)
        await bench.run("R6=R6+1\n/R6=R6+10\nM1\nSTOPRE\nR6=R6+100\nM17")
        assert bench.r(6) == 1.0
        bench.nck.nc_start()
        await bench.until_idle()
        assert bench.r(6) == 101.0
        assert bench.nck.channel_status == 0


async def test_nck_reset_aborts_and_keeps_what_is_buffered() -> None:
    async with on_bench() as bench:
        await bench.run('R1=4\n$MA_BACKLASH[0,X1]=0.002\nG0 X50\nMSG("WAIT")\nM0\nSTOPRE\nR1=5\nM30')
        assert bench.nck.message == "WAIT"
        bench.nck.nck_reset()
        assert bench.nck.booting
        assert (bench.nck.channel_status, bench.nck.program_status, bench.nck.message) == (0, 5, "")
        assert not bench.nck.reference_axis("X1")
        await bench.sleep(4.0)
        assert bench.nck.booting
        await bench.sleep(1.5)
        assert not bench.nck.booting
        view = bench.nck.axis_state("X1")
        assert (view.referenced, view.set_position) == (False, 50.0)
        assert (bench.r(1), bench.nck.get("$MA_BACKLASH[0,X1]")) == (4.0, 0.002)
        assert bench.nck.selected == MAIN
        await bench.warm_up()
        assert bench.nck.axis_state("X1").set_position == 0.0
        assert bench.nck.nc_start()


async def test_reset_in_the_middle_of_referencing_leaves_the_axis_unreferenced() -> None:
    async with on_bench() as bench:
        await bench.run("G0 X500\nM30")
        bench.nck.reference_axis("X1")
        await bench.sleep(1.0)
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        await bench.sleep(10.0)
        view = bench.nck.axis_state("X1")
        assert not view.referenced
        assert 0.0 < view.set_position < 500.0


async def test_user_alarm_that_only_shows() -> None:
    async with on_bench() as bench:
        await bench.run('SETAL(65010,"look")\nR1=1\nM30')
        assert bench.numbers() == [65010]
        assert bench.r(1) == 1.0
        bench.nck.acknowledge_alarms()
        assert bench.numbers() == []


async def test_override_stretches_motion() -> None:
    async with on_bench() as bench:
        bench.nck.set_feed_override(50.0)
        begin = bench.clock.now()
        await bench.run("G1 X10 F600\nM30")
        assert bench.clock.now() - begin > 2.0
        for bad in (0.0, 121.0):
            with pytest.raises(ValueError, match="override"):
                bench.nck.set_feed_override(bad)


async def test_access_level_is_checked() -> None:
    async with on_bench() as bench:
        bench.nck.set_access_level(7)
        assert bench.nck.access_level == 7
        with pytest.raises(ValueError, match="level"):
            bench.nck.set_access_level(8)
