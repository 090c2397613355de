"""Frozen records of the grinding process: what the deviations of inspected parts consist of, and a wheel's profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivers.message import Message
from drivers.types.identity import MachineIdentity
from gateway.domain.values import FloatArray

SetupName = Literal["x", "dressing", "swivel"]
HeldUnit = Literal["mm", "um", "deg", "arcsec"]
SETUP_KEYS: Mapping[SetupName, str] = {"x": "x_um", "dressing": "dressing_um", "swivel": "swivel_arcsec"}
"""The set-up values of a separation by the names that they are handed over under."""


@dataclass(frozen=True, slots=True)
class ProcessShare:
    """One cause's share of the flank: RMS over the judged flank and its standard uncertainty, um."""

    name: str
    rms_um: float
    u_um: float


@dataclass(frozen=True, slots=True)
class EstimatedValue:
    """A value with its standard uncertainty, both in ``unit``."""

    value: float
    u: float
    unit: str = "um"


@dataclass(frozen=True, slots=True)
class WheelForm:
    """What the wheel leaves on every flank alike: normal deviations (T,) in um, + surplus, at profile angles (T,).

    Only over the part of the profile that was measured, and without what a shift of the wheel or a turn of the gear
    makes of it. ``covariance_um2`` (T, T).
    """

    theta_rad: FloatArray
    deviation_um: FloatArray
    covariance_um2: FloatArray

    @property
    def u_um(self) -> FloatArray:
        """Standard uncertainty (T,) of each point, um."""
        return self.covariance_um2.diagonal().clip(min=0.0) ** 0.5


@dataclass(frozen=True, slots=True)
class Separation:
    """The deviations of one or several parts by cause.

    ``shares`` in the order wheel, dresser, set-up, axes, clamping, wear, rest; ``details`` split some of them
    further. ``diamond`` is an equal error along the whole profile (- : the wheel was too large, as a worn diamond
    leaves it); ``diamond_named`` whether the profile shows that it is one. ``setup`` are values to add for the next
    part: x_um, dressing_um, swivel_arcsec (+: the profile moves along + of the wheel's axis above the middle of the
    face; a slant of the machine's own cannot be told from it, and its u is infinite where only one height was seen).
    ``wear`` is what grew from the first space ground to the last. ``correlations`` are pairs of terms that cannot be
    told apart well, with their coefficient.
    """

    parts: tuple[str, ...]
    total_um: float
    point_u_um: float
    shares: tuple[ProcessShare, ...]
    details: tuple[ProcessShare, ...]
    form: WheelForm
    diamond: EstimatedValue
    diamond_named: bool
    setup: Mapping[str, EstimatedValue]
    clamping: Mapping[str, EstimatedValue]
    wear: Mapping[str, EstimatedValue]
    correlations: tuple[tuple[str, str, float], ...] = ()
    said: tuple[Message, ...] = field(default=())

    def share(self, name: str) -> ProcessShare:
        """One share or detail by its name. Raises KeyError."""
        for one in (*self.shares, *self.details):
            if one.name == name:
                return one
        raise KeyError(name)

    def asks(self, name: SetupName) -> EstimatedValue:
        """What these parts ask to be added to a set-up value."""
        return self.setup[SETUP_KEYS[name]]


@dataclass(frozen=True, slots=True)
class CorrectionStep:
    """The flank (RMS, with the RMS of its u, um) and the drive (p-p, u, arcsec; None without one) after a correction.

    ``name`` is "as ground", "set-up", "tables" or "wheel".
    """

    name: str
    flank_um: float
    u_um: float
    transmission_arcsec: float | None = None
    transmission_u_arcsec: float | None = None


@dataclass(frozen=True, slots=True)
class CorrectionOrder:
    """What each correction gives on a part, in the order of what it gives; each step on top of those before it.

    ``floor_um`` is what everything possible leaves: without the wheel's form where the wheel can be dressed, else as
    ``undressed_floor_um``, with it.
    """

    part: str
    steps: tuple[CorrectionStep, ...]
    floor_um: float
    undressed_floor_um: float


@dataclass(frozen=True, slots=True)
class WheelVerdict:
    """What a dressing made of the wheel's form, um RMS: before, predicted and found; ``held`` within k = 2 of ``u_um``.

    ``missed_um`` is what the form found differs by from the predicted one.
    """

    before_um: float
    predicted_um: float
    after_um: float
    missed_um: float
    u_um: float
    held: bool


@dataclass(frozen=True, slots=True)
class UnexplainedField:
    """What corrected parts show alike beside their prediction, um RMS, with its u; along the stroke, and over C."""

    common_um: float
    u_um: float
    over_z_um: float
    over_c_um: float

    @property
    def sure(self) -> bool:
        """Whether it is more than what the parts differ by, and worth a table."""
        return self.common_um > max(2.0 * self.u_um, 0.1)


@dataclass(frozen=True, slots=True)
class HeldValue:
    """One set-up value of the builder's cycle: where the control holds it, and the number before and after.

    ``added`` is what the set-up value grows by, um or arcsec; ``old`` and ``new`` are the control's numbers in
    ``unit``. A place of "" is one where a person types.
    """

    name: SetupName
    place: str
    unit: HeldUnit
    added: float
    old: float = 0.0
    new: float = 0.0


@dataclass(frozen=True, slots=True)
class SetupHandover:
    """Set-up values handed over to the builder's cycle after a part: what was asked, and how it ended.

    "rolled-back": a read-back says that the old numbers are there; "held": nobody knows, or not all are old or new.
    "typed": a person typed them. ``step`` names the value whose sense this known step is to prove. ``undoes`` is the
    transaction that this one took back, ``machine`` where the numbers are held (None: a person typed them).
    """

    part: str
    values: tuple[HeldValue, ...]
    outcome: Literal["committed", "rolled-back", "held", "refused", "typed"]
    transaction: int = 0
    step: str = ""
    undoes: int = 0
    utc: str = ""
    reasons: tuple[Message, ...] = ()
    machine: MachineIdentity | None = None


@dataclass(frozen=True, slots=True)
class SetupProof:
    """What a known step of a held number did to the next part: its sense, with the share ``gain`` that was seen and u.

    It counts for this place, unit and machine alone.
    """

    machine: MachineIdentity
    name: SetupName
    place: str
    unit: HeldUnit
    sense: Literal[1, -1]
    gain: float
    u: float
    date_utc: str
