"""Anything that is opened and closed, files and the road to a device, and how a driver speaks to people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from drivers.checks import CheckLine, ControlFacts, TrustView, Wanted
from drivers.tablefile import ArchiveMember, TableFile, TableFinding, TableMachine
from drivers.types.exchange import ErrorSet, ReadAs
from drivers.types.identity import Identity
from drivers.types.results import MeasuredSet
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit


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
class TableExchange(Protocol):
    """Compensation tables in the format of another control or program; ``forms`` by name, the usual one first."""

    suffix: str
    forms: tuple[str, ...]

    def text(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str], /) -> str:
        """The file of tables of one axis. Raises TableError for what the format cannot hold."""
        ...

    def read(self, text: str, where: str, known: ReadAs, /) -> tuple[CompensationTable, ...]:
        """The tables of a file; ``known`` where it does not say so itself. Raises FileFormatError with the line."""
        ...


@runtime_checkable
class ErrorExchange(Protocol):
    """Errors of a machine in the format of another control or program."""

    suffix: str

    def text(self, errors: ErrorSet, comments: Sequence[str]) -> str:
        """The file of all errors."""
        ...

    def read(self, text: str, where: str) -> ErrorSet:
        """The errors of a file. Raises FileFormatError with the line."""
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

    async def accept(self, thumbprint: str, who: str, timeout_s: float, reason: str = "") -> TrustView:
        """Pin what the server shows now, if its thumbprint is the typed one. Raises DeviceRefused (E-TRUST-OTHER).

        One that is not valid now needs a ``reason``, which is kept with it.
        """
        ...


@runtime_checkable
class Survey(Protocol):
    """Tells what a control knows of itself, so that nobody types it; every question is a read."""

    async def survey(self, timeout_s: float) -> ControlFacts:
        """Axes, travel, encoders, room for tables. Raises what a login raises."""
        ...
