"""The laser interferometer of the paper's section 5: fringes, Doppler shift, greatest speed, angles, closure.

Lengths in mm, wavelengths in nm, deviations of angles in arcsec. A moving reflector shifts the frequency of the
measuring beam by 2 v / lambda; the counted fringes N are the integral of that beat, so the path is l = N lambda / 2.
lambda is the wavelength in the air of the day, lambda_vacuum / n. The paper prints that the distance between fringes
is one wavelength; of the reflector's path it is half of it.

The functions are those of a run: `drivers.units`, `gateway.evaluate.optics`.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError
from drivers.message import Message, digits, fixed
from drivers.types.sensing import Ambient
from drivers.units import (
    arcsec_of_path,
    followed_feed_mm_min,
    fringe_rate_hz,
    light_frequency_hz,
    path_of_fringes_mm,
)
from gateway.domain.values import FloatArray
from gateway.evaluate.optics import air
from gateway.evaluate.optics import rotary_calibration as turned
from trueflank.given import plain_numbers

WAVELENGTH_NM = air.WAVELENGTH_NM
"""Vacuum wavelength of a stabilised helium-neon laser, nm."""


def wavelength_nm(
    *, air_degc: float, pressure_hpa: float, humidity_pct: float, vacuum_nm: float = WAVELENGTH_NM,
    equation: Literal["edlen", "ciddor", "edlen-1966"] = "edlen",
) -> float:  # fmt: skip
    """The wavelength in air, nm: vacuum wavelength / index. Raises ConfigError (E-LIBRARY-KIND), AmbientOutOfRange."""
    given = Ambient(air_degc=air_degc, pressure_hpa=pressure_hpa, humidity_pct=humidity_pct)
    return _positive("vacuum_nm", vacuum_nm) / air.index(given, equation=equation, wavelength_nm=vacuum_nm)


def frequency_hz(vacuum_nm: float = WAVELENGTH_NM) -> float:
    """The light's frequency f = c / lambda in Hz, the same in any medium. Raises ConfigError (E-LIBRARY-KIND)."""
    return light_frequency_hz(_positive("vacuum_nm", vacuum_nm))


def length_mm(fringes: ArrayLike, wavelength_nm: float = WAVELENGTH_NM) -> FloatArray:
    """l = N lambda / 2 in mm, of the reflector's path, for any shape of N. Raises ConfigError (E-LIBRARY-KIND)."""
    return np.asarray(path_of_fringes_mm(_numbers("fringes", fringes), _positive("wavelength_nm", wavelength_nm)))


def doppler_shift_hz(feed_mm_min: ArrayLike, wavelength_nm: float = WAVELENGTH_NM) -> FloatArray:
    """Shift of the measuring beam's frequency, 2 v / lambda in Hz, which is the rate of fringes; sign of the feed."""
    feeds = _numbers("feed_mm_min", feed_mm_min)
    return np.asarray(fringe_rate_hz(feeds, _positive("wavelength_nm", wavelength_nm)))


def greatest_feed_mm_min(fringe_rate_hz: float, wavelength_nm: float = WAVELENGTH_NM) -> float:
    """The greatest feed in mm/min that a counter of so many fringes a second follows, v = f lambda / 2."""
    rate = _positive("fringe_rate_hz", fringe_rate_hz)
    return followed_feed_mm_min(rate, _positive("wavelength_nm", wavelength_nm))


def check_feed(feed_mm_min: float, fringe_rate_hz: float, wavelength_nm: float = WAVELENGTH_NM) -> float:
    """Before measuring: how much of the counter's rate a feed (mm/min) takes, 0 .. 1.

    Raises ConfigError (E-LIBRARY-FEED) where the counter cannot follow: it would lose fringes without a sign of it.
    """
    limit = greatest_feed_mm_min(fringe_rate_hz, wavelength_nm)
    feed = abs(float(_numbers("feed_mm_min", feed_mm_min)))
    if feed > limit:
        raise ConfigError("E-LIBRARY-FEED", "check_feed", feed=digits(feed, 6), limit=fixed(limit, 0))
    return feed / limit


def angle_arcsec(path_difference_mm: ArrayLike, spacing_mm: float) -> FloatArray:
    """arcsin(difference / spacing) in arcsec: how much farther one reflector is than the other, s mm apart.

    The difference is one of displacements, N lambda / 2; half of it if it is raw optical path. Raises ConfigError
    (E-LIBRARY-KIND) where no angle makes that difference.
    """
    paths, spacing = _numbers("path_difference_mm", path_difference_mm), _positive("spacing_mm", spacing_mm)
    if np.any(np.abs(paths) > spacing):
        _refuse(Message.of("W-LIB-PATH"), f"{np.max(np.abs(paths)):g} mm", Message.of("W-LIB-AT-MOST", spacing=spacing))
    return np.asarray(arcsec_of_path(paths, spacing))


def rotary_deviations_arcsec(
    targets_deg: ArrayLike, device_deg: ArrayLike, laser_deg: ArrayLike, *, reference_deg: float = 0.0
) -> FloatArray:
    """Deviations in arcsec of a rotary axis from a calibrator that counter-turns and the interferometer's rest, deg.

    Zero at the reference target; the shape of the readings. Raises ConfigError (E-LIBRARY-KIND), ModelError
    (E-EVAL-SHAPE, E-EVAL-DATUM).
    """
    parts = (_numbers(key, one) for key, one in (("device_deg", device_deg), ("laser_deg", laser_deg)))
    device, laser = parts
    targets = _numbers("targets_deg", targets_deg)
    return turned.rotary_deviations(device, laser, targets, reference_deg=reference_deg)


def closure_arcsec(targets_deg: ArrayLike, deviations_arcsec: ArrayLike) -> float | None:
    """How far the deviations (arcsec) of places a whole turn apart (0 and 360 deg) differ; None without such a pair.

    On an axis with a direct encoder it is drift, slip or lost counts. Raises ConfigError (E-LIBRARY-KIND), ModelError.
    """
    found = _numbers("deviations_arcsec", deviations_arcsec, missing=True)
    gap = turned.closure(_numbers("targets_deg", targets_deg), found)
    return None if gap is None else gap.gap


def _numbers(key: str, value: Any, *, missing: bool = False) -> FloatArray:
    return plain_numbers(value, f"tf.interferometer: {key}", missing=missing)


def _positive(key: str, value: Any) -> float:
    found = _numbers(key, value)
    if found.ndim or not float(found) > 0.0:
        _refuse(key, repr(value), Message.of("W-LIB-ABOVE-0"))
    return float(found)


def _refuse(wanted: str | Message, given: str, how: str | Message) -> None:
    raise ConfigError("E-LIBRARY-KIND", "interferometer", call="tf.interferometer", wanted=wanted, given=given, how=how)


__all__ = [
    "WAVELENGTH_NM", "angle_arcsec", "check_feed", "closure_arcsec", "doppler_shift_hz", "greatest_feed_mm_min",
    "length_mm", "rotary_deviations_arcsec", "wavelength_nm",
]  # fmt: skip
