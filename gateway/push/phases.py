"""The state machine of a push: its events, its phases, and what is true of the table in each of them.

A push of one table is a sequence of journal lines. Each line is an event; each event has the phases that it may follow,
the phase that it leads to, and what is known of the table from then on. The events of one table of a transaction:

    prepared -> read -> loading -> loaded -> enabling -> enabled -> active -> proved -> committed
                           |         |          |           |         |         |
                           +---------+----------+-----------+---------+---------+-> rolling back -> rolled back
                                                                                         |
                                          untouched <-+     held (on or off) <- switching off

Untouched: the control shows that the program of the load never began, so nothing is to be put back.

A line is on the disk before what it announces is done, so `LOADING`, `ENABLING` and `SWITCHING_OFF` mean that something
was announced and nobody has read the outcome. `Switch` keeps what is known: a way back or a recovery that begins knows
no more than what was known before it. The work in progress and the journal read in a later process go through the same
table (`PushState.after`, `state_of`), hence every screen, recovery and interlock speaks of the same state. An event
that may not follow is a fault of ours: `PushState.after` refuses it before it is written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from drivers.message import Message, Moment
from gateway.errors import IllegalTransition


class PushEvent(StrEnum):
    """The kind of a journal line; its value is what stands on the disk."""

    LEASED = "LEASED"
    AUDITED = "AUDITED"
    UNDOES = "UNDOES"
    SNAPSHOT = "SNAPSHOT"
    BACKUP = "BACKUP"
    DISABLE = "DISABLE"
    LOADED = "LOADED"
    FAILED_TABLE = "FAILED_TABLE"
    ENABLE = "ENABLE"
    ENABLED = "ENABLED"
    LEFT_DISABLED = "LEFT_DISABLED"
    ACTIVATED = "ACTIVATED"
    EFFECT = "EFFECT"
    MEASURED = "MEASURED"
    PLACE = "PLACE"
    PLACED = "PLACED"
    SWITCH_OFF = "SWITCH_OFF"
    OFF = "OFF"
    STILL_ON = "STILL_ON"
    STOPPED = "STOPPED"
    RECOVERING = "RECOVERING"
    ROLLING_BACK = "ROLLING_BACK"
    TORN = "TORN"
    RESTARTED = "RESTARTED"
    COMMITTED = "COMMITTED"
    ROLLED_BACK = "ROLLED_BACK"
    UNTOUCHED = "UNTOUCHED"
    ABORTED = "ABORTED"
    CLOSED = "CLOSED"
    HELD = "HELD"


class PushPhase(StrEnum):
    """Where the push of one table stands."""

    NOTHING = "nothing"
    PREPARED = "prepared"
    READ = "read"
    LOADING = "loading"
    LOADED = "loaded"
    ENABLING = "enabling"
    ENABLED = "enabled"
    LEFT_OFF = "left off"
    ACTIVE = "active"
    PROVED = "proved"
    MEASURED = "measured"
    ROLLING_BACK = "rolling back"
    RECOVERING = "recovering"
    SWITCHING_OFF = "switching off"
    OFF = "off"
    STILL_ON = "still on"
    HELD = "held"
    COMMITTED = "committed"
    ROLLED_BACK = "rolled back"
    ABORTED = "aborted"
    CLOSED = "closed"

    @property
    def final(self) -> bool:
        """Whether nothing is left to do."""
        return self in FINAL


FINAL = frozenset((PushPhase.COMMITTED, PushPhase.ROLLED_BACK, PushPhase.ABORTED, PushPhase.CLOSED))
OPEN = frozenset(PushPhase) - FINAL
BEGUN = OPEN - {PushPhase.NOTHING}
FAILED = (PushEvent.ROLLING_BACK, PushEvent.HELD, PushEvent.STOPPED, PushEvent.ABORTED)
"""Events that carry the reason why a push did not go on as asked."""


class Switch(StrEnum):
    """What is known of the table in the control."""

    UNTOUCHED = "untouched"
    UNKNOWN = "unknown"
    OFF = "off"
    ON = "on"
    NEW = "new"
    OLD = "old"


class TableNow(StrEnum):
    """What may be said of a table while its push is at work, and after it; never more than was read."""

    BEGUN = "begun"  # the table from before acts
    WRITING = "writing"  # an order was announced, its outcome not read
    WRITTEN = "written"  # read back equal, not on yet
    ON = "on"
    OFF = "off"
    NEW = "new"  # ended: the table that was wanted
    OLD = "old"  # ended: the table from before is back
    UNTOUCHED = "untouched"  # ended: nothing was written
    UNKNOWN = "unknown"  # on, or not known to be off


@dataclass(frozen=True, slots=True)
class Transition:
    """An event, the phases that it may follow, and where it leads; None: phase or switch stay as they were."""

    event: PushEvent
    sources: frozenset[PushPhase]
    target: PushPhase | None = None
    switch: Switch | None = None


def _from(*phases: PushPhase) -> frozenset[PushPhase]:
    return frozenset(phases)


_P = PushPhase
TRANSITIONS: tuple[Transition, ...] = (
    Transition(PushEvent.LEASED, _from(_P.NOTHING), _P.PREPARED, Switch.UNTOUCHED),
    Transition(PushEvent.AUDITED, _from(_P.PREPARED)),
    Transition(PushEvent.UNDOES, _from(_P.PREPARED)),
    Transition(PushEvent.SNAPSHOT, _from(_P.PREPARED), _P.READ),
    Transition(
        PushEvent.DISABLE,
        _from(_P.READ, _P.ROLLING_BACK, _P.RECOVERING, _P.LEFT_OFF),  # after a restart with the old table left off
        _P.LOADING,
        Switch.UNKNOWN,
    ),
    Transition(PushEvent.BACKUP, BEGUN - {_P.PREPARED}),  # a second reading may be missing till then
    Transition(PushEvent.FAILED_TABLE, _from(_P.LOADING)),
    Transition(PushEvent.LOADED, _from(_P.LOADING), _P.LOADED),
    Transition(PushEvent.ENABLE, _from(_P.LOADED), _P.ENABLING, Switch.UNKNOWN),
    Transition(PushEvent.ENABLED, _from(_P.ENABLING), _P.ENABLED),
    Transition(PushEvent.LEFT_DISABLED, _from(_P.ENABLING), _P.LEFT_OFF, Switch.OFF),
    Transition(PushEvent.ACTIVATED, _from(_P.ENABLED), _P.ACTIVE),
    Transition(PushEvent.RESTARTED, _from(_P.LEFT_OFF)),
    Transition(PushEvent.EFFECT, _from(_P.ENABLED, _P.ACTIVE), _P.PROVED),
    Transition(PushEvent.MEASURED, _from(_P.ENABLED, _P.ACTIVE, _P.LEFT_OFF), _P.MEASURED),
    Transition(PushEvent.PLACE, _from(_P.READ), _P.LOADING, Switch.UNKNOWN),  # set-up values: no switch, no program
    Transition(PushEvent.PLACED, _from(_P.LOADING), _P.PROVED),
    Transition(PushEvent.ROLLING_BACK, BEGUN - {_P.PREPARED}, _P.ROLLING_BACK),
    Transition(PushEvent.TORN, _from(_P.ROLLING_BACK, _P.RECOVERING)),
    Transition(PushEvent.RECOVERING, BEGUN, _P.RECOVERING),
    Transition(
        PushEvent.SWITCH_OFF,
        BEGUN,
        _P.SWITCHING_OFF,
        Switch.UNKNOWN,
    ),
    Transition(PushEvent.OFF, _from(_P.SWITCHING_OFF), _P.OFF, Switch.OFF),
    Transition(PushEvent.STILL_ON, _from(_P.SWITCHING_OFF), _P.STILL_ON, Switch.ON),
    Transition(PushEvent.HELD, BEGUN - {_P.PREPARED}, _P.HELD, Switch.ON),
    Transition(PushEvent.STOPPED, BEGUN),
    Transition(
        PushEvent.COMMITTED,
        # Read: it was live already. Left off: a table from before that was off. Recovering: found as it should be.
        _from(_P.READ, _P.ENABLED, _P.ACTIVE, _P.LEFT_OFF, _P.PROVED, _P.RECOVERING),
        _P.COMMITTED,
        Switch.NEW,
    ),
    Transition(
        PushEvent.ROLLED_BACK,
        _from(_P.ROLLING_BACK, _P.ENABLED, _P.ACTIVE, _P.LEFT_OFF),
        _P.ROLLED_BACK,
        Switch.OLD,
    ),
    Transition(PushEvent.UNTOUCHED, _from(_P.ROLLING_BACK), _P.ABORTED, Switch.UNTOUCHED),
    Transition(
        PushEvent.ABORTED,
        # Loading: refused by the control, or another gateway came first. Still on: an order to switch off that failed.
        _from(_P.PREPARED, _P.READ, _P.LOADING, _P.ROLLING_BACK, _P.STILL_ON),
        _P.ABORTED,
    ),
    Transition(PushEvent.CLOSED, BEGUN, _P.CLOSED),
)
_OF = {one.event: one for one in TRANSITIONS}


@dataclass(frozen=True, slots=True)
class PushState:
    """The phase of a table's push and what is known of the table."""

    phase: PushPhase = PushPhase.NOTHING
    switch: Switch = Switch.UNTOUCHED

    @property
    def table(self) -> TableNow:
        """What may be said of the table."""
        known = _TABLE.get(self.phase)
        if known is TableNow.ON and self.switch is Switch.OFF:
            return TableNow.OFF
        return known or _LEFT[self.switch]

    def after(self, event: PushEvent, facts: Mapping[str, Any]) -> PushState:
        """The state that an event leads to. Raises IllegalTransition (E-PUSH-TRANSITION) where it may not follow."""
        if self.phase not in _OF[event].sources:
            raise IllegalTransition("E-PUSH-TRANSITION", event, event=event, phase=self.phase)
        return self.apply_recorded(event, facts)

    def apply_recorded(self, event: PushEvent, facts: Mapping[str, Any]) -> PushState:
        """As `after`, of what a journal tells: it has happened, whatever it follows."""
        one = _OF[event]
        switch = one.switch
        if event is PushEvent.HELD and facts.get("on") is False:
            switch = Switch.OFF
        return PushState(one.target or self.phase, switch or self.switch)


