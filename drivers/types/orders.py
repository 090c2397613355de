"""What is asked of a control's tables: read, load, switch off; and the proof of their sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivers.terms import TableKind, spoken
from drivers.types.identity import MachineIdentity
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import GONE, Sense
from drivers.units import AxisUnit


@dataclass(frozen=True, slots=True)
class TableQuestion:
    """Which tables act on ``axis`` (``letter`` in programs), measured by ``encoder``.

    Where only a program of ours can read them it moves nothing; a person has ``start_s`` to start it. Cross tables come
    as deviations by ``proof``, and as they are stored where that is None. ``loaded``: where a control puts tables to
    work at its start, those that wait for it are asked for; else they are refused while they wait.
    """

    axis: str
    letter: str
    unit: AxisUnit
    rotary: bool
    encoder: int = 0
    start_s: float = 600.0
    proof: SignProof | None = None
    loaded: bool = False


@dataclass(frozen=True, slots=True)
class SignProof:
    """How this machine's compensation acts, measured: +1 a positive stored value moves the axis negative.

    ``slope`` is measured step / commanded deviation with standard uncertainty ``slope_u``; ``machine`` the
    fingerprint it holds for; ``sign`` is what the driver multiplies d with, and nobody else.
    """

    machine: MachineIdentity
    kind: TableKind
    output_axis: str
    slope: float
    slope_u: float
    sign: Sense
    date_utc: str

    @staticmethod
    def sign_of(step: float) -> Sense:
        """The sign that a measured step proves: a positive stored value that moves the axis negative is +1."""
        return 1 if step < 0 else -1

    @property
    def agrees(self) -> bool:
        """Whether slope and sign say the same."""
        return self.slope != 0 and self.sign == self.sign_of(self.slope)

    @property
    def reversed(self) -> bool:
        """Whether an axis table or a reversal acts against what the control's manual says."""
        return self.kind != "cross" and self.sign != 1

    @property
    def sense(self) -> Sense:
        """In which sense tables of its kind are deviations by it; an axis table is one as it stands."""
        return self.sign if self.kind == "cross" else 1


@dataclass(frozen=True, slots=True)
class PushOrder:
    """One table to load, alone or in a batch. ``transaction`` is the number the controller must echo before it enables.

    ``purpose`` "table" needs a `SignProof` in ``proof``; "sign-proof" and "restore" do not. For "restore"
    ``table`` is the old table and ``enable`` the switch it had.
    ``agreeing_position`` is where old and new table agree and the table's *input* axis must stand; ``letter``
    and ``rotary`` are those of the input axis. ``coupled`` (cross tables) says that other tables of the output axis
    were on and must be on again at the end, whether this one is enabled or not. ``head`` (64 bits) is left in the
    controller's marker, where that holds it. ``encoder`` is the measuring system of the output axis that acts,
    ``encoder_said`` whether a person named it.
    """

    transaction: int
    table: CompensationTable
    letter: str
    rotary: bool
    enable: bool
    agreeing_position: float
    purpose: Literal["table", "sign-proof", "restore"]
    proof: SignProof | None = None
    coupled: bool = False
    head: int = 0
    encoder: int = 0
    encoder_said: bool = True

    @property
    def saved_encoder(self) -> int:
        """Whose own table is saved beside the one that is loaded: an axis table's own, else the one that acts."""
        return self.encoder if self.table.kind == "cross" else self.table.index


PushBatch = tuple[PushOrder, ...]
"""The tables of one transaction, loaded together and each switched by itself; one table is the batch of one.

All carry the same number, purpose and head, and no table is named twice. Orders with the same input axis have the same
agreeing position, orders with the same output axis the same measuring system.
"""


@dataclass(frozen=True, slots=True)
class ReadBack:
    """What the first half made of one order of a batch: what stood before, and what was read back, off.

    ``agreed`` says whether the control, where it compares by itself, found every point and parameter as sent.
    """

    backup: LiveSet
    found: LiveSet
    agreed: bool = True


@dataclass(frozen=True, slots=True)
class DisableOrder:
    """One table to switch off; it carries no value, so that none can be written.

    ``transaction`` is the number the controller must echo. ``axis`` is the output axis; ``index`` the encoder of
    an axis table or the number of a cross table. With a cross table the output axis' switch may go off too: all cross
    tables of that axis are silent then.
    """

    transaction: int
    kind: TableKind
    axis: str
    index: int = 0

    @property
    def name(self) -> str:
        """The table among all of a machine, as people name it: "X1", "X1-cec3"."""
        return spoken().name(self.kind, self.axis, self.index)


@dataclass(frozen=True, slots=True)
class SwitchReading:
    """A table's switch as read back, and what acts on its axis now.

    ``enabled``: every switch of it reads on, or off; None where they differ or cannot be read. ``acting`` is the
    acting compensation of the table's layer, um or arcsec.
    """

    enabled: bool | None
    acting: float

    @property
    def off(self) -> bool:
        """Proved off: the switch reads off and nothing acts; a switch alone proves nothing."""
        return self.enabled is False and abs(self.acting) <= GONE
