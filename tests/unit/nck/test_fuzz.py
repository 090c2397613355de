"""Damaged programs: each runs, or stops with an alarm or a syntax error; nothing else ever comes out."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.nck.language import NcSyntaxError, parse
from tests.unit.nck.bench import MAIN, Bench, on_bench
from tests.unit.nck.test_execution import SKELETON

SEED = """DEF INT I, ERR
DEF STRING[60] TEXT="a"
DEF AXIS WHICH=(X1)
$MA_ENC_COMP_ENABLE[0,X1]=0
NEWCONF
N10 G90 G94 G60 G601 G500
FOR I=0 TO 3
  $AA_ENC_COMP[0,I,X1]=0.001*I
  IF (I==2) AND NOT (R1>5)
    TEXT="v"<<$AA_ENC_COMP[0,I,X1]<<I
    WRITE(ERR,"_N_OUT_SPF",TEXT)
  ELSE
    MSG("I="<<I)
  ENDIF
ENDFOR
$MA_ENC_COMP_ENABLE[0,WHICH]=1
NEWCONF
STOPRE
SUPA G1 X1=10+R1 C=ACP(R2 MOD 360) F=5000
AX[WHICH]=IC(-2) Z-3
WHILE (R3<4) OR FALSE
  R3=R3+1 R4=SQRT(R3)*SIN(30) DIV 1
  IF R3==2 GOTOF NEXT1
NEXT1: G4 F0.01
ENDWHILE
CASE R3 OF 4 GOTOF N90 DEFAULT GOTOF N80
N80 SETAL(65001,"x")
N90 $AN_CEC_INPUT_AXIS[0]=(Z1) $SN_CEC_TABLE_ENABLE[0]=1
DELETE(ERR,"_N_OUT_SPF")
M0
M30
"""
ALPHABET = "ABCXZRNGMF0123456789 .,;:=<>()[]\"$_+-*/\n\t%&'#äDEFIFORENDGOTO"


def mutated(text: str, chance: random.Random) -> str:
    """Some characters changed, lines moved, doubled or dropped."""
    letters = list(text)
    for _ in range(chance.randint(1, 2)):
        place = chance.randrange(len(letters))
        kind = chance.random()
        if kind < 0.4:
            letters[place] = chance.choice(ALPHABET)
        elif kind < 0.6:
            del letters[place]
        elif kind < 0.8:
            letters.insert(place, chance.choice(ALPHABET))
        else:
            other = chance.randrange(len(letters))
            letters[place:place] = letters[other : other + chance.randint(1, 30)]
    lines = "".join(letters).split("\n")
    if chance.random() < 0.05:
        chance.shuffle(lines)
    return "\n".join(lines)


@given(st.text(alphabet=ALPHABET, max_size=120))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_program_or_a_syntax_error(text: str) -> None:
    try:
        program = parse(text)
    except NcSyntaxError as error:
        line, reason = error.line, error.reason
    else:
        line, reason = len(program.lines), "read"
        assert line == len(text.splitlines())
    assert reason
    assert min(1, len(text.splitlines())) <= line <= len(text.splitlines())


@pytest.mark.parametrize("seed", range(6))
def test_damaged_programs_never_break_the_control(seed: int) -> None:
    async def body(bench: Bench) -> None:
        chance = random.Random(seed)
        loop_errors: list[object] = []
        for number in (11, 12, 14):
            bench.nck.set(f"R[{number}]", 3.0 * number, 7)
        for _ in range(60):
            bench.load(mutated(chance.choice((SEED, SKELETON)), chance))
            assert bench.nck.select(MAIN) == 0
            bench.nck.nc_start()
            task = bench.nck.channel.task
            await bench.sleep(chance.choice((0.1, 3.0, 30.0)))
            bench.nck.nc_start()
            await bench.sleep(1.0)
            if task is not None and task.done() and not task.cancelled() and task.exception() is not None:
                loop_errors.append(task.exception())
            bench.nck.channel_reset()
            bench.nck.acknowledge_alarms()
            assert bench.nck.channel_status == 0
        assert loop_errors == []

    on_bench(body)


def test_the_undamaged_program_runs() -> None:
    async def body(bench: Bench) -> None:
        await bench.run(SEED)
        assert bench.numbers() == []
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert (bench.nck.channel_status, bench.r(3)) == (0, 4.0)

    on_bench(body)
