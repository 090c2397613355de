"""Everything a report is made of, as one frozen record; a report computes nothing that is not in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivers.message import Message
from drivers.types.identity import Identity, MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.values import FloatArray
from drivers.units import AxisUnit, DeviationUnit, deviation_unit
from gateway.correct.outlook.flank_uncertainty import OpenDoubt
from gateway.domain.captures import Capture
from gateway.domain.equipment import SenseProof
from gateway.domain.figures import Component, Evaluation
from gateway.domain.grinding_process import CorrectionOrder, Separation, WheelVerdict
from gateway.domain.identity import KnownFact
from gateway.domain.outcomes import ActingCheck, AxisVerdict, PushRecord
from gateway.domain.proposals import TableChange
from gateway.domain.stated import StatedFacts
from gateway.evaluate.standards.conformity import Decision
from gateway.evaluate.uncertainty.budget import Budget
from gateway.gear.cycloid import CycloidGear
from gateway.model.error_model import ErrorModel
from gateway.report.particulars import Particulars
from gateway.tooth import AxisOutlook, GearProposal, GroundPart, InspectedFlank, ToothProposal, ToothVerdict

CONDITIONS = (
    "instrument",
    "feed",
    "dwell_s",
    "overrun",
    "cycle",
    "warm_up",
    "tables",
    "compensated",
    "expansion",
    "other_axes",
    "offsets",
    "sensors",
)
"""What ISO 230-2 asks to be recorded with a test, besides what has a place of its own in the report."""
Outcome = Literal["better", "unchanged", "worse", "not-pushed", "pushed", "measured", "inspected"]
Kind = Literal["errors", "part", "closing"]


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
class AmbientCourse:
    """Air and material over one capture: ``ambients`` at ``time_s`` (k,), seconds of the instrument."""

    time_s: FloatArray
    ambients: tuple[Ambient, ...]


@dataclass(frozen=True, slots=True)
class AxisMaterial:
    """One axis of the run. Whatever the run did not reach is None or empty.

    ``axis`` is the controller's name (X1), ``letter`` the axis letter (X), ``unit`` mm or deg; deviations
    are in um or arcsec. ``change`` is that of its own table, ``beside`` what else is corrected on the axis itself: its
    reversal. ``findings`` say what was found but not corrected, and what becomes of the reversal; ``acting``
    is the short check with every table acting, ``outlook`` what was predicted of it. ``budget`` is what U rests on.
    ``test_before`` and ``test_after`` are the conditions of the two captures by key of `CONDITIONS`; one that is not
    there was not stated.
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
    beside: tuple[TableMaterial, ...] = ()
    sign_proof: SignProof | None = None
    sense_proof: SenseProof | None = None
    verdict: AxisVerdict | None = None
    findings: tuple[Message, ...] = ()
    acting: ActingCheck | None = None
    outlook: AxisOutlook | None = None
    budget: Budget | None = None
    course_before: AmbientCourse | None = None
    course_after: AmbientCourse | None = None
    test_before: Mapping[str, str] = field(default_factory=dict)
    test_after: Mapping[str, str] = field(default_factory=dict)

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
class Judged:
    """A limit that was decided: of which axis or part, by which standard and edition, as found or as left."""

    of: str
    standard: str
    as_left: bool
    decision: Decision


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """One test part by its name in the run: how it was ground, what was found on it; None for what was not done."""

    part: str
    ground: GroundPart | None = None
    flank: InspectedFlank | None = None


@dataclass(frozen=True, slots=True)
class TableMaterial:
    """One table of the proposal, what its push did (None: it was not pushed), how its sense was proved."""

    change: TableChange
    push: PushRecord | None = None
    proof: SignProof | None = None


@dataclass(frozen=True, slots=True)
class WheelMaterial:
    """A part's deviations by cause; the order of corrections and what a dressing did, where a closing run has them."""

    separation: Separation
    order: CorrectionOrder | None = None
    verdict: WheelVerdict | None = None


@dataclass(frozen=True, slots=True)
class ToothMaterial:
    """What a run knows of the errors and of the tooth; whatever it did not reach is None or empty.

    ``parts`` in the order they were ground; ``from_gear`` is what one of them asks for by itself. ``gear`` and its name
    say what was ground, where the site's gear file can still be read. ``letters`` translates machine axes (X1 -> X).
    ``open`` are the errors by what measuring them next would change, ``advice`` says so in words.
    """

    errors: ErrorModel | None = None
    proposal: ToothProposal | None = None
    verdict: ToothVerdict | None = None
    parts: tuple[PartMaterial, ...] = ()
    tables: tuple[TableMaterial, ...] = ()
    from_gear: GearProposal | None = None
    wheel: WheelMaterial | None = None
    gear: CycloidGear | None = None
    gear_name: str = ""
    letters: Mapping[str, str] = field(default_factory=dict)
    open: tuple[OpenDoubt, ...] = ()
    advice: tuple[Message, ...] = ()

    @property
    def kind(self) -> Kind:
        """Errors measured and no more, parts inspected and no more, or a run that closes the loop."""
        if self.proposal is None and self.verdict is None:
            if not self.parts:
                return "errors"
            if self.errors is None:
                return "part"
        return "closing"

    def part(self, name: str) -> PartMaterial:
        """A part by its name; one with nothing in it where there is none."""
        return next((one for one in self.parts if one.part == name), PartMaterial(name))


@dataclass(frozen=True, slots=True)
class ReportMaterial:
    """A whole run as the report shows it; dates are ISO 8601, ``hashes`` name -> sha256 of a record.

    ``simulated``: a double was in the loop, by its own word or the site file's. ``unprotected`` says why others on the
    network could read or change what passed to the control; "" where they could not. ``excused``: who accepted the
    control's certificate although it was not valid, and why. ``accepted``: changes of the machine's identity that a
    person answers for.
    """

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
    tooth: ToothMaterial | None = None
    particulars: Particulars = field(default_factory=Particulars)
    simulated: bool = False
    unprotected: Message | None = None
    excused: tuple[str, str] = ("", "")
    accepted: tuple[KnownFact, ...] = ()
    judged: tuple[Judged, ...] = ()
    stated: StatedFacts = field(default_factory=StatedFacts)
