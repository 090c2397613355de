"""Frozen records that cross a port: what a device tells the gateway and what the gateway hands it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.terms import TableKind, spoken
from drivers.units import AxisUnit, DeviationUnit, deviation_unit

FloatArray = NDArray[np.float64]
Approach = Literal[1, -1]
CompensatedFor = Literal["nothing", "air", "air+material"]
Sense = Literal[1, -1]
"""In which sense a cross table's values are held: +1 as they stand in the control. A driver's own: kept, never used."""
# um or arcsec: an acting compensation below this is none
GONE = 0.001


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a device says it is. ``fingerprint`` holds what must stay the same for a controller."""

    driver: str
    model: str
    serial: str
    firmware: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class MachineIdentity:
    """The fingerprint of a machine: three fields and more, all of them compared before every write."""

    serial: str
    version: str
    axis_names: tuple[str, ...]
    unit_system: Literal["metric", "inch"] = "metric"

    def differences(self, other: MachineIdentity) -> tuple[str, ...]:
        """Names of the fields that differ."""
        names = ("serial", "version", "axis_names", "unit_system")
        return tuple(name for name in names if getattr(self, name) != getattr(other, name))


@dataclass(frozen=True, slots=True)
class Ambient:
    """Air and material readings. None means not connected; never assumed to be 20 degC."""

    air_degc: float | None = None
    pressure_hpa: float | None = None
    humidity_pct: float | None = None
    material_degc: tuple[float, ...] = ()
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """A block of consecutive readings of one instrument, stamped in instrument time.

    ``time_s`` shape (n,): instrument time, sequence number / sample frequency or the bridge's time stamp.
    ``values`` shape (n, len(channels)), in the unit that ends each channel's name.
    ``valid`` shape (n,): false while the beam is obstructed or the sample is marked bad.
    ``lost`` counts samples the instrument skipped just before this block.
    """

    channels: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    valid: NDArray[np.bool_]
    lost: int = 0
    events: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.time_s.shape[0])


@dataclass(frozen=True, slots=True)
class Optics:
    """What is mounted in the beam, as far as the instrument itself can tell ("unknown" else)."""

    kind: str = "unknown"
    detail: str = ""


class ChannelStatus(Enum):
    """State of the NC channel (chanStatus)."""

    RESET = 0
    ACTIVE = 1
    INTERRUPTED = 2


@dataclass(frozen=True, slots=True)
class AxisState:
    """One axis as the controller reports it. ``in_position`` is aaStat 4 (exact stop fine)."""

    name: str
    position: float
    referenced: bool
    in_position: bool
    encoder_compensation: float
    cross_compensation: float
    unit: AxisUnit


@dataclass(frozen=True, slots=True)
class MachineState:
    """The controller's state in one read; ``axes`` by machine axis name."""

    channel: ChannelStatus
    mode: str
    message: str
    alarms: tuple[int, ...]
    access_level: int
    axes: Mapping[str, AxisState]
    program: str = ""


