"""Measuring instruments, sensors of the air, and gear inspection machines."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import Protocol, runtime_checkable

from drivers.ports.devices import Device
from drivers.types.gears import ClampedPart, GearPlan, InspectedGear
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor


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
