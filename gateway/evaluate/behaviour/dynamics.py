"""What a record in time shows of an axis: vibrations by frequency, settling after a move, drift and jumps of a capture.

Spectrum: Welch's averaged periodogram, Hann window, half overlap, amplitude scaled so that a sine of
amplitude a gives a peak of a. Settling: from the last time the signal was outside the band about its final value.
Steadiness: what a capture's readings share in the order of time, a smooth drift and one step, beyond their scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.message import Message, digits, fixed
from drivers.recordings import Recording
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray
from gateway.errors import NotIdentifiable

MOST_LINES = 1 << 16
WINDOW = "hann"
# A Hann window spreads a sine over its neighbours: peaks nearer than this are one.
APART = 4
FEWEST_SAMPLES = 16
FEWEST_CHANGES = 2


@dataclass(frozen=True, slots=True)
class Peak:
    """One vibration: frequency in Hz and amplitude (half of peak to peak) in the record's unit."""

    frequency_hz: float
    amplitude: float


@dataclass(frozen=True, slots=True)
class DynamicSpectrum:
    """Amplitude spectrum: ``frequency_hz`` and ``amplitude`` (f,); ``rms`` of everything but mean and trend."""

    frequency_hz: FloatArray
    amplitude: FloatArray
    unit: DeviationUnit
    rms: float
    averages: int
    peaks: tuple[Peak, ...]


@dataclass(frozen=True, slots=True)
class SettlingResult:
    """How a move ended. Times in s from the start of the move (``start_s`` of the record); values in the unit.

    ``time_s`` None: it never stayed within ``band``. ``overshoot`` beyond the final value in the sense of the
    move, 0 if none; ``ringing`` is the swinging about the final value beyond the band, None without a whole swing.
    """

    start_s: float
    step: float
    final: float
    band: float
    time_s: float | None
    overshoot: float
    ringing: Peak | None
    unit: DeviationUnit


def amplitude_spectrum(recording: Recording, lines: int = 4096, peaks: int = 8) -> DynamicSpectrum:
    """Amplitude spectrum of a record; gaps are never bridged, pieces are averaged.

    ``lines`` is the number of frequencies wanted at most. Raises NotIdentifiable (E-EVAL-DYNAMIC-SHORT).
    """
    wanted = 2 * min(max(lines, FEWEST_SAMPLES), MOST_LINES)
    longest = max((stop - start for start, stop in recording.stretches()), default=0)
    size = min(wanted, longest)
    if size < FEWEST_SAMPLES:
        raise NotIdentifiable("E-EVAL-DYNAMIC-SHORT", "spectrum", samples=longest, needed=FEWEST_SAMPLES)
    window = scipy.signal.get_window(WINDOW, size)
    power, averages = _average_pieces(recording, size, window)
    frequency = np.asarray(np.fft.rfftfreq(size, 1.0 / recording.rate_hz), dtype=np.float64)
    amplitude = 2.0 * np.sqrt(power) / window.sum()
    amplitude[0] /= 2.0
    rms = float(np.sqrt(2.0 * power[1:].sum() / (size * np.square(window).sum())))
    return DynamicSpectrum(
        frequency_hz=frequency,
        amplitude=amplitude,
        unit=recording.unit,
        rms=rms,
        averages=averages,
        peaks=_peaks(frequency, amplitude, power, peaks),
    )


