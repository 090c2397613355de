"""INI files: what is taken, what is counted, checksums, and the control's own output back in."""

from __future__ import annotations

import pytest

from simulators.nck import NckRefusal
from simulators.nck.program.inifile import checksum
from tests.unit.nck.bench import eec_lines, load_eec, on_bench
from tests.unit.nck.test_cec import table

THREE_BAD = b"""%_N_AX1_EEC_INI
CHANDATA(1)
; by hand
$AA_ENC_COMP[0,0,X1] = -0.003 ; a value
$AA_ENC_COMP[0,1,X1]=0,004
$AA_ENC_COMP[0,1,Q1]=0.004
N30 $AA_ENC_COMP[0,2,AX1]=.5
G0 X100
$AA_ENC_COMP_IS_MODULO[0,X1]=FALSE
M30
$AA_ENC_COMP[0,3,X1]=9
"""


@pytest.mark.parametrize(
    ("mode", "taken", "numbers"),
    [(0, 1, [12080, 15180]), (1, 3, [12080, 12550, 15185]), (2, 3, [15185])],
)
async def test_ini_file_mode(mode: int, taken: int, numbers: list[int]) -> None:
    async with on_bench() as bench:
        bench.nck.set("$MN_INI_FILE_MODE", mode, 0)
        await bench.run("$AA_ENC_COMP[0,1,X1]=0.777\nM30")
        report = bench.nck.load_ini(THREE_BAD, level=2)
        assert (report.taken, report.aborted, bench.numbers()) == (taken, mode == 0, numbers)
        assert [line for line, _, _ in report.errors] == ([5] if mode == 0 else [5, 6, 8])
        read = [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(4)]
        assert read == [-0.003, 0.777, 0.0 if mode == 0 else 0.5, 0.0], "a bad value never overwrites a current one"
        assert bench.nck.axis_state("X1").set_position == 0.0
        if mode > 0:
            assert bench.nck.alarms[-1].text.startswith("3 errors")


async def test_an_enabled_table_is_not_loaded() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", [0.001] * 3, 0.0, 10.0)
        report = bench.nck.load_ini(b"$AA_ENC_COMP[0,0,X1]=0.5\nM17\n", level=0)
        assert [number for _, number, _ in report.errors] == [17070]
        assert bench.nck.get("$AA_ENC_COMP[0,0,X1]") == 0.001
        bench.nck.nck_reset()
        with pytest.raises(NckRefusal, match="starting"):
            bench.nck.load_ini(b"M17", level=0)


async def test_lines_without_a_valid_checksum_need_the_manufacturers_rights() -> None:
    line = "$AA_ENC_COMP[0,0,X1]=0.5 "
    good = f"{line}'{checksum(line)}\nM17\n".encode()
    bad = f"{line}'0000\nM17\n".encode()

    async with on_bench() as bench:
        for data, level, value in ((bad, 4, 0.0), (b"$AA_ENC_COMP[0,0,X1]=1", 3, 0.0), (good, 4, 0.5), (bad, 2, 0.25)):
            report = bench.nck.load_ini(data.replace(b"0.5", b"0.25") if value == 0.25 else data, level)
            refused = [number for _, number, _ in report.errors]
            assert refused == ([] if value else [4075])
            assert bench.nck.get("$AA_ENC_COMP[0,0,X1]") == value


@pytest.mark.parametrize("style", [0, 1])
async def test_what_the_control_gives_out_it_takes_back(style: int) -> None:
    async with on_bench() as bench:
        bench.nck.set("$MN_MD_FILE_STYLE", style, 0)
        text = eec_lines("C1", [0.0, 0.0021, -0.0013, 0.0], 0.0, 120.0, modulo=1)
        await bench.run(text + table(1, "Z1", "X1", [0.0, -0.0104, 0.5], -5.0, 7.5, direction=-1) + "M30")
        memory = bench.nck.static_memory()["tables"]
        files = [bench.nck.eec_ini("C1"), bench.nck.cec_ini(1)]
        assert files[0].startswith(b"%_N_AX4_EEC_INI\nCHANDATA(1)\n")
        assert (b" '" in files[0]) == (style == 1)
        clear = "".join(f"$AA_ENC_COMP[0,{n},C1]=7\n$AN_CEC[1,{n % 20}]=7\n" for n in range(80))
        await bench.run(clear + "$AN_CEC_DIRECTION[1]=0 $AN_CEC_INPUT_AXIS[1]=(C1)\nM30")
        assert bench.nck.static_memory()["tables"] != memory
        for file in files:
            assert bench.nck.load_ini(file, level=7 if style else 2).errors == ()
        assert bench.nck.static_memory()["tables"] == memory
