"""The message of each step of a journal: its kinds in capitals stay on the disk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.message import Message, Moment
from gateway.push.records.phases import TableNow

SAID: Mapping[str, str] = {
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
    "ABORTED": "W-STEP-ABORTED",
    "CLOSED": "W-STEP-CLOSED",
    "HELD": "W-STEP-HELD",
}


_STANDS: Mapping[TableNow, str] = {
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
    code = SAID.get(kind)
    return Message.of(code) if code else Message.stored(kind.lower().replace("_", " "))


def table_message(state: TableNow) -> Message:
    """What is true of a table in a state, e.g. "written and read back, not on yet"."""
    return Message.of(_STANDS[state])


def noted_step(kind: str, utc: str, facts: Mapping[str, Any]) -> Message:
    """A step with its moment and the numbers, names and messages among its facts."""
    told = {key: value for key, value in facts.items() if isinstance(value, (str, int, Message))}
    found = step_message(kind)
    return Message(found.code, {**found.fields, **told, "utc": Moment(utc)})
