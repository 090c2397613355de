"""Programs it was not made for: values, strings, structures, jumps, subprograms, and alarms that stop."""

from __future__ import annotations

import pytest

from drivers.clock import run_virtual
from tests.unit.nck.bench import Bench, on_bench

SKELETON = """
; linear, typed by hand
DEF INT I, K
DEF REAL TGT
G500 D0 G90 G94 G60 G601
FOR K=1 TO 5
  SUPA G0 X1=R10-R13              ; start minus overrun
  FOR I=0 TO R12-1
    TGT=R10+I*R11
    SUPA G1 X1=TGT F=R14
    G4 F=R15
    STOPRE
    R90=K R91=1 R92=I R93=TGT R94=R94+1     ; 94 = new-point counter the PC waits on
    G4 F=R16
  ENDFOR
  SUPA G1 X1=R10+(R12-1)*R11+R13 F=R14
ENDFOR
M30
"""


async def test_measuring_skeleton_runs() -> None:
    async with on_bench() as bench:
        for number, value in {10: 5.0, 11: 10.0, 12: 4.0, 13: 2.0, 14: 2000.0, 15: 1.0, 16: 0.5}.items():
            bench.nck.set(f"R[{number}]", value, 7)
        bench.press_start(SKELETON)
        seen = []
        while bench.nck.channel_status == 1:
            await bench.sleep(0.1)
            count = bench.r(94)
            if count != len(seen):
                view = bench.nck.axis_state("X1")
                assert view.aa_stat == 4
                assert view.actual_position == pytest.approx(bench.r(93), abs=1e-6)
                seen.append((bench.r(90), bench.r(92), bench.r(93)))
        assert seen == [(k, i, 5.0 + 10.0 * i) for k in range(1, 6) for i in range(4)]
        assert bench.numbers() == []
        assert (bench.nck.channel_status, bench.nck.program_status) == (0, 5)
        assert bench.nck.axis_state("X").set_position == 37.0


def outcome(text: str, *names: str) -> list[object]:
    """R1, R2 ... (or other names) after a program."""
    found: list[object] = []

    async def body(bench: Bench) -> None:
        await bench.run(text)
        assert bench.numbers() == [], bench.nck.alarms
        found.extend(bench.nck.get(name) for name in names or ("R1",))

    async def main() -> None:
        async with on_bench() as on:
            await body(on)

    run_virtual(main)
    return found


def alarms_of(text: str, **changes: object) -> list[str]:
    """Alarms after a program, as the screen shows them."""
    found: list[str] = []

    async def body(bench: Bench) -> None:
        await bench.run(text)
        found.extend(f"{alarm.number} {alarm.text}" for alarm in bench.nck.alarms)
        if found:
            assert (bench.nck.channel_status, bench.nck.program_status) == (2, 1)
            assert not bench.nck.nc_start()

    async def main() -> None:
        async with on_bench(**changes) as on:
            await body(on)

    run_virtual(main)
    return found


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("7/2", 3.5),
        ("7 DIV 2", 3.0),
        ("-7 DIV 2", -3.0),
        ("7 MOD 3", 1.0),
        ("SIN(30)", 0.5),
        ("ATAN2(30.5,80.1)", 20.84553),
        ("SQRT(2)*SQRT(2)", 2.0),
        ("POT(-3)", 9.0),
        ("ROUND(2.5)", 3.0),
        ("ROUND(-2.5)", -2.0),
        ("TRUNC(-2.7)", -2.0),
        ("ABS(-4)", 4.0),
        ("LN(EXP(1.5))", 1.5),
        ("'HFF' B_AND 'B1010'", 10.0),
        ("B_NOT 0", -1.0),
        ("(1==1) AND (2<>2) OR TRUE", 1.0),
        ("0.1+0.2==0.3", 1.0),
        ("NOT 3", 0.0),
        ('INDEX("ABC","C")', 2.0),
        ('NUMBER("1.5EX1")', 15.0),
        ("MAXVAL(2,BOUND(0,5,9))", 5.0),
    ],
)
def test_expressions(expression: str, value: float) -> None:
    assert outcome(f"R1={expression}\nM30") == [pytest.approx(value, abs=1e-5)]


