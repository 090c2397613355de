"""Frozen records of a run: each stage takes some and makes the next, and all of them are stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.terms import spoken
from drivers.types import Ambient, CompensationTable, Identity, LiveSet, MachineIdentity, SignProof
from drivers.units import AxisUnit, DeviationUnit, deviation_unit

FloatArray = NDArray[np.float64]
COVERAGE = 2.0
"""k of an expanded uncertainty U = k u; 95.45 % of a normal quantity (GUM 6.2)."""
COVERED = 0.9545
"""The share of a normal quantity within k = 2."""


def component_unit(name: str, axis_unit: AxisUnit) -> DeviationUnit:
    """The unit of an error by its ISO 230-1 name: um for EYX or X0C, arcsec for EAX or B0Z; of the axis else."""
    along = name[1:2] if name.startswith("E") else name[:1] if name[1:2] == "0" else ""
    if along and along in "XYZ":
        return "um"
    return "arcsec" if along and along in "ABC" else deviation_unit(axis_unit)


@dataclass(frozen=True, slots=True)
class Item:
    """One device of the run: who it said it was and what it cannot see."""

    name: str
    identity: Identity
    notices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Equipment:
    """What the run was made with."""

    machine: MachineIdentity
    items: tuple[Item, ...]
    started_utc: str


@dataclass(frozen=True, slots=True)
class SenseProof:
    """How an instrument's sense was proved: ``sense`` multiplies its readings; scale is reading / jog."""

    instrument: str
    axis: str
    sense: Literal[1, -1]
    scale: float
    evidence: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CorrectionRecord:
    """One step done to readings: what, by whom, in words, with which coefficients; ``undone`` takes it back."""

    step: str
    by: str
    words: str
    coefficients: Mapping[str, float] = field(default_factory=dict)
    undone: bool = False


@dataclass(frozen=True, slots=True)
class Corrections:
    """What was applied to raw readings, by whom, with which coefficients; applied once, refused twice.

    The words say what stands; ``chain`` holds every step in the order it was done.
    """

    air: str
    expansion: str
    dead_path: str
    drift: str
    details: Mapping[str, float] = field(default_factory=dict)
    chain: tuple[CorrectionRecord, ...] = ()


@dataclass(frozen=True, slots=True)
class Between:
    """Check stops between the targets: places ``targets`` (k,), ``deviations`` (k, n, 2) as in a `Capture`.

    They are held against the fitted curve and never fitted themselves.
    """

    targets: FloatArray
    deviations: FloatArray


@dataclass(frozen=True, slots=True)
class Capture:
    """Deviations of one axis as captured, corrected, in um or arcsec.

    ``targets`` (m,) machine coordinates in the axis unit. ``deviations`` (m, n, 2): target, repetition,
    approach + then -, NaN where missing. ``reading_u`` is the standard uncertainty of one averaged reading
    as seen in its own window. ``suspects`` lists (target, repetition, approach index) out of line.
    ``live`` is what compensated the axis while it was measured. ``unsteady_u`` is the standard uncertainty that
    drift and jumps leave in the targets' means; ``drift_per_h`` how fast the zero wandered, 0 where that is not clear.
    ``line_mm`` is where the reflector stood beside the line that counts, its lever taken off; None: they hold for the
    line that was measured. ``lever_u`` is the standard uncertainty that unknown angles leave at each place.
    """

    axis: str
    component: str
    axis_unit: AxisUnit
    targets: FloatArray
    deviations: FloatArray
    reading_u: float
    ambient_start: Ambient
    ambient_end: Ambient
    corrections: Corrections
    live: LiveSet | None
    sense: SenseProof | None
    suspects: tuple[tuple[int, int, int], ...] = ()
    source: str = "live"
    started_utc: str = ""
    ended_utc: str = ""
    notes: tuple[str, ...] = ()
    cycle: Literal["standard", "pendulum", "pilgrim"] = "standard"
    between: Between | None = None
    unsteady_u: float = 0.0
    line_mm: tuple[float, float, float] | None = None
    lever_u: float = 0.0
    drift_per_h: float = 0.0

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the deviations."""
        return component_unit(self.component, self.axis_unit)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """ISO 230-2 results of one axis; None where the data do not allow a parameter.

    Arrays have shape (m,) with NaN for what does not exist; scalars in the capture's deviation unit.
    """

    standard: str
    unit: DeviationUnit
    targets: FloatArray
    mean_up: FloatArray
    mean_down: FloatArray
    s_up: FloatArray
    s_down: FloatArray
    B_i: FloatArray
    R_i: FloatArray
    B: float | None
    B_mean: float | None
    M: float | None
    E: float | None
    E_up: float | None
    E_down: float | None
    R: float | None
    R_up: float | None
    R_down: float | None
    A: float | None
    A_up: float | None
    A_down: float | None
    U: Mapping[str, float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    edition: str = ""
    certainty: str = ""


@dataclass(frozen=True, slots=True)
class Component:
    """A fitted error motion, e.g. ECC over C: basis, coefficients and their covariance.

    ``basis`` is "polynomial", "fourier", "bspline", "piecewise"; ``domain`` the fitted range (lo, hi) in
    the axis unit. Values come from `gateway.model.components.value` and `standard_uncertainty`.
    """

    name: str
    axis: str
    axis_unit: AxisUnit
    basis: str
    domain: tuple[float, float]
    coefficients: FloatArray
    covariance: FloatArray
    parameters: Mapping[str, object] = field(default_factory=dict)
    residual_rms: float = 0.0

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the values."""
        return component_unit(self.name, self.axis_unit)


