"""What a faithful double must show, point by point: the list of 13 in the vendor research, one test each.

Point 11 is the OPC UA server's (tests/contract/test_opcua_server.py); here is what the NCK answers it with.
"""

from __future__ import annotations

import numpy as np
import pytest

from simulators.nck import AxisSpec, NckRefusal
from tests.unit.nck.bench import MAIN, SPEC, Bench, eec_lines, enable, load_eec, on_bench
from tests.unit.nck.test_cec import encoder, load, move, table


async def test_point_01_eec_as_the_manual_states_it() -> None:
    values = [0.004, 0.010, -0.006]

    async with on_bench() as bench:
        await load_eec(bench, "Z1", values, 0.0, 100.0)
        for place, value in {-50.0: 0.004, 0.0: 0.004, 50.0: 0.007, 100.0: 0.010, 150.0: 0.002, 300.0: -0.006}.items():
            await move(bench, f"Z{place}")
            view = bench.nck.axis_state("Z1")
            assert view.actual_position == pytest.approx(view.encoder_position + view.eec_value, abs=1e-9)
            assert view.eec_value == pytest.approx(value, abs=1e-9)
            assert encoder(bench, "Z1") == pytest.approx(place - value, abs=1e-9), "a positive value moves it negative"
        text = enable("Z1", 0) + "$AA_ENC_COMP_MAX[0,Z1]=1000 $AA_ENC_COMP[0,59,Z1]=0.02\n"
        await bench.run(text + "$AA_ENC_COMP_STEP[0,Z1]=10\n" + enable("Z1", 1) + "M30")
        await bench.reset_and_reference()
        await move(bench, "Z600")
        assert bench.nck.axis_state("Z1").eec_value == pytest.approx(0.02), "60 points end at 590: MAX is shortened"
        await load_eec(bench, "C1", [0.0, 0.002, 0.0], 0.0, 180.0, modulo=1)
        await move(bench, "C=ACP(90)")
        await move(bench, "C=ACP(45)")
        assert bench.nck.axis_state("C1").eec_value == pytest.approx(0.0005, abs=1e-9)


async def test_point_01_the_active_encoders_table_drives_the_axis() -> None:
    async with on_bench() as bench:
        second = eec_lines("X1", [0.005] * 3, 0.0, 100.0).replace("[0,", "[1,")
        first = enable("X1", 0) + eec_lines("X1", [0.002] * 3, 0.0, 100.0)
        await bench.run(first + second + enable("X1", 1) + "$MA_ENC_COMP_ENABLE[1,X1]=1\nNEWCONF\nM30")
        await bench.reset_and_reference()
        await move(bench, "X50")
        assert encoder(bench, "X1") == pytest.approx(49.998, abs=1e-9)
        assert bench.nck.get("$VA_ENC2_COMP_VAL[X1]") == 0.0, "encoder 2 is not referenced"
        assert bench.nck.select_encoder("X1", 1)
        assert not bench.nck.axis_state("X1").referenced
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(50.0, abs=1e-9)
        bench.nck.reference_axis("X1")
        await bench.sleep(3.0)
        await move(bench, "X50")
        assert bench.nck.get("$VA_ENC2_COMP_VAL[X1]") == pytest.approx(0.005)
        assert encoder(bench, "X1") == pytest.approx(49.995, abs=1e-9)
        assert bench.nck.select_encoder("X1", 0)
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(49.998, abs=1e-9)


async def test_point_02_no_table_is_written_while_it_is_enabled() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.001] * 3, 0.0, 10.0)
        await bench.run("$AA_ENC_COMP[0,0,X1]=0.5\nM30")
        assert bench.numbers() == [17070]
        bench.nck.channel_reset()
        with pytest.raises(NckRefusal, match="17070"):
            bench.nck.set("$AA_ENC_COMP_MIN[0,X1]", 1.0, 0)
        await bench.run("$AN_CEC_OUTPUT_AXIS[0]=(Z1)\n$MA_CEC_ENABLE[Z1]=1\n$AN_CEC[0,0]=1\nM30")
        assert bench.numbers() == [17070]
        assert (bench.nck.get("$AA_ENC_COMP[0,0,X1]"), bench.nck.get("$AN_CEC[0,0]")) == (0.001, 0.0)


