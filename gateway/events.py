"""What happens in a run, as typed events: published by the workflow; read by panels, jobs, stream, MQTT and logs.

An event is told as a word of progress (`gateway.say`): its code is the tag of its type and its fields fill the text, so
it passes through every `Say`, a lease of another process and a log like any other word. `received` is the only place
that reads the tag; everything else decides by the class and its typed fields. Progress that nobody decides by is no
event: it is text for people, and `gateway.audience` says for whom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import PurePath
from typing import Any, ClassVar

from drivers.message import Message
from gateway.say import Say


@dataclass(frozen=True, slots=True)
class Event:
    """Anything that happened; ``code`` is its text in the catalogue."""

    code: ClassVar[str] = ""

    @property
    def told_fields(self) -> dict[str, Any]:
        """The fields of its text."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def tell(self, say: Say) -> None:
        """Publish it."""
        say(self.code, **self.told_fields)


@dataclass(frozen=True, slots=True)
class RunStarted(Event):
    """A run has its folder."""

    code: ClassVar[str] = "P-RUN"
    folder: str = ""

    @property
    def run_id(self) -> str:
        """The run's id: the name of its folder."""
        return PurePath(self.folder).name


@dataclass(frozen=True, slots=True)
class DevicesOpened(Event):
    """Every device of a site is open; ``run`` is the id of the run that has them, "" for none."""

    code: ClassVar[str] = "P-OPEN"
    site: str = ""
    serial: str = ""
    count: int = 0
    run: str = ""


@dataclass(frozen=True, slots=True)
class ConnectionUnprotected(Event):
    """Others can read and change what passes to the control."""

    code: ClassVar[str] = "P-UNPROTECTED"
    road: Any = ""


@dataclass(frozen=True, slots=True)
class StopDone(Event):
    """Another stop of a plan was made."""

    code: ClassVar[str] = "P-STOP"
    axis: str = ""
    program: str = ""
    done: int = 0
    total: int = 0


@dataclass(frozen=True, slots=True)
class BeamLost(Event):
    """The beam was lost during a plan."""

    code: ClassVar[str] = "P-CAP-BEAM"
    axis: str = ""
    left: int = 0
    total: int = 0


@dataclass(frozen=True, slots=True)
class AxisMeasurementStarted(Event):
    """An axis is measured, ``phase`` "before" or "after"."""

    code: ClassVar[str] = "P-MEASURE"
    axis: str = ""
    component: str = ""
    phase: str = ""
    when: Message | str = ""
    """The phase as people read it."""

    def __post_init__(self) -> None:
        when = Message.of("S-PHASE-AFTER" if self.phase == "after" else "S-PHASE-BEFORE")
        object.__setattr__(self, "when", self.when or when)


@dataclass(frozen=True, slots=True)
class TargetsAdded(Event):
    """More targets of the same part are measured."""

    code: ClassVar[str] = "P-MORE-TARGETS"
    axis: str = ""
    doubt: str = ""
    unit: str = ""
    count: int = 0
    minutes: str = ""
    left: str = ""


@dataclass(frozen=True, slots=True)
class SetupStarted(Event):
    """The next set-up of an error measurement."""

    code: ClassVar[str] = "P-SETUP-PLAN"
    setup: str = ""
    number: int = 0
    total: int = 0


@dataclass(frozen=True, slots=True)
class ActingCheckStarted(Event):
    """A short check while every table acts."""

    code: ClassVar[str] = "P-ACTING"
    axis: str = ""
    count: int = 0


@dataclass(frozen=True, slots=True)
class PartStarted(Event):
    """A part is ground and inspected, with these set-up values."""

    code: ClassVar[str] = "P-PART"
    part: str = ""
    x_um: float = 0.0
    c_arcsec: float = 0.0
    dressing_um: float = 0.0


@dataclass(frozen=True, slots=True)
class SignProofStarted(Event):
    """The sign of a table is proved."""

    code: ClassVar[str] = "P-SIGN"
    axis: str = ""


@dataclass(frozen=True, slots=True)
class TrialTablesLoaded(Event):
    """The test tables of a sign proof are in the control; a person restarts it."""

    code: ClassVar[str] = "P-PUSH-TRIALS"
    axis: str = ""


@dataclass(frozen=True, slots=True)
class TransactionSelected(Event):
    """The program of a transaction, or its first part, waits for the start."""

    axis: str = ""
    transaction: int = 0


@dataclass(frozen=True, slots=True)
class WholeTransactionSelected(TransactionSelected):
    """One program makes the whole transaction."""

    code: ClassVar[str] = "P-PUSH-START"


@dataclass(frozen=True, slots=True)
class FirstPartSelected(TransactionSelected):
    """The first of two programs."""

    code: ClassVar[str] = "P-PUSH-LOAD"


@dataclass(frozen=True, slots=True)
class PushPhaseChanged(Event):
    """The journal of a push has another line for a table: ``step`` is its kind, ``said`` its message."""

    code: ClassVar[str] = "P-PUSH-STEP"
    axis: str = ""
    step: str = ""
    said: Message | str = ""


@dataclass(frozen=True, slots=True)
class TableStateChanged(Event):
    """What is true of a table in the control has changed while a push is at work.

    ``axis`` is the table as in a `PushPhaseChanged`, ``state`` the value of a `gateway.push.phases.TableNow`.
    """

    code: ClassVar[str] = "P-TABLE-STATE"
    axis: str = ""
    state: str = ""
    said: Message | str = ""


@dataclass(frozen=True, slots=True)
class PushEnded(Event):
    """A push of these tables ended; ``outcome`` as in a `PushRecord`."""

    code: ClassVar[str] = "P-PUSH-END"
    axis: str = ""
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class DisableMoves(Event):
    """Switching a table off will move the axis by what acts."""

    code: ClassVar[str] = "P-PUSH-DISABLE-MOVES"
    axis: str = ""
    table: str = ""
    acting: float = 0.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class ProgramSelected(Event):
    """A program of a plan waits for the start."""

    code: ClassVar[str] = "P-START"
    axis: str = ""
    program: str = ""


@dataclass(frozen=True, slots=True)
class MountingRequested(Event):
    """A person mounts what the next set-up needs; no light comes back meanwhile."""

    code: ClassVar[str] = "P-MOUNT"
    axis: str = ""
    setup: str = ""


@dataclass(frozen=True, slots=True)
class SetupJogRequested(MountingRequested):
    """A person mounts a set-up and then moves the axis by hand."""

    code: ClassVar[str] = "P-JOG-SETUP"
    position: float = 0.0
    unit: str = ""
    side: Any = ""
    room: Any = ""


@dataclass(frozen=True, slots=True)
class SetupProgramSelected(ProgramSelected):
    """A program that asks for a set-up first."""

    code: ClassVar[str] = "P-START-SETUP"
    setup: str = ""


def _kinds(base: type[Event]) -> dict[str, type[Event]]:
    found = {one.code: one for one in base.__subclasses__() if one.code}
    for one in base.__subclasses__():
        found |= _kinds(one)
    return found


EVENTS: Mapping[str, type[Event]] = _kinds(Event)


def received(code: str, told: Mapping[str, object]) -> Event | None:
    """The event that a word of progress tells of; None for text that is for people alone."""
    kind = EVENTS.get(code)
    if kind is None:
        return None
    named = {one.name: told[one.name] for one in fields(kind) if one.name in told}
    return kind(**named)
