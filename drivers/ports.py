"""What the gateway may ask of the outside world: one Protocol for each role a device can play."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Protocol, runtime_checkable

from drivers.types import (
    Ambient,
    CompensatedFor,
    Identity,
    LiveSet,
    MachineIdentity,
    MachineState,
    MeasuredSet,
    Optics,
    PushOrder,
    SampleBlock,
    StopPlan,
    StopReached,
    TableLimits,
)


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
class Controller(Device, Protocol):
    """A machine controller that measures by hand-shake and takes compensation tables.

    Reads may be retried by the caller; a write is never retried: after DeadlineExceeded the outcome is
    unknown and must be read back. Nothing here starts a program: the operator presses NC START.
    """

    async def identify(self) -> MachineIdentity:
        """Read the fingerprint afresh."""
        ...

    async def state(self) -> MachineState:
        """Read the machine state afresh."""
        ...

    async def table_limits(self, axis: str) -> TableLimits:
        """Reserved EEC points (MD38000) and value resolution of one axis."""
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

    async def saved_tables(self, axis: str) -> LiveSet:
        """Fetch the file that the last `prepare_stops` program wrote before its first move."""
        ...

    async def prepare_push(self, order: PushOrder) -> None:
        """Generate, send, read back and select the two-half program; the operator starts it."""
        ...

    async def wait_loaded(self, order: PushOrder, timeout_s: float) -> tuple[LiveSet, LiveSet]:
        """Wait until the first half stands at its M0: (back-up of the old, read-back of the new).

        Raises DeviceRefused when the program itself counted mismatches or ended by another way.
        """
        ...

    async def release_push(self, order: PushOrder) -> None:
        """Set the release word to the transaction number; the operator's second NC START enables."""
        ...

    async def wait_enabled(self, order: PushOrder, timeout_s: float) -> bool:
        """Wait for the second half's end: true if it enabled, false if it left compensation disabled."""
        ...

    async def wait_activated(self, order: PushOrder, timeout_s: float) -> None:
        """Wait while the operator does NCK reset and reference run, until the axis is referenced again."""
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

    def findings(self, text: str, where: str) -> tuple[str, ...]:
        """Everything wrong or doubtful in a table file, as catalogue-rendered lines; empty is clean."""
        ...