def test_structures_and_jumps() -> None:
    text = """
    DEF INT I, N=0
    DEF REAL LIST[3]=(1,2.5,4)
    FOR I=0 TO 2
      R1=R1+LIST[I]
    ENDFOR
    WHILE N<4
      N=N+1
      IF N==2 GOTOF NEXT1
      R2=R2+1
    NEXT1: R3=R3+10
    ENDWHILE
    REPEAT
      R4=R4+1
    UNTIL R4>=3
    LOOP
      R5=R5+1
      IF R5>6
        GOTOF OUT1
      ELSE
        R6=R5
      ENDIF
    ENDLOOP
    OUT1:
    CASE R5 OF 6 GOTOF BAD 7 GOTOF GOOD DEFAULT GOTOF BAD
    BAD: R7=-1
    GOOD: R8=1
    IF R8<3
      GOTOF N900
    ENDIF
    R9=1
    N900 M30
    """
    names = [f"R{number}" for number in range(1, 10)]
    assert outcome(text, *names) == [7.5, 3.0, 40.0, 3.0, 7.0, 6.0, 0.0, 1.0, 0.0]


def test_for_that_never_runs_and_its_end_is_looked_at_each_time() -> None:
    text = "FOR R1=5 TO 4\nR2=1\nENDFOR\nR3=2\nFOR R4=0 TO R3\nIF R4==1\nR3=4\nENDIF\nR5=R5+1\nENDFOR\nM30"
    assert outcome(text, "R2", "R5") == [0.0, 5.0]


async def test_strings_are_readable() -> None:
    async with on_bench() as bench:
        await bench.run(
            'DEF STRING[80] TEXT\nDEF INT N=3\nTEXT="N"<<N<<" R"<<R1<<" "<<0.0000125<<" "<<-2.50<<" "<<TRUE\n'
            "MSG(TEXT)\nM0"
        )
        assert bench.nck.message == "N3 R0 0.0000125 -2.5 1"
        assert (bench.nck.channel_status, bench.nck.program_status) == (2, 2)
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert bench.nck.message == ""


async def test_subprograms_with_values_and_references() -> None:
    async with on_bench() as bench:
        bench.load(
            "PROC DOUBLE(REAL IN, VAR REAL OUT, INT PLUS=1)\nDEF REAL LOCAL\nLOCAL=IN*2\nOUT=LOCAL+PLUS\nRET",
            "/_N_SPF_DIR/_N_DOUBLE_SPF",
        )
        bench.load("R5=R5+1\nM17", "/_N_SPF_DIR/_N_L100_SPF")
        await bench.run(
            "EXTERN DOUBLE(REAL, VAR REAL, INT)\nDEF REAL GOT\nDOUBLE(4,GOT)\nR1=GOT\nDOUBLE(4,R2,3)\nL100\nL100\nM30"
        )
        assert bench.numbers() == []
        assert [bench.r(number) for number in (1, 2, 5)] == [9.0, 11.0, 2.0]


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("FROBNICATE", 12550),
        ("FROBNICATE(1)", 12550),
        ("R1=NOWHERE+1", 12550),
        ("NOWHERE=1", 12550),
        ("E5", 12550),
        ("$AA_NOTHING[X1]=1", 12550),
        ("R1=$AA_IM[Q1]", 12550),
        ("$AA_ENC_COMP[0,1,X]=1", 12550),
        ("R1=1 R2", 12550),
        ("R1=1E5", 12550),
        ("G2 X1 I1", 12550),
        ("G3 X1 CR=5", 12550),
        ("G777", 12470),
        ('EXTOPEN(R1,"LOCAL_DRIVE/OUT")', 12550),
        ("X1=5 X2 X=3", 12110),
        ("R1=1/0", 14092),
        ("R1=SQRT(-1)", 14092),
        ("R1=EXP(5000)", 12160),
        ('R1="A"', 12150),
        ('R1=1+"A"', 12150),
        ("R[5000]=1", 17020),
        ("R1=R[-1]", 17020),
        ("GOTOF NOWHERE", 14080),
        ("G1 X10", 10860),
        ("G1 X10 F0", 14800),
        ("G0 X701", 10720),
        ("G0 X=ACP(3)", 16810),
        ("G0 C=DC(400)", 16830),
        ("R1=IC(3)", 12550),
        ("DEF INT LATE", 14500),
        ('SETAL(61234,"stop here")', 61234),
        ("ELSE R1=2", 12640),
        ("R1=SIN(1,2)", 12340),
        ('WRITE(1,"X","Y")', 12300),
        ("$AA_ENC_COMP[0,900,X1]=0", 17030),
        ("$AA_ENC_COMP[2,1,X1]=0", 17020),
        ("$AN_CEC[4,0]=0", 17020),
        ("$AN_CEC[0,20]=0", 17030),
        ("$AN_CEC_DIRECTION[0]=2", 12160),
        ("$VA_ENC1_COMP_VAL[X1]=1", 17070),
        ("$MN_AXCONF_MACHAX_NAME_TAB[0]=1", 17070),
    ],
)
def test_what_it_does_not_know_stops_the_program(line: str, number: int) -> None:
    shown = alarms_of(f"R50=1\n{line}\nR50=2\nM30") if number != 12640 else refused_at_start(line)
    assert [text.split()[0] for text in shown] == [str(number)]
    assert "line 2" in shown[0]