@pytest.mark.parametrize(("mode", "taken", "shown"), [(0, 1, [17030, 15180]), (1, 3, [17030, 12080, 17020, 15185])])
async def test_point_03_bad_indices_and_ini_files(mode: int, taken: int, shown: list[int]) -> None:
    text = (
        b"%_N_AX_EEC_INI\nCHANDATA(1)\n$AA_ENC_COMP[0,0,X1]=0.003\n$AA_ENC_COMP[0,900,X1]=0.1\n"
        b"$AA_ENC_COMP[0,1,X1]  0.004\n$AA_ENC_COMP[2,1,X1]=1\nN20 $AA_ENC_COMP [0,1,AX1] = +0.012\n"
        b"$AA_ENC_COMP_IS_MODULO[0,X1]=0\nM17\n"
    )

    async with on_bench() as bench:
        bench.nck.set("$MN_INI_FILE_MODE", mode, 0)
        report = bench.nck.load_ini(text, level=2)
        assert (report.taken, bench.numbers()) == (taken, shown)
        assert report.aborted == (mode == 0)
        assert [error[0] for error in report.errors] == ([4] if mode == 0 else [4, 5, 6])
        assert bench.nck.get("$AA_ENC_COMP[0,0,X1]") == 0.003
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == (0.0 if mode == 0 else 0.012)
        bench.nck.acknowledge_alarms()
        await bench.run("$AA_ENC_COMP[0,900,X1]=0\nM30")
        assert bench.numbers() == [17030]


async def test_point_04_machine_data_without_rights() -> None:
    async with on_bench() as bench:
        bench.nck.set_access_level(4)
        await bench.run("$MA_ENC_COMP_ENABLE[0,X1]=1\nR1=7\nM30")
        assert (bench.numbers(), bench.r(1), bench.nck.channel_status) == ([4075], 7.0, 0)
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert bench.nck.nc_start(), "4075 alone locks nothing"
        await bench.until_idle()
        bench.nck.acknowledge_alarms()
        assert bench.numbers() == [4076]
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        assert not bench.nck.nc_start(), "only power on clears it"
        bench.nck.power_cycle()
        await bench.sleep(11.0)
        await bench.warm_up()
        assert bench.nck.nc_start()


async def test_point_05_memory_data_wipe_buffered_memory_at_the_next_boot() -> None:
    async with on_bench(gud=(("GUDLIST", 3),)) as bench:
        await load_eec(bench, "X1", [0.001] * 3, 0.0, 10.0)
        bench.nck.set("GUDLIST[1]", 5.0, 7)
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,X1]", 901, 2)
        assert bench.numbers() == [4400]
        assert bench.nck.get("$AA_ENC_COMP[0,1,X1]") == 0.001
        await bench.reset_and_reference()
        assert bench.numbers() == [6020]
        assert (bench.nck.get("$AA_ENC_COMP[0,1,X1]"), bench.nck.get("GUDLIST[1]")) == (0.0, 0.0)
        assert bench.nck.files.list("/_N_MPF_DIR") == []
        assert bench.nck.get("$AA_ENC_COMP[0,900,X1]") == 0.0


async def test_point_06_enabling_moves_the_axis_and_exact_stop_falls() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.010] * 3, 0.0, 100.0)
        bench.press_start(f"G0 X50\nG4 F1\n{enable('X1', 0)}M0\nSTOPRE\n{enable('X1', 1)}M0\nM30")
        await bench.until_idle()
        await bench.sleep(1.0)
        assert (bench.nck.axis_state("X1").aa_stat, encoder(bench, "X1")) == (4, pytest.approx(50.0, abs=1e-9))
        bench.nck.nc_start()
        states, seen = [], []
        for _ in range(200):
            await bench.sleep(0.005)
            states.append(bench.nck.axis_state("X1").aa_stat)
            seen.append(encoder(bench, "X1"))
        assert states[0] in (1, 4)
        assert 1 in states
        assert states[-1] == 4
        assert sorted(set(states[states.index(1) :]), key=states[states.index(1) :].index) == [1, 4]
        assert seen[-1] == pytest.approx(49.990, abs=1e-9)
        assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == pytest.approx(0.010)
        bench.nck.lose_reference("X1")
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(50.0, abs=1e-9)
        assert bench.nck.get("$VA_ENC1_COMP_VAL[X1]") == 0.0


