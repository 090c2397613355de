"""Raw averages or a result file -> a Capture: sense, air, expansion and dead path applied once; pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.message import Message, fixed
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient
from drivers.types.tables import LiveSet
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import deviation_scale, deviation_unit
from gateway.capture.checks import check_all_ambient
from gateway.capture.collection import RawCapture
from gateway.capture.targets import CHECK_REPETITIONS
from gateway.config import AxisSection
from gateway.domain.captures import Between, Capture, Corrections
from gateway.domain.equipment import SenseProof
from gateway.errors import AmbientOutOfRange, CaptureError
from gateway.evaluate.behaviour.doubts import accept_doubts, all_doubts
from gateway.evaluate.behaviour.dynamics import steadiness
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.optics import corrections, displacement, rotary_calibration

MOST_SUSPECTS = 0.05
STEEP_UM_PER_M = 100.0


def from_live(axis: AxisSection, raw: RawCapture, proof: SenseProof, already: CompensatedFor) -> Capture:
    """A live capture in um or arcsec, datum at the first target's first reading.

    Raises AmbientOutOfRange when air or material readings are needed and missing, ModelError from the
    evaluation rooms.
    """
    if axis.kind == "linear":
        check_all_ambient(axis, raw.ambient, already, proof.instrument)
        deviations, done = _linear_corrections(axis, raw, proof, already)
    else:
        deviations, done = _rotary_corrections(axis, raw, proof)
    sigma = raw.window_sigma * deviation_scale(axis.unit)
    reading_u = float(np.sqrt(np.nanmean(sigma**2) / max(raw.window_count, 1)))
    targets, deviations, times, between = _split_check_stops(raw, deviations)
    first = ~np.isin(targets, raw.targets[list(raw.added)])
    steady = steadiness(times[first], deviations[first], deviation_unit(axis.unit))
    lost = (Message.of("S-CAP-LOST", count=raw.lost_samples),) if raw.lost_samples else ()
    capture = Capture(
        axis=axis.name,
        component=axis.measure.component,
        axis_unit=axis.unit,
        targets=targets,
        deviations=deviations,
        reading_u=reading_u,
        ambient_start=raw.ambient[0],
        ambient_end=raw.ambient[-1],
        corrections=done,
        live=raw.live,
        sense=proof,
        suspects=robust_means(targets, deviations).suspects,
        source="live",
        started_utc=raw.started_utc,
        ended_utc=raw.ended_utc,
        notes=(
            *(*lost, *raw.notes, *_alignment_doubt(axis, targets, deviations), *steady.said),
            *temperature_note(raw.live, targets),
        ),
        cycle=axis.measure.cycle,
        between=between,
        unsteady_u=steady.u,
        drift_per_h=steady.per_h,
        rest_u=float(np.std(raw.standing, ddof=1)) * deviation_scale(axis.unit) if len(raw.standing) > 1 else 0.0,
        rest_count=len(raw.standing),
    )
    return with_capture_doubts(capture, axis)


def with_capture_doubts(capture: Capture, axis: AxisSection) -> Capture:
    """The capture with every doubt of its readings, those settled that the site file accepts for this axis."""
    return replace(capture, doubts=accept_doubts(all_doubts(capture, modulo=axis.modulo), axis.measure.accept_doubts))


def _split_check_stops(
    raw: RawCapture, deviations: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, Between | None]:
    """Targets, deviations and times of the targets alone, and the check stops."""
    if not raw.checks:
        return raw.targets, deviations, raw.time_s, None
    checks = list(raw.checks)
    kept = np.setdiff1d(np.arange(len(raw.targets)), checks)
    between = Between(raw.targets[checks], deviations[checks, :CHECK_REPETITIONS])
    return raw.targets[kept], deviations[kept], raw.time_s[kept], between


def _alignment_doubt(axis: AxisSection, targets: FloatArray, deviations: FloatArray) -> tuple[Message, ...]:
    """A steep mean line may be the beam's angle to the travel (cosine error): said, never corrected."""
    if axis.kind != "linear" or len(targets) < 2:
        return ()
    mean = np.nanmean(deviations.reshape(len(targets), -1), axis=1)
    known = np.isfinite(mean)
    if known.sum() < 2:
        return ()
    slope = 1000.0 * float(np.polyfit(targets[known], mean[known], 1)[0])
    if abs(slope) <= STEEP_UM_PER_M:
        return ()
    return (Message.of("S-CAP-STEEP", slope=fixed(slope, 0)),)


def _fractions(raw: RawCapture) -> FloatArray:
    start, end = float(raw.ambient_time_s[0]), float(raw.ambient_time_s[-1])
    return np.clip((raw.time_s - start) / max(end - start, 1e-9), 0.0, 1.0)


def _linear_corrections(
    axis: AxisSection, raw: RawCapture, proof: SenseProof, already: CompensatedFor
) -> tuple[FloatArray, Corrections]:
    counted = proof.sense * raw.values[..., 0]
    setup = displacement.LinearSetup(
        datum_mm=float(raw.targets[0]),
        dead_path_mm=axis.measure.dead_path_mm,
        expansion_ppm_per_k=axis.measure.expansion_ppm_per_k,
        beam=axis.measure.beam,
    )
    return displacement.linear_deviations(
        counted - counted[0, 0, 0],
        raw.targets,
        setup,
        start=raw.ambient[0],
        end=raw.ambient[-1],
        fraction=_fractions(raw),
        already=already,
    )


