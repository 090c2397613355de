"""What a sign proof puts into the control, and what its readings say: small tables, steps, the verdict on them; pure.

A triangle table, zero at the reference and both ends, peak 3 um or 3 arcsec. The mean step of switching it is judged by
the rule that the interlock reads a stored proof with (`gateway.interlocks.proves`). An axis table: it must be negative,
as the manual says. A cross table: no public text settles the sign, so it is what is measured. A reversal: a trial value
as large while the axis goes away and comes back: what changes is B = mean(+) - mean(-), so it does not matter whether a
control takes a new value up at once or at the next turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Any, Literal, Protocol

import numpy as np

from drivers.errors import TableError, UnsupportedDevice
from drivers.terms import TableKind
from drivers.types.orders import SignProof
from drivers.types.stops import StopPlan
from drivers.types.tables import CompensationTable, LiveSet, reversal_of
from drivers.types.values import Approach
from drivers.units import deviation_unit
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.proofs.switching import PEAK, Steps
from gateway.push.unexpected import unheard
from gateway.push.work import Reading


class Eyes(Protocol):
    """Instruments that see output axes, each mounted when its axis' turn has come."""

    def plans(self, axis: str) -> Sequence[StopPlan]:
        """What mounting will visit, for a control that makes one program of plans."""
        ...

    async def on(self, axis: str) -> Reading:
        """Mount it: what then opens, for each table, the settled readings of this axis.

        A reading is of the *output* axis at a stop in um or arcsec, positive as the axis counts, with its u; only
        differences matter.
        """
        ...


def _unheard(_steps: Steps) -> None:
    """Nobody keeps it."""


@dataclass(frozen=True, slots=True)
class SignQuestion:
    """Which sign to prove: of a kind of table on the context's output axis, on this grid of its input axis.

    ``index`` is the number of the cross table to borrow, ``direction`` that of travel in which it is to act (0: both).
    ``again`` hears the first steps where they prove nothing, before the table is switched once more.
    """

    context: PushContext
    minimum: float
    maximum: float
    step: float
    kind: TableKind = "axis"
    index: int = 0
    direction: Approach | Literal[0] = 0
    again: Callable[[Steps], None] = _unheard


@dataclass(frozen=True, slots=True)
class AlreadyOn:
    """Eyes that see already."""

    reading: Reading

    def plans(self, _axis: str) -> Sequence[StopPlan]:
        """Nothing to visit."""
        return ()

    async def on(self, _axis: str) -> Reading:
        """The reading it was made with."""
        return self.reading


@dataclass(frozen=True, slots=True, eq=False)
class TrialTable:
    """One question with its table, and where that has its peak."""

    question: SignQuestion
    context: PushContext
    table: CompensationTable
    peak: float

    def change(self, live: LiveSet | None) -> TableChange:
        """Before the live table is known the triangle is asked about as if nothing were live."""
        nothing = np.zeros(0)
        held = table_in(live, self.table) if live is not None else None
        old, enabled = (held.table, held.enabled) if held is not None else (self.table, False)
        digest = live.digest if live is not None else ""
        return TableChange(
            self.table.output_axis,
            old,
            new=self.table,
            old_enabled=enabled,
            base_digest=digest,
            targets=nothing,
            predicted=nothing,
            predicted_U=nothing,
        )


def triangle(
    context: PushContext,
    minimum: float,
    maximum: float,
    step: float,
    kind: TableKind = "axis",
    index: int = 0,
) -> tuple[CompensationTable, float]:
    """The proof's table on the input axis' grid, and where its peak is; ``index`` is the cross table's number.

    Zero at the reference (and its two neighbours when it lies between points), at both ends and everywhere
    outside the longer side of the reference. Raises TableError (E-PUSH-TRIANGLE) when no peak fits.
    """
    return triangle_of(context.moved, context.axis, minimum=minimum, maximum=maximum, step=step, kind=kind, index=index)


def triangle_of(
    axis: AxisRecord,
    output: AxisRecord,
    minimum: float,
    maximum: float,
    step: float,
    kind: TableKind = "axis",
    index: int = 0,
) -> tuple[CompensationTable, float]:
    """As `triangle`, for an input ``axis`` and an ``output`` axis without a machine to push to."""
    if kind == "reversal":
        return reversal_of(output.name, output.unit, PEAK, output.encoder), float(np.mean(output.room))
    count = round((maximum - minimum) / step) + 1
    at = min(max((axis.reference - minimum) / step, 0.0), float(count - 1))
    below, above = (0, floor(at + 1e-9)), (ceil(at - 1e-9), count - 1)
    first, last = max(below, above, key=lambda side: side[1] - side[0])
    peak = _peak(axis.room, minimum, step=step, first=first, last=last)
    if not first < peak < last:
        grid: dict[str, Any] = {"minimum": minimum, "maximum": maximum, "step": step}
        raise TableError("E-PUSH-TRIANGLE", axis.name, axis=axis.name, **grid)
    values = np.interp(np.arange(count), [first, peak, last], [0.0, PEAK, 0.0])
    table = CompensationTable(
        kind,
        axis.name,
        output_axis=output.name,
        minimum=minimum,
        maximum=maximum,
        step=step,
        deviations=tuple(round(float(value), 3) for value in values),
        modulo=axis.modulo,
        index=output.encoder if kind == "axis" else index,
        input_unit=axis.unit,
        output_unit=output.unit,
    )
    return table, minimum + peak * step


def _peak(travel: tuple[float, float], minimum: float, step: float, first: int, last: int) -> int:
    """The grid point nearest to the middle of the side that the axis can reach."""
    low = max(first + 1, ceil((travel[0] - minimum) / step))
    high = min(last - 1, floor((travel[1] - minimum) / step))
    return min(max((first + last) // 2, low), high) if low <= high else first


def trial_of(question: SignQuestion) -> TrialTable:
    """The question's trial table. Raises TableError (E-PUSH-TRIANGLE), UnsupportedDevice (E-PUSH-NO-SWITCHING)."""
    context = replace(unheard(question.context), proof=None)
    table, peak = triangle(
        context,
        question.minimum,
        maximum=question.maximum,
        step=question.step,
        kind=question.kind,
        index=question.index,
    )
    table = replace(table, direction=question.direction) if question.kind == "cross" else table
    if not context.controller.capabilities.proves_signs:
        raise UnsupportedDevice("E-PUSH-NO-SWITCHING", context.axis.name, table=table.name)
    return TrialTable(question, context, table, peak)


def judged(context: PushContext, steps: Steps, kind: TableKind) -> SignProof:
    """The proof of a kind of table on an output axis. Raises VerifyError (E-PUSH-NO-PROOF, E-PUSH-SIGN)."""
    axis = context.axis
    if not steps.prove:
        told: dict[str, Any] = {"mean": round(steps.mean, 3), "u": round(steps.u, 3), "peak": PEAK}
        told["count"] = len(steps.each)
        raise VerifyError("E-PUSH-NO-PROOF", axis.name, axis=axis.name, unit=deviation_unit(axis.unit), **told)
    if kind != "cross" and steps.mean > 0:
        told = {"mean": round(steps.mean, 3), "unit": deviation_unit(axis.unit)}
        raise VerifyError("E-PUSH-SIGN", axis.name, axis=axis.name, **told)
    moment = context.clock.utc().isoformat(timespec="seconds")
    sign = SignProof.sign_of(steps.mean)
    return SignProof(
        context.machine,
        kind,
        output_axis=axis.name,
        slope=steps.mean / PEAK,
        slope_u=steps.u / PEAK,
        sign=sign,
        date_utc=moment,
    )
