"""Two gateways at one control: whoever was frozen before its first write leaves alone what the other has done since."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded
from drivers.types.abilities import Marker
from drivers.types.machine import ChannelStatus
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.errors import BusyError, VerifyError
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.transaction import push_table
from tests.steps import lines
from tests.unit.push.double import MACHINE, NEW, Bench, Machine, bench, change_of, journals_of

pytestmark = pytest.mark.attack("another gateway pushes or loads in between", "port")


THEIRS = replace(NEW, deviations=(0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, 0.0))
NUMBER = 777_700_042
# Every request that A makes between its first look and its first write, and that write itself.
PLACES = [
    *(("marker", nth, when) for nth in (1, 2, 3) for when in ("before", "after")),
    *(("state", nth, "after") for nth in (1, 2)),
    ("saved_tables", 1, "after"),
    ("table_limits", 1, "after"),
    ("stage", 1, "before"),
]


def they_push(machine: Machine) -> None:
    """The other gateway pushes from beginning to end."""
    machine.end()
    machine.become(LiveTable(THEIRS, enabled=True))
    machine.acting, machine.marker = THEIRS, Marker(NUMBER, "committed")


def they_load(machine: Machine) -> None:
    """The other gateway's program waits between its halves, the table half written and off."""
    machine.end()
    half = replace(NEW, deviations=(*THEIRS.deviations[:4], *machine.own.table.deviations[4:]))
    machine.become(LiveTable(half, enabled=False))
    machine.marker, machine.channel, machine.phase = Marker(NUMBER, "in-progress"), ChannelStatus.INTERRUPTED, 4


def frozen(at: Bench, place: tuple[str, int, str], act: Any, *, broken: bool) -> list[Any]:
    """Let ``act`` happen at that request; ``broken``: the thawed gateway finds its session gone. What was then."""
    kept: list[Any] = []

    def meanwhile(machine: Machine) -> None:
        del at.controller.faults[place]
        act(machine)
        kept.append((machine.own, machine.marker, machine.channel, len(machine.history)))
        if broken:
            raise DeadlineExceeded("E-LINK-DEADLINE", "double", timeout_s=5.0)

    at.controller.faults[place] = meanwhile
    return kept


def push(at: Bench) -> PushRecord | str:
    """A's push; the code of what it raised."""
    try:
        return run_virtual(lambda: push_table(change_of(at.machine), at.context))
    except (BusyError, DeadlineExceeded, VerifyError) as error:
        return error.code


@pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "mailbox"])
@pytest.mark.parametrize("broken", [False, True], ids=["session lives", "session gone"])
@pytest.mark.parametrize("act", [they_push, they_load])
@pytest.mark.parametrize("place", PLACES, ids=lambda one: "-".join(map(str, one)))
def test_what_the_other_did_meanwhile_stays(
    tmp_path: Path, place: tuple[str, int, str], act: Any, broken: bool, by_hand: bool
) -> None:
    at = bench(tmp_path, by_hand=by_hand)
    at.machine.marker = Marker(123_400_001, "committed")
    kept = frozen(at, place, act, broken=broken)
    found = push(at)
    assert kept, "this request was made"
    if place[0] == "stage" and not broken and act is they_push:
        return  # it wrote in the very moment after its last look; what it meets is compared before it is changed
    assert (at.machine.own, at.machine.marker, at.machine.channel, len(at.machine.history)) == kept[0]
    assert at.machine.writes == []
    told = found if isinstance(found, str) else found.outcome
    assert told in ("E-PUSH-ANOTHER", "refused", "E-LINK-DEADLINE", "E-TEST-RESET"), told
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()


@pytest.mark.parametrize("act", [they_push, they_load])
def test_a_gateway_that_sent_nothing_says_who_is_there(tmp_path: Path, act: Any) -> None:
    at = bench(tmp_path)
    kept = frozen(at, ("stage", 1, "before"), act, broken=True)
    assert push(at) == "E-PUSH-ANOTHER"
    assert (at.machine.own, at.machine.marker) == kept[0][:2]
    assert "abort_program" not in at.controller.calls
    assert [one.kinds[-1] for one in journals_of(tmp_path)] == ["ABORTED"]


@pytest.mark.parametrize("call", ["read_back", "activate", "confirm", "restarted"])
def test_under_anothers_mark_nothing_is_restored_aborted_or_marked(tmp_path: Path, call: str) -> None:
    at = bench(tmp_path)
    kept = frozen(at, (call, 1, "before"), they_push, broken=True)
    record = push(at)
    assert isinstance(record, PushRecord)
    assert record.outcome == "held-on"  # theirs acts, and it is not ours to switch off
    assert "E-PUSH-ANOTHER" in " ".join(lines(record))
    assert (at.machine.own, at.machine.marker) == kept[0][:2]
    assert not {"abort_program", "finish_push"} & set(at.controller.calls)


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_killed_gateway_recovers_nothing_that_is_anothers(tmp_path: Path, when: str) -> None:
    at = bench(tmp_path)

    def killed(machine: Machine) -> None:
        raise KeyboardInterrupt

    at.controller.faults[("stage", 1, when)] = killed
    with pytest.raises(KeyboardInterrupt):
        push(at)
    at.controller.faults.clear()
    they_push(at.machine)
    kept = at.machine.own, at.machine.marker
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    finding = run_virtual(lambda: inspect_unfinished(found, at.context))
    assert (finding.code, finding.action) == ("R-PUSH-SUPERSEDED", "close")
    record = run_virtual(lambda: recover_table(found, at.context))
    assert record.outcome == "rolled-back"
    assert (at.machine.own, at.machine.marker) == kept
    assert at.machine.writes == []
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()