def _rotary_corrections(axis: AxisSection, raw: RawCapture, proof: SenseProof) -> tuple[FloatArray, Corrections]:
    laser, device = raw.channels.index("laser_deg"), raw.channels.index("device_deg")
    deviations = rotary_calibration.rotary_deviations(
        raw.values[..., device],
        raw.values[..., laser],
        raw.targets,
        reference_deg=axis.reference,
        sense=proof.sense,
    )
    return deviations, corrections.begin("air+material")


def from_file(axis: AxisSection, measured: MeasuredSet, live: LiveSet | None, source: str) -> Capture:
    """A result file as a capture: its zero moved to the site's datum, its direction to the axis' sense.

    Raises CaptureError (E-CAP-FILE-UNIT, E-CAP-FILE-TRAVEL) when the file cannot be this axis' measurement.
    """
    if measured.axis_unit != axis.unit:
        raise CaptureError("E-CAP-FILE-UNIT", source, found=measured.axis_unit, axis=axis.name, wanted=axis.unit)
    sense = axis.measure.file_axis_sense
    datum = axis.measure.file_datum if axis.measure.file_datum is not None else 0.0
    measured = _at_temperature(measured, axis)
    targets = datum + sense * measured.targets
    deviations = sense * measured.deviations
    if sense < 0:
        deviations = deviations[..., ::-1]
    order = np.argsort(targets)
    targets, deviations = targets[order], deviations[order]
    _inside(axis, targets, source)
    done = corrections.begin(measured.compensated_for)
    if measured.expansion_ppm_per_k is not None:
        done = replace(done, details={"expansion.ppm_per_k": measured.expansion_ppm_per_k})
    if axis.kind == "linear" and measured.compensated_for == "air":
        deviations, done = _to_20(axis, measured, targets, deviations, done, source)
    capture = Capture(
        axis=axis.name,
        component=axis.measure.component,
        axis_unit=axis.unit,
        targets=targets,
        deviations=deviations,
        reading_u=0.0,
        ambient_start=measured.ambient_start,
        ambient_end=measured.ambient_end,
        corrections=done,
        live=live,
        sense=None,
        suspects=robust_means(targets, deviations).suspects,
        source=source,
        started_utc=measured.header.get("Date", ""),
        ended_utc="",
        notes=(
            *measured.warnings,
            *((Message.of("S-CAP-FILE-TABLES"),) if live is not None else ()),
            *temperature_note(live, targets),
        ),
        doubts=measured.doubts,
    )
    return with_capture_doubts(capture, axis)


def _at_temperature(measured: MeasuredSet, axis: AxisSection) -> MeasuredSet:
    """With the material's temperature as a person gave it, where the file has none."""
    given = axis.measure.material_degc
    if given is None or measured.ambient_start.material_degc:
        return measured
    return replace(measured, ambient_start=replace(measured.ambient_start, material_degc=(given,)))


def _inside(axis: AxisSection, targets: FloatArray, source: str) -> None:
    low, high = axis.travel
    if axis.modulo:
        high = max(high, low + 360.0)
    if targets[0] < low - 1e-6 or targets[-1] > high + 1e-6:
        first, last = float(targets[0]), float(targets[-1])
        raise CaptureError("E-CAP-FILE-TRAVEL", source, first=first, last=last, low=low, high=high, axis=axis.name)


def _to_20(
    axis: AxisSection,
    measured: MeasuredSet,
    targets: FloatArray,
    deviations: FloatArray,
    done: Corrections,
    source: str,
) -> tuple[FloatArray, Corrections]:
    if not measured.ambient_start.material_degc:
        raise AmbientOutOfRange("E-CAP-MATERIAL", source)
    end: Ambient = measured.ambient_end if measured.ambient_end.material_degc else measured.ambient_start
    return displacement.expansion_corrected(
        deviations,
        targets,
        axis.measure.expansion_ppm_per_k,
        done,
        datum_mm=float(targets[0]),
        start=measured.ambient_start,
        end=end,
    )


# What temperature compensation did while an axis was measured, in words; pure.


def temperature_note(live: LiveSet | None, targets: FloatArray) -> tuple[Message, ...]:
    """One note where it acts, or where nobody could read whether it does; none where nothing acts.

    ``targets`` (m,) in the axis unit.
    """
    if live is None or not targets.size:
        return ()
    shift, unit = live.temperature, live.own.table.output_unit
    if shift is None:
        return (Message.of("W-CAP-WARMTH-UNKNOWN", axis=live.axis),)
    scale = deviation_scale(unit)
    low, high = (float(targets[place]) for place in (0, -1))
    first, last = round(shift.at(low) * scale, 3), round(shift.at(high) * scale, 3)
    if not first and not last:
        return ()
    fields = {"low": low, "high": high, "first": first, "last": last, "unit": deviation_unit(unit)}
    return (Message.of("W-CAP-WARMTH", axis=live.axis, **fields),)