@pytest.mark.parametrize("sign", [1, -1])
async def test_point_07_cec_sums_weights_directions_and_products(sign: int) -> None:
    text = table(0, "Z1", "X1", [0.0, 0.010], 0.0, 100.0) + table(1, "Z1", "X1", [0.002] * 2, 0.0, 100.0, direction=1)
    text += table(2, "Y1", "X1", [0.0, 1.0], 0.0, 100.0, mult_by_table=4)
    text += table(3, "Z1", "X1", [0.0, 0.004], 0.0, 100.0)

    async with on_bench(cec_sign=sign) as bench:
        await load(bench, text, "X1", extra="$SN_CEC_TABLE_WEIGHT[0]=0.5\n")
        await move(bench, "Y50 Z50 X10")
        expected = 0.5 * 0.005 + 0.002 + 0.5 * 0.002
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(expected, abs=1e-9)
        assert encoder(bench, "X1") == pytest.approx(10.0 - sign * expected, abs=1e-9)
        await move(bench, "Z40")
        expected = 0.5 * 0.004 + 0.5 * 0.0016
        assert encoder(bench, "X1") == pytest.approx(10.0 - sign * expected, abs=1e-9), "the + table only with + travel"
        assert bench.numbers() == []


async def test_point_07_sum_and_rate_are_limited_and_made_up() -> None:
    async with on_bench() as bench:
        text = table(0, "Z1", "X1", [0.0, 1.5], 0.0, 10.0)
        await load(bench, text, "X1", extra="$MA_CEC_MAX_SUM[X1]=1\n$MA_CEC_MAX_VELO[X1]=1\n")
        await bench.run("G0 Z10\nM30")
        assert set(bench.numbers()) == {20124, 20125}
        assert abs(bench.nck.axis_state("X1").cec_value) < 0.5
        await bench.sleep(2.0)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(1.0), "clipped, and made up later"


async def test_point_07_cylinder_errors_are_added_to_the_two_points() -> None:
    async with on_bench() as bench:
        await load(bench, table(0, "Z1", "X1", [0.001, 0.001], 0.0, 100.0, type=1), "X1")
        data = "$SN_CEC_BAS_0[0]=0 $SN_CEC_BAS_1[0]=50 $SN_CEC_COMP_0[0]=0.002 $SN_CEC_COMP_1[0]=0.006\n"
        await bench.run(data + "$SN_CEC_CALC[0]=1\n$SN_CEC_CALC[0]=0\nG0 Z100\nG4 F1\nM30")
        assert (bench.nck.get("$SN_CEC_0[0]"), bench.nck.get("$SN_CEC_1[0]")) == (0.002, pytest.approx(0.010))
        assert (bench.nck.get("$SN_CEC_BAS_1[0]"), bench.nck.get("$SN_CEC_BAS_STORE_1[0]")) == (0.0, 50.0)
        assert (bench.nck.get("$SN_CEC_COMP_1[0]"), bench.nck.get("$SN_CEC_COMP_STORE_1[0]")) == (0.0, 0.006)
        assert bench.nck.axis_state("X1").cec_value == pytest.approx(0.011)
        await bench.run("$SN_CEC_CALC_ADD[0]=1\n" + data + "$SN_CEC_CALC[0]=1\nM30")
        assert bench.nck.get("$SN_CEC_1[0]") == pytest.approx(0.020)


