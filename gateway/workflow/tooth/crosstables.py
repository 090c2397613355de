"""Corrections of one axis over another as changes of the control's cross tables: placed, merged, checked, rounded."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from drivers.types.tables import CompensationTable, LiveSet
from gateway.correct.flank.tables import Table
from gateway.correct.plan.plan import table_record
from gateway.domain.proposals import TableChange
from gateway.model.chain import Chain
from gateway.workflow.axes.crossplaces import placed_change, places_of
from gateway.workflow.bench import Bench


async def cross_changes(
    at: Bench,
    tables: Sequence[Table],
    chain: Chain,
    *,
    live: Mapping[str, LiveSet],
    adds: bool,
    spoken_for: Collection[int] = (),
) -> tuple[TableChange, ...]:
    """Corrections (one table for each output and input axis, chain letters) as changes of the control's cross tables.

    ``live`` are the live sets as captured, by machine axis. With ``adds`` the corrections come on top of what acted,
    else they are all that shall act. Numbers that are ``spoken_for`` are left alone. A change without a place is
    skipped and says why. Raises CaptureError (E-RUN-LIVE) without the live set of an output axis, ValueOutOfRange
    (E-COMP-...) beyond the limits of a table.
    """
    names = {axis.letter: axis.name for axis in at.site.axes}
    plain = [table_record(chain, table, "cross", names=names) for table in tables]
    places = await places_of(at, plain, live, spoken_for=spoken_for)
    return tuple(placed_change(at, table, place, live, adds=adds) for table, place in zip(plain, places, strict=True))


def acting_cross(at: Bench, live: Mapping[str, LiveSet]) -> tuple[CompensationTable, ...]:
    """Cross tables that act between the axes of the site, as deviations by the proofs of their output axes.

    Those without a proof are left out.
    """
    found = []
    for name, one in live.items():
        proof = at.proofs.find(at.machine, "cross", name)
        if proof is not None:
            mine = at.supervisor.controller.tables_by(one, proof).cross
            found += [one.table for one in mine if one.enabled and one.table.input_axis in at.moved]
    return tuple(found)
