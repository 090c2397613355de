"""What is proposed against a measured reversal: the constant, and a pair of tables where B varies with the position."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import Gap
from drivers.limits import ACCESS_LEVEL, Limits
from drivers.message import Message, digits
from drivers.types.abilities import TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_scale
from gateway.config import AxisSection
from gateway.correct.plan.plan import CROSS
from gateway.correct.plan.reversal import ReversalAdvice, reversal_advice, reversal_pair
from gateway.domain.figures import Component
from gateway.domain.proposals import FindingWeight, TableChange, TableFinding
from gateway.domain.values import COVERAGE
from gateway.model.components import is_periodic, value
from gateway.model.waves import fit_means
from gateway.table import Grid, effective
from gateway.table.comparison import acting_mean
from gateway.table.limits import check_reach, reason
from gateway.table.merging import curve_for_grid, with_directions
from gateway.workflow.axes.cross_tables import free_places, placed_change, table_places
from gateway.workflow.axes.structure import Structure
from gateway.workflow.run.context import RunContext


@dataclass(frozen=True, slots=True)
class MeasuredReversal:
    """B (m,) of a capture with its standard uncertainty u (m,), the curve fitted to it, and what it asks for."""

    B: FloatArray
    u: FloatArray
    curve: Component
    advice: ReversalAdvice


def reversal_of_capture(axis: AxisSection, shown: Structure) -> MeasuredReversal | None:
    """The reversal that a capture shows; None where no target was come to from both sides. Raises as `fit_means`."""
    means, capture = shown.means, shown.capture
    B = means.mean_up - means.mean_down
    known = np.isfinite(B)
    if np.count_nonzero(known) < 2:
        return None
    # The mean of both directions is half as uncertain as their difference; what drift leaves is common to all.
    common = 2.0 * capture.unsteady_u
    own = np.sqrt(np.maximum((2.0 * means.u) ** 2 - common**2, 0.0))
    u = np.maximum(np.where(known, own, np.nan), capture.reading_u if np.isfinite(capture.reading_u) else 0.0)
    u = np.maximum(u, 1e-6)
    curve = fit_means(
        capture.targets[known],
        B[known],
        u[known],
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )
    return MeasuredReversal(B, u, curve, reversal_advice(curve, B, u, common))


def reversal_change(
    axis: AxisSection,
    shown: Structure,
    live: LiveSet,
    *,
    seen: MeasuredReversal,
    able: bool,
    resolution: float,
    against: Message | None,
    pair: Sequence[TableChange] = (),
) -> TableChange:
    """The change of an axis' constant reversal; ``skipped`` says why there is none.

    ``able``: the road takes one and its sign is, or can be, proved; ``resolution`` is the control's, in the axis unit;
    ``against`` says why none can be pushed here (None: one can);
    ``pair`` are the tables, one for each direction, that take what varies with the position: the constant then takes B
    at the reference. ``predicted`` (m,) is B as it will be at the targets with all of them, with ``predicted_U``. What
    lies within its scatter is left alone, and so is what a constant would not make smaller.
    """
    advice, old, unit = seen.advice, live.reversal, shown.capture.unit
    step = resolution * deviation_scale(axis.unit)
    acts = old.table.deviations[0]
    constant = float(curve_for_grid(seen.curve, np.asarray([axis.reference]))[0]) if pair else advice.constant
    wanted = round(float(np.rint((acts + constant) / step)) * step, 9) + 0.0
    skipped = None if pair else _why_not(axis.name, unit, advice, able=able)
    if not skipped and abs(wanted) > Limits.of(axis.unit).reversal:
        limit = f"{Limits.of(axis.unit).reversal:g}"
        skipped = reason("S-REVERSAL-LARGE", axis.name, wanted=digits(wanted, 3, signed=True), limit=limit, unit=unit)
    if not skipped and pair and wanted == acts:
        skipped = reason("S-REVERSAL-PAIR", axis.name)
    skipped = skipped or against
    targets = shown.capture.targets
    taken = 0.0 if skipped else wanted - acts
    return TableChange(
        axis=axis.name,
        old=old.table,
        new=old.table if skipped else replace(old.table, deviations=(wanted,)),
        old_enabled=old.enabled,
        base_digest=live.digest,
        targets=targets,
        predicted=seen.B - taken - by_direction(pair, targets),
        predicted_U=COVERAGE * np.hypot(seen.u * np.sqrt(2.0), 2.0 * shown.capture.unsteady_u),
        skipped=skipped,
    )


def by_direction(pair: Sequence[TableChange], at: FloatArray) -> FloatArray:
    """What tables for one direction each change of B = mean(+) - mean(-) at positions (m,), um or arcsec."""
    found = np.zeros_like(at)
    for one in pair:
        before = LiveTable(one.old, enabled=one.old_enabled)
        found += one.new.direction * (acting_mean(one.new, at) - acting_mean(effective(before), at))
    return found


def _why_not(axis: str, unit: DeviationUnit, advice: ReversalAdvice, *, able: bool) -> Message | None:
    sizes = {"B": f"{advice.largest:.2g}", "U": f"{advice.U:.2g}", "mean": f"{advice.mean:+.2g}", "unit": unit}
    if advice.within:
        return reason("S-REVERSAL-WITHIN", axis, **sizes)
    if not able:
        return reason("S-REVERSAL-KIND", axis, **sizes)
    if advice.constant == 0.0:
        return reason("S-REVERSAL-NO-GAIN", axis, **sizes)
    return None


async def reversal_changes(
    at: RunContext,
    axis: AxisSection,
    shown: Structure,
    live: LiveSet,
    *,
    resolution: float,
    taken: Collection[int] = (),
) -> tuple[TableChange, ...]:
    """The change of the constant reversal and after it those of a pair, where there is one; () where nothing tells B.

    ``resolution`` is that of the axis' tables, in the axis unit; cross tables of the numbers ``taken`` are proposed for
    others. Raises as `fit_means`, ValueOutOfRange (E-COMP-...).
    """
    seen = reversal_of_capture(axis, shown)
    if seen is None:
        return ()
    proved = at.proofs.find(at.machine, "reversal", axis.name) is not None
    against = await _objection(at, axis, proved=proved)
    can = at.supervisor.controller.capabilities
    pair, why = ((), None) if against or not seen.advice.depends else await _pair_changes(at, axis, seen, live, taken)
    # Proving its sign takes coming from both sides, so a program.
    able = can.table("reversal") is not None and (proved or can.stops)
    given = (axis, shown, live)
    turned = reversal_change(*given, seen=seen, able=able, resolution=resolution, against=against, pair=pair)
    if why:
        at.say("P-REVERSAL-VARIES", axis=axis.name, words=why)
    return (turned, *pair)


async def _objection(at: RunContext, axis: AxisSection, *, proved: bool) -> Message | None:
    """Why a reversal of this axis could not be pushed here, whatever was measured; None where it could."""
    if not proved and not axis.measure.instrument:
        return reason("S-REVERSAL-PROOF", axis.name)
    level = (await at.supervisor.controller.state()).access_level
    return reason("S-REVERSAL-ACCESS", axis.name, level=level, needed=ACCESS_LEVEL) if level > ACCESS_LEVEL else None


async def _pair_changes(
    at: RunContext, axis: AxisSection, seen: MeasuredReversal, live: LiveSet, taken: Collection[int]
) -> tuple[tuple[TableChange, ...], Message | None]:
    """Both tables, or () and why there are none.

    The tooth's own cross tables come first: a pair takes what they leave.
    """
    can = at.supervisor.controller.capabilities
    cross = can.table("cross")
    provable = can.stops or at.proofs.find(at.machine, "cross", axis.name) is not None
    if cross is None or cross.directions != "tables" or can.table("reversal") is None or not provable:
        return (), reason("S-REVERSAL-PAIR-ROAD", axis.name)
    grid = Grid(axis.table.minimum, axis.table.maximum, axis.table.step)
    try:
        tables = reversal_pair(seen.curve, axis.unit, grid, reference=axis.reference, modulo=axis.modulo)
    except Gap as error:  # fewer targets were read in both directions than in one: the mean may have its table
        return (), error.message
    sets = {axis.name: live}
    if len(await free_places(at, axis.name, sets, taken)) < _numbers_needed(at, tables, live):
        return (), reason("S-REVERSAL-PAIR-ROOM", axis.name)
    places = await table_places(at, tables, sets, spoken_for=taken)
    if any(place.reason for place in places):
        return (), reason("S-REVERSAL-PAIR-ROOM", axis.name)
    return tuple(
        placed_change(at, table, place, sets, adds=True) for table, place in zip(tables, places, strict=True)
    ), None


def _numbers_needed(at: RunContext, tables: tuple[CompensationTable, ...], live: LiveSet) -> int:
    """How many numbers must be free: for tables that have none yet, and for all that the tooth may ask for."""
    held = [one.table for one in (*live.cross, *live.others) if one.enabled or any(one.table.deviations)]
    ways = {one.direction for one in held if one.input_axis == one.output_axis == live.axis}
    of_tooth = sum(one.direction == 0 for one in held)
    tooth = max(len(CROSS) - of_tooth, 0) if at.site.work is not None else 0
    return tooth + sum(one.direction not in ways for one in tables)


# An axis' change where the control holds a curve for each direction: the reversal goes into the table itself.


def remaining_reversal(turned: TableChange, seen: MeasuredReversal) -> TableChange:
    """The reversal's change as far as it matters for the table beside it: what a fitted B leaves of B."""
    return turned if seen.advice.within else replace(turned, predicted=seen.B - value(seen.curve, turned.targets))


def split_by_direction(
    axis: AxisSection, change: TableChange, live: LiveSet, limits: TableLimits, seen: MeasuredReversal
) -> TableChange:
    """The same change with a column for each direction; a reversal alone makes one too. Raises as `with_directions`."""
    curve = None if seen.advice.within else seen.curve
    said: tuple[TableFinding, ...] = ()
    if curve is not None and not is_periodic(curve):
        try:
            check_reach(curve.domain, (axis.table.minimum, axis.table.maximum), axis.unit, axis.name)
        except Gap as error:  # fewer targets were read in both directions than in one: the mean may have its table
            curve, said = None, (TableFinding(error.message, FindingWeight.REFUSES),)
    if change.skipped and (curve is None or live.cross):
        return replace(change, findings=(*change.findings, *said))
    new = with_directions(
        axis.facts,
        None if change.skipped else change.new,
        effective(live.own),
        reversal=curve,
        grid=Grid(axis.table.minimum, axis.table.maximum, axis.table.step),
        resolution=limits.resolution * deviation_scale(axis.unit),
    )
    return replace(change, new=new, skipped=None, findings=(*change.findings, *said))
