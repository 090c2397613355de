"""Errors of the set-up taken out of deviations: drift, cosine, Abbe, closure; each once and recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import mm_to_um
from gateway.domain import Corrections, FloatArray
from gateway.errors import ModelError
from gateway.evaluate import length, rotary
from gateway.evaluate.corrections import applied

Done = tuple[FloatArray, Corrections]
# The two rotations that move a point off the axis, and the lever each acts on: (e x r) along the axis.
_LEVERS: Mapping[str, tuple[tuple[str, int, int], tuple[str, int, int]]] = {
    "X": (("B", 2, 1), ("C", 1, -1)),
    "Y": (("C", 0, 1), ("A", 2, -1)),
    "Z": (("A", 1, 1), ("B", 0, -1)),
}


def drift_removed(
    deviations: ArrayLike,
    times_s: ArrayLike,
    start: tuple[float, float],
    end: tuple[float, float],
    record: Corrections,
    *,
    largest: float,
) -> Done:
    """Deviations less a drift linear in *time* between datum readings (time, reading) at start and end.

    ``times_s`` has the shape of `deviations`. ``largest`` is what may still be removed, E_VE or R/4: beyond it
    the run is to be rejected (ModelError E-EVAL-DRIFT-SIZE). A removed drift is said in the record, and
    `corrections.told` brings it to every report. Also E-EVAL-DRIFT-TIME, E-EVAL-SHAPE, E-EVAL-TWICE.
    """
    x, times = np.asarray(deviations, dtype=np.float64), np.asarray(times_s, dtype=np.float64)
    if x.shape != times.shape:
        raise ModelError("E-EVAL-SHAPE", "drift", targets=times.shape, deviations=x.shape)
    change = end[1] - start[1]
    words = f"{change:+.3g} over {end[0] - start[0]:g} s removed linearly in time, by the gateway"
    done = applied(record, "drift", words, start_s=start[0], end_s=end[0], start=start[1], end=end[1])
    if not abs(change) <= largest:
        raise ModelError("E-EVAL-DRIFT-SIZE", "drift", change=f"{change:.3g}", largest=f"{largest:.3g}")
    return length.drift_removed(times, x, start, end), done


def cosine_removed(
    deviations_um: ArrayLike, targets_mm: ArrayLike, lateral_mm: float, record: Corrections, *, datum_mm: float
) -> Done:
    """Deviations of readings that ran short because the beam ran off by `lateral_mm` over the whole travel.

    Acts on target + deviation from the datum; a plane-mirror beam reads long, so do not use this for it.
    """
    x, at = np.asarray(deviations_um, dtype=np.float64), np.asarray(targets_mm, dtype=np.float64)
    travel = length.spread(at, x) - datum_mm
    full = float(np.ptp(at))
    if not full > 0.0:
        raise ModelError("E-EVAL-LINE", "cosine", positions=at.size, deviations=x.size)
    words = f"{lateral_mm:g} mm over {full:g} mm, by the gateway"
    done = applied(record, "cosine", words, lateral_mm=lateral_mm, travel_mm=full)
    reading = travel + x / 1000.0
    return mm_to_um(length.cosine_corrected(reading, full, lateral_mm) - travel), done


def abbe_error_um(
    axis: str, angles_arcsec: Mapping[str, ArrayLike], offset_mm: tuple[float, float, float]
) -> FloatArray:
    """What a measuring line at `offset_mm` (x, y, z) from the line of interest reads too much, um (m,).

    ``angles_arcsec`` are the angular error motions of the axis at the targets, by name: for X EBX and ECX, for
    Y EAY and ECY, for Z EAZ and EBZ, right-handed (ISO 230-1). X: EBX z - ECX y, and cyclic. An angle whose
    lever is not 0 is required. Raises ModelError (E-EVAL-ABBE).
    """
    if axis not in _LEVERS:
        raise ModelError("E-EVAL-ABBE", "Abbe", axis=axis, missing="a linear axis X, Y or Z")
    total: FloatArray = np.zeros(1)
    for letter, arm, sign in _LEVERS[axis]:
        lever, name = offset_mm[arm], f"E{letter}{axis}"
        if lever and name not in angles_arcsec:
            raise ModelError("E-EVAL-ABBE", "Abbe", axis=axis, missing=name)
        if lever:
            total = total + sign * length.abbe_um(lever, np.asarray(angles_arcsec[name], dtype=np.float64))
    return total


def abbe_removed(
    deviations_um: ArrayLike,
    axis: str,
    angles_arcsec: Mapping[str, ArrayLike],
    offset_mm: tuple[float, float, float],
    record: Corrections,
) -> Done:
    """Deviations (m, ...) on the line of interest, from a beam at `offset_mm` from it and the fitted angles (m,).

    Only where the offsets are known: beam less line of interest (the scale's to judge the axis, the tool's to
    judge parts), machine coordinates. The angles' own zero decides a constant only.
    """
    x = np.asarray(deviations_um, dtype=np.float64)
    error = abbe_error_um(axis, angles_arcsec, offset_mm)
    if error.size not in (1, x.shape[0]):
        raise ModelError("E-EVAL-SHAPE", "Abbe", targets=error.shape, deviations=x.shape)
    words = f"{axis} at offset {offset_mm} mm with {', '.join(sorted(angles_arcsec))}, by the gateway"
    names = dict(zip(("x_mm", "y_mm", "z_mm"), offset_mm, strict=True))
    done = applied(record, "abbe", words, **names, largest_um=float(np.abs(error).max()))
    return x - error.reshape((-1,) + (1,) * (x.ndim - 1)), done


def closure_removed(
    targets_deg: ArrayLike, deviations_arcsec: ArrayLike, record: Corrections, *, encoder: Literal["direct", "indirect"]
) -> Done:
    """Rotary deviations (m, ...) less their closing error, linear in the angle: asked for, never by itself.

    With an indirect encoder a closing error is real (gear ratio) and is not removed: ModelError
    (E-EVAL-CLOSURE). Without whole turns there is nothing to remove: E-EVAL-CLOSURE too.
    """
    at, x = np.asarray(targets_deg, dtype=np.float64), np.asarray(deviations_arcsec, dtype=np.float64)
    gap = rotary.closure_arcsec(at, x)
    if encoder == "indirect" or gap is None:
        why = "the encoder is indirect, so it may be real" if gap is not None else "the targets close no turn"
        raise ModelError("E-EVAL-CLOSURE", "rotary", why=why)
    words = f"{gap:+.3g} arcsec over {np.ptp(at):g} deg removed linearly, by the gateway"
    done = applied(record, "closure", words, closure_arcsec=gap)
    share = (at - at.min()) / float(np.ptp(at))
    return x - gap * length.spread(share, x), done