_TABLE: Mapping[PushPhase, TableNow] = {
    **dict.fromkeys((_P.NOTHING, _P.PREPARED, _P.READ), TableNow.BEGUN),
    **dict.fromkeys((_P.LOADING, _P.ENABLING, _P.SWITCHING_OFF), TableNow.WRITING),
    **dict.fromkeys((_P.ROLLING_BACK, _P.RECOVERING), TableNow.WRITING),
    _P.LOADED: TableNow.WRITTEN,
    **dict.fromkeys((_P.ENABLED, _P.ACTIVE, _P.PROVED, _P.MEASURED), TableNow.ON),
    _P.COMMITTED: TableNow.NEW,
    _P.ROLLED_BACK: TableNow.OLD,
}
_LEFT: Mapping[Switch, TableNow] = {
    Switch.UNTOUCHED: TableNow.UNTOUCHED,
    Switch.OFF: TableNow.OFF,
    Switch.NEW: TableNow.NEW,
    Switch.OLD: TableNow.OLD,
    Switch.ON: TableNow.UNKNOWN,
    Switch.UNKNOWN: TableNow.UNKNOWN,
}
INITIAL_STATE = PushState()


def state_of(lines: Iterable[tuple[str, Mapping[str, Any]]]) -> PushState:
    """The state that the lines of a journal (kind, facts) add up to; a kind of a newer program changes nothing."""
    state = INITIAL_STATE
    for kind, facts in lines:
        if kind in PushEvent.__members__:
            state = state.apply_recorded(PushEvent(kind), facts)
    return state


