"""Instruments that lie, in whole runs: each ends with its reason, or with the figure that the machine really has.

The lie is put into what the simulated instrument sends: a wrong unit, a value that stands still, steps of a quarter
wave, bursts of what is no number, time that goes backwards, ten times the rate. The cell's truth is the judge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.bridge.codec import SampleFrame
from drivers.errors import TrueflankError
from drivers.umd.codec import DISPLACEMENT, SEQUENCE
from simulators.bridge import BridgeServer
from simulators.cell import Cell
from simulators.umd import UmdServer
from tests.cell.bench import main_job, short
from tests.sizes import long

FIGURES = {"M": 0.3, "B": 0.5}
"""How far a short run's figures may be from the truth, as a share; and 0.3 um or arcsec."""
LEAST = 0.3
QUARTER_COUNTS = 8  # counts_per_cycle of the demo is 16, a cycle half a wave
BEGINS = 5


@dataclass
class Lie:
    """What an instrument sends once it lies: from the first byte on, or from a stop of the run on."""

    at_once: bool = False
    lying: bool = False
    stops: int = 0
    blocks: int = 0
    kept: Any = None
    told: int = 0
    notes: list[str] = field(default_factory=list)

    def heard(self, _cell: Cell, code: str, fields: dict[str, object]) -> None:
        """A stop is done."""
        if code == "P-STOP" and str(fields["program"]).startswith("TFMEAS"):
            self.stops = int(str(fields["done"]))
            self.lying = self.lying or self.stops >= BEGINS


Rows = np.ndarray[Any, np.dtype[np.int64]]


def ten_times(lie: Lie, rows: Rows) -> Rows:
    """Another unit: every count is ten."""
    rows[:, DISPLACEMENT[0]] *= 10
    return rows


def frozen(lie: Lie, rows: Rows) -> Rows:
    """The value stands still, and the lines go on."""
    lie.kept = rows[-1, DISPLACEMENT[0]] if lie.kept is None else lie.kept
    rows[:, DISPLACEMENT[0]] = lie.kept
    return rows


def quarter_waves(lie: Lie, rows: Rows) -> Rows:
    """A quarter of a wave lost at every stop: half a cycle of the counter."""
    rows[:, DISPLACEMENT[0]] += QUARTER_COUNTS * max(lie.stops - BEGINS, 0)
    return rows


def backwards(lie: Lie, rows: Rows) -> Rows:
    """Lines numbered backwards, in every third block."""
    if lie.blocks % 3 == 0:
        rows[:, SEQUENCE] = rows[::-1, SEQUENCE]
    return rows


def too_fast(lie: Lie, rows: Rows) -> Rows:
    """Ten lines for each that the rate allows, numbered through."""
    first = int(rows[0, SEQUENCE])
    rows = np.repeat(rows, 10, axis=0)
    rows[:, SEQUENCE] = 10 * first + np.arange(len(rows))
    return rows


def no_number(lie: Lie, data: bytes) -> bytes:
    """Every third block is no numbers at all."""
    return b"nan nan nan nan nan nan nan nan\r\n" * data.count(b"\n") if lie.blocks % 3 == 0 else data


def laser_lies(monkeypatch: pytest.MonkeyPatch, lie: Lie, how: Callable[[Lie, Any], Any]) -> None:
    """The laser's counter lies."""
    honest, sends = UmdServer.rows, UmdServer._send

    def rows(self: UmdServer, counts: Any) -> Any:
        found = honest(self, counts)
        if not (lie.lying or lie.at_once):
            return found
        lie.blocks += 1
        lie.told += 1
        return found if how is no_number else how(lie, found)

    async def send(self: UmdServer, data: bytes) -> None:
        await sends(self, no_number(lie, data) if how is no_number and (lie.lying or lie.at_once) else data)

    monkeypatch.setattr(UmdServer, "rows", rows)
    monkeypatch.setattr(UmdServer, "_send", send)


def radians(_lie: Lie, frame: SampleFrame) -> SampleFrame:
    """Another unit: rad in place of deg."""
    return replace(frame, values=np.deg2rad(frame.values))


def stuck(lie: Lie, frame: SampleFrame) -> SampleFrame:
    """The value stands still."""
    lie.kept = frame.values[-1].copy() if lie.kept is None else lie.kept
    return replace(frame, values=np.tile(lie.kept, (len(frame.values), 1)))


