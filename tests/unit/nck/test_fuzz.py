"""Damaged programs: each ends, or stops with an alarm, within its step limit; nothing else ever comes out."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import run_virtual
from simulators.nck.language.parser import parse
from simulators.nck.language.syntax import NcSyntaxError
from tests.sizes import few
from tests.unit.nck.bench import MAIN, Bench, on_bench
from tests.unit.nck.test_execution import SKELETON

STEP_LIMIT = 300
PROGRAMS = 10_000
SHARES = 20

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
STOPRE
GUDLIST[2]=$P_EP[X1] $SN_CEC_CALC[0]=1
G70 G91 G0 X0.1
G710 G90 G1 X5 Z2 F3000
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


async def outcome(bench: Bench, text: str) -> str:
    """Run a damaged program: "alarm", "ended", or "limit" when its steps or hours were used up."""
    nck = bench.nck
    nck.files.write(MAIN, text.encode("latin-1", "replace"))
    assert nck.select(MAIN) == 0
    used_up: list[int] = []

    def count(block: int) -> None:
        if block >= STEP_LIMIT:
            used_up.append(block)
            nck.channel_reset()

    nck.on_block = count
    for _ in range(4):
        nck.nc_start()
        task = nck.channel.task
        for _ in range(30):
            if nck.channel_status != 1:
                break
            await bench.sleep(120.0)
        if task is not None and task.done() and not task.cancelled():
            assert task.exception() is None, text
        if nck.channel_status != 2 or nck.program_status == 1:
            break
    found = "limit" if used_up or nck.channel_status == 1 else "alarm" if nck.alarms else "ended"
    stuck = nck.channel_status == 1
    nck.channel_reset()
    nck.acknowledge_alarms()
    assert nck.channel_status == 0
    if stuck:
        await bench.sleep(0.0)
    return found


async def batch(bench: Bench, seed: int, count: int) -> Counter[str]:
    chance = random.Random(seed)
    found: Counter[str] = Counter()
    for _ in range(count):
        for number, value in {1: 0.0, 2: 0.0, 3: 0.0, 10: 0.0, 11: 3.0, 12: 4.0, 13: 1.0, 14: 2000.0}.items():
            bench.nck.set(f"R[{number}]", value, 7)
        found[await outcome(bench, mutated(chance.choice((SEED, SKELETON)), chance))] += 1
        if not all(axis.referenced for axis in bench.nck.core.axes):
            await bench.warm_up()
    return found


def run_batch(seed: int, count: int) -> None:
    found: Counter[str] = Counter()

    async def body(bench: Bench) -> None:
        found.update(await batch(bench, seed, count))

    async def main() -> None:
        async with on_bench(gud=(("GUDLIST", 5),)) as on:
            await body(on)

    run_virtual(main)
    print(f"seed {seed}: {dict(found)}")
    assert found.total() == count
    assert found["alarm"] > count // 10
    assert found["ended"] > count // 20


@pytest.mark.parametrize("seed", few(range(SHARES), more=5))
def test_damaged_programs_end_or_alarm_within_their_steps(seed: int) -> None:
    run_batch(seed, PROGRAMS // SHARES)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(100, 100 + SHARES))
def test_damaged_programs_ten_times_as_many(seed: int) -> None:
    run_batch(seed, 10 * PROGRAMS // SHARES)


async def test_the_undamaged_program_runs() -> None:
    async with on_bench(gud=(("GUDLIST", 5),)) as bench:
        await bench.run(SEED)
        assert bench.numbers() == []
        assert bench.nck.nc_start()
        await bench.until_idle()
        assert (bench.nck.channel_status, bench.r(3)) == (0, 4.0)
        assert bench.nck.axis_state("X1").set_position == 5.0
        assert bench.nck.get("GUDLIST[2]") == pytest.approx(8.0)
