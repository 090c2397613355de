"""What a push says of its table while it is at work, against the memory of the simulated control at that moment."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from gateway.daemon.stream import Hub, StreamListener
from gateway.events import PushEnded, PushPhaseChanged, TableStateChanged, received
from gateway.push.context import PushContext
from gateway.push.phases import TRANSITIONS, PushPhase, PushState, Switch, TableNow
from tests.push.bench import Plan, told
from tests.push.mischief import Moment
from tests.push.oracle import Oracle
from tests.push.world import Scene, World

TRUE: Mapping[TableNow, Callable[[Oracle], bool]] = {
    TableNow.BEGUN: lambda at: at.as_before and at.writes == 0,
    TableNow.WRITING: lambda _at: True,
    TableNow.WRITTEN: lambda at: (at.is_new() or at.is_old()) and at.off,
    TableNow.ON: lambda at: (at.is_new() or at.is_old()) and at.switched_on,
    TableNow.OFF: lambda at: at.off,
    TableNow.NEW: lambda at: at.as_wanted and at.acts,
    TableNow.OLD: lambda at: at.as_before,
    TableNow.UNTOUCHED: lambda at: at.as_before and at.writes == 0,
    TableNow.UNKNOWN: lambda _at: True,
}
"""What the control's memory must hold the moment a state is told."""
UNTIL_THE_NEXT = {**TRUE, TableNow.ON: lambda at: at.switched_on}
"""And until the next one: that a control exchanged points of a table that is on shows at the next read, as a state."""


@dataclass
class Page:
    """What a page at the stream shows of each table: by the frames alone, as the bar above draws them."""

    listener: StreamListener
    tables: dict[str, str] = field(default_factory=dict)

    def look(self) -> None:
        """Takes what was sent since the last look."""
        sent = [frame for frame, _passing in self.listener._frames]
        self.listener._frames.clear()
        for line in "".join(sent).splitlines():
            data = json.loads(line[6:]) if line.startswith("data: ") else {}
            if data.get("event") == "TableStateChanged":
                self.tables[data["fields"]["axis"]] = data["fields"]["state"]


@dataclass
class Watch:
    """Every state that was told of the table, those that were not true then, and how the push ended."""

    states: list[str] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    ended: int = 0
    world: list[World] = field(default_factory=list)
    hub: Hub = field(default_factory=lambda: Hub(LoopClock(), dict))
    pages: tuple[Page, ...] = ()
    looks: int = 0

    def __post_init__(self) -> None:
        self.pages = Page(self.hub.join()), Page(self.hub.join())

    def look(self) -> None:
        """Both pages show what is true of the control's memory now."""
        for page in self.pages:
            page.look()
            for name, state in page.tables.items():
                self.looks += 1
                if not UNTIL_THE_NEXT[TableNow(state)](self.world[0].oracle):
                    self.false.append(f"a page shows {name} {state}: {self.world[0].oracle.content}")

    def edit(self, context: PushContext) -> PushContext:
        """Listens to what the push tells."""

        def say(code: str, /, **fields: object) -> None:
            event = received(code, fields)
            if isinstance(event, TableStateChanged):
                self.states.append(event.state)
                if not TRUE[TableNow(event.state)](self.world[0].oracle):
                    self.false.append(f"{event.state}: {self.world[0].oracle.content}")
            self.ended += isinstance(event, PushEnded)
            self.hub.hear(code, fields)
            if isinstance(event, TableStateChanged | PushPhaseChanged | PushEnded):
                self.look()
            context.say(code, **fields)

        return replace(context, say=say)


def watched(root: Path, scene: Scene, *at: tuple[Moment, Callable[[World], None]]) -> tuple[Watch, str]:
    """A push through the mailbox, and how it ended."""
    watch = Watch()
    story = told(Plan(scene, at=at, first=watch.world.append, edit=watch.edit, recover=False), root)
    assert story.wrong == []
    return watch, story.outcome


@pytest.mark.parametrize("scene", [Scene(), Scene(cross=True), Scene(never=True)], ids=["axis", "cross", "never"])
def test_each_state_of_a_push_is_told_when_it_is_true(tmp_path: Path, scene: Scene) -> None:
    watch, outcome = watched(tmp_path, scene)
    assert (outcome, watch.false, watch.ended) == ("committed", [], 1)
    assert watch.looks > 2 * len(watch.states), "both pages were looked at, also between two changes"
    assert [set(page.tables.values()) for page in watch.pages] == [{"new"}, {"new"}]
    assert watch.states == ["begun", "writing", "written", "writing", "on", "new"]


def test_a_control_that_exchanges_points_is_told_off_and_never_new(tmp_path: Path) -> None:
    watch, outcome = watched(tmp_path, Scene(strict=True, nck={"swaps_points_at_reset": 2}))
    assert (outcome, watch.false) == ("held", [])
    assert "new" not in watch.states
    assert watch.states[-1] == "off"


def test_a_hand_at_the_switch_in_mid_write_never_makes_a_state_false(tmp_path: Path) -> None:
    watch, outcome = watched(tmp_path, Scene(), (Moment(1, "ACTIVATE"), lambda at: at.nck.enable_by_itself()))
    assert watch.false == []
    assert watch.states[-1] == {"committed": "new", "rolled-back": "old", "held": "off"}[outcome]


def test_nothing_is_called_on_off_or_back_before_it_was_read() -> None:
    """By the table of transitions: an order that was only announced makes a state that says so."""
    for one in TRANSITIONS:
        if one.switch is Switch.UNKNOWN and one.target is not None:
            assert PushState(one.target, Switch.UNKNOWN).table is TableNow.WRITING
    assert PushState(PushPhase.HELD, Switch.ON).table is TableNow.UNKNOWN
    assert PushState(PushPhase.HELD, Switch.OFF).table is TableNow.OFF
    assert PushState(PushPhase.LEFT_OFF, Switch.OFF).table is TableNow.OFF
    assert PushState(PushPhase.ABORTED, Switch.UNTOUCHED).table is TableNow.UNTOUCHED