@pytest.mark.parametrize(("mode", "reverses"), [(0, True), (2, False)])
async def test_point_08_backlash(mode: int, reverses: bool) -> None:
    async with on_bench() as bench:
        text = table(0, "Z1", "X1", [0.0, 0.010], 0.0, 100.0)
        extra = f"$MA_BACKLASH[0,X1]=0.004 $MA_BACKLASH_FACTOR[0,X1]=2 $MA_BACKLASH_MODE[0,X1]={mode}\n"
        await load(bench, text, "X1", extra=extra)
        await move(bench, "X50")
        assert encoder(bench, "X1") == pytest.approx(50.004, abs=1e-9), "the encoder leads"
        await move(bench, "X40")
        assert encoder(bench, "X1") == pytest.approx(39.996, abs=1e-9)
        await move(bench, "X50")
        await move(bench, "Z100")
        lead = -0.004 if reverses else 0.004
        assert encoder(bench, "X1") == pytest.approx(50.0 - 0.010 + lead, abs=1e-9)


async def test_point_08_dynamic_backlash_comes_slowly_and_half_in_each_direction() -> None:
    async with on_bench() as bench:
        await bench.run("$MA_BACKLASH_DYN[0,X1]=0.1 $MA_BACKLASH_DYN_MAX_VELO[X1]=0.03\nNEWCONF\nG0 X10\nG4 F1\nM30")
        assert encoder(bench, "X1") == pytest.approx(10.0, abs=1e-9)
        bench.nck.set_dynamic_backlash("X1", active=True)
        await bench.sleep(0.6)
        assert 10.02 < encoder(bench, "X1") < 10.03, "0.05 mm at 0.05 mm/s"
        await bench.sleep(1.0)
        assert encoder(bench, "X1") == pytest.approx(10.05, abs=1e-6)
        await bench.run("G0 X5\nG4 F3\nM30")
        assert encoder(bench, "X1") == pytest.approx(4.95, abs=1e-6)
        bench.nck.set_dynamic_backlash("X1", active=False)
        await bench.sleep(2.0)
        assert encoder(bench, "X1") == pytest.approx(5.0, abs=1e-6)


async def test_point_08_power_on_forgets_the_direction_unless_mode_bit_0() -> None:
    async with on_bench() as bench:
        for mode, lead in ((0, 0.002), (1, -0.002)):
            await bench.run(f"$MA_BACKLASH[0,X1]=0.004 $MA_BACKLASH_MODE[0,X1]={mode}\nNEWCONF\nG0 X10\nX-5\nM30")
            bench.nck.power_cycle()
            await bench.sleep(11.0)
            bench.nck.core.axis("X1").referenced = True
            bench.nck.core.refresh()
            await bench.sleep(1.0)
            assert encoder(bench, "X1") == pytest.approx(-5.0 + lead, abs=1e-9)
            await bench.warm_up()


async def test_point_09_points_that_are_not_written_stay() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.01] * 5, 0.0, 10.0)
        await load_eec(bench, "X1", [0.02] * 3, 0.0, 20.0)
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(5)] == [0.02] * 3 + [0.01] * 2
        await bench.run(enable("X1", 0) + "$AA_ENC_COMP_MAX[0,X1]=80\n" + enable("X1", 1) + "M30")
        await bench.reset_and_reference()
        await move(bench, "X80")
        assert bench.nck.axis_state("X1").eec_value == pytest.approx(0.01), "an old point is live again"


async def test_point_10_values_are_read_in_the_basic_system() -> None:
    async with on_bench(unit_system="inch") as bench:
        await bench.run(enable("X1", 0) + eec_lines("X1", [0.0, 0.001, 0.0], 0.0, 1.0) + enable("X1", 1) + "M30")
        await bench.reset_and_reference()
        await bench.run("G0 X1\nG4 F1\nSTOPRE\nR1=$AA_IM[X1] R2=$VA_ENC1_COMP_VAL[X1]\nM30")
        assert encoder(bench, "X1") == pytest.approx(25.4 - 0.0254, abs=1e-9), "one inch and a thousandth"
        assert (bench.r(1), bench.r(2)) == (pytest.approx(1.0), pytest.approx(0.001))
        assert bench.nck.axis_state("X1").set_position == pytest.approx(1.0)
        assert bench.nck.spec.unit_system == "inch"


