"""Every pushed axis measured again, once, with everything of its own layer in, and judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from drivers.carried import Carried
from drivers.types.stops import StopPlan
from gateway.config import AxisSection, SiteFile
from gateway.domain.outcomes import AxisVerdict, PushRecord
from gateway.domain.proposals import TableChange
from gateway.workflow.axes.measure import MeasuredAxis, live_again, measure_axis, plans_of_axis
from gateway.workflow.axes.verdict import PUSHED, judge_measured, unmeasured
from gateway.workflow.bench import Bench

Records = Mapping[str, PushRecord]
"""How each change ended, by its name."""
Holds = Callable[[AxisSection], bool]
"""Whether the optics of an axis stand already."""


def plans_again(at: Bench, own: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What `judged` will visit where each of these changes goes in."""
    return plans_of(at.site, own, at.standing.holds) if _runs_visits(at) else ()


def plans_of(site: SiteFile, own: Sequence[TableChange], holds: Holds = lambda _axis: False) -> tuple[StopPlan, ...]:
    """As `plans_again`, of a control that runs visits; ``holds`` says whose optics stand already. Pure."""
    axes = {axis.name: axis for axis in site.axes}
    mine = by_axis([one for one in own if not one.skipped])
    turn = sorted(mine, key=lambda name: not holds(axes[name]))
    return tuple(_plans(holds, [_targets_again(axes[name], mine[name]) for name in turn]))


def _plans(holds: Holds, again: Sequence[AxisSection | None]) -> list[StopPlan]:
    sections = [axis for axis in again if axis is not None]
    return [plan for axis in sections for plan in plans_of_axis(axis, "after", stands=holds(axis))]


def by_axis(own: Sequence[TableChange]) -> dict[str, list[TableChange]]:
    """The changes of each axis, in order."""
    return {name: [one for one in own if one.axis == name] for name in dict.fromkeys(one.axis for one in own)}


def in_turn(at: Bench, mine: Mapping[str, list[TableChange]]) -> dict[str, list[TableChange]]:
    """The axis whose optics still stand from the sign proofs first."""
    return {name: mine[name] for name in sorted(mine, key=lambda name: not at.standing.holds(at.axis(name)))}


async def judged(
    at: Bench,
    own: Sequence[TableChange],
    before: Mapping[str, MeasuredAxis],
    records: Records,
    reads: Sequence[StopPlan] = (),
) -> tuple[AxisVerdict, ...]:
    """A verdict for each axis of the changes ``own``, in order. Raises as `measure_axis`.

    The program that measures waits at its end for the plans ``reads``, which save tables.
    """
    mine = in_turn(at, by_axis(own))
    again = {name: _again(at, changes, records) for name, changes in mine.items()}
    await at.foresee([*_plans(at.standing.holds, list(again.values())), *reads])
    verdicts = {name: await _verdict(at, changes, again[name], before[name], records) for name, changes in mine.items()}
    if not reads:
        await at.foresee(())
    return tuple(verdicts[name] for name in by_axis(own))


def _again(at: Bench, changes: Sequence[TableChange], records: Records) -> AxisSection | None:
    """How an axis is measured after its tables were pushed; None where none was, or nothing can measure it."""
    pushed = any(records[one.name].outcome in PUSHED for one in changes)
    return _measured_again(at, changes) if pushed else None


def _measured_again(at: Bench, changes: Sequence[TableChange]) -> AxisSection | None:
    return _targets_again(at.axis(changes[0].axis), changes) if _runs_visits(at) else None


def _runs_visits(at: Bench) -> bool:
    """Whether the control runs programs that wait for readings."""
    controller = at.supervisor.controller
    return controller.capabilities.stops and not isinstance(controller, Carried)


def _targets_again(axis: AxisSection, changes: Sequence[TableChange]) -> AxisSection | None:
    return live_again(axis, _judged_by(changes).targets)


def _turned(changes: Sequence[TableChange]) -> TableChange | None:
    """What is predicted of B: it stands at the change of the constant, with what a pair of tables takes."""
    return next((one for one in changes if one.new.kind == "reversal"), None)


def _judged_by(changes: Sequence[TableChange]) -> TableChange:
    return next((one for one in changes if one.new.kind == "axis"), changes[0])


async def _verdict(
    at: Bench, changes: Sequence[TableChange], again: AxisSection | None, before: MeasuredAxis, records: Records
) -> AxisVerdict:
    pushed = [one for one in changes if records[one.name].outcome in PUSHED]
    change = _judged_by(changes)
    turned = _turned(changes) if any(one.new.kind != "axis" for one in pushed) else None
    if again is None:
        return unmeasured(change.axis, before.evaluation, change, pushed=bool(pushed))
    after = await measure_axis(at, again, "after")
    return judge_measured(change, before, after, turned=turned)
