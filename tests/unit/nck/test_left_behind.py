"""Modal states that a program leaves: they change where the next one goes, unless it sets or suppresses them."""

from __future__ import annotations

import pytest

from drivers.clock import run_virtual
from tests.unit.nck.bench import Bench, on_bench

MOVE = "G1 X=10 F=600"


def stands(left: str, block: str, axis: str = "X1", *, modal_stays: bool = True, **switches: object) -> float:
    """Where the axis stands after a block, run after a program that left something behind."""
    found: list[float] = []

    async def body(bench: Bench) -> None:
        await bench.run(f"{left}\nM30")
        await bench.run(f"{block}\nM30")
        found.append(bench.nck.axis_state(axis).set_position if not bench.numbers() else -float(bench.numbers()[0]))

    async def main() -> None:
        async with on_bench(modal_stays=modal_stays, **switches) as on:
            await body(on)

    run_virtual(main)
    return found[0]


@pytest.mark.parametrize(
    ("left", "cure", "wrong", "switches"),
    [
        ("DIAMON", "DIAMOF\n", 5.0, {"diameter_axis": "X"}),
        ("DIAM90", "DIAMOF\n", 5.0, {"diameter_axis": "X"}),
        ("G70", "G71\n", 254.0, {}),
        ("G700", "G710\n", 254.0, {}),
        ("G54", "G500\n", 17.0, {"zero_offset_mm": 7.0}),
        ("G54", "SUPA ", 17.0, {"zero_offset_mm": 7.0}),
        ("TRANS X3", "SUPA ", 13.0, {}),
        ("TRANS X3\nATRANS X1", "TRANS\n", 14.0, {}),
        ("MIRROR X0", "SUPA ", -10.0, {}),
        ("SCALE X2", "G153 ", 20.0, {}),
        ("G19 D1", "D0\n", 18.0, {"tool_length_mm": 8.0}),
        ("G19 D1", "G17\n", 18.0, {"tool_length_mm": 8.0}),
        ("TRANSMIT", "TRAFOOF\n", -14404.0, {}),
        ("TRACYL(40)", "TRAFOOF\n", -14404.0, {}),
        ("G41", "G40\n", -10750.0, {}),
        ("G95", "G94\n", -14800.0, {}),
    ],
)
def test_what_is_left_acts_until_it_is_set_or_suppressed(
    left: str, cure: str, wrong: float, switches: dict[str, object]
) -> None:
    assert stands(left, MOVE, **switches) == pytest.approx(wrong)
    assert stands(left, cure + MOVE, **switches) == pytest.approx(10.0)
    assert stands(left, MOVE, modal_stays=False, **switches) == pytest.approx(10.0)


def test_distances_follow_mirrors_and_diameters_but_no_shift() -> None:
    assert stands("G54\nTRANS X3", "G91 " + MOVE, zero_offset_mm=7.0) == pytest.approx(10.0)
    assert stands("DIAMON", "G91 " + MOVE, diameter_axis="X") == pytest.approx(5.0)
    assert stands("DIAM90", "G91 " + MOVE, diameter_axis="X") == pytest.approx(10.0)
    assert stands("MIRROR X0", "G91 " + MOVE) == pytest.approx(-10.0)


def test_a_rotation_is_not_done_and_not_passed_over() -> None:
    assert stands("R1=1", "ROT Z30\n" + MOVE) == -12550.0
    assert stands("ROT", MOVE) == pytest.approx(10.0)
