"""One reading broken in any kind of set-up, at any repetition: it is taken again, and no run ends by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock
from gateway.config import SiteFile
from gateway.domain.captures import Capture
from gateway.store import RunFolder, Store
from gateway.workflow.errors21.measurement import PlanOutcome, measure_site
from gateway.workflow.run import stages
from simulators.cell import Cell
from simulators.optics import mountings
from tests.cell.test_components import few, on_cell

OFF = 3.0  # um or arcsec: thirty times what readings of the demo scatter
JOG, COUNT = 3, 6
KINDS = ("EXX", "ECC", "EYX", "EAX", "EXC", "B0Z", "A0C", "EBC")


class Broken(mountings.StopNoise):
    """The stop with this number reads what is not there; every mounting begins anew with number 0."""

    at = frozenset[int]()

    def outlier(self, index: int) -> float:
        """Nothing but these."""
        return OFF if index in self.at else 0.0


def captures(folder: RunFolder) -> dict[str, Capture]:
    """Every set-up that was measured, by its key."""
    kept = [stage for stage in folder.stages if stage.startswith(stages.setup(""))]
    return {one: folder.get(one, Capture) for one in kept if not one.endswith(("-raw", "-proof"))}


def measured(
    folder: Path, patch: pytest.MonkeyPatch, wanted: tuple[str, ...], at: frozenset[int]
) -> dict[str, Capture]:
    """These set-ups of the demo cell with readings broken at these stops."""
    patch.setattr(Broken, "at", at)
    for module in ("sensors", "interferometer", "calibrator"):
        patch.setattr(f"simulators.optics.{module}.StopNoise", Broken, raising=False)
    found: dict[str, Capture] = {}

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        def say(code: str, /, **fields: object) -> None:
            print(code, fields)

        done: PlanOutcome = await measure_site(site, cell.site_path, clock=clock, say=say, wanted=wanted)
        found.update(captures(Store(folder).open(done.run_folder)))

    def edit(text: str) -> str:
        """Without check stops, whose median bears one reading out of line."""
        return few(COUNT, 3)(text).replace("[axes.measure]\n", "[axes.measure]\nbetween = 0\n")

    on_cell(folder, edit, story)
    return found


def judge(found: dict[str, Capture]) -> list[str]:
    """Set-ups that were left with a reading out of line, or that never saw one."""
    wrong = []
    for key, one in found.items():
        apart = one.deviations - np.nanmedian(one.deviations, axis=1, keepdims=True)
        taken = any("outlier" in note for note in map(str, one.notes))
        print(key, f"{np.nanmax(np.abs(apart)):.2f}", one.suspects, one.notes)
        if one.suspects or np.nanmax(np.abs(apart)) > OFF / 2.0 or not taken:
            wrong.append(key)
    return wrong


def test_a_broken_reading_is_taken_again_on_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = measured(tmp_path, monkeypatch, ("EYX",), frozenset({JOG + 4}))
    assert len(found) == 1
    assert judge(found) == []


@pytest.mark.long
def test_two_broken_readings_that_agree_do_not_outvote_the_good_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three the good one is doubted first; taken again it says the same, and then the others are doubted."""
    agree = frozenset({JOG + 4, JOG + 4 * COUNT + 4})
    found = measured(tmp_path, monkeypatch, ("EXX",), agree)
    assert judge(found) == []


@pytest.mark.soak
@pytest.mark.parametrize("at", range(JOG + 2 * 3 * COUNT))
def test_a_broken_reading_in_any_set_up_at_any_repetition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """The first stops are those of the jog: they are proofs, and one broken reading is no disproof."""
    found = measured(tmp_path, monkeypatch, KINDS, frozenset({at}))
    assert {key.split("-")[1] for key in found} == set(KINDS)
    assert at < JOG or judge(found) == []
