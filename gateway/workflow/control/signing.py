"""The signs that a proposal needs: all in one transaction, each instrument mounted once for all that it sees.

A sign that stays unknown costs its tables, not the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from drivers.message import Message
from gateway.domain.proposals import TableChange, torn
from gateway.errors import VerifyError
from gateway.push import PushContext, trials_stay_off
from gateway.workflow import stages
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.consents import left_out
from gateway.workflow.control.contexts import kept, table_context
from gateway.workflow.control.proving import BenchEyes, prove
from gateway.workflow.tooth.without import best_rest, tried_on
from gateway.workflow.witness import Witness

Wish = tuple[TableChange, PushContext]


async def signed(
    at: Bench, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]
) -> tuple[TableChange, ...]:
    """The changes, their signs proved; those whose sign stays unknown are left out, with the reason.

    An axis without one keeps what it had, and the others are worth having: they need not fail with it. Of tables for a
    tooth go on what leaves the better flank without them. Raises as `prove`, and VerifyError (E-PUSH-SIGN;
    E-PUSH-NO-PROOF where no table is left that is worth a push).
    """
    wishes = _open(at, changes, measured)
    eyes = BenchEyes(at)
    unproved: dict[tuple[str, str], VerifyError] = {}
    for group in _groups(wishes):
        mine = [change for change, _ in group]
        proofs = await kept(at, mine, prove(at, group, eyes))
        for change, proof in zip(mine, proofs, strict=True):
            if isinstance(proof, VerifyError) and proof.code != "E-PUSH-NO-PROOF":
                raise proof
            if isinstance(proof, VerifyError):
                unproved[change.axis, change.new.kind] = proof
    return _without(at, changes, unproved) if unproved else tuple(changes)


def _open(at: Bench, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]) -> list[Wish]:
    """One change for each kind of table and output axis whose sign nobody knows, axis by axis."""
    captures = {name: item.capture for name, item in measured.items()}
    wanted: dict[tuple[str, str], Wish] = {}
    for change in changes:
        context = table_context(at, change.new, captures.get(change.axis))
        if not change.skipped and context.proof is None:
            wanted.setdefault((change.axis, change.new.kind), (change, replace(context, log=Witness(at))))
    axes = in_turn(at, [axis for axis, _ in wanted])
    return [wish for axis in axes for (of, _), wish in wanted.items() if of == axis]


def in_turn(at: Bench, axes: Sequence[str]) -> list[str]:
    """Each axis once: first what stands mounted, last a laser's, which stays for measuring again."""
    found = {name: at.axis(name) for name in axes}
    return sorted(found, key=lambda name: (not at.standing.holds(found[name]), found[name].kind == "linear"))


def _groups(wishes: Sequence[Wish]) -> list[Sequence[Wish]]:
    """All together where no trial table acts but while it is measured; else one by one."""
    if wishes and trials_stay_off(wishes[0][1]):
        return [wishes]
    return [(wish,) for wish in wishes]


def _without(
    at: Bench, changes: Sequence[TableChange], unproved: Mapping[tuple[str, str], VerifyError]
) -> tuple[TableChange, ...]:
    """The changes without those of a kind and axis that has no proof, and what these take with them."""
    open_ = [one for one in changes if not one.skipped]
    lost = {one.name: unproved[one.axis, one.new.kind].message for one in open_ if (one.axis, one.new.kind) in unproved}
    left = [one for one in open_ if one.name not in lost]
    halves = {one.axis for one in open_ if one.name in torn(left, changes)}
    for one in left:
        if one.axis in halves and one.layer == "axis" and one.new.kind != "axis":
            lost[one.name] = next(error.message for (axis, _), error in unproved.items() if axis == one.axis)
    left = [one for one in left if one.name not in lost]
    tables = [one for one in open_ if one.new.kind != "reversal"]
    if any(one.name in lost for one in tables):
        lost |= _poorer(at, tables, [one for one in left if one.new.kind != "reversal"], lost)
    if tables and all(one.name in lost for one in tables):
        raise next(iter(unproved.values()))
    for reason in dict.fromkeys(lost.values()):
        names = ", ".join(name for name, why in lost.items() if why == reason)
        at.say("P-PUSH-WITHOUT", axis=names, reason=reason)
    for one in open_:
        if one.name in lost:
            left_out(at, one, str(lost[one.name]))
    return tuple(replace(one, skipped=lost.get(one.name, one.skipped)) for one in changes)


def _poorer(
    at: Bench, every: Sequence[TableChange], left: Sequence[TableChange], lost: Mapping[str, Message]
) -> dict[str, Message]:
    """Which tables of a tooth go too, and why: those that leave a worse flank once the ``lost`` ones are out."""
    if not left or not at.folder.has(stages.TOOTH):
        return {}
    names = ", ".join(one.name for one in every if one.name in lost)
    tried = tried_on(at, every)
    if tried is None:
        return {one.name: Message.of("W-PUSH-WITHOUT-UNKNOWN", names=names) for one in left}
    rest = best_rest(tried, every, left)
    figures = {"rest": f"{rest.rms_um:.2f}", "all": f"{rest.all_um:.2f}", "none": f"{rest.none_um:.2f}"}
    at.say("P-PUSH-WITHOUT-FLANK", names=names, **figures)
    go_on = {one.name for one in rest.changes}
    return {one.name: Message.of("W-PUSH-WITHOUT-WORSE", names=names) for one in left if one.name not in go_on}
