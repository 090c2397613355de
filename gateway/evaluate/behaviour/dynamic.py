"""What a dynamic capture shows of an axis: its vibrations by frequency, and how it settles after a move.

Spectrum: Welch's averaged periodogram, Hann window, half overlap, amplitude scaled so that a sine of
amplitude a gives a peak of a. Settling: from the last time the signal was outside the band about its final value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from drivers.recordings import Recording
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray
from gateway.errors import NotIdentifiable

MOST_LINES = 1 << 16
WINDOW = "hann"
# A Hann window spreads a sine over its neighbours: peaks nearer than this are one.
APART = 4
FEWEST = 16
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
class Settling:
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


def spectrum(recording: Recording, lines: int = 4096, peaks: int = 8) -> DynamicSpectrum:
    """Amplitude spectrum of a record; gaps are never bridged, pieces are averaged.

    ``lines`` is the number of frequencies wanted at most. Raises NotIdentifiable (E-EVAL-DYNAMIC-SHORT).
    """
    wanted = 2 * min(max(lines, FEWEST), MOST_LINES)
    longest = max((stop - start for start, stop in recording.stretches()), default=0)
    size = min(wanted, longest)
    if size < FEWEST:
        raise NotIdentifiable("E-EVAL-DYNAMIC-SHORT", "spectrum", samples=longest, needed=FEWEST)
    window = scipy.signal.get_window(WINDOW, size)
    power, averages = _averaged(recording, size, window)
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


def _averaged(recording: Recording, size: int, window: FloatArray) -> tuple[FloatArray, int]:
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


def settling(recording: Recording, band: float, start_s: float | None = None, last_part: float = 0.1) -> Settling:
    """How the signal settles after a move that begins at ``start_s`` (default: the trigger, else the first motion).

    ``band`` is half the width about the final value, the mean of the last ``last_part`` of the record, in its
    unit. Raises NotIdentifiable (E-EVAL-DYNAMIC-SHORT, -GAP, -MOVE) when the record does not show a move whole.
    """
    if recording.gaps:
        raise NotIdentifiable("E-EVAL-DYNAMIC-GAP", "settling", gaps=len(recording.gaps))
    values = recording.values()
    tail = max(round(last_part * len(values)), FEWEST)
    if len(values) < 4 * FEWEST or tail >= len(values) // 2:
        raise NotIdentifiable("E-EVAL-DYNAMIC-SHORT", "settling", samples=len(values), needed=4 * FEWEST)
    final = float(values[-tail:].mean())
    begin = _begin(recording, values, band, start_s)
    step = final - float(values[: begin + 1].mean() if begin < FEWEST else values[begin - FEWEST : begin].mean())
    if not abs(step) > 2.0 * band:
        raise NotIdentifiable("E-EVAL-DYNAMIC-MOVE", "settling", step=f"{step:.4g}", band=f"{band:.4g}")
    return _settled(recording, values, begin, step, final, band, tail)


def _begin(recording: Recording, values: FloatArray, band: float, start_s: float | None) -> int:
    if start_s is not None:
        return min(max(round(start_s * recording.rate_hz), 0), len(values) - 1)
    if recording.trigger is not None and recording.trigger > 0:
        return recording.trigger
    moved = np.flatnonzero(np.abs(values - values[:FEWEST].mean()) > band)
    return int(moved[0]) if len(moved) else 0


def _settled(
    recording: Recording, values: FloatArray, begin: int, step: float, final: float, band: float, tail: int
) -> Settling:
    after = values[begin:] - final
    outside = np.flatnonzero(np.abs(after) > band)
    last = int(outside[-1]) + 1 if len(outside) else 0
    time = last / recording.rate_hz if last <= len(after) - tail else None
    overshoot = max(float((np.sign(step) * after).max()), 0.0)
    ringing = _ringing(after[outside], outside / recording.rate_hz) if overshoot > band else None
    start = begin / recording.rate_hz
    return Settling(
        start_s=start,
        step=step,
        final=final,
        band=band,
        time_s=time,
        overshoot=overshoot,
        ringing=ringing,
        unit=recording.unit,
    )


def _ringing(swings: FloatArray, time_s: FloatArray) -> Peak | None:
    """By the usual time between changes of side beyond the band; None below a whole swing."""
    changes = np.flatnonzero(np.diff(np.sign(swings)) != 0)
    if len(changes) < FEWEST_CHANGES:
        return None
    middle = 0.5 * (time_s[changes] + time_s[changes + 1])
    frequency = 0.5 / float(np.median(np.diff(middle)))
    return Peak(frequency, float(np.abs(swings[changes[0] + 1 :]).max()))
