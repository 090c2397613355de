"""The one place where a deviation meets the control's sign: cross tables turned to and from what a proof says.

An axis table's stored value is the deviation itself. A cross table's is the deviation times the sign that was
measured on the machine; without a proof its values are taken as they stand.
"""

from __future__ import annotations

from dataclasses import replace

from drivers.types import CompensationTable, LiveSet, LiveTable, PushOrder, Sense, SignProof


def sense_of(proof: SignProof | None) -> Sense:
    """The sense in which cross tables are deviations by a proof; as they stand without one of their kind."""
    return proof.sense if proof is not None else 1


def sense_for(order: PushOrder) -> Sense:
    """The sense of an order's cross tables: an order for an axis table leaves them as they stand."""
    return sense_of(order.proof) if order.table.kind == "cross" else 1


def table_by(table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
    """A table that was read or kept in ``sense`` as a deviation by ``proof``; an axis table as it is."""
    if table.kind == "axis" or sense == sense_of(proof):
        return table
    return replace(table, deviations=_minus(table.deviations), reverse=_minus(table.reverse))


def tables_by(live: LiveSet, proof: SignProof | None) -> LiveSet:
    """The same set with its cross tables as deviations by ``proof``: as stored where that is None."""

    def turned(tables: tuple[LiveTable, ...]) -> tuple[LiveTable, ...]:
        return tuple(replace(one, table=table_by(one.table, live.sense, proof)) for one in tables)

    return replace(live, cross=turned(live.cross), others=turned(live.others), sense=sense_of(proof))


def _minus(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(-value + 0.0 for value in values)