async def test_point_11_what_the_server_is_answered_with() -> None:
    async with on_bench() as bench:
        bench.load("M0\nM30", "/_n_mpf_dir/_n_small_mpf")
        assert bench.nck.files.list("/_N_MPF_DIR") == ["_N_SMALL_MPF"]
        codes = [bench.nck.select(path) for path in ("/_N_MPF_DIR/_N_SMALL_MPF", "/_N_MPF_DIR/_N_NONE_MPF")]
        assert (*codes, bench.nck.select("/_N_MPF_DIR/_N_SMALL_MPF", 2)) == (0, 2, 1)
        bench.nck.nc_start()
        await bench.until_idle()
        assert bench.nck.select("/_N_MPF_DIR/_N_SMALL_MPF") == 3
        with pytest.raises(NckRefusal):
            bench.nck.files.write("/_N_MPF_DIR/_N_SMALL_TXT", b"M30")
        with pytest.raises(NckRefusal):
            bench.nck.files.write("/_N_MPF_DIR/_N_SMALL_MPF", b"M30")
        bench.nck.nck_reset()
        assert bench.nck.select("/_N_MPF_DIR/_N_SMALL_MPF") == 4


async def test_point_12_power_off_between_disable_and_enable() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.001] * 5, 0.0, 10.0)
        bench.nck.power_cut_at_block(3 + 2 + 3)
        bench.press_start(enable("X1", 0) + eec_lines("X1", [0.002] * 5, 0.0, 20.0) + enable("X1", 1) + "M30")
        await bench.sleep(30.0)
        assert not bench.nck.booting
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False, "the compensation stays off"
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(5)] == [0.002] * 3 + [0.001] * 2
        assert bench.nck.get("$AA_ENC_COMP_STEP[0,X1]") == 20.0, "new parameters, some old values"
        await bench.warm_up()
        assert bench.nck.axis_state("X1").eec_value == 0.0


async def test_point_12_an_alarm_and_the_key_switch_in_the_middle_of_a_write() -> None:
    text = enable("X1", 0) + eec_lines("X1", [0.002] * 5, 0.0, 20.0) + enable("X1", 1) + "M30"

    async def alarm(bench: Bench) -> None:
        await bench.run(text)
        assert (bench.numbers(), bench.nck.channel_status) == ([300504], 2)
        assert [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(5)] == [0.002] * 3 + [0.0] * 2
        bench.nck.channel_reset()
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False

    async def key(bench: Bench) -> None:
        await bench.run(text)
        assert bench.numbers() == [4075]
        assert bench.nck.get("$AA_ENC_COMP[0,4,X1]") == 0.002
        assert bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is False, "the program ran to its end and enabled nothing"

    async with on_bench(alarm_at_block=3 + 2 + 3) as on:
        await alarm(on)
    async with on_bench(keyswitch_at_block=3 + 2 + 3) as on:
        await key(on)


async def test_point_13_when_nc_start_and_select_are_refused() -> None:
    async with on_bench(warm=False) as bench:
        bench.load("M0\nM30")
        bench.nck.select(MAIN)
        bench.nck.set_mode("AUTO")
        assert not bench.nck.nc_start()
        assert bench.numbers() == [22062]
        await bench.warm_up()
        bench.nck.set_mode("JOG")
        assert not bench.nck.nc_start()
        bench.nck.set_mode("AUTO")
        bench.nck.drive_alarm(300504, "drive")
        assert not bench.nck.nc_start()
        bench.nck.channel_reset()
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.nck.select(MAIN) == 3


async def test_point_13_an_axis_that_needs_no_reference_does_not_lock() -> None:
    axes = (*SPEC.axes[:3], AxisSpec("C1", "C", rotary=True, modulo=True))

    async with on_bench(warm=False, axes=axes) as bench:
        bench.nck.set("$MA_REFP_CYCLE_NR[C1]", -1, 2)
        bench.nck.channel_reset()
        for name in ("X1", "Y1", "Z1"):
            bench.nck.reference_axis(name)
        await bench.sleep(10.0)
        bench.nck.set_mode("AUTO")
        bench.load("R1=3\nM30")
        bench.nck.select(MAIN)
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.r(1) == 3.0
        assert not np.isnan(encoder(bench, "C1"))
