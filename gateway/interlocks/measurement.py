"""Rules on the measurement from which a table was made: complete, recent, proved, and worth writing."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

import numpy as np

from drivers.types.sensing import Ambient
from drivers.types.values import FloatArray
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour.doubts import all_doubts, blocking_doubts
from gateway.evaluate.behaviour.repetitions import good_readings, inconsistent_targets, pass_offsets
from gateway.interlocks.facts import (
    CROSS_DRIFT_K,
    EXPANSION_DOUBT,
    LEAST_DRIFT_K,
    MAX_AGE,
    MAX_AHEAD,
    MAX_REMAINING,
    MAX_REPEATABILITY,
    MAX_SUSPECT_SHARE,
    MIN_REPETITIONS,
    MOST_DRIFT_K,
    ROUNDING,
    SPOILT_SHARE,
    PushFacts,
    Refusal,
    Rule,
    refuse,
)
from gateway.interlocks.table import largest_change
from gateway.table.comparison import directional_difference


def _age(facts: PushFacts) -> Iterator[Refusal]:
    """A vendor's file has no end time we could trust, so its age is the operator's to know."""
    if facts.request.capture is not None:
        yield from age_refusals(facts.request.capture, facts.now_utc)


def age_refusals(capture: Capture, now_utc: datetime) -> Iterator[Refusal]:
    """Why a capture is too old to make a table from, or its date none."""
    if capture.source != "live" and not capture.ended_utc:
        return
    try:
        age = now_utc - datetime.fromisoformat(capture.ended_utc)
    except (ValueError, TypeError):
        yield from refuse("E-INT-DATE", axis=capture.axis, found=capture.ended_utc or "nothing")
        return
    if age > MAX_AGE or age < -MAX_AHEAD:
        hours = round(age.total_seconds() / 3600.0, 1)
        limit = MAX_AGE.total_seconds() / 3600.0
        yield from refuse("E-INT-AGE", axis=capture.axis, hours=hours, limit=limit)


def _warmth(facts: PushFacts) -> Iterator[Refusal]:
    if facts.request.capture is None or facts.request.ambient_now is None:
        return
    then, now = _degc(facts.request.capture.ambient_end), _degc(facts.request.ambient_now)
    limit = allowed_drift_k(facts.change)
    if then is not None and now is not None and abs(now - then) > limit:
        fields = {"then": round(then, 1), "now": round(now, 1), "limit": round(limit, 1)}
        worth = {"change": round(largest_change(facts.change), 1), "unit": facts.table.deviation_unit}
        share = round(100.0 * SPOILT_SHARE)
        yield from refuse("E-INT-WARMTH", axis=facts.request.capture.axis, share=share, **fields, **worth)


def allowed_drift_k(change: TableChange) -> float:
    """By how many K the machine may be warmer or colder than it was measured, for this table, in K.

    A linear axis grows by its length: what that may spoil is held against what the table corrects. Angles of a
    uniformly warm machine do not grow. A linear cross table holds what bends, not what grows.
    """
    table = change.new
    if table.output_unit == "deg":
        return MOST_DRIFT_K
    if table.kind != "axis":
        return CROSS_DRIFT_K
    um_per_k = EXPANSION_DOUBT * 1e-3 * abs(table.maximum - table.minimum)
    matters = SPOILT_SHARE * largest_change(change) / um_per_k if um_per_k > 0.0 else LEAST_DRIFT_K
    return float(np.clip(matters, LEAST_DRIFT_K, MOST_DRIFT_K))


def _degc(ambient: Ambient) -> float | None:
    known = [value for value in ambient.material_degc if np.isfinite(value)]
    return float(np.mean(known)) if known else ambient.air_degc


def _coverage(facts: PushFacts) -> Iterator[Refusal]:
    """The table may reach one measuring interval past the outer targets, no further."""
    beyond, widest = unmeasured_range(facts)
    if beyond > widest * 0.5 + ROUNDING and facts.request.capture is not None:
        table, targets = facts.table, facts.request.capture.targets
        first, last = float(np.min(targets)), float(np.max(targets))
        span = {"minimum": table.minimum, "maximum": table.maximum}
        yield from refuse("E-INT-COVERAGE", table=table.called, first=first, last=last, **span)


def unmeasured_range(facts: PushFacts) -> tuple[float, float]:
    """(how far the table reaches past the outer targets beyond one measuring interval, that interval)."""
    capture, table = facts.request.capture, facts.table
    if capture is None or capture.targets.size < 2:
        return 0.0, 0.0
    targets = np.sort(capture.targets)
    widest = max(float(np.max(np.diff(targets))), table.step)
    if table.modulo:
        gap = float(targets[0]) + (table.maximum - table.minimum) - float(targets[-1])
        beyond = max(gap, 0.0) - widest
    else:
        low, high = float(targets[0]) - table.minimum, table.maximum - float(targets[-1])
        beyond = max(low, high) - widest
    return beyond, widest


def _complete(facts: PushFacts) -> Iterator[Refusal]:
    capture = facts.request.capture
    if capture is None:
        return
    good = good_readings(capture.deviations, capture.suspects)
    short = int(np.sum(good < MIN_REPETITIONS))
    if short:
        fields = {"places": short, "total": good.size, "needed": MIN_REPETITIONS}
        yield from refuse("E-INT-INCOMPLETE", axis=capture.axis, **fields)
    yield from suspect_refusals(capture)


def suspect_refusals(capture: Capture) -> Iterator[Refusal]:
    """Why so many readings out of line are no accident any more."""
    share = len(capture.suspects) / max(capture.deviations.size, 1)
    if share > MAX_SUSPECT_SHARE:
        count, percent = len(capture.suspects), 100.0 * MAX_SUSPECT_SHARE
        yield from refuse("E-INT-SUSPECTS", axis=capture.axis, count=count, limit=percent)


def _doubts(facts: PushFacts) -> Iterator[Refusal]:
    """Readings with a doubt that nobody answered for make no table, whichever way the proposal came about."""
    capture = facts.request.capture
    for one in blocking_doubts(all_doubts(capture)) if capture is not None else ():
        yield from refuse("E-INT-DOUBT", axis=facts.change.axis, named=one.code, doubt=one.text)


def _measured_axis(facts: PushFacts) -> Iterator[Refusal]:
    capture, change = facts.request.capture, facts.change
    if capture is None:
        return
    if capture.axis != change.axis or capture.axis_unit != change.new.input_unit:
        found = f"{capture.axis} in {capture.axis_unit}"
        yield from refuse("E-INT-MEASURED", axis=change.axis, found=found)
    if capture.source == "live" and capture.sense is None:
        yield from refuse("E-INT-SENSE", axis=capture.axis)


def _gain(facts: PushFacts) -> Iterator[Refusal]:
    if facts.request.capture is not None:
        yield from gain_refusals(facts.request.capture, facts.change)


def gain_refusals(capture: Capture, change: TableChange) -> tuple[Refusal, ...]:
    """Why this change of an axis' own table gains too little for what was measured; empty: it is worth writing.

    Twice the pooled standard deviation of one reading, those out of line left out, must be a third of the largest
    correction at most, and what is predicted to remain half of what was measured. More of both is no reason where the
    gain is likely all the same (`Chance.worth`): of what the control's grid cannot hold a table leaves the rest, and
    the mean of many readings is surer than one.
    """
    if change.chance is not None and change.chance.worth:
        return ()
    return (*_scatter_refusals(capture, change), *_remainder_refusals(capture, change))


def _scatter_refusals(capture: Capture, change: TableChange) -> Iterator[Refusal]:
    scatter, largest = 2.0 * _pooled_deviation(_in_line(capture)), largest_change(change)
    if largest > 0.0 and scatter > MAX_REPEATABILITY * largest:
        fields = {"scatter": round(scatter, 3), "largest": round(largest, 3), "unit": change.new.deviation_unit}
        yield from refuse("E-INT-REPEAT", axis=change.axis, **fields)


def _remainder_refusals(capture: Capture, change: TableChange) -> Iterator[Refusal]:
    if change.predicted.size < 2:
        return
    measured, predicted = _spread(_means(capture.deviations)), _spread(change.predicted)
    if change.new.reverse:
        measured, predicted = _both_ways(capture, change)
    if not predicted <= measured * (MAX_REMAINING + 1e-9):
        fields = {"predicted": round(predicted, 3), "measured": round(measured, 3), "limit": 100.0 * MAX_REMAINING}
        yield from refuse("E-INT-GAIN", axis=change.axis, unit=change.new.deviation_unit, **fields)


def _both_ways(capture: Capture, change: TableChange) -> tuple[float, float]:
    """Spread over both directions of travel, as measured and as it will be, where a table has a curve for each."""
    ways = np.stack([_means(capture.deviations[:, :, side : side + 1]) for side in (0, 1)])
    if ways.shape[1] != change.targets.size:
        return _spread(_means(capture.deviations)), _spread(change.predicted)
    taken = directional_difference(change.new, change.targets) - (
        directional_difference(change.old, change.targets) if change.old_enabled else 0.0
    )
    half = (ways[0] - ways[1] - taken) / 2.0
    return _spread(ways.ravel()), _spread(np.concatenate([change.predicted + half, change.predicted - half]))


def _in_line(capture: Capture) -> FloatArray:
    """The deviations (m, n, 2) without readings out of line, or of approaches that do not agree.

    The table was not fitted to these either.
    """
    deviations = np.array(capture.deviations, dtype=np.float64)
    for target, repetition, approach in capture.suspects:
        deviations[target, repetition, approach] = np.nan
    level = deviations - pass_offsets(deviations)[None, :, :]
    return np.where(inconsistent_targets(level)[:, None, :], np.nan, deviations)


def _pooled_deviation(deviations: FloatArray) -> float:
    """Standard deviation of repetitions of one target and approach, pooled; 0 where nothing is repeated."""
    there = np.isfinite(deviations)
    count = np.sum(there, axis=1, keepdims=True)
    sums = np.sum(np.where(there, deviations, 0.0), axis=1, keepdims=True)
    apart = np.where(there, deviations - sums / np.maximum(count, 1), 0.0)
    freedom = int(np.sum(np.maximum(count - 1, 0)))
    return float(np.sqrt(np.sum(apart**2) / freedom)) if freedom else 0.0


def _means(deviations: FloatArray) -> FloatArray:
    """Mean of each target over all that is there; a target with nothing is left out."""
    flat = deviations.reshape(deviations.shape[0], -1)
    there = np.isfinite(flat)
    count = np.sum(there, axis=1)
    sums = np.sum(np.where(there, flat, 0.0), axis=1)
    return np.asarray(sums[count > 0] / count[count > 0])


def _spread(values: FloatArray) -> float:
    return float(np.std(values)) if values.size else 0.0


MEASURED: tuple[Rule, ...] = (_measured_axis, _doubts, _age, _warmth, _coverage, _complete, _gain)
MEASURED_REVERSAL: tuple[Rule, ...] = (_measured_axis, _doubts, _age, _warmth, _complete)
MEASURED_CROSS: tuple[Rule, ...] = (_doubts, _age, _warmth, _complete)
