"""Everything a report is made of, as one frozen record; a report computes nothing that is not in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivers.types import Identity, MachineIdentity, SignProof
from drivers.units import AxisUnit, DeviationUnit, deviation_unit
from gateway.domain import AxisVerdict, Capture, Component, Evaluation, PushRecord, SenseProof, TableChange

Outcome = Literal["better", "unchanged", "worse", "not-pushed"]


@dataclass(frozen=True, slots=True)
class InstrumentNote:
    """One instrument of the run: who it said it is, and what it cannot see."""

    name: str
    identity: Identity
    notices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FileUsed:
    """A file the run read or wrote, with the sha256 of its bytes."""

    path: str
    sha256: str
    role: str


@dataclass(frozen=True, slots=True)
class AxisMaterial:
    """One axis of the run. Whatever the run did not reach is None or empty.

    ``axis`` is the controller's name (X1), ``letter`` the axis letter (X), ``unit`` mm or deg; deviations
    are in um or arcsec. ``findings`` are what was found but not corrected, in words.
    """

    axis: str
    letter: str
    unit: AxisUnit
    capture_before: Capture | None = None
    capture_after: Capture | None = None
    before: Evaluation | None = None
    after: Evaluation | None = None
    components: tuple[Component, ...] = ()
    change: TableChange | None = None
    push: PushRecord | None = None
    sign_proof: SignProof | None = None
    sense_proof: SenseProof | None = None
    verdict: AxisVerdict | None = None
    findings: tuple[str, ...] = ()

    @property
    def deviation_unit(self) -> DeviationUnit:
        """Unit of every deviation of this axis."""
        return deviation_unit(self.unit)

    @property
    def rotary(self) -> bool:
        """True for an axis in degrees."""
        return self.unit == "deg"

    @property
    def component(self) -> str:
        """The measured error motion, ISO 230-1 letters ("" when nothing was captured)."""
        for capture in (self.capture_before, self.capture_after):
            if capture is not None:
                return capture.component
        return self.components[0].name if self.components else ""


@dataclass(frozen=True, slots=True)
class ReportMaterial:
    """A whole run as the report shows it; dates are ISO 8601, ``hashes`` name -> sha256 of a record."""

    site: str
    machine: MachineIdentity
    run_id: str
    outcome: Outcome
    axes: tuple[AxisMaterial, ...]
    started_utc: str = ""
    ended_utc: str = ""
    software: str = ""
    operator: str = ""
    instruments: tuple[InstrumentNote, ...] = ()
    files: tuple[FileUsed, ...] = ()
    hashes: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
