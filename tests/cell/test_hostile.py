"""Machines whose errors hide from the plan are refused, no worse than stated, or called worse: judged by the truth."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import TrueflankError
from drivers.message import prose
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder
from gateway.workflow.run import stages
from simulators.cell import Cell
from simulators.cellfile import CellFile, load_cell
from simulators.truth import AxisMotion
from tests.cell.bench import Judged, main_job, short
from tests.steps import said

During = Callable[[Cell], Awaitable[None]]
Term = dict[str, Any]


def wave(order: int, amplitude: float) -> Term:
    return {"kind": "harmonic", "order": order, "amplitude": amplitude, "phase_deg": 15.0}


def period(length: float, amplitude: float) -> Term:
    return {"kind": "harmonic", "period": length, "amplitude": amplitude, "phase_deg": 15.0}


def bump(at: float, half: float, height: float) -> Term:
    return {"kind": "table", "positions": (at - half, at, at + half), "values": (0.0, height, 0.0)}


def with_terms(motion: str, *terms: Term, even: bool = False) -> CellFile:
    """The demo machine with more error; ``even`` targets have no random offsets."""
    cell = load_cell("demo").model_dump()
    cell["truth"]["motions"][motion] += terms
    for axis in cell["axes"]:
        if even and axis["measure"]:
            axis["measure"]["targets"]["offset_fraction"] = 0.0
    return CellFile.model_validate(cell)


def with_axis(name: str, **keys: Any) -> CellFile:
    cell = load_cell("demo").model_dump()
    next(axis for axis in cell["axes"] if axis["name"] == name).update(keys)
    return CellFile.model_validate(cell)


def with_laser(**noise: Any) -> CellFile:
    cell = load_cell("demo").model_dump()
    next(one for one in cell["instruments"] if one["name"] == "laser")["noise"].update(noise)
    return CellFile.model_validate(cell)


def hot() -> CellFile:
    cell = load_cell("demo").model_dump()
    cell["climate"]["material_degc"].update(start=24.0, per_h=2.0)
    return CellFile.model_validate(cell)


def moving(extra: Callable[[str, AxisMotion, float], np.ndarray | float]) -> During:
    """What the axis does beyond its truth, from now on: ``extra`` (letter, motion, s) in um or arcsec."""

    async def during(cell: Cell) -> None:
        usual = cell.truth.along

        def along(letter: str, motion: AxisMotion, t: float) -> np.ndarray:
            return np.asarray(usual(letter, motion, t) + extra(letter, motion, t))

        cell.truth.along = along  # type: ignore[method-assign]

    return during


def jump(um: float, at_s: float) -> During:
    """The whole reading steps once, as when a reflector is touched."""
    return moving(lambda letter, _motion, t: um if letter == "X" and t > at_s else 0.0)


def loose(um: float) -> During:
    """A loose gib: a reversal that depends on the place and on the minute."""

    def extra(letter: str, motion: AxisMotion, t: float) -> np.ndarray | float:
        if letter != "X" or t == 0.0:
            return 0.0
        share = np.random.default_rng([7, int(t // 60.0)]).uniform(0.0, 1.0)
        return -0.5 * um * share * motion.direction * np.abs(np.sin(motion.position / 47.0))

    return moving(extra)


@dataclass(frozen=True)
class End:
    """How a run ended, its words, and the truth of its one axis before and after."""

    judged: Judged | None
    words: str
    stated: float = 0.0
    tabled: bool = False
    """Whether the axis' own table was proposed; its reversal stands beside it and is judged by itself."""

    @property
    def pushed(self) -> bool:
        return self.judged is not None and self.judged.outcome.data["outcome"] != "not-pushed"


def run(folder: Path, cell: CellFile, axis: str, count: int, repetitions: int, **keys: Any) -> End:
    during = keys.pop("during", None)
    try:
        judged = main_job(folder, cell, during=during, edit=short((axis,), count, repetitions, **keys))
    except TrueflankError as error:
        return End(None, str(error))
    change = RunFolder(Path(judged.outcome.run_folder)).get(stages.PROPOSAL, Proposal).changes[0]
    told = " ".join(map(str, judged.outcome.lines))
    return End(judged, told, float(np.max(change.predicted_U)), tabled=not change.skipped)


def never_silently_worse(end: End, axis: str) -> None:
    """Not written; or no worse than stated by the truth; or called worse, with the way back."""
    if not end.pushed or end.judged is None:
        return
    before, after = end.judged.before[axis], end.judged.after[axis]
    called = end.judged.outcome.data["outcome"] == "worse"
    assert called or after["M"] <= before["M"] + end.stated, end.words
    assert (end.judged.outcome.exit_code == 9) == called
    assert ("trueflank rollback SITE --axis" in end.words) == called


def cec_by_itself() -> During:
    """Somebody left a CEC table on that moves C by C."""

    async def during(cell: Cell) -> None:
        for name, value in (("STEP", 30.0), ("MIN", 0.0), ("MAX", 360.0)):
            cell.nck.set(f"$AN_CEC_{name}[2]", value, 0)
        for name in ("INPUT", "OUTPUT"):
            cell.nck.set(f"$AN_CEC_{name}_AXIS[2]", "C1", 0)
        for point, arcsec in enumerate((0, 4, 8, 4, 0, -4, -8, -4, 0, 2, 4, 2, 0)):
            cell.nck.set(f"$AN_CEC[2,{point}]", arcsec / 3600.0, 0)
        cell.nck.set("$SN_CEC_TABLE_ENABLE[2]", 1, 0)
        cell.nck.set("$MA_CEC_ENABLE[C1]", 1, 0)

    return during


