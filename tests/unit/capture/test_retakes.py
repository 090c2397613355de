"""A reading out of line costs a retake at the end of its capture, whatever its set-up, pass and size."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.sensing import Optics
from drivers.types.stops import StopPlan
from drivers.units import wrap_deg
from gateway.capture.corrections import from_live
from gateway.capture.error_motion import ErrorRig, capture_error, error_capture, prove_mounting
from gateway.capture.live import RawCapture, capture_axis
from gateway.capture.revisits import require_complete
from gateway.capture.rig import Rig, prove_sense
from gateway.config import AxisSection, SiteFile
from gateway.daemon.stream import LiveObserver
from gateway.domain.captures import Capture
from gateway.domain.equipment import SenseProof
from gateway.errors import CaptureError, Incomplete
from gateway.live import looked_on_by
from gateway.say import silence
from gateway.store import Store
from gateway.workflow.axes.site_remarks import remarks
from gateway.workflow.errors21.measurement import _setups_to_measure
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.run import stages
from tests.sizes import few
from tests.unit.capture.double import LittleMachine
from tests.unit.capture.test_live import AXIS, PATIENCE, _error_um
from tests.unit.components.site import site_data

TARGETS, NOISE_UM, OFF_UM = 6, 0.05, 4.0


class Disturbed(LittleMachine):
    """At the stops of these numbers, counted over all programs, the reading is off by ``off_mm`` while it stands."""

    bad: Collection[int] = ()
    off_mm = OFF_UM / 1000.0
    drift_mm_per_s = 0.0
    number = -1
    moves = 0

    async def move(self, target: float) -> None:
        """Every second move ends at a stop."""
        await super().move(target)
        self.moves += 1
        self.number += self.moves % 2 == 0

    async def prepare_stops(self, plan: StopPlan) -> None:
        """A program begins with the way to its first stop."""
        self.moves = 0
        await super().prepare_stops(plan)

    async def optics(self) -> Optics:
        return Optics("straightness")

    def shift_mm(self, times: np.ndarray) -> np.ndarray:
        """What is added to what the instrument sees now."""
        return self.off_mm * (self.number in self.bad) + self.drift_mm_per_s * times


def axis(repetitions: int, **measure: Any) -> Any:
    changes = {"repetitions": repetitions, "between": 0, **measure}
    return AXIS.model_copy(update={"measure": AXIS.measure.model_copy(update=changes)})


def positioned(bad: Collection[int], repetitions: int = 3, *, drift_um_per_s: float = 0.0, **measure: Any) -> Capture:
    """X measured while the readings at these stops were off; the jog's three stops are not among them."""
    used = axis(repetitions, **measure)

    async def main() -> tuple[RawCapture, Any]:
        clock, rng = LoopClock(), np.random.default_rng(3)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            noise = rng.normal(0.0, 1e-5, position.shape) + NOISE_UM / 1000.0 * np.sin(7.0 * machine.number)
            return position + _error_um(position) / 1000.0 + machine.shift_mm(times) + noise

        machine = Disturbed(clock, reads)
        rig = Rig(used, machine, machine, clock, PATIENCE)
        proof = await prove_sense(rig)
        machine.bad, machine.number = bad, -1
        machine.drift_mm_per_s = drift_um_per_s / 1000.0
        return await capture_axis(rig, proof), proof

    raw, proof = run_virtual(main)
    return from_live(used, raw, proof, "air+material")


def straightened(bad: Collection[int], repetitions: int, *, jogged: bool = False, off_um: float = OFF_UM) -> Capture:
    """The same of an error motion: EYX by an instrument that hardly follows the axis; ``jogged`` first, 3 stops."""
    used = axis(repetitions, stable=0.5, component="EYX")

    async def main() -> RawCapture:
        clock, rng = LoopClock(), np.random.default_rng(5)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            noise = rng.normal(0.0, 0.01, position.shape) + NOISE_UM * np.sin(7.0 * machine.number)
            return _error_um(position) + 1000.0 * machine.shift_mm(times) + noise

        machine = Disturbed(clock, reads, channels=("deviation_um",), name="level")
        machine.bad, machine.off_mm = bad, off_um / 1000.0
        rig = ErrorRig(used, machine, machine, clock, PATIENCE, optics=("straightness",), largest=500.0)
        if jogged:
            await prove_mounting(rig)
        return await capture_error(rig)

    raw = run_virtual(main)
    rig: Any = ErrorRig(used, None, None, LoopClock(), PATIENCE)  # type: ignore[arg-type]
    return error_capture(rig, raw, 1)


