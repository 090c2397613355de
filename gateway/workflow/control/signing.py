"""The signs that a proposal needs: all in one transaction, each instrument mounted once for all that it sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.push import PushContext, quiet
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.control.contexts import kept, table_context
from gateway.workflow.control.proving import BenchEyes, prove
from gateway.workflow.witness import Witness

Wish = tuple[TableChange, PushContext]


async def signed(
    at: Bench, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]
) -> tuple[TableChange, ...]:
    """The changes, their signs proved. A reversal too small to be told from the scatter is left out instead.

    Without it the axis keeps what it had, and its tables are worth having: they need not fail with it.
    """
    wishes = _open(at, changes, measured)
    eyes = BenchEyes(at)
    found = {change.name: change for change in changes}
    for group in _groups(wishes):
        mine = [change for change, _ in group]
        proofs = await kept(at, mine, prove(at, group, eyes))
        for change, proof in zip(mine, proofs, strict=True):
            if isinstance(proof, VerifyError):
                found[change.name] = _without(at, change, proof)
    return tuple(found.values())


def _open(at: Bench, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]) -> list[Wish]:
    """One change for each kind of table and output axis whose sign nobody knows, axis by axis."""
    captures = {name: item.capture for name, item in measured.items()}
    wanted: dict[tuple[str, str], Wish] = {}
    for change in changes:
        context = table_context(at, change.new, captures.get(change.axis))
        if not change.skipped and context.proof is None:
            wanted.setdefault((change.axis, change.new.kind), (change, replace(context, log=Witness(at))))
    axes = dict.fromkeys(axis for axis, _ in wanted)
    return [wish for axis in axes for (of, _), wish in wanted.items() if of == axis]


def _groups(wishes: Sequence[Wish]) -> list[Sequence[Wish]]:
    """All together where no trial table acts but while it is measured; else one by one."""
    if wishes and quiet(wishes[0][1]):
        return [wishes]
    return [(wish,) for wish in wishes]


def _without(at: Bench, change: TableChange, error: VerifyError) -> TableChange:
    if change.new.kind != "reversal" or error.code != "E-PUSH-NO-PROOF":
        raise error
    at.say("P-PUSH-REFUSED", axis=change.name, reason=str(error))
    return replace(change, skipped=str(error))