@dataclass(frozen=True, slots=True)
class TableAbility:
    """One kind of table that a control holds.

    ``grid``: points of equal step, or at free positions. ``most_points`` of one table; None where the control's own
    memory says (`Controller.table_limits`). ``directions``: how the two directions of travel differ: not at all, by a
    table for each, or by a second column of the same table.
    """

    kind: TableKind
    grid: Literal["equal-step", "free"] = "equal-step"
    directions: Literal["none", "tables", "columns"] = "none"
    most_points: int | None = None


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What the road to a controller can do; whoever works with it asks before it begins.

    ``stops``: runs motion programs of ours (stops, hand-shake, saved tables); without them the tables are read
    directly and the axis is moved by the operator. ``tables`` are the kinds it holds. ``switched``: how a table is
    switched on and off: at a stop of such a program, by itself, or only by a restart of the control. ``marker``: the
    controller keeps the number and state of the transaction where it outlives the gateway's PC. ``consent`` is how
    the person at the machine agrees. ``grinding``: grinds a test part. ``alarms``: its state names alarms.
    ``acting_tables``: the tables that act can be read; else only what was loaded, and the acting value.
    ``cross_shown``: whether the acting value of cross tables counts as their deviations do, or nobody knows which way.
    ``self_test``: it tries the words of its programs (`drivers.programs.SelfTests`); a push asks for it.
    """

    stops: bool
    tables: tuple[TableAbility, ...]
    switched: Literal["at-stop", "by-itself", "by-restart"]
    marker: bool
    consent: Literal["start", "panel", "restart"]
    grinding: bool = False
    alarms: bool = True
    acting_tables: bool = True
    cross_shown: Literal["as-is", "either-way"] = "as-is"
    self_test: bool = False

    @property
    def switches_now(self) -> bool:
        """Whether a table can be switched while the control runs, as a proof of its sign needs."""
        return self.switched != "by-restart"

    def shown(self, kind: TableKind, value: float) -> tuple[float, ...]:
        """What the control may show where tables of a kind add up to a value; the ways keep their order."""
        return (value, -value) if kind == "cross" and self.cross_shown == "either-way" else (value,)

    def table(self, kind: TableKind) -> TableAbility | None:
        """What the control can do with tables of a kind; None where it has none."""
        return next((one for one in self.tables if one.kind == kind), None)


@dataclass(frozen=True, slots=True)
class Marker:
    """What the controller itself remembers of the last push: transaction number (0 none) and its state.

    ``head`` is what it was told of the audit log's end, 64 bits; None where the road carries none. It is no part of
    what makes two markers the same.
    """

    transaction: int
    state: Literal["none", "in-progress", "committed", "held"]
    head: int | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class TableLimits:
    """What the controller can hold for one axis or table: reserved points and the resolution of a value.

    ``resolution`` and ``max_value`` in the output axis' unit; ``max_sum`` (cross tables only) is the largest sum of
    all tables of that axis the control lets through, in the same unit; None where it cannot be read.
    """

    reserved_points: int
    resolution: float
    max_value: float
    max_sum: float | None = None


@dataclass(frozen=True, slots=True)
class CompensationTable:
    """A compensation table as *deviations* d = -q that it cancels, in um (linear) or arcsec (rotary).

    ``minimum``, ``maximum``, ``step`` are in the input axis' unit; ``deviations`` has k+1 values for
    k = (maximum-minimum)/step, in the deviation unit of the *output* axis. ``kind`` "axis": an axis' own table (input =
    output); "cross": of one axis over another. ``index`` is the encoder of an axis table and the number of a cross
    table. ``direction`` 0 both, +1/-1 one travel direction of the input axis (cross tables only). ``places`` are points
    at free positions, rising, () where the step is equal; ``reverse`` is the curve of the negative direction of travel,
    () where ``deviations`` holds for both. A control takes what its `TableAbility` says and refuses the rest.
    """

    kind: TableKind
    input_axis: str
    output_axis: str
    minimum: float
    maximum: float
    step: float
    deviations: tuple[float, ...]
    modulo: bool = False
    index: int = 0
    input_unit: AxisUnit = "mm"
    output_unit: AxisUnit = "mm"
    direction: Literal[-1, 0, 1] = 0
    multiply_by: int = 0
    table_type: int = 0
    places: tuple[float, ...] = ()
    reverse: tuple[float, ...] = ()

    @property
    def deviation_unit(self) -> DeviationUnit:
        """Unit of ``deviations``."""
        return deviation_unit(self.output_unit)

    @property
    def positions(self) -> FloatArray:
        """Interpolation points in the input axis' unit, shape (k+1,)."""
        if self.places:
            return np.asarray(self.places, dtype=np.float64)
        return self.minimum + self.step * np.arange(len(self.deviations), dtype=np.float64)

    @property
    def name(self) -> str:
        """Short name, output first: X(X), C(Z)."""
        return f"{self.output_axis}({self.input_axis})"

    @property
    def is_plain(self) -> bool:
        """Whether points of equal step and one curve for both directions are all there is to it."""
        return not self.places and not self.reverse

    def at(self, positions: FloatArray, approach: Approach = 1) -> FloatArray:
        """Deviation at input positions, shape as given: linear between points, clamped or modulo outside.

        ``approach`` chooses the curve where the table has one for each direction.
        """
        curve = self.reverse if approach < 0 and self.reverse else self.deviations
        values = np.asarray(curve, dtype=np.float64)
        wanted = np.asarray(positions, dtype=np.float64)
        if self.modulo:
            wanted = self.minimum + np.mod(wanted - self.minimum, self.maximum - self.minimum)
        return np.interp(wanted, self.positions, values)