def refused_at_start(line: str) -> list[str]:
    found: list[str] = []

    async def body(bench: Bench) -> None:
        bench.load(f"R50=1\n{line}\nM30")
        bench.nck.select("/_N_MPF_DIR/_N_TEST_MPF")
        assert not bench.nck.nc_start()
        assert bench.nck.channel_status == 2
        found.extend(f"{alarm.number} {alarm.text}" for alarm in bench.nck.alarms)

    async def main() -> None:
        async with on_bench() as on:
            await body(on)

    run_virtual(main)
    return found


async def test_nothing_behind_a_bad_block_is_executed_and_reset_clears() -> None:
    async with on_bench() as bench:
        await bench.run("R1=1\nFOO\nR1=2\nM30")
        assert bench.r(1) == 1.0
        assert bench.nck.program_line == 2
        assert bench.nck.select("/_N_MPF_DIR/_N_TEST_MPF") == 3
        bench.nck.channel_reset()
        assert (bench.nck.channel_status, bench.nck.program_status, bench.numbers()) == (0, 5, [])
        await bench.run("R1=3\nM30")
        assert bench.r(1) == 3.0


async def test_handshake_with_an_echo_from_outside() -> None:
    text = """
    DEF INT POINT
    FOR POINT=1 TO 20
      R80=POINT
      WHILE (R85<>R80) AND (R86==0)
        G4 F0.05
        STOPRE
      ENDWHILE
      IF R86<>0 GOTOF ABORTED
    ENDFOR
    R99=1
    M30
    ABORTED: R99=2
    M30
    """
    async with on_bench() as bench:
        bench.press_start(text)
        seen = []
        while bench.nck.channel_status == 1:
            await bench.sleep(0.13)
            counter = bench.r(80)
            if counter != bench.r(85):
                seen.append(counter)
                bench.nck.set("R[85]", counter, 7)
        assert seen == [float(point) for point in range(1, 21)]
        assert bench.r(99) == 1.0
        bench.press_start(text)
        await bench.sleep(5.0)
        assert bench.nck.channel_status == 1
        bench.nck.set("R[86]", 1, 7)
        await bench.until_idle()
        assert bench.r(99) == 2.0


async def test_a_tight_loop_leaves_time_to_others_and_to_reset() -> None:
    async with on_bench() as bench:
        bench.press_start("AGAIN: R1=R1+1\nGOTOB AGAIN")
        await bench.sleep(10.0)
        assert bench.r(1) > 1000.0
        bench.nck.channel_reset()
        count = bench.r(1)
        await bench.sleep(1.0)
        assert bench.r(1) == count


async def test_timers_and_own_name() -> None:
    async with on_bench() as bench:
        await bench.run(
            "$AC_TIMER[1]=0\nG4 F2\nSTOPRE\nR1=$AC_TIMER[1]\n$AC_TIMER[1]=-1\nG4 F1\nSTOPRE\n"
            "R2=$AC_TIMER[1]\nMSG($P_PROG[0])\nM0"
        )
        assert bench.nck.message == "_N_TEST_MPF"
        assert bench.r(1) == pytest.approx(2.0, abs=0.05)
        assert bench.r(2) == pytest.approx(bench.r(1), abs=0.01)


async def test_an_801_point_table_takes_few_turns_of_the_clock() -> None:
    points = [0.0001 * place for place in range(801)]
    lines = "".join(f"$AA_ENC_COMP[0,{n},X1]={value:.6f}\n" for n, value in enumerate(points))
    text = (
        "DEF INT POINT, ERR\n"
        + lines
        + "FOR POINT=0 TO 800\nIF ABS($AA_ENC_COMP[0,POINT,X1]-0.0001*POINT)>0.0000005\nR1=R1+1\nENDIF\nENDFOR\n"
        + 'FOR POINT=0 TO 800\nWRITE(ERR,"_N_OUT_SPF","$AA_ENC_COMP[0,"<<POINT<<",X1]="<<$AA_ENC_COMP[0,POINT,X1])\n'
        + "IF ERR<>0\nR2=ERR\nENDIF\nENDFOR\nM30"
    )

    async with on_bench() as bench:
        begin = bench.clock.now()
        await bench.run(text)
        assert bench.numbers() == []
        assert (bench.r(1), bench.r(2)) == (0.0, 0.0)
        assert bench.clock.now() - begin < 5.0
        written = bench.nck.files.read("/_N_MPF_DIR/_N_OUT_SPF").decode().splitlines()
        assert len(written) == 801
        assert written[800] == "$AA_ENC_COMP[0,800,X1]=0.08"
