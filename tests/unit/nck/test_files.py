"""Files of the NCK: paths, WRITE and DELETE with their codes, limits, and files in use."""

from __future__ import annotations

import pytest

from simulators.nck import NckRefusal
from simulators.nck.machine.files import FileSystem, NcFileMissing
from tests.unit.nck.bench import MAIN, Bench, on_bench


def test_files_come_back_byte_for_byte() -> None:
    files = FileSystem(10_000, 10)
    data = bytes(range(256)) + b"\r\nG0 X1\r\n\n  ;\xc3\xa4\n\x0b\x85last"
    files.write("/_n_spf_dir/_n_any_spf", data)
    assert files.read("/_N_SPF_DIR/_N_ANY_SPF") == data
    assert files.size("/_N_SPF_DIR/_N_ANY_SPF") == len(data)
    assert files.list("/_N_SPF_DIR") == ["_N_ANY_SPF"]
    files.write("/_N_WKS_DIR/_N_GEAR_WPD/_N_A_MPF", b"x")
    assert files.list("/_N_WKS_DIR") == ["_N_GEAR_WPD"]
    files.delete("/_N_SPF_DIR/_N_ANY_SPF")
    with pytest.raises(NcFileMissing):
        files.read("/_N_SPF_DIR/_N_ANY_SPF")


@pytest.mark.parametrize(
    "path",
    ["/etc/passwd", "/_N_MPF_DIR/../_N_A_MPF", "/_N_MPF_DIR/_N_A_EXE", "/_N_CMA_DIR/_N_A_SPF", "/_N_MPF_DIR/A", ""],
)
def test_bad_paths_are_refused(path: str) -> None:
    with pytest.raises(NckRefusal):
        FileSystem(10_000, 10).write(path, b"")


def test_memory_and_number_of_files_are_limited() -> None:
    files = FileSystem(100, 2)
    files.write("/_N_MPF_DIR/_N_A_MPF", b"x" * 60)
    with pytest.raises(NckRefusal):
        files.write("/_N_MPF_DIR/_N_B_MPF", b"x" * 60)
    files.write("/_N_MPF_DIR/_N_A_MPF", b"x" * 90)
    files.write("/_N_MPF_DIR/_N_B_MPF", b"")
    with pytest.raises(NckRefusal):
        files.write("/_N_MPF_DIR/_N_C_MPF", b"")
    files.delete("/_N_MPF_DIR/_N_A_MPF")
    files.write("/_N_MPF_DIR/_N_C_MPF", b"y" * 100)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("_N_OUT_SPF", 0),
        ("out", 0),
        ("/_N_SPF_DIR/_N_OUT_SPF", 0),
        ("/_N_WKS_DIR/_N_GEAR_WPD/_N_OUT_MPF", 0),
        ("/HOME/_N_OUT_MPF", 1),
        ("/_N_XYZ_DIR/_N_OUT_MPF", 2),
        ("/_N_WKS_DIR/_N_OUT_MPF", 2),
        ("_N_OUT.X_SPF", 4),
        ("/_N_CMA_DIR/_N_OUT_SPF", 13),
        ("_N_TEST_MPF", 11),
    ],
)
async def test_state_of_write(name: str, code: int) -> None:
    async with on_bench() as bench:
        await bench.run(f'DEF INT STATE\nWRITE(STATE,"{name}","G0 X1 ; a;b")\nR1=STATE\nM30')
        assert bench.numbers() == []
        assert bench.r(1) == code
        assert bench.nck.files.exists(MAIN)


async def test_write_appends_until_the_file_is_full() -> None:
    async with on_bench(files_max_bytes=2048) as bench:
        await bench.run(
            'DEF INT STATE\nREPEAT\nWRITE(STATE,"_N_OUT_SPF","0123456789")\nR1=R1+1\nUNTIL STATE<>0\nR2=STATE\nM30'
        )
        assert (bench.r(1), bench.r(2)) == (2 * 1024 // 11 + 1, 10.0)


async def test_text_beyond_200_characters_is_an_alarm_in_the_expression() -> None:
    async with on_bench() as bench:
        long = "x" * 150
        await bench.run(f'DEF INT STATE\nWRITE(STATE,"_N_OUT_SPF","{long}"<<"{long}")\nM30')
        assert bench.numbers() == [12210]


async def test_delete_isfile_filesize_and_read() -> None:
    text = """
    DEF INT ERR, SIZE
    DEF STRING[80] LINES[2]
    DELETE(ERR,"_N_OUT_SPF")
    R1=ERR
    WRITE(ERR,"_N_OUT_SPF","first")
    WRITE(ERR,"_N_OUT_SPF","second")
    R2=ISFILE("_N_OUT_SPF")
    FILESIZE(ERR,"_N_OUT_SPF",SIZE)
    R3=SIZE
    READ(ERR,"_N_OUT_SPF",1,2,LINES)
    R4=ERR
    IF LINES[1]=="second"
      R5=1
    ENDIF
    DELETE(ERR,"_N_OUT_SPF")
    R6=ERR
    R7=ISFILE("_N_OUT_SPF")
    M30
    """
    async with on_bench() as bench:
        await bench.run(text)
        assert bench.numbers() == []
        assert [bench.r(number) for number in range(1, 8)] == [3.0, 1.0, 13.0, 0.0, 1.0, 0.0, 0.0]


async def test_a_backup_written_by_write_can_be_run() -> None:
    text = """
    DEF INT ERR, POINT
    DELETE(ERR,"/_N_SPF_DIR/_N_BACK_SPF")
    FOR POINT=0 TO 4
      WRITE(ERR,"/_N_SPF_DIR/_N_BACK_SPF","$AA_ENC_COMP[0,"<<POINT<<",X1]="<<$AA_ENC_COMP[0,POINT,X1])
    ENDFOR
    WRITE(ERR,"/_N_SPF_DIR/_N_BACK_SPF","M17")
    FOR POINT=0 TO 4
      $AA_ENC_COMP[0,POINT,X1]=0
    ENDFOR
    BACK
    M30
    """
    async with on_bench() as bench:
        for place in range(5):
            bench.nck.set(f"$AA_ENC_COMP[0,{place},X1]", -0.001 * place, 2)
        await bench.run(text)
        assert bench.numbers() == []
        values = [bench.nck.get(f"$AA_ENC_COMP[0,{place},X1]") for place in range(5)]
        assert values == pytest.approx([-0.001 * place for place in range(5)])


async def test_fetching_while_a_program_waits() -> None:
    async def open_(bench: Bench) -> None:
        await bench.run("M0\nM30")
        assert bench.nck.files.read(MAIN)
        with pytest.raises(NckRefusal):
            bench.nck.files.write(MAIN, b"M30")
        with pytest.raises(NckRefusal):
            bench.nck.files.delete(MAIN)

    async def closed(bench: Bench) -> None:
        await bench.run("M0\nM30")
        with pytest.raises(NckRefusal):
            bench.nck.files.read(MAIN)
        bench.nck.channel_reset()
        assert bench.nck.files.read(MAIN)

    async with on_bench() as on:
        await open_(on)
    async with on_bench(fetch_while_waiting=False) as on:
        await closed(on)
