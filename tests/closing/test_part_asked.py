"""The part before is asked whether the model is right: reversed optics are refused and named, honest ones pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import run_virtual
from simulators.cell import Cell
from simulators.cell.filed import write_setup_file
from simulators.cellfile import load_cell, with_plan
from tests.closing.machines import machine
from tests.closing.parts import Asked, asked, turned

# Of the errors that a straightness or angle set-up measures those that show on a flank beyond what doubts it.
SHOWN = ("EXC", "EYC", "EAC", "EBC")


def look(seed: int, folder: Path, *reversed_: str) -> Asked:
    """What a closing run on the machine of a seed makes of its part."""
    found, _ = run_virtual(lambda: asked(turned(machine(seed), *reversed_), folder))
    return found


@pytest.mark.long
@pytest.mark.timeout(900)
def test_reversed_optics_end_a_run_before_its_tables_and_measured_anew_it_goes_on(tmp_path: Path) -> None:
    def mount_right(cell: Cell, path: Path) -> None:
        """Somebody turns the indicator round; the bench measures that set-up again."""
        setups = cell.file.setups
        cell.bench.turn_round("EXC")
        (table,) = path.with_suffix(".setups").glob("EXC-*.csv")
        write_setup_file(cell, "EXC", "C1", table)
        assert [one.reversed for one in setups if one.component == "EXC"] == [True]

    async def run() -> tuple[Asked, Asked | None]:
        return await asked(turned(with_plan(load_cell("demo")), "EXC"), tmp_path, mount_right)

    first, again = run_virtual(run)
    assert (first.code, first.exit_code, first.proposed) == ("E-PART-APART", 6, False)
    assert first.found.missed_um > 3.0 * first.found.u_um
    (only,) = first.found.explanations
    assert (only.error, only.how) == ("EXC", "reversed")
    assert only.left_um < 0.2 * first.found.missed_um
    assert "EXC-C1" in first.text
    assert again is not None
    assert (again.code, again.proposed, again.found.outcome) == ("", True, "agrees")
    assert again.found.missed_um < 2.0 * again.found.u_um


@pytest.mark.soak
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("seed", range(1, 21))
def test_seeded_machines_with_one_reversed_optic_and_honest_ones(tmp_path: Path, seed: int) -> None:
    error = SHOWN[seed % len(SHOWN)]
    honest, wrong = look(seed, tmp_path / "honest"), look(seed, tmp_path / "wrong", error)
    print(seed, error, honest.found.ratio, wrong.found)
    assert (honest.code, honest.found.outcome, honest.found.explanations) == ("", "agrees", ())
    assert (wrong.code, wrong.proposed) == ("E-PART-APART", False)
    assert [(one.error, one.how) for one in wrong.found.explanations] == [(error, "reversed")]
