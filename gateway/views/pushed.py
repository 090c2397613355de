"""What pushes left in a control, as data: each table with its number, date and points, and pushes that did not end."""

from __future__ import annotations

from typing import Any

from gateway import audit
from gateway.push.records.history import Committed, consent_set, every_push, named
from gateway.push.records.holding import TableState, held_pushes, table_states
from gateway.push.records.journal import JOURNALS
from gateway.store import Store


def standing_tables(store: Store, serial: str) -> dict[str, Any]:
    """How each table stands, the alarms about them, and what is held. Raises StoreError.

    ``settled`` is false while anything must be put right before the next push.
    """
    journals, known = store.root / JOURNALS, audit.standing(store.root, serial)
    looks = {name: (utc, known.kinds.get(name, "differs")) for name, utc in known.looked.items()}
    states, pushes = table_states(journals, serial, looks), every_push(journals, serial)
    held = held_pushes(journals)
    return {
        "serial": serial,
        "tables": [_state(one, pushes) for one in states],
        "alarms": dict(known.alarms),
        "held": [one.as_data() for one in held],
        "settled": not held and all(one.settled for one in states),
    }


def _state(state: TableState, pushes: tuple[Committed, ...]) -> dict[str, Any]:
    """A table as every screen shows it; ``back`` are the tables that a rollback of its axis restores, with names."""
    found = consent_set(pushes, state.axis)
    told: dict[str, Any] = {
        "table": state.table,
        "axis": state.axis,
        "id": state.name.id,
        "transaction": state.push.transaction if state.push is not None else 0,
        "utc": state.name.utc or state.utc,
        "known_utc": state.utc,
        "acts": state.acts,
        "enabled": state.acts == "on",
        "held": state.held.as_data() if state.held is not None else None,
        "back": [_back(one, pushes) for one in found.tables] if found is not None else [],
        "stays": [one.table for one in found.rest] if found is not None else [],
    }
    return told | _points(state.push)


def _back(push: Committed, pushes: tuple[Committed, ...]) -> dict[str, str]:
    before = tuple(one for one in pushes if one.transaction != push.transaction)
    newer, older = named(pushes, push.table, push.new), named(before, push.table, push.old, push.utc)
    return {"table": push.table, "newer": newer.words, "older": older.words}


def _points(push: Committed | None) -> dict[str, Any]:
    """An axis' own table with its points; a cross table's are kept in the control's sense, so they stay out."""
    if push is None:
        return {"kind": "", "unit": ""}
    table = push.new.table
    told: dict[str, Any] = {"kind": table.kind, "unit": table.deviation_unit}
    if table.kind == "axis":
        told |= {"positions": table.positions.tolist(), "deviations": list(map(float, table.deviations))}
    if table.kind == "reversal":
        told |= {"value": float(table.deviations[0])}
    return told