def nan_bursts(lie: Lie, frame: SampleFrame) -> SampleFrame:
    """Every third frame is NaN, and says that it is valid."""
    return replace(frame, values=np.full_like(frame.values, np.nan)) if lie.blocks % 3 == 0 else frame


def back_in_time(lie: Lie, frame: SampleFrame) -> SampleFrame:
    """Every third frame is of five seconds before."""
    return replace(frame, t0_s=frame.t0_s - 5.0) if lie.blocks % 3 == 0 else frame


def quicker(_lie: Lie, frame: SampleFrame) -> SampleFrame:
    """Samples ten times as often as the device said."""
    return replace(frame, values=np.repeat(frame.values, 10, axis=0), dt_s=frame.dt_s / 10.0)


def calibrator_lies(monkeypatch: pytest.MonkeyPatch, lie: Lie, how: Callable[[Lie, Any], Any]) -> None:
    """The rotary calibrator lies."""
    honest = BridgeServer._told

    def told(self: BridgeServer, turns: Any, sequence: int) -> Any:
        found = honest(self, turns, sequence)
        if type(self) is not BridgeServer or not (lie.lying or lie.at_once):
            return found
        lie.blocks += 1
        lie.told += 1
        return [how(lie, one) if isinstance(one, SampleFrame) else one for one in found]

    monkeypatch.setattr(BridgeServer, "_told", told)


@dataclass(frozen=True)
class Case:
    """A lie, when it begins, and the reasons with which a run may end ("": with the right figure)."""

    axis: str
    how: Callable[[Lie, Any], Any]
    at_once: bool
    ends: tuple[str, ...]

    @property
    def name(self) -> str:
        return f"{self.axis} {self.how.__name__} {'from the start' if self.at_once else 'in mid-run'}"


FIGURE = ""
ENDS: dict[str, dict[Callable[[Lie, Any], Any], tuple[str, str]]] = {
    "X1": {
        ten_times: ("E-CAP-SENSE", "E-CAP-BEAM"),
        frozen: ("E-CAP-SENSE", "E-CAP-BEAM"),
        quarter_waves: (FIGURE, FIGURE),
        backwards: ("E-UMD-BACKWARDS", "E-UMD-BACKWARDS"),
        too_fast: (FIGURE, "E-CAP-BEAM"),
        no_number: (FIGURE, FIGURE),
    },
    "C1": {
        radians: ("E-CAP-SENSE", "E-CAP-UNIT"),
        stuck: ("E-CAP-SENSE", "E-CAP-COUNT"),
        nan_bursts: ("E-BRIDGE-MESSAGE", "E-BRIDGE-MESSAGE"),
        back_in_time: ("E-LINK-BROKEN", "E-BRIDGE-CLOCK"),
        quicker: ("E-LINK-STALE", "E-LINK-STALE"),
    },
}
"""How a run with each lie ends: from the first byte on, and from a stop on."""
CASES = [
    Case(axis, how, at_once, (end,))
    for axis, lies in ENDS.items()
    for how, ends in lies.items()
    for at_once, end in zip((True, False), ends, strict=True)
]
QUICK = "C1 radians from the start"


def lied_to(folder: Path, monkeypatch: pytest.MonkeyPatch, case: Case) -> str:
    """How a run with this lie ends: the code of its error, or "" with figures that are held to the truth."""
    lie = Lie(case.at_once)
    (laser_lies if case.axis == "X1" else calibrator_lies)(monkeypatch, lie, case.how)
    try:
        judged = main_job(folder, apply=False, edit=short((case.axis,)), heard=lie.heard)
    except TrueflankError as error:
        return error.code if lie.told and error.exit_code not in (0, 1) else f"{error.code}, exit {error.exit_code}"
    assert lie.told, "it never lied"
    measured, truth = judged.outcome.data["axes"][case.axis]["before"], judged.before[case.axis]
    wrong = {
        name: (measured[name], truth[name])
        for name, share in FIGURES.items()
        if abs(measured[name] - truth[name]) > max(share * truth[name], LEAST)
    }
    assert wrong == {}, f"{case.name}: a figure that is not the machine's"
    return ""


@pytest.mark.parametrize(
    "case", [case if case.name == QUICK else long(case) for case in CASES], ids=lambda case: case.name
)
def test_a_lie_ends_with_its_reason_or_with_the_right_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: Case
) -> None:
    found = lied_to(tmp_path, monkeypatch, case)
    print(f"ENDS {case.name}: {found!r}")
    assert found in case.ends