class Turning(Disturbed):
    """A modulo axis takes the shortest way round."""

    async def move(self, target: float) -> None:
        """The place is counted on over whole turns."""
        here = float(self.at(np.array([self.clock.now()]))[0])
        await super().move(here + wrap_deg(target - here))


def table_axis(count: int) -> Any:
    """C1, modulo, with so many targets around."""
    data = {**AXIS.model_dump(), "name": "C1", "letter": "C", "kind": "rotary", "modulo": True, "travel": (0.0, 360.0)}
    data["measure"] |= {"component": "ECC", "between": 0, "stable": 5.0, "repetitions": 3, "overrun": 2.0}
    data["measure"]["targets"] = {"first": 0.0, "last": 360.0 - 360.0 / count, "count": count}
    data["table"] = {"minimum": 0.0, "maximum": 360.0, "step": 360.0 / count}
    return AxisSection.model_validate(data)


def judged(found: Capture, within_um: float = 0.4) -> None:
    """Nothing is out of line any more, and every reading is the truth's."""
    assert found.suspects == ()
    true = _error_um(found.targets)
    off = found.deviations - true[:, None, None]
    assert np.ptp(off - off.mean(axis=0)) < within_um
    require_complete(found)


@pytest.mark.parametrize("bad", few((0, 8, 35, 5, 17, 25), 3))
def test_one_reading_out_of_line_in_any_pass_is_taken_again(bad: int) -> None:
    found = positioned((bad,))
    judged(found)
    assert any("outlier" in note for note in map(str, found.notes))


def test_nothing_is_taken_again_where_nothing_is_out_of_line() -> None:
    assert not any("again" in note for note in map(str, positioned(()).notes))


@pytest.mark.parametrize("bad", few((9, 0, 30), 1))
def test_it_is_taken_again_with_the_level_of_its_own_pass(bad: int) -> None:
    """The zero has moved by 20 um until the end: what is taken then belongs to the pass it stands in."""
    judged(positioned((bad,), drift_um_per_s=0.05), within_um=1.5)


@pytest.mark.parametrize("again", [36, 37])
def test_a_retake_that_is_off_again_is_taken_once_more(again: int) -> None:
    """36 stops are the capture; then come one neighbour, the one in doubt and two more neighbours."""
    judged(positioned((9, again)))


def test_a_modulo_axis_may_reach_a_retake_the_other_way_round() -> None:
    """From 67.5 to 270 deg through zero: the count then lacks a turn, and that is no switched sign."""
    used = table_axis(16)
    nothing = SenseProof(instrument="laser", axis="C1", sense=1, scale=1.0, evidence=(0.0, 0.0))

    async def main() -> RawCapture:
        clock, rng = LoopClock(), np.random.default_rng(3)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            laser = rng.normal(0.0, 1e-5, position.shape) + machine.shift_mm(times)
            return np.stack([laser + 1e-5 * np.sin(7.0 * machine.number), -position], axis=-1)

        machine = Turning(clock, reads, channels=("laser_deg", "device_deg"))
        machine.bad = (1, 32 + 15)
        return await capture_axis(Rig(used, machine, machine, clock, PATIENCE), nothing)

    found = from_live(used, run_virtual(main), nothing, "air+material")
    assert found.suspects == ()
    assert not any("beam" in note for note in map(str, found.notes))
    assert np.ptp(found.deviations) < 1.0