def _average_pieces(recording: Recording, size: int, window: FloatArray) -> tuple[FloatArray, int]:
    total, count = np.zeros(size // 2 + 1), 0
    for start, stop in recording.stretches():
        for place in range(start, stop - size + 1, max(size // 2, 1)):
            piece = scipy.signal.detrend(recording.values(place, place + size))
            total += np.square(np.abs(np.fft.rfft(piece * window)))
            count += 1
    return total / count, count


def _peaks(frequency: FloatArray, amplitude: FloatArray, power: FloatArray, count: int) -> tuple[Peak, ...]:
    """The strongest local maxima, strongest first; the frequency is the centre of mass of the main lobe."""
    places, _ = scipy.signal.find_peaks(amplitude, distance=APART, prominence=0.05 * float(amplitude.max()))
    strongest = sorted(places.tolist(), key=lambda at: -amplitude[at])[:count]
    return tuple(_peak(frequency, power, amplitude, at) for at in strongest)


def _peak(frequency: FloatArray, power: FloatArray, amplitude: FloatArray, at: int) -> Peak:
    lobe = slice(max(at - 2, 0), at + 3)
    centre = float(np.average(frequency[lobe], weights=power[lobe]))
    # A Hann main lobe holds 1.5 times the power of its centre line, wherever between lines the sine lies.
    height = float(np.sqrt(np.square(amplitude[lobe]).sum() / 1.5))
    return Peak(centre, height)


def evaluate_settling(
    recording: Recording, band: float, start_s: float | None = None, last_part: float = 0.1
) -> SettlingResult:
    """How the signal settles after a move that begins at ``start_s`` (default: the trigger, else the first motion).

    ``band`` is half the width about the final value, the mean of the last ``last_part`` of the record, in its
    unit. Raises NotIdentifiable (E-EVAL-DYNAMIC-SHORT, -GAP, -MOVE) when the record does not show a move whole.
    """
    if recording.gaps:
        raise NotIdentifiable("E-EVAL-DYNAMIC-GAP", "settling", gaps=len(recording.gaps))
    values = recording.values()
    tail = max(round(last_part * len(values)), FEWEST_SAMPLES)
    if len(values) < 4 * FEWEST_SAMPLES or tail >= len(values) // 2:
        raise NotIdentifiable("E-EVAL-DYNAMIC-SHORT", "settling", samples=len(values), needed=4 * FEWEST_SAMPLES)
    final = float(values[-tail:].mean())
    begin = _begin(recording, values, band, start_s)
    step = final - float(
        values[: begin + 1].mean() if begin < FEWEST_SAMPLES else values[begin - FEWEST_SAMPLES : begin].mean()
    )
    if not abs(step) > 2.0 * band:
        raise NotIdentifiable("E-EVAL-DYNAMIC-MOVE", "settling", step=digits(step, 4), band=digits(band, 4))
    return _settling_time(recording, values, begin, step, final, band, tail)


def _begin(recording: Recording, values: FloatArray, band: float, start_s: float | None) -> int:
    if start_s is not None:
        return min(max(round(start_s * recording.rate_hz), 0), len(values) - 1)
    if recording.trigger is not None and recording.trigger > 0:
        return recording.trigger
    moved = np.flatnonzero(np.abs(values - values[:FEWEST_SAMPLES].mean()) > band)
    return int(moved[0]) if len(moved) else 0


def _settling_time(
    recording: Recording, values: FloatArray, begin: int, step: float, final: float, band: float, tail: int
) -> SettlingResult:
    after = values[begin:] - final
    outside = np.flatnonzero(np.abs(after) > band)
    last = int(outside[-1]) + 1 if len(outside) else 0
    time = last / recording.rate_hz if last <= len(after) - tail else None
    overshoot = max(float((np.sign(step) * after).max()), 0.0)
    ringing = _ringing_frequency(after[outside], outside / recording.rate_hz) if overshoot > band else None
    start = begin / recording.rate_hz
    return SettlingResult(
        start_s=start,
        step=step,
        final=final,
        band=band,
        time_s=time,
        overshoot=overshoot,
        ringing=ringing,
        unit=recording.unit,
    )


def _ringing_frequency(swings: FloatArray, time_s: FloatArray) -> Peak | None:
    """By the usual time between changes of side beyond the band; None below a whole swing."""
    changes = np.flatnonzero(np.diff(np.sign(swings)) != 0)
    if len(changes) < FEWEST_CHANGES:
        return None
    middle = 0.5 * (time_s[changes] + time_s[changes + 1])
    frequency = 0.5 / float(np.median(np.diff(middle)))
    return Peak(frequency, float(np.abs(swings[changes[0] + 1 :]).max()))


# ---- Steadiness: whether machine and instrument stood still during a capture.

DEGREE = 3
SIDE = 8
FEWEST = 16
# With two repetitions nothing says which of them is off.
TELLS_WHICH = 3
SURE = 7.0
# Steps and drifts below this are no news on any machine, um or arcsec.
SMALL = 0.5
MAD_TO_SIGMA = 1.4826
MEDIAN = 1.25
OUT_OF_LINE = 6.0
CLEAR = 3.0
# Less than this, um or arcsec, within a capture says nothing of an hour, however clear it is.
LEAST = 0.1


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Drift and largest jump of one capture, in the deviation unit; ``drift`` from first to last reading.

    ``per_h`` is the drift in an hour where it is clear, 0 else. ``jump_at_s`` is instrument time of the first reading
    after the jump (NaN: none). ``u`` is the standard uncertainty (RMS) that both leave in the targets' means: what
    hits all targets alike is not in it.
    """

    drift: float
    drift_u: float
    jump: float
    jump_at_s: float
    u: float
    said: tuple[Message, ...]
    per_h: float = 0.0


def steadiness(times_s: ArrayLike, deviations: ArrayLike, unit: DeviationUnit) -> Steadiness:
    """Judge deviations (m, n, 2) by when each was read, times_s (m, n, 2), NaN where missing; n >= 2.

    A target read again after a while shows what changed meanwhile. Drift is a cubic in time through these
    differences. A jump is a step between the readings before and after a moment that no drift explains; in a cycle
    that finishes one target before the next, it can only be seen among the readings of one target.
    """
    t, x = np.asarray(times_s, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    repeated = np.isfinite(x).sum(axis=1, keepdims=True) > 1
    good = np.isfinite(x) & np.isfinite(t) & repeated
    if good.sum() < FEWEST:
        return Steadiness(drift=0.0, drift_u=float("nan"), jump=0.0, jump_at_s=float("nan"), u=0.0, said=())
    powers = _powers(t, good)
    course = _course(x, good, powers)
    at_s = _moment(t[good], course.left) if np.max(good.sum(axis=1)) >= TELLS_WHICH else float("nan")
    late = np.where(t >= at_s, 1.0, 0.0)
    if np.isfinite(at_s):
        course = _course(x, good, [*powers, late])
    drifted = course.found[:DEGREE]
    jump = float(course.found[DEGREE]) if np.isfinite(at_s) else 0.0
    ones = np.ones(DEGREE)
    drift_u = float(np.sqrt(ones @ course.covariance[:DEGREE, :DEGREE] @ ones))
    left = np.stack([_per_target(power, good) for power in powers], axis=-1) @ drifted + jump * _per_target(late, good)
    drift = float(drifted.sum())
    return Steadiness(
        drift=drift,
        drift_u=drift_u,
        jump=jump,
        jump_at_s=at_s,
        u=float(np.std(left)),
        said=_steadiness_messages(drift, drift_u, jump, at_s, unit),
        per_h=3600.0 * drift / float(np.ptp(t[good])) if abs(drift) > max(LEAST, CLEAR * drift_u) else 0.0,
    )


def _steadiness_messages(
    drift: float, drift_u: float, jump: float, at_s: float, unit: DeviationUnit
) -> tuple[Message, ...]:
    told: tuple[Message, ...] = ()
    if jump:
        told += (Message.of("W-STEADY-JUMP", jump=digits(jump, signed=True), at_s=fixed(at_s, 0), unit=unit),)
    if abs(drift) > max(2.0 * SMALL, CLEAR * drift_u):
        told += (Message.of("W-STEADY-DRIFT", drift=digits(drift, signed=True), unit=unit),)
    return told


def _less_means(values: FloatArray, good: FloatArray) -> FloatArray:
    """Values (m, n, 2) less their mean over the repetitions of the same target and approach."""
    count = np.maximum(good.sum(axis=1, keepdims=True), 1)
    mean = np.sum(np.where(good, values, 0.0), axis=1, keepdims=True) / count
    return np.asarray(values - mean)


def _per_target(values: FloatArray, good: FloatArray) -> FloatArray:
    """Mean over all readings of each target (m',), targets without any left out."""
    count = good.sum(axis=(1, 2))
    sums = np.sum(np.where(good, values, 0.0), axis=(1, 2))
    return np.asarray(sums[count > 0] / count[count > 0])


@dataclass(frozen=True, slots=True)
class _Course:
    """Least squares through what changed between visits: step and powers of time, and their covariance."""

    found: FloatArray
    covariance: FloatArray
    left: FloatArray


def _course(x: FloatArray, good: FloatArray, columns: list[FloatArray]) -> _Course:
    """Readings far out of line are left out, as in the means of the targets."""
    design = np.stack([_less_means(column, good)[good] for column in columns], axis=-1)
    y = _less_means(x, good)[good]
    keep = np.ones(y.size, dtype=np.bool_)
    for _ in range(3):
        inverse = np.linalg.pinv(design[keep].T @ design[keep], rcond=1e-9)
        found = inverse @ (design[keep].T @ y[keep])
        left = y - design @ found
        middle = float(np.median(left))
        keep = np.abs(left - middle) <= OUT_OF_LINE * max(MAD_TO_SIGMA * float(np.median(np.abs(left - middle))), 1e-9)
    freedom = max(int(keep.sum()) - len(columns) - 2 * x.shape[0], 1)
    return _Course(found, inverse * float(left[keep] @ left[keep]) / freedom, left)


def _powers(t: FloatArray, good: FloatArray) -> list[FloatArray]:
    first, last = float(np.min(t[good])), float(np.max(t[good]))
    share = (t - first) / max(last - first, 1e-9)
    return [share**k for k in range(1, DEGREE + 1)]


def _moment(t: FloatArray, apart: FloatArray) -> float:
    """Time (of t (k,)) of the first reading after the clearest step in ``apart`` (k,), NaN where there is none."""
    order = np.argsort(t)
    times, y = t[order], apart[order]
    if y.size < 2 * SIDE:
        return float("nan")
    medians = np.median(np.lib.stride_tricks.sliding_window_view(y, SIDE), axis=1)
    steps = medians[SIDE:] - medians[:-SIDE]
    steps = steps - np.median(steps)
    # What neighbours in time differ by is scatter alone; a drift adds nothing to it.
    scatter = MAD_TO_SIGMA * float(np.median(np.abs(np.diff(y)))) / np.sqrt(2.0)
    worst = int(np.argmax(np.abs(steps)))
    if abs(steps[worst]) <= max(SURE * MEDIAN * scatter * np.sqrt(2.0 / SIDE), SMALL):
        return float("nan")
    return float(times[worst + _split(y[worst : worst + 2 * SIDE])])


def _split(y: FloatArray) -> int:
    """Where two levels explain a stretch of readings best."""
    left = [float(np.sum(np.abs(part - np.median(part)))) for k in range(2, y.size - 1) for part in (y[:k], y[k:])]
    return int(np.argmin(np.asarray(left).reshape(-1, 2).sum(axis=1))) + 2