@dataclass(frozen=True, slots=True)
class TableChange:
    """One proposed table: the old one as live, the new one merged, and what the axis will then show.

    ``predicted`` (m,) mean deviation expected at ``targets`` after the push, with expanded uncertainty
    ``predicted_U`` (k = 2). ``skipped`` says why nothing is proposed ("" when something is).

    ``axis`` is the output axis. A cross table's change names its table by ``new``: kind, index, input and output axis,
    direction, multiplication; its deviations are d of the output axis, whatever the machine's sign. ``targets``
    are then positions of the input axis. ``base`` is the live set the change was made on, where it is not that
    of a capture of this axis.
    """

    axis: str
    old: CompensationTable
    new: CompensationTable
    old_enabled: bool
    base_digest: str
    targets: FloatArray
    predicted: FloatArray
    predicted_U: FloatArray
    findings: tuple[str, ...] = ()
    skipped: str = ""
    base: LiveSet | None = None

    @property
    def layer(self) -> Literal["axis", "cross"]:
        """Which layer of correction the table belongs to."""
        return self.new.kind

    @property
    def name(self) -> str:
        """The table among all of a proposal, as people name it: "X1", and for a cross table its number too."""
        return spoken().name(self.layer, self.axis, self.new.index)


@dataclass(frozen=True, slots=True)
class Approval:
    """One person's consent to one plan: ``plan_hash`` from `gateway.push.plan_hash`, bound to base and machine.

    ``actor`` is who gave it; ``serial`` the machine; it holds from ``given_utc`` until ``expires_utc`` (ISO 8601
    with offset). ``run_id`` is the run whose proposal was approved.
    """

    actor: str
    plan_hash: str
    base_digest: str
    serial: str
    given_utc: str
    expires_utc: str
    run_id: str = ""


@dataclass(frozen=True, slots=True)
class Proposal:
    """All table changes of a run, for one machine, made from captures named by their hashes; ``warnings`` in words."""

    machine: MachineIdentity
    changes: tuple[TableChange, ...]
    parents: tuple[str, ...]
    created_utc: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PushRecord:
    """What a push did to one axis: the outcome in one word and every step with its time.

    "held": stopped half way, and a read-back says that the table is off. "held-on": it is still on, or unknown.
    """

    transaction: int
    axis: str
    outcome: Literal["committed", "already-applied", "rolled-back", "held", "held-on", "refused", "skipped"]
    steps: tuple[str, ...]
    backup_path: str
    effect: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class SwitchRecord:
    """What a disable-only order did to one table; ``table`` as in a proposal ("X1", a cross table with its number).

    "off" and "already-off" are said of what was read back. ``before`` and ``after`` are the acting compensation, in
    ``unit``; None where it could not be read. ``steps`` say why it is still on, or every reason against it.
    """

    transaction: int
    axis: str
    table: str
    outcome: Literal["off", "already-off", "still-on", "refused"]
    unit: str
    before: float | None
    after: float | None
    steps: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class AxisVerdict:
    """Before and after of one axis in the words of ISO 230-2, and whether the prediction held.

    ``improved`` and ``worse`` are judged at the targets and at the check stops between them.
    """

    axis: str
    unit: DeviationUnit
    before: Evaluation
    after: Evaluation
    improved: bool
    within_prediction: bool
    words: str
    worse: bool = False


@dataclass(frozen=True, slots=True)
class Verdict:
    """The run's answer: every axis, and one word for all."""

    axes: tuple[AxisVerdict, ...]
    outcome: Literal["better", "unchanged", "worse", "not-pushed"]
    proofs: tuple[SignProof, ...] = ()
