"""A whole cell grinds its part through its control: blank, program, true flank, inspection, tables on and off."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.pytest_plugin import CellStarter
from tests.unit.simulators.planned_run import ground
from tests.unit.simulators.test_cell import load_table, settled

PROGRAM = """G500 D0 G90 G94 G60 G601
MSG("TRUEFLANK LOAD BLANK RV-40E-LIKE")
M0
MSG("")
SUPA G0 Z1=138 Y1=0
SUPA G0 X1=-170
S1500 M3
FOR R1=0 TO 38
SUPA G0 C1=DC((39-R1)*360/39)
SUPA G1 X1=-160 F1000
SUPA G1 Z1=162 F3000
SUPA G1 Z1=138
SUPA G0 X1=-170
ENDFOR
M5
STOPRE
R99=R99+1
M30
"""
PATH = "/_N_MPF_DIR/_N_GRIND_MPF"


async def grind(cell: Cell) -> None:
    before = cell.nck.get("R[99]")
    cell.nck.files.write(PATH, PROGRAM.encode())
    assert cell.nck.select(PATH, 1) == 0
    for _ in range(4000):
        await cell.clock.sleep(1.0)
        if cell.nck.get("R[99]") != before:
            return
    raise AssertionError(f"the program did not end: {cell.nck.alarms} {cell.operator.log}")


def flank(cell: Cell) -> np.ndarray:
    work = cell.shop.ground
    assert work is not None
    assert work.finished
    return work.surplus_um(np.arange(39.0), work.lobes.even(8), np.linspace(-5.0, 5.0, 3))


def predicted(cell: Cell, start_s: float) -> np.ndarray:
    """The same from the truth, with what the control adds to each axis standing there; nothing moves.

    From space 1 on: the program comes to space 0 with C standing, from whichever side it came before.
    """

    def added(name: str, direction: int):
        return lambda places: cell.nck.compensated_encoder(name, places[name[0]], direction) - places[name[0]]

    corrections = {"X": added("X1", 1), "Z": added("Z1", 1), "C": added("C1", -1)}
    part = cell.file.part
    assert part is not None
    work = ground(cell.truth, part, cell.shop.ground.seat, corrections=corrections, start_s=start_s)
    return work.surplus_um(np.arange(39.0), work.lobes.even(8), np.linspace(-5.0, 5.0, 3))


def test_the_part_is_ground_through_the_control_and_its_tables(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        assert cell.shop.ground is None
        began = cell.clock.now()
        await grind(cell)
        assert cell.operator.log == ["NC START", "clamped a blank", "NC START"]
        bare = flank(cell)
        first = cell.shop.ground
        np.testing.assert_allclose(bare[1:], predicted(cell, began)[1:], atol=0.03)
        assert np.std(bare) > 1.0
        at = np.arange(0.0, 361.0, 5.0)
        mean = (cell.raw_deviation("C1", at, 1, 0.0) + cell.raw_deviation("C1", at, -1, 0.0)) / 2.0
        load_table(cell, "C1", 0.0, 5.0, ((mean - mean[0]) / 3600.0).tolist(), modulo=1)
        await settled(cell)
        again = cell.clock.now()
        await grind(cell)
        assert cell.shop.ground is not first
        better = flank(cell)
        np.testing.assert_allclose(better[1:], predicted(cell, again)[1:], atol=0.03)
        assert np.max(np.abs(better - bare)) > 1.0
        cell.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 0, 0)
        cell.nck.channel_reset()
        await cell.clock.sleep(1.0)
        off = cell.clock.now()
        await grind(cell)
        np.testing.assert_allclose(flank(cell)[1:], predicted(cell, off)[1:], atol=0.03)
        # A new blank sits a little elsewhere: 0.3 um and 2 arcsec of clamping, and the drift of some minutes.
        assert np.std(flank(cell) - bare) < 0.5

    trueflank_cell.in_memory(main)


def test_nothing_is_cut_without_a_blank_and_the_judge_knows_the_part(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        judge = BackDoor(cell)
        assert await judge.answer({"ask": "part"}) == {"clamped": None, "ground": None}
        assert "error" in await judge.answer({"ask": "flank"})
        told = await judge.answer({"ask": "motion", "name": "EYX", "positions": [-100.0, -50.0]})
        np.testing.assert_array_equal(told["motion"], cell.truth.motion("EYX", np.asarray([-100.0, -50.0])))
        assert await judge.answer({"ask": "location", "name": "B0Z"}) == {"value": 6.0}
        assert await judge.answer({"set": "load_blank"}) == {"done": True}
        assert (await judge.answer({"ask": "part"}))["clamped"] == {
            "number": 1, "spaces": 0, "passes": 0, "finished": False,
        }  # fmt: skip
        cell.nck.files.write(
            PATH, b"G500 D0 G90 G94 G60 G601\nSUPA G0 Z1=138\nSUPA G1 X1=-160 F9000\nSUPA G1 Z1=162 F3000\nM30\n"
        )
        cell.nck.select(PATH, 1)
        await cell.clock.sleep(60.0)
        told = (await judge.answer({"ask": "part"}))["clamped"]
        assert (told["spaces"], told["finished"]) == (1, False)
        surplus = np.asarray((await judge.answer({"ask": "flank", "profile": 10, "width": 3}))["surplus_um"])
        assert surplus.shape == (39, 10, 3)
        assert np.all(surplus[1:] == pytest.approx(80.0))
        assert np.all(np.abs(surplus[0]) < 40.0)
        assert await judge.answer({"set": "unload_part"}) == {"done": True}
        assert (await judge.answer({"ask": "part"}))["clamped"] is None

    trueflank_cell.in_memory(main)


def test_the_builders_cycle_makes_the_same_part_by_another_way(trueflank_cell: CellStarter) -> None:
    """Two wheels, every seventh space, strokes one way: what is left is the machine's, and its x comes from R210."""

    async def main(cell: Cell) -> None:
        async def cycle() -> np.ndarray:
            assert cell.run_builder_cycle()
            await cell.clock.sleep(30.0)
            for _ in range(4000):
                await cell.clock.sleep(1.0)
                if cell.nck.channel_status == 0:
                    return flank(cell)
            raise AssertionError(f"the cycle did not end: {cell.nck.alarms} {cell.operator.log}")

        bare = await cycle()
        wanted = ["NC START", "clamped a blank", "NC START", "changed to wheel 1", "NC START"]
        wanted += ["changed to wheel 2", "NC START", "took the part off", "NC START"]
        assert cell.operator.log[1:] == wanted
        work = cell.shop.ground
        assert work is not None
        assert list(work._passes) != sorted(work._passes)
        await grind(cell)
        own = flank(cell)
        # Another clamping, and C and Z approached from the other side: reversals turn or move all spaces alike.
        apart = np.mean(bare - own, axis=0)
        assert np.std(bare - own - apart) < 1.0
        cell.nck.set("R[210]", 0.02, 0)
        deeper = await cycle()
        normal = work.lobes.profile(work.lobes.even(8))[1]
        np.testing.assert_allclose(np.mean(deeper - bare, axis=(0, 2)), -normal.real * 20.0, atol=1.0)

    trueflank_cell.in_memory(main)
