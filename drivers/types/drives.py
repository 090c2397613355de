"""A record of a reducer on its test bench: angles of both ends, torque and temperature over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from drivers.message import Message
from drivers.types.values import FloatArray


class DriveStatement(NamedTuple):
    """What a record states of a reducer: the key in its comment lines and whether it is a whole number."""

    key: str
    whole: bool


STATEMENTS: Mapping[str, DriveStatement] = {
    "pins": DriveStatement("Pins", True),
    "ratio": DriveStatement("Ratio", False),
    "rated_torque_nm": DriveStatement("Rated torque Nm", False),
    "cranks": DriveStatement("Cranks", True),
    "sun_teeth": DriveStatement("Sun teeth", True),
    "output_encoder_U_arcsec": DriveStatement("Output encoder U arcsec", False),
    "input_encoder_U_arcsec": DriveStatement("Input encoder U arcsec", False),
}
"""By the name a question has for them."""


@dataclass(frozen=True, slots=True)
class DriveRecord:
    """Readings row by row (n,), in the order of time: s, deg, deg, Nm, degC; None for a column that is not there.

    ``input_deg`` and ``output_deg`` count on through turns. ``torque_nm`` acts on the output, + turns it on.
    ``lines`` (n,) are the file's own. ``stated`` are numbers by the keys of `STATEMENTS`.
    """

    input_deg: FloatArray
    output_deg: FloatArray
    lines: FloatArray
    time_s: FloatArray | None = None
    torque_nm: FloatArray | None = None
    temperature_degc: FloatArray | None = None
    stated: Mapping[str, float] = field(default_factory=dict)
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()
