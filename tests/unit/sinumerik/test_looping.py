"""Loops over tables do what the same program written out does: on the double, stop by stop, move by move."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from drivers.sinumerik.legality import Machine, check
from drivers.sinumerik.ncprogram import blocks, pushing
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.measuring import MachineSetting, build_measuring_program
from drivers.sinumerik.ncprogram.words import Words
from drivers.types.identity import MachineIdentity
from drivers.types.orders import PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from tests.unit.nck.bench import SPEC, on_bench

AXES = ("X1", "Y1", "Z1", "C1")
MEMORY = ReservedPoints(4, (20, 20, 20, 20), AXES)
OF_X = StopPlan("TX", "X1", "X", "mm", False, (), 6000.0, 5.0, 0.1, save_tables=False)
OF_C = StopPlan("TC", "C1", "C", "deg", True, (), 7200.0, 5.0, 0.1, save_tables=False)
PROOF = SignProof(MachineIdentity("S", "V", ("X1",)), "axis", "X1", 1.0, 0.01, 1, "2026-01-01")


def cycle(targets: list[float], rounds: int, once: tuple[int, ...] = ()) -> tuple[Stop, ...]:
    """Up and down, ``rounds`` times; targets ``once`` in the first round alone."""
    return tuple(
        Stop(targets[label], side, turn, label)
        for turn in range(rounds)
        for side in (1, -1)
        for label in (range(len(targets)) if side > 0 else reversed(range(len(targets))))
        if not (turn and label in once)
    )


def steps(targets: list[float], rounds: int) -> tuple[Stop, ...]:
    """Each target from both sides before the next."""
    return tuple(
        Stop(place, side, turn, label)
        for turn in range(rounds)
        for label, place in enumerate(targets)
        for side in (1, -1)
    )


def drawn(seed: int, low: float, high: float) -> tuple[Stop, ...]:
    rng = np.random.default_rng(seed)
    return tuple(
        Stop(round(float(rng.choice(np.linspace(low, high, 7))), 3), 1 if rng.random() < 0.5 else -1, int(turn), 7)
        for turn in rng.integers(0, 3, 12)
    )


SWITCHING = tuple(Stop(40.0, 1, turn, turn, switch=bool(turn % 2)) for turn in range(4))
PLANS = {
    "cycle": replace(OF_X, stops=cycle([0.0, 10.0, 25.5, 40.0], 2)),
    "check stops": replace(OF_X, stops=cycle([0.0, 10.0, 14.7, 25.5, 40.0], 3, once=(2,))),
    "steps": replace(OF_X, stops=steps([0.0, 10.0, 25.5], 2)),
    "no overrun": replace(OF_X, stops=cycle([0.0, 10.0, 25.5], 2), overrun=0.0),
    "any order": replace(OF_X, stops=drawn(1, -20.0, 60.0)),
    "switching": replace(OF_X, stops=SWITCHING),
    "some switch": replace(OF_X, stops=(Stop(10.0, 1), *SWITCHING, Stop(10.0, -1, 9, 9))),
    "a turn": replace(OF_C, stops=cycle([0.0, 90.0, 200.0, 345.0], 2)),
    "a closed turn": replace(OF_C, stops=cycle([0.0, 90.0, 200.0, 360.0], 2, once=(1,))),
    "two turns": replace(OF_C, stops=(Stop(0.0, 1), Stop(360.0, 1, 0, 1), Stop(725.0, 1, 0, 2), Stop(725.0, -1, 0, 2))),
    "turning on": replace(OF_C, stops=drawn(2, 0.0, 360.0)),
    "a turn without overrun": replace(OF_C, stops=cycle([0.0, 120.0, 240.0], 2), overrun=0.0),
    "switched standing": replace(OF_C, stops=SWITCHING),
}


async def visited(text: str, axis: str) -> tuple[list[tuple[float, ...]], list[float]]:
    """The words of each stop with where the axis stood, and every place that it turned round at."""
    stood: list[tuple[float, ...]] = []
    async with on_bench(axes=tuple(replace(one, eec_points=(20, 0)) for one in SPEC.axes)) as bench:
        bench.press_start(text)
        ends, before, way = [], float(bench.nck.get(f"$AA_IM[{axis}]")), 0.0
        for _ in range(20_000):
            if bench.nck.channel_status != 1:
                break
            now = float(bench.nck.get(f"$AA_IM[{axis}]"))
            step = (now - before + 180.0) % 360.0 - 180.0 if axis == "C1" else now - before
            if step * way < 0.0:
                ends.append(round(before, 3))
            before, way = now, step or way
            if bench.r(80) > len(stood):
                on = float(bench.nck.get(f"$MA_ENC_COMP_ENABLE[0,{axis}]"))
                stood.append((*(bench.r(80 + word) for word in range(1, 5)), round(now, 6), on))
                bench.nck.set("R[85]", bench.r(80), 1)
            await bench.sleep(0.02)
        assert bench.numbers() == []
        assert bench.r(90) == 7.0
    return stood, ends


@pytest.mark.parametrize("plan", PLANS.values(), ids=list(PLANS))
async def test_a_loop_makes_the_same_stops_and_turns_round_at_the_same_places(plan: StopPlan) -> None:
    setting = MachineSetting(Words(), MEMORY, modulo=plan.rotary)
    looped, written = (build_measuring_program(plan, 4711, replace(setting, loops=loops)) for loops in (True, False))
    assert "UTARGET[0]=SET(" in looped
    assert "SET(" not in written
    assert [line for line in looped.splitlines() if line.startswith("; Moves")] == [
        line for line in written.splitlines() if line.startswith("; Moves")
    ]
    stood, ends = await visited(looped, plan.axis)
    assert (stood, ends) == await visited(written, plan.axis)
    wanted = [(one.repetition, one.label, one.approach, one.target) for one in plan.stops]
    assert [one[:4] for one in stood] == wanted


def test_the_length_of_a_measuring_program_does_not_grow_with_its_targets() -> None:
    setting = MachineSetting(Words(), MEMORY, modulo=False)
    lengths = []
    for count in (4, 400):
        targets = [round(0.7 * place, 3) for place in range(count)]
        text = build_measuring_program(replace(OF_X, stops=cycle(targets, 5, once=(1, 3))), 4711, setting)
        lengths.append(len([line for line in text.splitlines() if not re.match(r"U\w+\[\d+\]=SET", line)]))
        assert max(map(len, text.splitlines())) < 200
    assert lengths[0] == lengths[1] < 75


def test_tables_beyond_a_programs_memory_are_written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = MachineSetting(Words(), MEMORY, modulo=False)
    monkeypatch.setattr(blocks, "MOST_BYTES", 190)
    assert "SET(" in build_measuring_program(PLANS["no overrun"], 4711, setting)
    assert "SET(" not in build_measuring_program(PLANS["check stops"], 4711, setting)


def pushed(loops: bool) -> str:
    setting = MachineSetting(Words(), MEMORY, modulo=False, loops=loops)
    own = CompensationTable("axis", "X1", "X1", 0.0, 30.0, 10.0, (0.0, -3.0, 1.0, 0.0))
    cross = CompensationTable("cross", "Z1", "X1", 0.0, 40.0, 10.0, (0.0, 2.0, 3.5, 1.0, 0.0), index=1)
    proofs = [PROOF, replace(PROOF, kind="cross")]
    orders = [
        PushOrder(4711, table, letter, False, True, 0.0, "table", proof)
        for table, letter, proof in zip((own, cross), "XZ", proofs, strict=True)
    ]
    return pushing.build_loading_program([(order, setting) for order in orders])


async def test_a_load_from_tables_leaves_the_same_points_in_the_control() -> None:
    """Every point of both tables, the zeroes beyond their ends and the program's own comparison."""
    held = []
    for loops in (True, False):
        text = pushed(loops)
        assert ("UTABLE2[0]=SET(" in text) is loops
        assert check(text, "TFLOAD_X1.MPF", Machine(frozenset(AXES))) == ()
        async with on_bench(axes=tuple(replace(one, eec_points=(4, 0)) for one in SPEC.axes)) as bench:
            await bench.run(text)
            assert (bench.numbers(), bench.r(90), bench.r(88), bench.r(82)) == ([], 4.0, 0.0, 3.0)
            names = [f"$AA_ENC_COMP[0,{place},X1]" for place in range(4)] + [
                f"$AN_CEC[1,{place}]" for place in range(20)
            ]
            held.append([float(bench.nck.get(name)) for name in names])
    assert held[0] == held[1]
    assert held[0][1] == pytest.approx(-0.003)
    assert held[0][6] == pytest.approx(0.0035)


