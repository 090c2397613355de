"""What pushes left in a control, as data: each table with its number, date and points, and pushes that did not end."""

from __future__ import annotations

from typing import Any

from gateway import audit
from gateway.push import (
    JOURNALS,
    CommittedPush,
    TableState,
    all_pushes,
    consent_set,
    held_pushes,
    rollback_previews,
    sense_conversion,
    table_states,
)
from gateway.store import Store
from gateway.store.proofs import Proofs


def standing_tables(store: Store, serial: str) -> dict[str, Any]:
    """How each table stands, the alarms about them, and what is held. Raises StoreError.

    ``settled`` is false while anything must be put right before the next push.
    """
    journals, known = store.root / JOURNALS, audit.read_log_state(store.root, serial)
    looks = {name: (utc, known.kinds.get(name, "differs")) for name, utc in known.looked.items()}
    states, held = table_states(journals, serial, looks), held_pushes(journals)
    rolling = _Rollbacks(store, serial)
    return {
        "serial": serial,
        "tables": [_state(one, rolling) for one in states],
        "rollback": rolling.of(""),
        "alarms": dict(known.alarms),
        "held": [one.as_data() for one in held],
        "settled": not held and all(one.is_settled for one in states),
    }


class _Rollbacks:
    """What a rollback of one axis, or of everything the newest consent changed (""), restores."""

    def __init__(self, store: Store, serial: str) -> None:
        proofs, journals = Proofs(store.root), store.root / JOURNALS
        self._kept = all_pushes(journals, serial)
        self._pushes = all_pushes(journals, serial, sense_conversion(lambda axis: proofs.sense_of(serial, axis)))

    def of(self, asked: str) -> dict[str, Any]:
        """``back`` are the tables with names and moves, ``stays`` tables of the same consent that go on acting."""
        found = consent_set(self._pushes, asked)
        if found is None:
            return {"back": [], "stays": []}
        back = [one.as_data() for one in rollback_previews(self._kept, found).values()]
        return {"back": back, "stays": [one.table for one in found.rest]}


def _state(state: TableState, rolling: _Rollbacks) -> dict[str, Any]:
    """A table as every screen shows it; ``back`` are the tables that a rollback of its axis restores."""
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
    }
    return told | rolling.of(state.axis) | _points(state.push)


def _points(push: CommittedPush | None) -> dict[str, Any]:
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