@dataclass(frozen=True, slots=True)
class LiveTable:
    """A table found in the controller with its switch; ``enabled`` is true where every switch of it is on."""

    table: CompensationTable
    enabled: bool


@dataclass(frozen=True, slots=True)
class TemperatureShift:
    """What temperature compensation is worth on an axis: ``constant`` + ``slope`` (position - ``reference``).

    In the axis unit, and per unit. Only the parts that the control has switched on, the slope as far as it lets it
    act; all 0 where nothing acts.
    """

    constant: float = 0.0
    slope: float = 0.0
    reference: float = 0.0

    def at(self, position: float) -> float:
        """Its worth at a position, in the axis unit."""
        return self.constant + self.slope * (position - self.reference)


@dataclass(frozen=True, slots=True)
class LiveSet:
    """Everything that compensates one axis right now: tables, switches, backlash; and the text as read.

    ``backlash`` is the constant reversal the control takes up, in the axis unit. ``native`` is the loadable back-up
    exactly as the controller wrote it; ``digest`` is the same as long as the tables are. ``own`` is the axis' own
    table; that of an axis that never had one is all zero and disabled. ``cross`` are the cross tables whose output is
    this axis, ``others`` those of other outputs, as far as they are known. Cross tables are deviations by the proof
    that was given with the question or order, in its ``sense``; without a proof they hold the stored values.
    ``temperature`` is what else moves the axis, read beside the tables and no part of the digest; None where the road
    cannot tell.
    """

    axis: str
    own: LiveTable
    cross: tuple[LiveTable, ...]
    backlash: float
    native: str
    digest: str
    others: tuple[LiveTable, ...] = ()
    sense: Sense = 1
    temperature: TemperatureShift | None = None


@dataclass(frozen=True, slots=True)
class Stop:
    """One place where the axis stands and waits to be measured.

    ``target`` in the axis unit, approached in direction ``approach``. ``switch`` turns the plan's table (the
    output axis' own, or its ``cross_table``) on or off before the reading (None leaves it). ``label`` says what
    the stop is for (an index in the plan).
    """

    target: float
    approach: Approach
    repetition: int = 0
    label: int = 0
    switch: bool | None = None


@dataclass(frozen=True, slots=True)
class StopPlan:
    """A motion programme of one axis: stop, hand-shake, next stop. Positions are machine coordinates.

    ``setup`` is the operator's message shown before the first move ("" for none).
    ``feed`` in mm/min or deg/min; ``overrun`` moves beyond reversal so that each stop is approached from
    its own side; ``dwell_s`` passes before each hand-shake; ``save_tables`` writes the live tables first.
    ``output_axis`` ("": the axis that moves) is the one whose tables are saved and whose compensation is shown,
    ``encoder`` its measuring system, ``encoder_said`` whether a person named it; ``cross_table`` is the cross table
    that stops switch (None: its own).
    """

    name: str
    axis: str
    letter: str
    unit: AxisUnit
    rotary: bool
    stops: tuple[Stop, ...]
    feed: float
    overrun: float
    dwell_s: float
    setup: str = ""
    save_tables: bool = True
    encoder: int = 0
    output_axis: str = ""
    cross_table: int | None = None
    encoder_said: bool = True

    @property
    def compensated_axis(self) -> str:
        """The axis whose tables this plan is about."""
        return self.output_axis or self.axis


@dataclass(frozen=True, slots=True)
class TableQuestion:
    """Which tables act on ``axis``, measured by ``encoder``, and what a program may move to find out.

    Where only a program of ours can read them it visits one stop: ``moved`` (``letter`` in programs) goes to ``place``
    in its ``unit`` and in direction ``approach``, at ``feed`` in mm/min or deg/min and with ``overrun`` beyond it; a
    person has ``start_s`` to start it and a move ``stop_s``. Cross tables come as deviations by ``proof``, and as they
    are stored where that is None.
    """

    axis: str
    moved: str
    letter: str
    unit: AxisUnit
    rotary: bool
    place: float
    feed: float
    overrun: float
    approach: Approach = 1
    encoder: int = 0
    start_s: float = 600.0
    stop_s: float = 120.0
    proof: SignProof | None = None


