"""What acts on the axes of the next layer, read in the program that has just measured: nobody starts one for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.carried import Carried
from drivers.ports.controller import ReadsTogether
from drivers.programs import ForeseesPlans, reading_plan
from drivers.types.stops import StopPlan
from drivers.types.tables import LiveSet
from gateway.domain.proposals import TableChange
from gateway.push import PushContext, read_live_of_axes, table_questions
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.control.contexts import table_context

Measured = Mapping[str, MeasuredAxis]


def reads_of(at: Bench, changes: Sequence[TableChange], measured: Measured) -> tuple[StopPlan, ...]:
    """The plans of `read_before`, to be foreseen behind what is visited before it."""
    contexts = _contexts(at, changes, measured)
    return tuple(reading_plan(one) for one in table_questions(contexts)) if contexts else ()


async def read_before(at: Bench, changes: Sequence[TableChange], measured: Measured) -> dict[str, LiveSet]:
    """What acts on each output axis of these changes, by its name; nothing where the road makes no program of plans.

    Raises as `gateway.push.controller_access.read_live_of_axes`.
    """
    contexts = _contexts(at, changes, measured)
    if not contexts:
        return {}
    found = await read_live_of_axes(contexts)
    return {context.axis.name: live for context, live in zip(contexts, found, strict=True)}


def _contexts(at: Bench, changes: Sequence[TableChange], measured: Measured) -> tuple[PushContext, ...]:
    controller = at.supervisor.controller
    together = isinstance(controller, ForeseesPlans) and isinstance(controller, ReadsTogether)
    if not together or isinstance(controller, Carried):
        return ()
    of: dict[str, PushContext] = {}
    for change in changes:
        if not change.skipped and change.axis not in of:
            known = measured.get(change.axis)
            of[change.axis] = table_context(at, change.new, known.capture if known is not None else None)
    return tuple(of.values())