def test_a_wave_that_looks_like_the_first_harmonic_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """Order 25 at 24 even targets cannot be told from order 1, and there is no time for more of them."""
    end = run(tmp_path, with_terms("ECC", wave(25, 12.0), even=True), "C1", 24, 3, extra_hours=0.0)
    assert not end.tabled
    assert "S-COMP-HIDDEN" in end.words
    never_silently_worse(end, "C1")
    assert end.judged is not None
    hidden = [fields["words"] for code, fields in end.judged.said if code == "P-HIDDEN"]
    assert "6 check stops between the targets deviate from the curve by" in prose(hidden[0])


@pytest.mark.long
def test_measured_without_check_stops_it_is_found_after_the_push(tmp_path: Path) -> None:
    end = run(tmp_path, with_terms("ECC", wave(25, 12.0), even=True), "C1", 24, 4, between=0)
    assert end.judged is not None
    assert end.judged.after["C1"]["M"] > end.judged.before["C1"]["M"]
    assert end.judged.outcome.data["outcome"] == "worse"
    never_silently_worse(end, "C1")


@pytest.mark.long
def test_cec_left_on_is_not_built_into_the_axis_own_table(tmp_path: Path) -> None:
    end = run(tmp_path, load_cell("demo"), "C1", 9, 3, during=cec_by_itself())
    assert not end.tabled
    assert "S-COMP-CROSS-ON" in end.words
    never_silently_worse(end, "C1")


@pytest.mark.long
def test_a_loose_gib_is_told_what_no_table_cures(tmp_path: Path) -> None:
    end = run(tmp_path, load_cell("demo"), "X1", 9, 3, during=loose(15.0))
    never_silently_worse(end, "X1")
    # Its minute decides whether a sign can be proved on it at all; without one nothing is pushed.
    assert end.judged is not None or end.words.startswith("E-PUSH-NO-PROOF")
    (run_folder,) = (path.parent for path in tmp_path.rglob("run.json"))
    before = RunFolder(run_folder).get(stages.evaluation("X1", "before"), Evaluation)
    assert any("are reversal and scatter, which the axis table does not change" in line for line in said(before))


LONG: dict[str, tuple[str, Callable[[], CellFile], dict[str, Any]]] = {
    **{f"C order {n}": ("C1", lambda n=n: with_terms("ECC", wave(n, 36.0)), {}) for n in (12, 24, 36, 39, 48, 72)},
    **{f"C even {n}": ("C1", lambda n=n: with_terms("ECC", wave(n, 9.0), even=True), {}) for n in (23, 24, 48)},
    **{f"X period {p}": ("X1", lambda p=p: with_terms("EXX", period(p, 7.0)), {}) for p in (10.0, 20.0, 21.0, 40.0)},
    "X bump between targets": ("X1", lambda: with_terms("EXX", bump(-150.0, 2.5, 6.0)), {}),
    "C bump between targets": ("C1", lambda: with_terms("ECC", bump(97.0, 1.0, 20.0)), {}),
    "C bump at a target": ("C1", lambda: with_terms("ECC", bump(120.0, 1.0, 20.0)), {}),
    "X hysteresis": ("X1", lambda: with_axis("X1", hysteresis={"size": -15.0, "distance": 2.0}), {}),
    "X bad repeatability": ("X1", lambda: with_laser(stop=2.0), {}),
    "X outliers": ("X1", lambda: with_laser(outliers={"count": 10, "size": 8.0, "every": 100}), {}),
    "X drift": ("X1", lambda: with_axis("X1", drift_per_h=6.0), {}),
    "X drift, pendulum": ("X1", lambda: with_axis("X1", drift_per_h=6.0), {"cycle": "pendulum"}),
    "X jump": ("X1", lambda: load_cell("demo"), {"during": jump(3.0, 300.0)}),
    "X loose": ("X1", lambda: load_cell("demo"), {"during": loose(15.0)}),
    "X hot": ("X1", hot, {}),
}


@pytest.mark.soak
@pytest.mark.parametrize("name", LONG)
def test_hostile_machines_with_the_whole_plan(tmp_path: Path, name: str) -> None:
    axis, cell, keys = LONG[name]
    never_silently_worse(run(tmp_path, cell(), axis, 24 if axis == "C1" else 21, 4, **keys), axis)


@pytest.mark.soak
@pytest.mark.parametrize("at_s", [120.0, 240.0, 480.0])
def test_a_jump_is_named_and_does_no_harm(tmp_path: Path, at_s: float) -> None:
    end = run(tmp_path, load_cell("demo"), "X1", 21, 4, during=jump(3.0, at_s))
    assert end.judged is not None
    capture = RunFolder(Path(end.judged.outcome.run_folder)).get(stages.capture("X1", "before"), Capture)
    assert any("jump by +" in note for note in map(str, capture.notes))
    assert end.judged.after["X1"]["M"] <= 2.0
