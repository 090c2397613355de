"""What the gateway may ask of the outside world: one Protocol for each role a device can play."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from drivers.checks import CheckLine, ControlFacts, TrustView, Wanted
from drivers.tablefile import ArchiveMember, TableFile, TableFinding, TableMachine
from drivers.terms import TableKind
from drivers.types import (
    Ambient,
    Capabilities,
    ClampedPart,
    CompensatedFor,
    CompensationTable,
    DisableOrder,
    GearPlan,
    Identity,
    InspectedGear,
    LiveSet,
    MachineIdentity,
    MachineState,
    Marker,
    MeasuredSet,
    Optics,
    PushOrder,
    SampleBlock,
    Sense,
    SignProof,
    StopPlan,
    StopReached,
    SwitchReading,
    TableLimits,
    TableQuestion,
)
from drivers.units import AxisUnit
from drivers.workpiece import GrindPlan


class Tell(Protocol):
    """Hears what a driver has to say to people: a code of its catalogue with fields."""

    def __call__(self, code: str, /, **fields: object) -> None:
        """Tell; returns at once and never raises."""
        ...


@runtime_checkable
class Device(Protocol):
    """Anything that is opened, says who it is, and is closed. `open` raises our exceptions only."""

    name: str

    async def open(self, timeout_s: float) -> Identity:
        """Connect and identify; raises TransportError, ProtocolError or DeviceError."""
        ...

    async def close(self) -> None:
        """Let go of the wire; never raises, may be called twice."""
        ...


@runtime_checkable
class Instrument(Device, Protocol):
    """A measuring instrument that streams.

    Channel names: a linear laser gives ("displacement_mm",): the optical path in mm of vacuum unless
    `compensated_for` says otherwise, positive as the instrument counts. A rotary calibrator gives
    ("device_deg", "laser_deg"); the device counts against the axis: axis = laser - device.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the value columns."""
        ...

    @property
    def compensated_for(self) -> CompensatedFor:
        """What the instrument has already applied to its length readings."""
        ...

    @property
    def notices(self) -> tuple[str, ...]:
        """What this instrument cannot see, to be printed in every report."""
        ...

    async def optics(self) -> Optics:
        """What is mounted in the beam, if the instrument can tell."""
        ...

    async def ambient(self) -> Ambient:
        """Latest environment readings of this instrument; fields are None where it has no sensor."""
        ...

    def blocks(self) -> AsyncIterator[SampleBlock]:
        """Samples from now on, oldest first. A lost wire ends it with TransportError."""
        ...


@runtime_checkable
class Recounting(Instrument, Protocol):
    """An instrument that must be told to count afresh after its beam was lost."""

    async def set_datum(self) -> None:
        """The present reading is good again. Raises BeamObstructed while no light returns."""
        ...


@runtime_checkable
class RotaryCalibrator(Instrument, Protocol):
    """A self-turning rotary calibrator (XR20-W principle)."""

    async def hold(self) -> None:
        """Stop following: the device keeps its own angle while the axis moves."""
        ...

    async def track(self) -> None:
        """Follow the axis again by turning against it."""
        ...

    async def turn(self, by_deg: float) -> None:
        """Turn the device alone by this angle of its own encoder, and hold."""
        ...


@runtime_checkable
class AmbientSensor(Device, Protocol):
    """Anything that reads the environment, an instrument among them."""

    async def ambient(self) -> Ambient:
        """Latest readings; fields are None where there is no sensor."""
        ...


@runtime_checkable
class TypedInstrument(Instrument, Protocol):
    """An instrument whose readings a person types: it is told what stands in front of it, and asks."""

    def expect(self, label: str, value: float, limit: float) -> None:
        """The next reading is of ``label`` and lies within ``limit`` of ``value``, else the person is asked again."""
        ...


@runtime_checkable
class GearInspector(Device, Protocol):
    """A gear inspection machine."""

    async def part(self) -> ClampedPart:
        """What is clamped now."""
        ...

    async def inspect(self, plan: GearPlan, progress: Callable[[str, int, int], None]) -> InspectedGear:
        """Measure; ``progress`` hears (trace, done, total). Whatever interrupts it aborts the machine's plan.

        Raises DeviceRefused (nothing clamped, operator stopped it), TransportError, ProtocolError.
        """
        ...

    async def abort(self) -> None:
        """Stop measuring and retract."""
        ...


@runtime_checkable
class Controller(Device, Protocol):
    """A machine controller that measures by hand-shake and takes compensation tables.

    Reads may be retried by the caller; a write is never retried: after DeadlineExceeded the outcome is
    unknown and must be read back. Nothing here starts a program: the operator does. What a control
    cannot do it declares, and refuses as unsupported; `drivers.contract` holds every controller to this port.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What this road can do."""
        ...

    async def identify(self) -> MachineIdentity:
        """Read the fingerprint afresh."""
        ...

    async def state(self) -> MachineState:
        """Read the machine state afresh."""
        ...

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        """Reserved points and value resolution: of encoder ``index`` or of cross table ``index``."""
        ...

    async def marker(self) -> Marker | None:
        """What the controller remembers of the last push, whoever made it; None without `Capabilities.marker`."""
        ...

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Generate, send, read back and select the motion program; the operator starts it."""
        ...

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a hand-shake counter above `after`; None when the program has ended instead.

        Raises DeadlineExceeded (no start or no progress), DeviceRefused (alarm: number in the fields).
        """
        ...

    async def release_stop(self, counter: int) -> None:
        """Echo the counter so that the axis may move on."""
        ...

    async def abort_program(self) -> None:
        """Ask the waiting program to end by its abort word; it leaves compensation as it is."""
        ...

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        """What compensates an axis now, read afresh; compensation stays as it is.

        Where only a program can read it, the driver makes that program and ``tell`` hears what the person is to do.
        Raises DeadlineExceeded (nobody started it), DeviceRefused (alarm, another way it ended).
        """
        ...

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """The live tables as the last `prepare_stops` program saved them before its first move.

        Without `Capabilities.stops` they are read directly, afresh. Cross tables are deviations by ``proof``, and as
        they are stored where that is None.
        """
        ...

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """A set that was read before, its cross tables now as deviations by ``proof`` (None: as stored); pure."""
        ...

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        """One table that was kept in ``sense``, now as a deviation by ``proof`` (None: as stored); pure."""
        ...

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Place set-up values, send, read back, select; its text. ConfigError, DeviceRefused, UnsupportedDevice."""

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Spaces done once > ``after`` (-1: begun), None: ended. Raises DeadlineExceeded, DeviceRefused (alarm...)."""

    async def stage(self, order: PushOrder) -> None:
        """Get ready to load: nothing of the compensation changes yet; the person at the machine starts it.

        Where programs load it, the program is generated, sent, read back and selected. What its abilities
        lack is refused here (TableError, DeviceRefused), with nothing sent. With `Capabilities.marker` the marker says
        in-progress with the order's number when this returns.
        """
        ...

    async def read_back(self, order: PushOrder, timeout_s: float) -> tuple[LiveSet, LiveSet]:
        """Disable, write, read all back; (back-up of the old, read-back of the new). The new one stays off.

        Cross tables of both are deviations by the order's proof. A
        table never loaded (step 0) is restored as such, or, where the road cannot say that, as zeros on the grid there.

        Raises PointsDiffer when every point was written and some read otherwise, TableActs when the control takes
        none because the table is on, DeviceRefused when it ended by another way.
        """
        ...

    async def backup_of(self, order: PushOrder) -> LiveSet:
        """What stood before ``order`` began, as the controller or this driver kept it under the order's number.

        With `Capabilities.stops` from the file that the order's first half wrote, also in a later process; else
        from `stage`, in the same process. Cross tables are deviations by the order's proof.
        Raises DeviceRefused when there is none, FileFormatError when it is not whole or of another order.
        """
        ...

    async def activate(self, order: PushOrder) -> None:
        """Release the loaded table under the transaction's number; what enables it is the person's next act."""
        ...

    async def confirm(self, order: PushOrder, timeout_s: float) -> bool:
        """Wait for the outcome: true if the table is switched on, or will be by the restart; false if left off."""
        ...

    async def restarted(self, order: PushOrder, timeout_s: float) -> None:
        """Wait while the operator restarts the control and references, until the table acts."""
        ...

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Switch the order's table on or off and wait until it acts or is gone, confirmed at the machine.

        Raises UnsupportedDevice unless `Capabilities.switched` is "by-itself", DeadlineExceeded,
        DeviceRefused.
        """
        ...

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        """The switch of the order's table and what acts on its axis, read afresh; writes and starts nothing."""
        ...

    async def prepare_disable(self, order: DisableOrder) -> None:
        """Get ready to switch a table off, wherever its axis stands; nothing changes yet.

        With `Capabilities.stops` a program that does only this is sent, read back and selected; the person at
        the machine starts it. Raises DeviceRefused when the machine may not be switched now.
        """
        ...

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Switch off, wait until nothing acts, read back; never retried. What is read is the answer, on or off.

        Raises DeadlineExceeded (nobody started the program, or unknown), DeviceRefused.
        """
        ...

    async def finish_push(self, order: PushOrder, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state (none: nothing is left of it) and end the talk about this order."""
        ...