def transitions_in_markdown() -> str:
    """The table of transitions as the page of the handbook shows it."""
    lines = [
        "# The states of a push",
        "",
        "The journal of a push has one line for each event of a table, written to the disk before what it announces is",
        "done. `trueflank docs schema --states` makes this page of the table that the program goes by: an event in a",
        "phase that is not named here is refused. What an event leaves unsaid (-) stays as it was.",
        "",
        "| event | follows | leads to | what is true of the table then |",
        "|---|---|---|---|",
    ]
    for one in TRANSITIONS:
        named = _phases_in_markdown(one.sources)
        after, known = one.target or "-", _known_in_markdown(one.switch)
        known = f"{known}, or off where a read-back said so" if one.event is PushEvent.HELD else known
        lines.append(f"| {one.event} | {named} | {after} | {known} |")
    ends = ", ".join(phase for phase in PushPhase if phase.final)
    return "\n".join([*lines, "", f"Nothing follows {ends}: the journal is set aside.", ""])


def _known_in_markdown(switch: Switch | None) -> str:
    said = {
        Switch.UNTOUCHED: "the table from before acts; nothing was written",
        Switch.UNKNOWN: "a write was announced and its outcome has not been read",
        Switch.OFF: "a read-back says that it is off",
        Switch.ON: "it is on, or not known to be off, and no push stands for it",
        Switch.NEW: "the new table is live and proved",
        Switch.OLD: "the table from before is live again, read back",
    }
    return "-" if switch is None else said[switch]


