"""A hand at the panel, or another gateway, between the proof of effect and the commit: never reported as committed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.message import render
from drivers.types.abilities import Marker
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.push.phases import PushEvent
from gateway.push.transaction import push_table
from tests.unit.push.double import NEW, Machine, bench, change_of

pytestmark = pytest.mark.attack("a hand between the proof and the commit", "port")

BY_HAND = replace(NEW, deviations=tuple(value + 0.5 * (value != 0.0) for value in NEW.deviations))
Act = Callable[[Machine], None]


def pushed(root: Path, act: Act, *, by_hand: bool) -> tuple[PushRecord, Machine]:
    """A push during which ``act`` happens as soon as the effect is proved."""
    at = bench(root, by_hand=by_hand)
    tell = at.context.say
    acted: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        tell(code, **fields)
        if fields.get("step") == PushEvent.EFFECT:
            acted.append(code)
            act(at.machine)

    record = run_virtual(lambda: push_table(change_of(at.machine), replace(at.context, say=say)))
    assert acted, [code for code, _ in at.told]
    return record, at.machine


def writes_values(machine: Machine) -> None:
    machine.become(LiveTable(BY_HAND, enabled=True))
    machine.acting = BY_HAND


def switches_off(machine: Machine) -> None:
    machine.become(LiveTable(machine.own.table, enabled=False))


def moves_the_axis(machine: Machine) -> None:
    machine.position += 37.5


def _reasons(record: PushRecord) -> str:
    return " ".join(render(reason, "en") for reason in record.reasons)


@pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "direct"])
def test_values_written_by_hand_are_somebody_elses(tmp_path: Path, by_hand: bool) -> None:
    record, machine = pushed(tmp_path, writes_values, by_hand=by_hand)
    assert record.outcome in ("held", "held-on")
    assert "neither the old nor the new" in _reasons(record)
    assert machine.own.table == BY_HAND  # left to a person, on or switched off
    assert machine.marker.state == "held"


@pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "direct"])
def test_a_table_switched_off_by_hand_goes_back(tmp_path: Path, by_hand: bool) -> None:
    record, machine = pushed(tmp_path, switches_off, by_hand=by_hand)
    assert record.outcome == "rolled-back"
    assert machine.own.enabled
    assert machine.own.table != NEW


@pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "direct"])
def test_another_gateways_marker_ends_in_a_hold_with_nothing_touched(tmp_path: Path, by_hand: bool) -> None:
    def another(machine: Machine) -> None:
        machine.marker = Marker(777_700_042, "committed")

    record, machine = pushed(tmp_path, another, by_hand=by_hand)
    assert record.outcome == "held-on"
    assert (machine.own.table, machine.own.enabled) == (NEW, True)
    assert machine.marker == Marker(777_700_042, "committed")


@pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "direct"])
def test_an_axis_that_was_moved_meanwhile_is_no_objection(tmp_path: Path, by_hand: bool) -> None:
    record, machine = pushed(tmp_path, moves_the_axis, by_hand=by_hand)
    assert record.outcome == "committed"
    assert machine.own == LiveTable(NEW, enabled=True)
