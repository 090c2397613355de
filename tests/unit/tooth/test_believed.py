"""Drift that was seen is believed, and nothing is ground to prove a push that did not happen."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock
from drivers.message import Message, prose
from gateway import audit
from gateway.capture.targets import cycle_visits
from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.domain.outcomes import Verdict
from gateway.evaluate.behaviour.dynamics import steadiness
from gateway.siteplan import WorkSection
from gateway.store import Store
from gateway.tooth import FlankMap, FlankPrediction, SetupValues, ToothProposal, ToothVerdict
from gateway.workflow import complete_run
from gateway.workflow.run import stages
from gateway.workflow.tooth.known_machine import _stated_shop, _with_drift, drift_warning
from tests.unit.components.site import site_data

FLAT = FlankMap(np.zeros(1), np.zeros(1), np.zeros((1, 1, 1)))
PREDICTED = ToothProposal(
    SetupValues(),
    FlankPrediction(FLAT, FLAT, FLAT, floor_um=0.1, u_um=0.2, u_point_um=np.zeros((1, 1, 1)), rms_um=0.3, rms_u_um=0.1),
)
AT = np.linspace(0.0, 400.0, 11)
GRINDING: Any = SimpleNamespace(infeed="X", index="C")
WORK = WorkSection(gear=Path("gear.toml"), height_mm=150.0, drift_um_per_h=0.3)


def per_h(rate: float, seed: int, seconds: float = 20.0) -> float:
    """The drift an hour that a capture of 5 repetitions sees, readings scattered by 0.1 um."""
    times = np.full((AT.size, 5, 2), np.nan)
    for number, stop in enumerate(cycle_visits("standard", AT, 5)):
        times[stop.label, stop.repetition, 0 if stop.approach == 1 else 1] = number * seconds
    x = rate * times / 3600.0 + np.random.default_rng(seed).normal(0.0, 0.1, times.shape)
    return steadiness(times, x, "um").per_h


@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_a_clear_drift_is_told_as_a_rate_and_none_where_there_is_none(rate: float) -> None:
    assert per_h(rate, 1) == pytest.approx(rate, rel=0.25)
    assert sum(per_h(0.0, seed) != 0.0 for seed in range(20)) <= 1


def test_the_larger_of_the_site_file_and_what_was_seen_counts_and_is_said() -> None:
    def shop(x: float, c: float) -> ProcessUncertainty:
        seen: Any = {"X": SimpleNamespace(drift_per_h=x), "C": SimpleNamespace(drift_per_h=c)}
        return _with_drift(_stated_shop(WORK), seen, GRINDING)

    fast, slow = shop(-2.0, 0.1), shop(0.1, 0.0)
    assert (fast.drift_um_per_h, fast.drift_arcsec_per_h) == (2.0, 0.5)
    assert slow.drift_um_per_h == 0.3
    (told,) = drift_warning(fast, WORK)
    assert "infeed drifted by 2.0 µm per hour" in str(told)
    assert drift_warning(slow, WORK) == ()


def _without_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    """A site with a place for the grinding program's values, where nothing is said of the wheel."""
    monkeypatch.setattr(complete_run, "work_section", lambda _site: SimpleNamespace(wheel_place="R200"))
    silent = dict.fromkeys(("propose_wheel", "tell_dressing", "judge_wheel", "tell_unexplained"), lambda *_given: None)
    monkeypatch.setattr(complete_run, "_wheel_in_run", lambda: SimpleNamespace(**silent))


class Loop(complete_run._ClosingRun):
    """A closing run whose stages are there already."""

    async def _part(self, part: str, setup: SetupValues, _cycle: str = "", **_had: object) -> Any:
        self.at.say("part", name=part, x=setup.x_um)
        return SimpleNamespace(part=part)

    async def _proposal(self) -> Any:
        return None, None

    async def _push_tables(self, proposal: Any) -> Verdict:
        return Verdict((), "not-pushed", ())