@runtime_checkable
class ResultFileFormat(Protocol):
    """A vendor result file format: bytes to record and back."""

    def read(self, path: Path) -> MeasuredSet:
        """Read a file; raises FileFormatError with line and reason."""
        ...


@runtime_checkable
class TableFormat(Protocol):
    """Compensation tables as files."""

    def read(self, data: str | bytes, where: str, units: Mapping[str, AxisUnit] | None = None) -> TableFile:
        """A file, back-up or archive as it would act; raises FileFormatError or TableError with line and reason."""
        ...

    def members(self, data: bytes, where: str) -> tuple[ArchiveMember, ...]:
        """What an archive of the control holds; nothing of any other file. Raises FileFormatError with the place."""
        ...

    def write(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str] = ()) -> str:
        """The text of tables in a form by name. Raises ConfigError naming the forms."""
        ...

    def findings(self, data: str | bytes, where: str, machine: TableMachine | None = None) -> tuple[TableFinding, ...]:
        """Everything wrong, doubtful or worth knowing in a table file; empty is clean."""
        ...


@runtime_checkable
class Doctor(Protocol):
    """Looks at the road to a device, from its name to its rights, and changes nothing there."""

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """Every line in the order of the road; ``timeout_s`` bounds each question. Never raises our errors."""
        ...


@runtime_checkable
class Trust(Protocol):
    """Which server certificate is trusted; a person decides, by its thumbprint."""

    async def show(self, timeout_s: float) -> TrustView:
        """What the server shows now beside what is pinned; nothing changes. Raises what the wire raises."""
        ...

    async def accept(self, thumbprint: str, who: str, timeout_s: float) -> TrustView:
        """Pin what the server shows now, if its thumbprint is the typed one. Raises DeviceRefused (E-TRUST-OTHER)."""
        ...


@runtime_checkable
class Survey(Protocol):
    """Tells what a control knows of itself, so that nobody types it; every question is a read."""

    async def survey(self, timeout_s: float) -> ControlFacts:
        """Axes, travel, encoders, room for tables. Raises what a login raises."""
        ...
