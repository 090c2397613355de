"""A push whose storage fails at every system call in turn, with every error, or loses its power there: never wrong."""

from __future__ import annotations

import errno
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import TrueflankError
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.push.recovery import recover_table, unfinished_tables
from gateway.push.transaction import push_table
from gateway.workflow.run.audit_trail import AuditAdapter
from tests.attacks import judged
from tests.push.syscalls import ERRNOS, Calls, caught
from tests.sizes import few
from tests.unit.approve.test_consents import At
from tests.unit.push.double import MACHINE, NEW, OLD, Bench, Killed, bench, change_of, only_old_or_new_enabled

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names of open files come from /proc")
OLD_ON, NEW_ON = LiveTable(OLD, enabled=True), LiveTable(NEW, enabled=True)
CUT = 0
UNSURE = {"E-PUSH-JOURNAL", "E-PUSH-HELD", "E-PUSH-HELD-ON", "E-PUSH-UNEXPECTED"}


def at_work(root: Path, machine: Any = None) -> Bench:
    """A bench over a real store: run folder, journal and audit log."""
    here = bench(root, machine=machine)
    runs = At.of(root, clock=here.context.clock)
    context = replace(here.context, folder=runs.folder, log=AuditAdapter(runs))  # type: ignore[arg-type]
    return Bench(here.machine, here.controller, context, here.told)


def untrue(here: Bench, ended: PushRecord | TrueflankError | None) -> str:
    """What of a push's word is not true of the control; None: it was killed and said nothing."""
    machine = here.machine
    if not only_old_or_new_enabled(machine, OLD, NEW):
        return "neither the old nor the new table"
    if isinstance(ended, PushRecord):
        wanted = {"committed": NEW_ON, "rolled-back": OLD_ON, "refused": OLD_ON, "failed": OLD_ON}
        if ended.outcome in wanted and machine.own != wanted[ended.outcome]:
            return f"said {ended.outcome}"
        if ended.outcome == "held" and machine.own.enabled:
            return "said held"
    elif isinstance(ended, TrueflankError) and ended.code not in UNSURE and machine.own != OLD_ON:
        return f"said {ended.code}, and the control has changed"
    return ""


def led_home(root: Path, here: Bench) -> str:
    """What is wrong once a person has recovered what was left, on a good disk."""
    here.machine.nck_reset()
    left = unfinished_tables(root / "journal", MACHINE.serial)
    for found in left:
        again = at_work(root, here.machine)
        run_virtual(lambda found=found, again=again: recover_table(found, again.context))
    if unfinished_tables(root / "journal", MACHINE.serial):
        return "recovery has not ended it"
    if here.machine.own not in (OLD_ON, NEW_ON):
        return "recovery left neither the old nor the new table" if here.machine.own.enabled else "left off"
    return ""


def one_try(root: Path, nth: int, code: int) -> tuple[str, str, int]:
    """Call that failed ("": there are fewer), what was wrong, and how many places a push has."""
    root.mkdir()
    here = at_work(root)
    ended: PushRecord | TrueflankError | None = None
    calls = Calls(root, nth, code)
    try:
        with caught(calls):
            ended = run_virtual(lambda: push_table(change_of(here.machine), here.context))
    except TrueflankError as error:
        ended = error
    except Killed:
        calls.cut()
    except OSError as error:
        return calls.hit, f"an error that is not ours: {error!r}", calls.count
    wrong = untrue(here, ended)
    if wrong or not calls.hit:
        return calls.hit, wrong, calls.count
    try:
        return calls.hit, led_home(root, here), calls.count
    except TrueflankError as error:
        return calls.hit, f"recovery: {error}", calls.count


def places(root: Path) -> int:
    """How many system calls of our storage a push makes."""
    return one_try(root, -1, CUT)[2]


def test_a_push_without_a_fault_commits_and_makes_many_calls(tmp_path: Path) -> None:
    hit, wrong, count = one_try(tmp_path / "none", -1, CUT)
    assert (hit, wrong) == ("", "")
    assert count > 60


@pytest.mark.attack
@pytest.mark.parametrize("code", [CUT, *ERRNOS], ids=lambda code: errno.errorcode.get(code, "power cut"))
@pytest.mark.parametrize("part", few(range(24), 1, 23))
def test_every_call_fails_once_and_nothing_wrong_is_enabled_or_said(tmp_path: Path, code: int, part: int) -> None:
    """A quick run takes one place in 24, other ones for each error; a long one all."""
    every = range(1, places(tmp_path / "count") + 1)
    drawn = [nth for nth in every if nth % 24 == (part + code) % 24]
    tries = [one_try(tmp_path / f"{code}-{nth}", nth, code) for nth in drawn]
    assert all(hit for hit, _wrong, _count in tries)
    family = "the power cut, writes since the last fsync lost" if code == CUT else "a system call that fails once"
    judged(
        f"{family}, at every place of a push", "storage", [[wrong] if wrong else [] for _hit, wrong, _count in tries]
    )
    assert [(nth, hit, wrong) for nth, (hit, wrong, _count) in zip(drawn, tries, strict=True) if wrong] == []


def test_a_journal_that_is_not_synced_is_found_by_these_tries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge is no rubber stamp: with a disk that forgets the journal some tables are left off, and it says so."""
    real = Calls.fsynced

    def forgetful(self: Calls, path: Path) -> None:
        if "journal" not in path.parts:
            real(self, path)

    monkeypatch.setattr(Calls, "fsynced", forgetful)
    wrong = [one_try(tmp_path / str(nth), nth, CUT)[1] for nth in range(70, 140, 10)]
    assert "left off" in wrong
