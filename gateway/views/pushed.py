"""What pushes left in a control, as data: each table with its number, date and points, and pushes that did not end."""

from __future__ import annotations

from typing import Any

from gateway import audit
from gateway.push.records.history import Committed, standing, table_id
from gateway.push.records.holding import held_pushes
from gateway.push.records.journal import JOURNALS
from gateway.store import Store


def standing_tables(store: Store, serial: str) -> dict[str, Any]:
    """The tables that should be live now, the alarms about them, and what is held. Raises StoreError."""
    journals = store.root / JOURNALS
    return {
        "serial": serial,
        "tables": [_table(one) for one in standing(journals, serial)],
        "alarms": dict(audit.standing(store.root, serial).alarms),
        "held": [one.as_data() for one in held_pushes(journals)],
    }


def _table(push: Committed) -> dict[str, Any]:
    """An axis' own table with its points; a cross table's are kept in the control's sense, so they stay out."""
    table = push.new.table
    told: dict[str, Any] = {
        "table": push.table,
        "axis": push.axis,
        "id": table_id(push),
        "transaction": push.transaction,
        "utc": push.utc,
        "enabled": push.new.enabled,
        "kind": table.kind,
        "unit": table.deviation_unit,
    }
    if table.kind == "axis":
        told |= {"positions": table.positions.tolist(), "deviations": list(map(float, table.deviations))}
    if table.kind == "reversal":
        told |= {"value": float(table.deviations[0])}
    return told