@dataclass(frozen=True, slots=True)
class StopReached:
    """The controller stands at a stop and waits: ``counter`` must be echoed to let it go on."""

    counter: int
    repetition: int
    label: int
    approach: Approach
    target: float
    encoder_compensation: float
    cross_compensation: float


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
        """Whether an axis table acts against what the control's manual says."""
        return self.kind == "axis" and self.sign != 1

    @property
    def sense(self) -> Sense:
        """In which sense tables of its kind are deviations by it; an axis table is one as it stands."""
        return self.sign if self.kind == "cross" else 1


@dataclass(frozen=True, slots=True)
class PushOrder:
    """One table to load. ``transaction`` is the number the controller must echo before it enables.

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
        return self.table.index if self.table.kind == "axis" else self.encoder


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


@dataclass(frozen=True, slots=True)
class MeasuredSet:
    """A result file as a record: deviations (m, n, 2) with NaN where missing; last axis is + then -.

    ``targets`` shape (m,) in the axis unit, relative to the file's own zero (a vendor file has no machine
    datum); ``deviations`` in um or arcsec.
    """

    targets: FloatArray
    deviations: FloatArray
    axis_unit: AxisUnit
    ambient_start: Ambient = field(default_factory=Ambient)
    ambient_end: Ambient = field(default_factory=Ambient)
    compensated_for: CompensatedFor = "air+material"
    expansion_ppm_per_k: float | None = None
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class GearInspection:
    """Measured flank points of one gear: positions, not a grid; each knows its space and flank.

    ``points_mm`` (n, 3): touched points x, y, z in the part frame, z along the gear's axis. ``space`` (n,) whole
    numbers; ``flank`` (n,): +1 the left flank of its space, -1 the right one. ``deviation_um`` (n,) along the
    normal, + surplus material, where the machine said it. ``probe_u_um`` standard uncertainty of one touch.
    """

    points_mm: FloatArray
    space: NDArray[np.int64]
    flank: NDArray[np.int64]
    deviation_um: FloatArray | None = None
    probe_u_um: float | None = None
    source: str = ""
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.points_mm.shape[0])


Flank = Literal["left", "right"]
GearTrace = Literal["profile", "lead", "pitch", "runout"]


@dataclass(frozen=True, slots=True)
class ClampedPart:
    """What is clamped on a gear inspection machine: ``part`` its number, ``clamping`` how, in the operator's words."""

    clamped: bool
    part: str = ""
    clamping: str = ""


@dataclass(frozen=True, slots=True)
class GearPlan:
    """What to measure of a gear with ``space_count`` spaces, numbered from 0 at +x towards +y.

    ``spaces`` are those whose ``flanks`` get a profile line (``profile_points`` at height ``profile_z_mm``) and a
    lead line (``lead_points`` over ``lead_z_mm``); no line where its points are 0. ``pitch`` touches both flanks of
    every space once, ``runout_ball_mm`` a ball of that diameter in every space (0: none).
    """

    space_count: int
    spaces: tuple[int, ...]
    flanks: tuple[Flank, ...] = ("left", "right")
    profile_points: int = 0
    profile_z_mm: float = 0.0
    lead_points: int = 0
    lead_z_mm: tuple[float, float] = (0.0, 0.0)
    pitch: bool = False
    runout_ball_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class InspectedGear:
    """What an inspection machine measured of one clamping: flank points, and balls in the spaces for the runout.

    ``trace`` (n,) names the line each point of ``inspection`` belongs to. ``balls_mm`` (m, 3) are ball centres in
    the part frame, ``ball_space`` (m,) their spaces. ``temperature_degc`` of the part, None where not measured.
    """

    inspection: GearInspection
    trace: tuple[GearTrace, ...]
    part: ClampedPart
    balls_mm: FloatArray
    ball_space: NDArray[np.int64]
    temperature_degc: float | None = None
    measured_utc: str = ""