def test_nothing_is_ground_again_where_nothing_was_pushed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    store = Store(tmp_path)
    folder = store.create("grinder")
    monkeypatch.setattr(complete_run, "same_machine", lambda _at: None)
    book = SimpleNamespace(current=lambda *_names: SetupValues())
    monkeypatch.setattr(complete_run, "SetupBook", lambda _root: book)
    lacks = SimpleNamespace(setup=SetupValues(x_um=1.5))
    monkeypatch.setattr(complete_run, "setup_from_part", lambda _part, _gear: lacks)
    monkeypatch.setattr(complete_run.self_test, "require_self_tests", lambda _at: None)
    _without_wheel(monkeypatch)
    at: Any = SimpleNamespace(folder=folder, store=store, machine=None, site=SiteFile.model_validate(site_data()))
    at.say = lambda code, **fields: said.append(f"{code} {fields.get('name', fields.get('x', ''))}")
    work: Any = SimpleNamespace(name="disc", gear=None, goal="flank")
    asyncio.run(Loop(at, work, None, {}).close(apply=True))  # type: ignore[arg-type]
    assert said == ["P-CLOSE-BACK ", "part before", "P-CLOSE-NOTHING 1.5"]
    assert folder.state == "not-pushed"


class Pushed(Loop):
    """One whose tables went in and whose parts are judged as told."""

    async def _proposal(self) -> Any:
        self.at.folder.put(stages.TOOTH, PREDICTED)
        return None, None

    async def _push_tables(self, proposal: Any) -> Verdict:
        return Verdict((), "better", ())

    def _expected_flank(self, before: Any, tooth: Any) -> SetupValues:
        return SetupValues()

    async def _part(self, part: str, setup: SetupValues, _cycle: str = "", **_had: object) -> Any:
        self.at.folder.put(stages.inspected(part), SetupValues())
        return SimpleNamespace(part=part)


@pytest.mark.parametrize(("outcome", "back", "taken"), [("worse", True, 1), ("worse", False, 0), ("better", True, 0)])
def test_a_flank_that_became_worse_takes_the_tables_back_unless_told_not_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outcome: Any, back: bool, taken: int
) -> None:
    said: list[str] = []
    asked: list[str] = []
    store = Store(tmp_path)
    folder = store.create("grinder")
    verdict = ToothVerdict(
        1.0,
        0.8,
        7.5,
        predicted_um=0.4,
        u_um=0.2,
        within_prediction=False,
        outcome=outcome,
        words=(Message.stored("W"),),
    )

    async def take_back(at: Any) -> Any:
        asked.append(at.folder.run_id)
        return SimpleNamespace(lines=(Message.stored("X1: the old one acts"),))

    async def nothing(_at: Any) -> None:
        return None

    monkeypatch.setattr(complete_run, "same_machine", lambda _at: None)
    book = SimpleNamespace(current=lambda *_names: SetupValues(), save=lambda *_given, **_more: None)
    monkeypatch.setattr(complete_run, "SetupBook", lambda _root: book)
    monkeypatch.setattr(complete_run, "setup_from_part", lambda _part, _gear: SimpleNamespace(setup=SetupValues()))
    monkeypatch.setattr(complete_run.self_test, "require_self_tests", lambda _at: None)
    monkeypatch.setattr(complete_run, "verify_combined_effect", nothing)
    monkeypatch.setattr(complete_run, "judge_tooth", lambda *_parts, **_more: verdict)
    monkeypatch.setattr(complete_run, "roll_back_run", take_back)
    monkeypatch.setattr(complete_run, "entry_instructions", lambda *_given: "")
    _without_wheel(monkeypatch)
    at: Any = SimpleNamespace(folder=folder, store=store, site=SiteFile.model_validate(site_data()))
    at.machine, at.clock = SimpleNamespace(serial="S1"), LoopClock()
    at.say = lambda code, **_fields: said.append(code)
    work: Any = SimpleNamespace(name="disc", gear=None, goal="flank")

    async def run() -> None:
        await Pushed(at, work, None, {}, back=back).close(apply=True)  # type: ignore[arg-type]
        await Pushed(at, work, None, {}, back=back).close(apply=True)  # type: ignore[arg-type]

    asyncio.run(run())
    stored = folder.get(stages.TOOTH_VERDICT, ToothVerdict)
    assert (len(asked), folder.state) == (taken, outcome)
    assert tuple(map(str, stored.taken_back)) == ("X1: the old one acts",) * taken
    assert ("X1: the old one acts" in prose(stored.words)) == bool(taken)
    assert said[0] == ("P-CLOSE-BACK" if back else "P-CLOSE-BACK-NOT")
    assert ("P-CLOSE-STAYS" in said) == (outcome == "worse" and not back)
    actions = [one["action"] for one in audit.read_entries(store.root)]
    assert actions.count("close-goes-back") == taken
