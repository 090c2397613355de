"""The signs that a proposal needs, proved axis by axis: each instrument is mounted once for all that it sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.control.contexts import kept, table_context
from gateway.workflow.control.proving import Mounted, mount, prove
from gateway.workflow.witness import Witness


async def signed(
    at: Bench, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]
) -> tuple[TableChange, ...]:
    """The changes, their signs proved: all that one instrument sees while it is mounted once."""
    known = {name: item.capture for name, item in measured.items()}
    found = {change.name: change for change in changes}
    for name in dict.fromkeys(change.axis for change in changes):
        mine = [change for change in changes if change.axis == name and not change.skipped]
        open_signs = [one for one in mine if table_context(at, one.new, known.get(name)).proof is None]
        if not open_signs:
            continue
        eye = await kept(at, open_signs[:1], mount(at, at.axis(name)))
        for change in open_signs:
            found[change.name] = await _with_sign(at, change, known.get(name), eye)
    return tuple(found.values())


async def _with_sign(at: Bench, change: TableChange, capture: Capture | None, eye: Mounted) -> TableChange:
    """The change, its sign proved; a reversal that is too small to be told from the scatter is left out instead.

    Without it the axis keeps what it had, and its tables are worth having: they need not fail with it.
    """
    context = table_context(at, change.new, capture)
    if context.proof is not None:  # of another table of this kind, a moment ago
        return change
    try:
        await kept(at, (change,), prove(at, change, replace(context, log=Witness(at)), eye))
    except VerifyError as error:
        if change.new.kind != "reversal" or error.code != "E-PUSH-NO-PROOF":
            raise
        at.say("P-PUSH-REFUSED", axis=change.name, reason=str(error))
        return replace(change, skipped=str(error))
    return change
