"""The table of transitions of a push: every path of it, what it says of the table, and what it does not allow."""

from __future__ import annotations

import random

import pytest

from gateway.errors import IllegalTransition
from gateway.push.phases import FINAL, INITIAL_STATE, TRANSITIONS, PushEvent, PushPhase, PushState, Switch, state_of

ANNOUNCED = (PushEvent.DISABLE, PushEvent.ENABLE, PushEvent.SWITCH_OFF)
READ_OFF = (PushEvent.OFF, PushEvent.LEFT_DISABLED)


def nexts(state: PushState) -> list[PushEvent]:
    return [one.event for one in TRANSITIONS if state.phase in one.sources]


def paths(seed: int, length: int = 40) -> list[PushEvent]:
    """A path through the table, as long as one may go on."""
    draw, state, path = random.Random(seed), INITIAL_STATE, []
    while len(path) < length and (may := nexts(state)):
        path.append(draw.choice(may))
        state = state.after(path[-1], {})
    return path


def test_each_event_has_one_line_and_each_phase_a_way_in_and_a_way_to_an_end() -> None:
    assert [one.event for one in TRANSITIONS] == list(dict.fromkeys(one.event for one in TRANSITIONS))
    assert {one.event for one in TRANSITIONS} == set(PushEvent)
    assert {one.target for one in TRANSITIONS} | {PushPhase.NOTHING} == {*PushPhase, None}
    ends = set(FINAL)
    while (
        more := {phase for phase in PushPhase for one in TRANSITIONS if phase in one.sources and one.target in ends}
        - ends
    ):
        ends |= more
    assert ends == set(PushPhase)


@pytest.mark.parametrize("phase", sorted(FINAL))
def test_nothing_follows_an_end(phase: PushPhase) -> None:
    assert nexts(PushState(phase)) == []
    for event in PushEvent:
        with pytest.raises(IllegalTransition, match="E-PUSH-TRANSITION"):
            PushState(phase).after(event, {})


@pytest.mark.parametrize("seed", range(300))
def test_what_a_path_says_of_the_table_is_what_was_announced_and_read(seed: int) -> None:
    """By other words than the table's: the newest announcement or reading on the way decides."""
    path = paths(seed)
    state = state_of((event, {}) for event in path)
    written = [event for event in path if event in (*ANNOUNCED, *READ_OFF, PushEvent.STILL_ON, PushEvent.HELD)]
    newest = written[-1] if written else None
    if state.phase is PushPhase.COMMITTED:
        assert state.switch is Switch.NEW
    elif state.phase is PushPhase.ROLLED_BACK:
        assert state.switch is Switch.OLD
    elif path[-1] is PushEvent.UNTOUCHED:  # the control showed that nothing of what was announced began
        assert state.switch is Switch.UNTOUCHED
    elif newest in ANNOUNCED:
        assert state.switch is Switch.UNKNOWN
    elif newest in READ_OFF:
        assert state.switch is Switch.OFF
    else:
        assert state.switch is (Switch.UNTOUCHED if newest is None else Switch.ON)


@pytest.mark.parametrize("seed", range(300))
def test_a_new_table_ends_live_only_after_it_was_compared_and_released(seed: int) -> None:
    path = paths(seed)
    if path[-1] is not PushEvent.COMMITTED or PushEvent.DISABLE not in path or PushEvent.RECOVERING in path:
        return
    since = path[len(path) - 1 - path[::-1].index(PushEvent.DISABLE) :]
    order = [since.index(event) for event in (PushEvent.DISABLE, PushEvent.LOADED, PushEvent.ENABLE)]
    assert order == sorted(order)


def test_a_hold_is_as_loud_as_its_last_reading() -> None:
    held = PushState(PushPhase.LOADING, Switch.UNKNOWN)
    assert held.after(PushEvent.HELD, {"on": False}).switch is Switch.OFF
    assert held.after(PushEvent.HELD, {"on": True}).switch is Switch.ON
    assert held.after(PushEvent.HELD, {}).switch is Switch.ON


def test_a_line_of_a_newer_program_changes_nothing() -> None:
    lines = [("LEASED", {}), ("SNAPSHOT", {}), ("DISABLE", {}), ("MADE_UP_LATER", {})]
    assert state_of(lines) == PushState(PushPhase.LOADING, Switch.UNKNOWN)
