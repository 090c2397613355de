"""What must be said of a proposal for the tooth: what was left alone, what cannot be cured, which unknowns matter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.types.tables import factors_of
from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.config import WorkSection
from gateway.correct.outlook.flank_uncertainty import THRESHOLD_UM
from gateway.correct.outlook.prediction import CrossTableSelection, DominantError, Prediction
from gateway.correct.plan.layers import LayeredCorrection
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour.repeatability import approach_of
from gateway.evaluate.standards.conformity import verdict_word
from gateway.model.error_model import ErrorModel
from gateway.table.comparison import taken_by_cross
from gateway.tooth import (
    AxisOutlook,
    CureRecord,
    DriveDoubt,
    DriveForecast,
    DriveProposal,
    ToothProposal,
    next_for_drive,
)


def required_messages(
    tooth: ToothProposal, model: ErrorModel, found: LayeredCorrection, gains: Prediction, left_alone: Sequence[Message]
) -> tuple[Message, ...]:
    """What people need, in words.

    ``gains`` is the outlook of the cross tables, proposed or not, ``left_alone`` what was said before.
    """
    return (*left_alone, *_gain(found, gains), *_mechanical(tooth), *_unmeasured_errors(tooth, model), *_work(tooth))


def explanatory_messages(tooth: ToothProposal, model: ErrorModel, found: LayeredCorrection) -> tuple[Message, ...]:
    """What explains the proposal and asks nothing of anybody, in words."""
    said = [*found.said]
    if not _beyond_tables(tooth):
        said.append(Message.of("S-TOOTH-ALL-CURED", limit=digits(THRESHOLD_UM, 6)))
    said.append(Message.of("S-TOOTH-B-LEFT", share=fixed(100.0 * tooth.b_left, 0)))
    sizes = _sizes(tooth, model)
    if sizes and max(sizes.values()) <= THRESHOLD_UM:
        said.append(Message.of("S-TOOTH-UNKNOWN-NONE", count=len(sizes), limit=digits(THRESHOLD_UM, 6)))
    return tuple(said)


def drive_messages(drive: DriveProposal | None) -> tuple[Message, ...]:
    """What drives the corrected machine will make, what each goal costs, and the verdicts on their limits, in words."""
    if drive is None:
        return ()
    figures = {
        "transmission": fixed(drive.transmission_arcsec, 1),
        "u": fixed(drive.transmission_u_arcsec, 1),
        "lost": fixed(drive.lost_motion_arcsec, 0),
        "lost_u": fixed(drive.lost_motion_u_arcsec, 0),
    }
    said = [Message.of("S-TOOTH-DRIVE", name=drive.reducer, datum=drive.datum, **figures)]
    for row in drive.rows:
        sizes = {"flank": fixed(row.flank_um), "transmission": fixed(row.transmission_arcsec, 1)}
        said.append(Message.of("S-TOOTH-GOAL", name=row.name, lost=fixed(row.lost_motion_arcsec, 0), **sizes))
    for one in drive.limits:
        value, limit = (
            Message.of("S-VALUE-U", value=fixed(one.value_arcsec, 1), U=fixed(one.U_arcsec, 1)),
            digits(one.limit_arcsec, 6),
        )
        said.append(
            Message.of(
                "S-TOOTH-DRIVE-LIMIT", name=one.name, value=value, limit=limit, verdict=verdict_word(one.verdict)
            )
        )
    return (*said, *measure_for_drive(drive.doubts))


def drive_forecast_messages(drive: DriveForecast | None) -> tuple[Message, ...]:
    """What drives the machine makes before and after its tables, and what to measure for them, in words."""
    if drive is None:
        return ()
    said = [Message.of("S-DAY-DRIVE", name=drive.reducer, datum=drive.datum)]
    for row in drive.rows:
        sizes = {"flank": fixed(row.flank_um), "transmission": fixed(row.transmission_arcsec, 1)}
        said.append(Message.of("S-TOOTH-GOAL", name=row.name, lost=fixed(row.lost_motion_arcsec, 0), **sizes))
    return (*said, *measure_for_drive(drive.doubts))


def measure_for_drive(doubts: Sequence[DriveDoubt]) -> tuple[Message, ...]:
    """The unmeasured error that costs most in the drive, in words; nothing where none is worth it."""
    one = next_for_drive(doubts)
    return () if one is None else (Message.of("S-DRIVE-NEXT", name=one.error, cost=fixed(one.cost_arcsec, 1)),)


def measure_better(worst: DominantError | None) -> tuple[Message, ...]:
    """Which measured error makes most of the doubt, and where to measure it at which step; nothing where none does."""
    if worst is None:
        return ()
    sizes = {"name": worst.name, "part": fixed(worst.part_um), "u": fixed(worst.u_um)}
    if worst.window is None:
        return (Message.of("S-TOOTH-DOMINANT", **sizes),)
    at = worst.window
    places = {"first": fixed(at.first, 1), "last": fixed(at.last, 1), "step": digits(at.step, 3), "unit": at.unit}
    return (Message.of("S-TOOTH-COARSE", **sizes, **places, left=fixed(at.left_um)),)


def doubted_tables_message(chosen: CrossTableSelection) -> tuple[Message, ...]:
    """Which cross tables stay away because the flank may get worse with them, in words."""
    whole = chosen.whole
    figures = {"gain": fixed(whole.gain_um), "U": fixed(COVERAGE * whole.gain_u_um)}
    worse = fixed(100.0 * whole.worse, 0)
    names = ", ".join(chosen.left_out)
    return (Message.of("S-TOOTH-DOUBTED", names=names, worse=worse, **figures),) if names else ()


def _gain(found: LayeredCorrection, gains: Prediction) -> Iterator[Message]:
    figures = {"gain": fixed(gains.gain_um), "U": fixed(COVERAGE * gains.gain_u_um)}
    if found.optimum.tables:
        yield Message.of("S-TOOTH-GAIN", **figures)
    elif not gains.worth:
        yield Message.of("S-TOOTH-NO-GAIN", **figures)


def _mechanical(tooth: ToothProposal) -> Iterator[Message]:
    for one in _beyond_tables(tooth):
        yield Message.of("S-TOOTH-MECHANICAL", name=one.error, rms=fixed(one.rms_um), left=fixed(one.floor_um))


def _beyond_tables(tooth: ToothProposal) -> list[CureRecord]:
    return [one for one in tooth.cures if one.floor_um > THRESHOLD_UM]


def _unmeasured_errors(tooth: ToothProposal, model: ErrorModel) -> Iterator[Message]:
    for name, size in sorted(_sizes(tooth, model).items(), key=lambda item: -item[1]):
        if size > THRESHOLD_UM:
            yield Message.of("S-TOOTH-UNKNOWN", name=name, u=fixed(size))


def _sizes(tooth: ToothProposal, model: ErrorModel) -> dict[str, float]:
    """What each error that was not measured may do to the flank, um (RMS)."""
    return {one.name: tooth.prediction.parts_um.get(one.name, 0.0) for one in model.unknown}


def _work(tooth: ToothProposal) -> Iterator[Message]:
    (x, y), (a, b) = tooth.eccentricity_um, tooth.tilt_arcsec
    if x or y or a or b:
        yield Message.of(
            "S-TOOTH-MOUNTING",
            x=fixed(x, 1, signed=True),
            y=fixed(y, 1, signed=True),
            a=fixed(a, 1, signed=True),
            b=fixed(b, 1, signed=True),
        )


# How each axis will deviate once every proposed table acts, cross tables too, and the words for it; pure.


def full_correction_outlooks(own: Sequence[TableChange], cross: Sequence[TableChange]) -> tuple[AxisOutlook, ...]:
    """One for each axis table's change, proposed or left alone, with the cross tables that are proposed.

    Measured was while no cross table acted between the site's axes, so what is proposed is all that will.
    """
    proposed = [one for one in cross if not one.skipped]
    tables = [one for one in own if one.new.kind == "axis"]
    return tuple(_outlook(one, [other for other in proposed if other.axis == one.axis]) for one in tables)


def outlook_messages(found: Sequence[AxisOutlook]) -> Iterator[Message]:
    """What cross tables make of an axis, in words; nothing of an axis that none acts on."""
    for one in found:
        fields = {"axis": one.axis, "M": fixed(one.M), "U": fixed(one.M_U), "unit": one.unit}
        if one.spoilt:
            yield Message.of("S-TOOTH-AXIS-ACTING", alone=fixed(one.M_alone), **fields)
        for name, size in one.moved_by.items():
            yield Message.of("S-TOOTH-AXIS-MOVED", other=name, size=fixed(size), **fields)


def _outlook(own: TableChange, tables: Sequence[TableChange]) -> AxisOutlook:
    factors = factors_of(one.new for one in tables)
    by_itself = [one.new for one in tables if one.new.input_axis == own.axis and one.new.index not in factors]
    deviation = own.predicted - taken_by_cross(by_itself, own.axis, own.targets)
    known = np.where(np.isfinite(deviation), deviation, np.nanmean(deviation))
    ends = own.predicted_U[[int(np.argmax(known)), int(np.argmin(known))]]
    return AxisOutlook(
        axis=own.axis,
        unit=own.new.deviation_unit,
        targets=own.targets,
        deviation=deviation,
        U=own.predicted_U,
        M=float(np.nanmax(deviation) - np.nanmin(deviation)),
        M_U=float(np.hypot(*ends)),
        M_alone=float(np.nanmax(own.predicted) - np.nanmin(own.predicted)),
        moved_by={one.new.input_axis: float(np.ptp(one.new.deviations)) for one in tables if one.new not in by_itself},
    )


# What a reversal does to a flank whose spaces are ground in one direction, in words; pure.


def one_way_message(
    axis: str, capture: Capture, work: WorkSection | None, own: Sequence[TableChange], *, lever_mm: FloatArray
) -> tuple[Message, ...]:
    """What the reversal of the index ``axis`` makes on the flank; nothing where it was come to from one side only.

    ``own`` are the changes of the axis layer, ``lever_mm`` what a turn of 1 rad moves each flank point by along its
    normal. What varies from place to place moves the spaces against each other; what is the same everywhere, and the
    reversals of infeed and stroke, leave no mark.
    """
    both = np.all(np.any(np.isfinite(capture.deviations), axis=1), axis=1)
    if work is None or not np.any(both):
        return ()
    varies = float(arcsec_to_rad(approach_of(capture).reversal))
    paired = any(
        one.axis == axis and one.new.kind == "cross" and one.layer == "axis" and not one.skipped for one in own
    )
    code = "S-TOOTH-ONE-WAY-PAIR" if paired else "S-TOOTH-ONE-WAY"
    moved = float(mm_to_um(varies * np.sqrt(np.mean(np.square(lever_mm)))))
    return (Message.of(code, axis=axis, way="+" if work.index_sense > 0 else "-", moved=fixed(moved)),)