def _phases_in_markdown(sources: frozenset[PushPhase]) -> str:
    """The phases by name; where nearly all are meant, those that are not."""
    out = [phase for phase in PushPhase if phase in BEGUN - sources]
    if len(out) > 1:
        return ", ".join(phase for phase in PushPhase if phase in sources)
    return "any that is open" + (f" but {out[0]}" if out else "")


# The journal contains the kinds in capitals; people read these messages.

STEP_CODES: Mapping[str, str] = {
    "LEASED": "W-STEP-LEASED",
    "AUDITED": "W-STEP-AUDITED",
    "UNDOES": "W-STEP-UNDOES",
    "SNAPSHOT": "W-STEP-SNAPSHOT",
    "BACKUP": "W-STEP-BACKUP",
    "DISABLE": "W-STEP-DISABLE",
    "LOADED": "W-STEP-LOADED",
    "FAILED_TABLE": "W-STEP-FAILED-TABLE",
    "ENABLE": "W-STEP-ENABLE",
    "ENABLED": "W-STEP-ENABLED",
    "LEFT_DISABLED": "W-STEP-LEFT-DISABLED",
    "ACTIVATED": "W-STEP-ACTIVATED",
    "EFFECT": "W-STEP-EFFECT",
    "MEASURED": "W-STEP-MEASURED",
    "PLACE": "W-STEP-PLACE",
    "PLACED": "W-STEP-PLACED",
    "SWITCH_OFF": "W-STEP-SWITCH-OFF",
    "OFF": "W-STEP-OFF",
    "STILL_ON": "W-STEP-STILL-ON",
    "STOPPED": "W-STEP-STOPPED",
    "RECOVERING": "W-STEP-RECOVERING",
    "ROLLING_BACK": "W-STEP-ROLLING-BACK",
    "TORN": "W-STEP-TORN",
    "RESTARTED": "W-STEP-RESTARTED",
    "COMMITTED": "W-STEP-COMMITTED",
    "ROLLED_BACK": "W-STEP-ROLLED-BACK",
    "UNTOUCHED": "W-STEP-UNTOUCHED",
    "ABORTED": "W-STEP-ABORTED",
    "CLOSED": "W-STEP-CLOSED",
    "HELD": "W-STEP-HELD",
}


_TABLE_CODES: Mapping[TableNow, str] = {
    TableNow.BEGUN: "W-TABLE-IS-BEGUN",
    TableNow.WRITING: "W-TABLE-IS-WRITING",
    TableNow.WRITTEN: "W-TABLE-IS-WRITTEN",
    TableNow.ON: "W-TABLE-IS-ON",
    TableNow.OFF: "W-TABLE-IS-OFF",
    TableNow.NEW: "W-TABLE-IS-NEW",
    TableNow.OLD: "W-TABLE-IS-OLD",
    TableNow.UNTOUCHED: "W-TABLE-IS-UNTOUCHED",
    TableNow.UNKNOWN: "W-TABLE-IS-UNKNOWN",
}


def step_message(kind: str) -> Message:
    """The step of a journal entry, e.g. "old table backed up" of BACKUP; an unknown kind in plain letters."""
    code = STEP_CODES.get(kind)
    return Message.of(code) if code else Message.stored(kind.lower().replace("_", " "))


def table_message(state: TableNow) -> Message:
    """What is true of a table in a state, e.g. "written and read back, not on yet"."""
    return Message.of(_TABLE_CODES[state])


def step_with_facts(kind: str, utc: str, facts: Mapping[str, Any]) -> Message:
    """A step with its moment and the numbers, names and messages among its facts."""
    told = {key: value for key, value in facts.items() if isinstance(value, (str, int, Message))}
    found = step_message(kind)
    return Message(found.code, {**found.fields, **told, "utc": Moment(utc)})
