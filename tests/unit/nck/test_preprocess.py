"""Preprocessing: what runs ahead of the machine, what waits for it, and how far ahead it goes."""

from __future__ import annotations

import pytest

from tests.unit.nck.bench import on_bench


@pytest.mark.parametrize(("ahead", "early"), [(20, True), (0, False)])
async def test_r_parameters_run_ahead_of_motion_without_stopre(ahead: int, early: bool) -> None:
    async with on_bench(preprocess_ahead=ahead) as bench:
        bench.press_start("G1 X10 F600\nR1=1 R2=$AA_IM[X1]\nX20\nSTOPRE\nR3=1 R4=$AA_IM[X1]\nM30")
        await bench.sleep(0.2)
        assert (bench.r(1) == 1.0) is early, "the axis has just set off"
        await bench.sleep(1.5)
        assert bench.r(3) == 0.0, "behind STOPRE nothing is early"
        await bench.until_idle()
        assert bench.r(2) == pytest.approx(0.0 if early else 10.0, abs=0.1), "read where the axis was then"
        assert (bench.r(3), bench.r(4)) == (1.0, pytest.approx(20.0))


async def test_a_measuring_handshake_without_stopre_counts_before_the_axis_is_there() -> None:
    async with on_bench() as bench:
        bench.press_start("FOR R1=1 TO 5\nG1 X=R1*10 F600\nG4 F1\nR94=R94+1\nENDFOR\nM30")
        await bench.sleep(0.5)
        assert bench.r(94) == 5.0
        assert bench.nck.axis_state("X1").set_position < 6.0


async def test_it_goes_no_further_ahead_than_its_buffer() -> None:
    async with on_bench(preprocess_ahead=3) as bench:
        bench.press_start("FOR R1=1 TO 50\nG4 F1\nENDFOR\nM30")
        await bench.sleep(0.5)
        assert bench.r(1) == 4.0, "one under way and three in the buffer"
        await bench.sleep(10.0)
        assert bench.r(1) == 14.0


async def test_newconf_and_setal_wait_for_the_machine_too() -> None:
    async with on_bench() as bench:
        bench.press_start('G4 F2\n$MA_BACKLASH[0,X1]=0.5\nNEWCONF\nR1=1\nG4 F2\nSETAL(65000,"x")\nR2=1\nM30')
        await bench.sleep(1.0)
        assert bench.nck.get("$MA_BACKLASH[0,X1]") == 0.5
        assert bench.nck.core.data.effective("$MA_BACKLASH", 0, 0) == 0.0
        await bench.sleep(1.5)
        assert (bench.nck.core.data.effective("$MA_BACKLASH", 0, 0), bench.r(1), bench.r(2)) == (0.5, 1.0, 0.0)
        assert bench.numbers() == []
        await bench.until_idle()
        assert (bench.numbers(), bench.r(2)) == ([65000], 1.0)


async def test_messages_and_stops_come_in_the_order_of_the_machine() -> None:
    async with on_bench() as bench:
        bench.press_start('MSG("ONE")\nG4 F1\nMSG("TWO")\nG4 F1\nMSG("THREE")\nM0\nR1=1\nMSG("")\nSTOPRE\nR2=1\nM30')
        await bench.sleep(0.5)
        assert bench.nck.message == "ONE"
        await bench.sleep(1.0)
        assert bench.nck.message == "TWO"
        await bench.until_idle()
        assert (bench.nck.message, bench.nck.channel_status) == ("THREE", 2)
        await bench.sleep(1.0)
        assert (bench.r(1), bench.r(2)) == (1.0, 0.0), "blocks behind M0 are interpreted already, up to STOPRE"
        bench.nck.nc_start()
        await bench.until_idle()
        assert (bench.nck.message, bench.r(2)) == ("", 1.0)


async def test_relative_words_add_up_however_far_ahead() -> None:
    async with on_bench() as bench:
        await bench.run("G91 G0 X10\nX10 C=IC(200)\nC=ACP(0)\nR1=$P_EP[X1] R2=$P_EP[C1]\nX5\nG90 C=DC(350)\nM30")
        assert (bench.r(1), bench.r(2)) == (20.0, 0.0)
        assert bench.nck.core.axis("X").end_point == 25.0
        assert bench.nck.core.axis("C").end_point == pytest.approx(350.0)


async def test_a_bad_block_stops_the_program_when_the_blocks_before_it_are_done() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X10 F600\nFOO\nX20\nM30")
        await bench.sleep(0.5)
        assert (bench.nck.channel_status, bench.numbers()) == (1, [])
        await bench.until_idle()
        assert bench.numbers() == [12550]
        assert bench.nck.program_line == 2
        assert bench.nck.axis_state("X1").set_position == 10.0


async def test_nc_stop_holds_machine_and_interpreter() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X10 F600\nAGAIN: R1=R1+1\nG4 F0.1\nIF R1<40 GOTOB AGAIN\nM30")
        await bench.sleep(0.5)
        bench.nck.nc_stop()
        await bench.sleep(0.1)
        assert bench.nck.channel_status == 2
        place, count = bench.nck.axis_state("X1").set_position, bench.r(1)
        assert 4.0 < place < 6.0
        await bench.sleep(5.0)
        assert (bench.nck.axis_state("X1").set_position, bench.r(1)) == (place, count)
        bench.nck.nc_stop()
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert (bench.r(1), bench.nck.axis_state("X1").set_position) == (40.0, 10.0)


async def test_nc_stop_holds_a_program_that_moves_nothing() -> None:
    async with on_bench() as bench:
        bench.press_start("AGAIN: R1=R1+1\nGOTOB AGAIN")
        await bench.sleep(1.0)
        bench.nck.nc_stop()
        await bench.sleep(0.1)
        assert bench.nck.channel_status == 2
        count = bench.r(1)
        await bench.sleep(5.0)
        assert bench.r(1) == count
        assert bench.nck.nc_start()
        await bench.sleep(1.0)
        assert bench.r(1) > count


@pytest.mark.parametrize(("stops", "value"), [(False, 0.0), (True, 10.0)])
async def test_reading_a_system_variable_may_stop_preprocessing_by_itself(stops: bool, value: float) -> None:
    async with on_bench(system_reads_stop=stops) as bench:
        await bench.run("G1 X10 F600\nR1=$AA_IM[X1]\nM30")
        assert bench.r(1) == pytest.approx(value, abs=0.1)


async def test_reset_in_the_middle_drops_what_was_ahead() -> None:
    async with on_bench() as bench:
        bench.press_start("G1 X10 F600\nX20\nX30\nM30")
        await bench.sleep(0.3)
        bench.nck.channel_reset()
        assert bench.nck.channel_status == 0
        place = bench.nck.axis_state("X1").set_position
        await bench.sleep(10.0)
        assert bench.nck.axis_state("X1").set_position == place
        await bench.run("G91 G0 X1\nM30")
        assert bench.nck.axis_state("X1").set_position == pytest.approx(place + 1.0)
