"""The double runs nothing that the printed rules refuse: the judge is asked before the first block."""

from __future__ import annotations

import pytest

from tests.unit.nck.bench import MAIN, on_bench

LENIENT = (
    ("DEF INT N\nR1=7\nM30\n", 1),
    ("R1=7\nIF R1==8 GOTOB UNOWHERE\nM30\n", 2),
    ("R1=7\nR2=$AA_ENC_COMP[0,1]\nM30\n", 2),
    ("R1=7\n", 1),
)


@pytest.mark.parametrize(("text", "line"), LENIENT)
async def test_no_block_of_an_illegal_program_is_done(text: str, line: int) -> None:
    async with on_bench(judges_programs=True) as at:
        at.load(text)
        assert at.nck.select(MAIN) == 0
        assert not at.nck.nc_start()
        assert at.numbers() == [12080]
        assert f"line {line}:" in at.nck.alarms[0].text
        assert at.r(1) == 0.0


async def test_a_legal_program_runs_and_may_call_another_but_no_illegal_one() -> None:
    async with on_bench(judges_programs=True) as at:
        at.load("R2=R2+1\nM17\n", "/_N_SPF_DIR/_N_UGOOD_SPF")
        at.load("DEF INT K\nR2=99\nM17\n", "/_N_SPF_DIR/_N_UBAD_SPF")
        await at.run("UGOOD\nR1=7\nM30\n")
        assert (at.numbers(), at.r(1), at.r(2)) == ([], 7.0, 1.0)
        await at.run("UBAD\nR1=8\nM30\n")
        assert (at.numbers(), at.r(1), at.r(2)) == ([12080], 7.0, 1.0)
