"""Signs of several tables in one transaction: each trial table is on at its own stops alone; all old ones return."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.errors import BeamObstructed, TrueflankError
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import LiveTable
from gateway.errors import VerifyError
from gateway.push import Reading, ReadStop, SignQuestion, prove_signs, unfinished_tables
from tests.sizes import few
from tests.unit.push.double import MACHINE, OLD, Bench, Killed, Machine, Reaper, deadline, journals_of, refuse
from tests.unit.push.test_batches import old, recovered
from tests.unit.push.test_cross import stage
from tests.unit.push.test_recovery import journal_under

OLD_ON = LiveTable(OLD, enabled=True)
BORROWED = (2, 3)


def machine_of() -> Machine:
    """An axis table that is on, a cross table that is on and one that is off: all three numbers are borrowed."""
    return Machine(OLD_ON, cross=tuple(old(index) for index in BORROWED))


def trials_on(machine: Machine) -> list[str]:
    """Which of the three tables act, whatever they hold."""
    cross = [f"cec{one.table.index}" for one in machine.cross if one.enabled and machine.cec_on]
    return ["X1"] * machine.own.enabled + cross


@dataclass
class Watching:
    """An instrument that reads what the machine does, and notes what acts whenever it is mounted or read."""

    at: Bench
    fails_at: int = -1
    mounted: list[str] = field(default_factory=list)
    seen: list[tuple[bool | None, list[str]]] = field(default_factory=list)

    def plans(self, axis: str) -> Sequence[StopPlan]:
        assert axis == "X1"
        return ()

    async def on(self, axis: str) -> Reading:
        assert trials_on(self.at.machine) == [], "it would be mounted while a trial table acts"
        self.mounted.append(axis)
        return self.reading

    @asynccontextmanager
    async def reading(self) -> AsyncIterator[ReadStop]:
        async def read(stop: Stop) -> tuple[float, float]:
            if len(self.seen) == self.fails_at:
                raise BeamObstructed("E-CAP-BEAM", "laser", at_s=1.0)
            machine = self.at.machine
            self.seen.append((stop.switch, trials_on(machine)))
            return 10.0 - machine.compensation + machine.crossing, 0.05

        yield read


def questions(at: Bench) -> list[SignQuestion]:
    own = replace(at.context, input=None)
    cross = [SignQuestion(at.context, 0.0, 400.0, 50.0, "cross", index) for index in BORROWED]
    return [SignQuestion(own, 0.0, 400.0, 50.0), *cross]


def prove(at: Bench, eyes: Watching) -> tuple[SignProof | VerifyError, ...]:
    return run_virtual(lambda: prove_signs(questions(at), eyes))


def as_before(machine: Machine) -> bool:
    return (machine.own, machine.cross, machine.cec_on) == (OLD_ON, tuple(old(index) for index in BORROWED), True)


def test_one_transaction_proves_all_and_none_acts_but_where_it_is_measured(tmp_path: Path) -> None:
    at = stage(tmp_path, machine=machine_of())
    at.controller.batches = True
    eyes = Watching(at)
    found = prove(at, eyes)
    assert [(one.kind, one.sign) for one in found if isinstance(one, SignProof)] == [
        ("axis", 1),
        ("cross", -1),
        ("cross", -1),
    ]
    assert eyes.mounted == ["X1"]
    own, borrowed = [["X1"]], [[f"cec{index}"] for index in BORROWED]
    assert [acting for switch, acting in eyes.seen if switch] == own * 3 + [one for one in borrowed for _ in range(3)]
    assert all(acting == [] for switch, acting in eyes.seen if not switch)
    assert at.machine.writes == ["sign-proof"] * 3 + ["restore"] * 3
    calls = at.controller.calls
    assert (calls["stage"], calls["activate"], calls["restarted"]) == (2, 2, 2)
    assert as_before(at.machine)
    (told,) = journals_of(tmp_path)
    assert told.is_ended


def test_what_fails_while_one_is_measured_takes_all_away_by_one_program(tmp_path: Path) -> None:
    at = stage(tmp_path, machine=machine_of())
    at.controller.batches = True
    with pytest.raises(BeamObstructed):
        prove(at, Watching(at, fails_at=8))
    assert as_before(at.machine)
    assert at.controller.calls["stage"] == 2


def proved_by(root: Path, reaper: Reaper, monkeypatch: pytest.MonkeyPatch) -> Bench:
    at = stage(root, machine=machine_of(), reaper=reaper)
    at.controller.batches = True
    with journal_under(reaper, monkeypatch):
        prove(at, Watching(at))
    return at


@pytest.mark.parametrize("every", few([19, 5, 1], 1, 1))
def test_killed_at_any_step_the_old_tables_return(tmp_path: Path, every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Reaper()
    (tmp_path / "whole").mkdir()
    proved_by(tmp_path / "whole", whole, monkeypatch)
    for step in range(3, whole.count, every):
        root = tmp_path / str(step)
        root.mkdir()
        reaper = Reaper(step)
        at = stage(root, machine=machine_of(), reaper=reaper)
        at.controller.batches = True
        with journal_under(reaper, monkeypatch), pytest.raises(Killed):
            prove(at, Watching(at))
        recovered(root, at.machine)
        assert not unfinished_tables(root / "journal", MACHINE.serial), step
        assert as_before(at.machine), step


@pytest.mark.parametrize(
    "call", ["stage", "read_back", "activate", "confirm", "restarted", "wait_stop", "saved_tables"]
)
@pytest.mark.parametrize("number", few([2, 1, 3, 4], 1))
def test_whatever_fails_on_the_way_the_old_tables_return_or_stay_off(tmp_path: Path, call: str, number: int) -> None:
    for fault, when in ((refuse, "before"), (deadline, "after")):
        root = tmp_path / when
        root.mkdir()
        at = stage(root, machine=machine_of())
        at.controller.batches = True
        at.controller.faults[(call, number, when)] = fault
        try:
            prove(at, Watching(at))
        except TrueflankError:
            assert as_before(at.machine) or trials_on(at.machine) == [] or not held_new(at)
        recovered(root, at.machine)
        assert as_before(at.machine)


def held_new(at: Bench) -> bool:
    """Whether a table that acts holds what was tried."""
    olds = {OLD, *(old(index).table for index in BORROWED)}
    tables = [at.machine.own.table, *(one.table for one in at.machine.cross if one.enabled and at.machine.cec_on)]
    return any(table not in olds for table in tables)
