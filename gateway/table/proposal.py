"""One axis' fitted deviation and its live table -> the table to load and its effect, or the reasons against one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivers.errors import Gap
from drivers.limits import Limits
from drivers.message import Form, Message, Quantity, digits
from drivers.types.doubts import Doubt
from drivers.types.tables import CompensationTable, LiveSet
from drivers.units import DeviationUnit, deviation_unit
from gateway.axes import AxisRecord
from gateway.domain.figures import Component
from gateway.domain.proposals import Chance, TableChange, TableFinding
from gateway.domain.values import COVERAGE, FloatArray
from gateway.model.components import is_periodic, standard_uncertainty, value
from gateway.table.benefit_probability import PosteriorCurves, benefit_probability
from gateway.table.comparison import acting_mean, effective
from gateway.table.limits import (
    check,
    check_points,
    check_reach,
    interlock_finding,
    reason,
    reasons_of,
    second_person_finding,
)
from gateway.table.merging import Grid, curve_for_grid, left_over, merge_curve, travel_places

BAND_RISK = 0.01
WIDEST_BRIDGE_DEG = 60.0
TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class MeasuredMeans:
    """Means of both directions (m,) at targets (m,), their standard uncertainties u (m,); NaN is missing.

    ``rest`` is the RMS of what one reading differs from the mean by: half the reversal and scatter, no table's matter.
    ``unseen`` is the best estimate of what lies between the targets (RMS); None takes the fit's ``residual_rms``.
    ``possible`` are axes that explain what was measured, where something unseen was found; None: none are known.
    ``doubts`` are of the readings: a blocking one leaves no table, an accepted one is a finding of it.
    ``place`` is then the target furthest out of the line of its neighbours, and how far.
    """

    targets: FloatArray
    means: FloatArray
    u: FloatArray
    rest: float = 0.0
    unseen: float | None = None
    possible: PosteriorCurves | None = None
    place: tuple[float, float] | None = None
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True, slots=True)
class InstrumentU:
    """Expanded uncertainty (k = 2) common to all readings: constant + per_unit x |position - reference|."""

    constant: float
    per_unit: float = 0.0

    @classmethod
    def usual(cls, unit: DeviationUnit) -> InstrumentU:
        """A laser on a machine: 0.3 um + 1.5 um/m (air, material to 0.2 K); a rotary calibrator: 1 arcsec."""
        return cls(0.3, 0.0015) if unit == "um" else cls(1.0)

    def standard(self, distance: FloatArray) -> FloatArray:
        """Standard uncertainty at a distance from the reference."""
        return np.asarray((self.constant + self.per_unit * np.abs(distance)) / COVERAGE)


def propose(
    axis: AxisRecord,
    component: Component,
    measured: MeasuredMeans,
    live: LiveSet,
    grid: Grid,
    *,
    resolution: float,
    reserved_points: int,
    instrument: InstrumentU | None = None,
    limits: Limits | None = None,
) -> TableChange:
    """The axis table that cancels the fitted deviation of an axis (value = +deviation, sign convention).

    ``component`` was fitted to ``measured``, captured while ``live`` acted: new = live (if enabled) +
    fitted, by least squares on the grid, zero at the reference, first = last for a modulo axis, rounded to
    ``resolution`` (deviation unit: um or arcsec). Beyond the measured range the last fitted value holds, which is said
    (W-COMP-FLAT); a table that lies mostly there is refused.

    Nothing is proposed (``skipped`` says why) when the whole fitted curve lies within its uncertainty:
    |d - mean d| <= U everywhere (see `_significance`), when the means would not get a smaller range, when what lies
    unseen between the targets is more than half of what the table takes away and the axes that may be behind it do not
    make a gain likely (`Chance.worth`), when reversal and scatter leave no gain
    beyond the uncertainty (see `reasons`), or while a cross table acted on the axis by its own position.
    The decision is for the whole curve: leaving out single points would put jumps of their uncertainty
    into the table. ``predicted`` is zero on the fitted curve at the reference; compare a later measurement
    after removing its common offset.

    Raises TooManyPoints (E-COMP-POINTS), Gap (E-COMP-GRID, E-COMP-TURN, E-COMP-REACH), ValueOutOfRange (see `check`).
    """
    check_points(grid.intervals + 1, reserved_points, axis.name)
    _check_turn(axis, component, grid)
    known = instrument or InstrumentU.usual(deviation_unit(axis.unit))
    acts = effective(live.own)
    limit = limits or Limits.of(axis.unit)
    new = merge_curve(axis, component, live.own.table, acts, grid=grid, resolution=resolution, limit=limit)
    skipped = (
        in_doubt(axis.name, measured.doubts)
        or other_layer(axis.name, live)
        or _why_not(axis, component, measured, known, acts, new)
    )
    findings: tuple[TableFinding, ...] = ()
    chance = None
    if skipped:
        new = live.own.table
    else:
        chance = _harm_probability(axis, component, measured, known, acts, new)
        doubtful = _doubtful(axis, component, measured, chance, _correction_rms(component, acts, new))
        accepted = accepted_doubts(axis.name, measured.doubts)
        findings = (*accepted, *_coverage(axis, component, grid), *doubtful, *check(new, acts, limit, axis.name))
    return TableChange(
        axis=axis.name,
        old=live.own.table,
        new=new,
        old_enabled=live.own.enabled,
        base_digest=live.digest,
        targets=measured.targets,
        predicted=_predicted_deviation(axis, component, measured, acts, acts if skipped else new),
        predicted_U=_predicted_U(axis, component, measured, known),
        findings=findings,
        skipped=skipped,
        chance=chance,
    )


def _check_turn(axis: AxisRecord, component: Component, grid: Grid) -> None:
    if not axis.modulo:
        if not is_periodic(component):
            check_reach(component.domain, (grid.minimum, grid.maximum), axis.unit, axis.name)
        return
    if abs(grid.maximum - grid.minimum - TURN_DEG) > 1e-9:
        raise Gap("E-COMP-GRID", axis.name, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)
    if not is_periodic(component):
        raise Gap("E-COMP-TURN", axis.name, low=component.domain[0], high=component.domain[1])


def _why_not(
    axis: AxisRecord,
    component: Component,
    measured: MeasuredMeans,
    instrument: InstrumentU,
    acts: CompensationTable,
    new: CompensationTable,
) -> Message | None:
    unit = deviation_unit(axis.unit)
    largest, bound = _significance(axis, component, instrument)
    hidden, taken = _unresolved_error(component, measured), _correction_rms(component, acts, new)
    if largest <= 1.0 and hidden <= max(instrument.constant, COVERAGE * float(np.nanmax(measured.u))):
        return reason("S-COMP-WITHIN-U", axis.name, bound=digits(bound, 2), unit=unit)
    if largest <= 1.0 or may_harm(hidden, taken):
        chance = probability_for(measured.possible, instrument, acts, new)
        if chance is None or not chance.worth:
            return hidden_structure_reason(axis.name, unit, hidden, taken, chance=chance)
    before = float(np.nanmax(measured.means) - np.nanmin(measured.means))
    after = _predicted_deviation(axis, component, measured, acts, new)
    left = float(np.nanmax(after) - np.nanmin(after))
    if left < before:
        # What a grid does to short waves between the targets counts as well.
        before, left = left_over(component, acts, acts), left_over(component, new, acts)
    if left >= before:
        return reason("S-COMP-NO-GAIN", axis.name, before=digits(before, 3), after=digits(left, 3), unit=unit)
    U = _predicted_U(axis, component, measured, instrument)
    return scatter_reason(axis.name, unit, means=measured.means, after=after, rest=measured.rest, U=U)


def _harm_probability(
    axis: AxisRecord,
    component: Component,
    measured: MeasuredMeans,
    instrument: InstrumentU,
    acts: CompensationTable,
    new: CompensationTable,
) -> Chance | None:
    """The chance that a table is proposed by, where what stays unseen may do harm; None where it may not."""
    chance = probability_for(measured.possible, instrument, acts, new)
    harm = may_harm(_unresolved_error(component, measured), _correction_rms(component, acts, new))
    return chance if harm or _significance(axis, component, instrument)[0] <= 1.0 else None


def _doubtful(
    axis: AxisRecord, component: Component, measured: MeasuredMeans, chance: Chance | None, taken: float
) -> tuple[TableFinding, ...]:
    """Warnings of a table that is proposed although something stays unseen between the targets."""
    hidden, unit = _unresolved_error(component, measured), deviation_unit(axis.unit)
    if chance is not None:
        return (by_chance(axis.name, unit, hidden, chance),)
    said = doubtful(axis.name, unit, hidden, taken)
    if said or measured.place is None:
        return said
    return one_place(axis.name, unit, axis.unit, place=measured.place, taken=taken)


def probability_for(
    possible: PosteriorCurves | None, instrument: InstrumentU, acts: CompensationTable, new: CompensationTable
) -> Chance | None:
    """What a new table does to the axes that may be; the instrument may be off by its own share."""
    if possible is None:
        return None
    at = possible.lattice
    found = benefit_probability(possible.curves, acting_mean(new, at) - acting_mean(acts, at))
    return replace(found, u=float(np.hypot(found.u, instrument.constant / COVERAGE)))


def _unresolved_error(component: Component, measured: MeasuredMeans) -> float:
    return component.residual_rms if measured.unseen is None else measured.unseen


def _correction_rms(component: Component, acts: CompensationTable, new: CompensationTable) -> float:
    """RMS of what the new table takes away from the measured range beyond what acts now, its mean left out."""
    at = travel_places(component)
    return float(np.std(acting_mean(new, at) - acting_mean(acts, at)))


def band(component: Component, at: FloatArray) -> FloatArray:
    """The Scheffe band of a fit at positions: how far its shape may be off, for all positions at once with 99 %."""
    freedom = max(component.coefficients.size - 1, 1)
    return np.asarray(np.sqrt(scipy.special.chdtri(freedom, BAND_RISK)) * standard_uncertainty(component, at))


def _significance(axis: AxisRecord, component: Component, instrument: InstrumentU) -> tuple[float, float]:
    """(largest |d - mean d| / U over the measured range, U there).

    U joins the band of the fit, what lies unseen between the targets, and the instrument.
    """
    at = travel_places(component)
    d = value(component, at)
    common = np.hypot(instrument.standard(at - axis.reference), component.residual_rms)
    U = np.hypot(band(component, at), COVERAGE * common)
    ratio = np.abs(d - d.mean()) / U
    worst = int(np.argmax(ratio))
    return float(ratio[worst]), float(U[worst])


def _predicted_deviation(
    axis: AxisRecord,
    component: Component,
    measured: MeasuredMeans,
    acts: CompensationTable,
    new: CompensationTable,
) -> FloatArray:
    places = np.append(measured.targets, axis.reference)
    change = acting_mean(new, places) - acting_mean(acts, places)
    datum = float(curve_for_grid(component, np.asarray([axis.reference]))[0])
    return np.asarray(measured.means - datum - (change[:-1] - change[-1]))


def _predicted_U(
    axis: AxisRecord, component: Component, measured: MeasuredMeans, instrument: InstrumentU
) -> FloatArray:
    """k = 2: readings before and after, the fit, what lies unseen between targets, and the instrument."""
    at = measured.targets
    variance = 2.0 * measured.u**2 + standard_uncertainty(component, at) ** 2 + component.residual_rms**2
    return np.asarray(COVERAGE * np.sqrt(variance + instrument.standard(at - axis.reference) ** 2))


def _coverage(axis: AxisRecord, component: Component, grid: Grid) -> Sequence[TableFinding]:
    if is_periodic(component):
        nodes = np.asarray(component.parameters.get("nodes", ()), dtype=np.float64)
        bridge = float(np.diff(np.append(nodes, nodes[0] + TURN_DEG)).max()) if nodes.size else 0.0
        if bridge > WIDEST_BRIDGE_DEG:
            return [second_person_finding("W-COMP-BRIDGE", axis.name, gap=Quantity(bridge), unit=axis.unit)]
        return []
    low, high = component.domain
    tolerance = grid.step * 1e-6
    found: list[TableFinding] = []
    if not grid.minimum - tolerance <= axis.reference <= grid.maximum + tolerance:
        ends = {"low": Quantity(grid.minimum), "high": Quantity(grid.maximum), "unit": axis.unit}
        found.append(second_person_finding("W-COMP-OUTSIDE", axis.name, reference=Quantity(axis.reference), **ends))
    if low <= grid.minimum + tolerance and high >= grid.maximum - tolerance:
        return found
    fields = {"low": Quantity(low), "high": Quantity(high), "minimum": Quantity(grid.minimum)}
    return [
        *found,
        interlock_finding("W-COMP-FLAT", axis.name, **fields, maximum=Quantity(grid.maximum), unit=axis.unit),
    ]


# ---- Reasons against a table that the axis itself gives: a cross table on, fine structure, reversal, scatter.

MOST_UNSEEN = 0.5
WORTH_SAYING = 0.25
OUTWEIGHS = 2.0


def in_doubt(axis: str, doubts: Sequence[Doubt]) -> Message | None:
    """Why no table is made of readings that leave a doubt which nobody settled; None without such."""
    said = tuple(replace(one.message, form=Form.REASON, where="") for one in doubts if one.blocking)
    return reason("S-DOUBT-TABLE", axis, doubts=said) if said else None


def accepted_doubts(axis: str, doubts: Sequence[Doubt]) -> tuple[TableFinding, ...]:
    """A finding for each doubt that a person settled: another person reads it before the push."""
    return tuple(
        second_person_finding("W-DOUBT-ACCEPTED", axis, named=one.code, reason=one.settled, doubt=one.message)
        for one in doubts
        if one.settled
    )


def other_layer(axis: str, live: LiveSet) -> Message | None:
    """One by the axis' own position looks like its deviation; by another axis' position it is a constant here.

    One of each direction is a reversal: half of it up and half of it down leave the mean of both as it is.
    """
    acted = [
        str(one.table.index)
        for one in live.cross
        if one.enabled and _by_itself(one.table) and any(one.table.deviations)
    ]
    return reason("S-COMP-CROSS-ON", axis, tables=", ".join(acted)) if acted else None


def _by_itself(table: CompensationTable) -> bool:
    return table.input_axis == table.output_axis and table.direction == 0


def hidden_structure_reason(
    axis: str, unit: DeviationUnit, hidden: float, taken: float, chance: Chance | None = None
) -> Message:
    """Why ``hidden`` structure (RMS) forbids a table that takes ``taken`` (RMS) away, and what its chances would be."""
    why = reason("S-COMP-HIDDEN", axis, hidden=digits(hidden, 2), gain=digits(taken, 2), unit=unit)
    if chance is None:
        return why
    return reasons_of(why, reason("S-COMP-CHANCE", axis, unit=unit, **_figures(chance)))


def by_chance(axis: str, unit: DeviationUnit, hidden: float, chance: Chance) -> TableFinding:
    """The label of a table that is proposed although ``hidden`` structure (RMS) stays: a second person is asked for."""
    return second_person_finding("W-COMP-CHANCE", axis, hidden=digits(hidden), unit=unit, **_figures(chance))


def by_gain(axis: str, unit: DeviationUnit, before: float, left: float, chance: Chance) -> TableFinding:
    """The label of a table that leaves more than half (RMS) of an axis and gains all the same: a second person too."""
    sizes = {"before": digits(before), "left": digits(left)}
    return second_person_finding("W-COMP-LEAVES", axis, unit=unit, **sizes, **_figures(chance))


def by_scatter(axis: str, unit: DeviationUnit, scatter: float, chance: Chance) -> TableFinding:
    """The label of a table on an axis whose single readings scatter much (s), and that gains all the same."""
    return second_person_finding("W-COMP-SCATTERS", axis, unit=unit, scatter=digits(scatter), **_figures(chance))


def _figures(chance: Chance) -> dict[str, str]:
    return {"gain": f"{chance.gain:.2g}", "u": f"{chance.u:.2g}", "worse": f"{100.0 * chance.worse:.0f}"}


def may_harm(hidden: float, taken: float) -> bool:
    """Whether the axis might get worse, however unlucky the hidden structure lies to the correction.

    With correction c and hidden h (RMS over the axis) the square of the error falls by |c|^2 + 2 <c, h> at least
    |c|^2 - 2 |c| |h| (Cauchy and Schwarz): never below zero while |h| <= |c| / 2.
    """
    return hidden > MOST_UNSEEN * taken


def doubtful(axis: str, unit: DeviationUnit, hidden: float, taken: float) -> tuple[TableFinding, ...]:
    """A warning where hidden structure stays that is worth a second look."""
    if hidden <= WORTH_SAYING * taken:
        return ()
    return (second_person_finding("W-COMP-HIDDEN", axis, hidden=digits(hidden), gain=digits(taken), unit=unit),)


def one_place(
    axis: str, unit: DeviationUnit, per: str, place: tuple[float, float], taken: float
) -> tuple[TableFinding, ...]:
    """A warning of the target furthest out of the line of its neighbours, however smooth the axis is elsewhere.

    One place is little of an RMS over the travel, and still all that a table may do wrong there.
    """
    at, off = place
    if off <= WORTH_SAYING * taken:
        return ()
    return (second_person_finding("W-COMP-PLACE", axis, at=digits(at, 4), per=per, off=digits(off), unit=unit),)


def scatter_reason(
    axis: str, unit: DeviationUnit, means: FloatArray, after: FloatArray, rest: float, U: FloatArray
) -> Message | None:
    """Where reversal and scatter (``rest``, RMS) are most of the error, the whole must fall by more than the table's U.

    ``means`` and ``after`` (m,) are the means of both directions now and as predicted, ``U`` (m,) of these (k = 2).
    """
    now, then, bound = float(np.nanstd(means)), float(np.nanstd(after)), float(np.sqrt(np.nanmean(U**2)))
    before, left = float(np.hypot(now, rest)), float(np.hypot(then, rest))
    if rest <= OUTWEIGHS * now or before - left > bound:
        return None
    fields = {"before": f"{before:.3g}", "after": f"{left:.3g}", "U": f"{bound:.2g}", "rest": f"{rest:.3g}"}
    return reason("S-COMP-REVERSAL", axis, **fields, unit=unit)