@pytest.mark.parametrize("bad", few((14, 3), 1))
@pytest.mark.parametrize("repetitions", [2, 3])
def test_an_error_motion_too_and_of_two_readings_that_disagree_both(bad: int, repetitions: int) -> None:
    found = straightened((bad,), repetitions)
    assert np.abs(found.deviations - found.deviations.mean(axis=(1, 2), keepdims=True)).max() < 0.4


@pytest.mark.parametrize("bad", [0, 2])
def test_one_reading_out_of_line_in_a_jog_is_no_wrong_mounting(bad: int) -> None:
    assert straightened((bad,), 2, jogged=True).suspects == ()


def test_optics_seem_touched_once_are_taken_again_and_seem_touched_twice_refuse_the_set_up() -> None:
    assert straightened((9,), 3, off_um=2000.0).suspects == ()
    with pytest.raises(CaptureError) as caught:
        straightened((9, 10), 3, off_um=2000.0)
    assert caught.value.code == "E-SETUP-TOUCHED"


def test_what_stays_out_of_line_is_refused_before_the_set_up_is_left() -> None:
    found = positioned((9, 37, 41))
    with pytest.raises(Incomplete) as caught:
        require_complete(found)
    assert caught.value.code == "E-CAP-INCOMPLETE"
    assert (caught.value.fields["places"], caught.value.fields["named"]) == (1, f"{found.targets[2]:g}-")


def resumed(folder: Path, capture: Capture, *, hours: float = 1.0, pushed: bool = False) -> list[str]:
    """What a resume finds left to measure of X, whose capture is stored."""
    site = SiteFile.model_validate(site_data())
    one = next(one for one in plan_setups(site) if one.key == "EXX-X1")
    run = Store(folder).create("grinder")
    run.write_text("setup-EXX-X1.json", one.setup.model_dump_json())
    run.put(stages.setup("EXX-X1"), capture)
    if pushed:
        run.put(stages.push("X1"), capture)
    now = datetime.fromisoformat(capture.ended_utc) + timedelta(hours=hours)
    return [left.key for left in _setups_to_measure(run, (one,), now, silence)]


def test_a_resume_measures_anew_what_no_table_could_be_pushed_from(tmp_path: Path) -> None:
    """An earlier version may have stored it; once something was pushed, what it was made from stays."""
    good, bad = positioned(()), positioned((9, 37, 41))
    assert resumed(tmp_path / "good", good) == []
    assert resumed(tmp_path / "old", good, hours=25.0) == ["EXX-X1"]
    assert resumed(tmp_path / "bad", bad) == ["EXX-X1"]
    assert resumed(tmp_path / "pushed", bad, pushed=True) == []


@pytest.mark.parametrize(("asked", "word"), [(2, "a push needs"), (3, "as many as"), (5, "")])
def test_a_site_that_asks_for_no_more_than_the_least_is_told(asked: int, word: str) -> None:
    data = site_data()
    for one in data["axes"]:
        one["measure"]["repetitions"] = asked
    told = remarks(SiteFile.model_validate(data))
    assert len(told) == (3 if word else 0)
    assert all(word in line and "to 5 or more" in line for line in map(str, told))


def test_a_site_that_asks_for_two_repetitions_is_whole_with_two() -> None:
    require_complete(positioned((), repetitions=2))


def test_what_an_onlooker_asks_for_is_taken_again_though_nothing_is_wrong_and_every_reading_is_told() -> None:
    told: list[dict[str, Any]] = []
    looking = LiveObserver(lambda kind, data: told.append(dict(data)) if kind == "taken" else None, LoopClock())
    target = float(positioned(()).targets[2])
    assert looking.ask_again("X1", (target, 2, 1))
    with looked_on_by(looking):
        capture = positioned(())
    assert any("measured again" in note and f"{target:g}+ repetition 2" in note for note in map(str, capture.notes))
    places = [(one["target"], one["repetition"], one["approach"]) for one in told]
    assert places.count((target, 2, 1)) == 2
    assert len(set(places)) == TARGETS * 3 * 2
    assert looking.asked_again("X1") == ()