async def test_a_control_without_lists_stops_at_the_first_and_has_moved_nothing() -> None:
    text = build_measuring_program(PLANS["cycle"], 4711, MachineSetting(Words(), MEMORY, modulo=False))
    async with on_bench(fills_arrays=False) as bench:
        before = bench.nck.get("$AA_IM[X1]")
        await bench.run(text)
        assert bench.numbers() == [12550]
        assert bench.nck.get("$AA_IM[X1]") == before


@pytest.mark.parametrize(
    ("block", "code"),
    [
        ("UTAB[0]=SET(1.0,2.0,3.0)", ""),
        ("UTAB[2]=SET(1.0,2.0)", "E-LEGAL-LIST"),
        ("UTAB[0]=SET(1.0,2.0,3.0,4.0)", "E-LEGAL-LIST"),
        ("UTAB[3]=SET(1.0)", "E-LEGAL-INDEX-VALUE"),
        ('UTAB[0]=SET(1.0,"a")', "E-LEGAL-TYPE"),
        ("UTAB[0]=REP(0.0)", ""),
        ("UGRID[1,1]=SET(1,2)", "E-LEGAL-LIST"),
        ("UGRID[1,0]=SET(1,2)", ""),
    ],
)
def test_lists_into_arrays_are_judged(block: str, code: str) -> None:
    found = check(f"DEF REAL UTAB[3]\nDEF INT UGRID[2,2]\n{block}\nM30\n")
    assert [one.code for one in found] == ([code] if code else [])
