"""What a push did, and the run's answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivers.message import Message, joined
from drivers.types.orders import SignProof
from drivers.units import DeviationUnit
from gateway.domain.figures import Evaluation
from gateway.domain.values import FloatArray


@dataclass(frozen=True, slots=True)
class PushRecord:
    """What a push did to one axis: the outcome in one word and every step with its time.

    "untouched": its program never began; what acted before acts, and nothing was changed.
    "held": stopped half way, and a read-back says that the table is off. "held-on": it is still on, or unknown.
    ``reasons`` are all reasons why it did not end as asked, first cause first (none: it did; a record of an older
    version has none). ``marker`` is why the control's marker could not be written at the end (None: it was).
    A step that the journal noted has the field ``utc``.
    ``purpose`` is "restore" for a rollback: "committed" says that the older table is back.
    """

    transaction: int
    axis: str
    outcome: Literal[
        "committed", "already-applied", "rolled-back", "untouched", "held", "held-on", "refused", "skipped"
    ]
    steps: tuple[Message, ...]
    backup_path: str
    effect: tuple[tuple[float, float, float], ...] = ()
    reasons: tuple[Message, ...] = ()
    marker: Message | None = None
    purpose: Literal["table", "sign-proof", "restore"] = "table"

    @property
    def why(self) -> str:
        """All reasons in one line, in English; "" where it ended as asked."""
        return joined(self.reasons)


@dataclass(frozen=True, slots=True)
class SwitchRecord:
    """What a disable-only order did to one table; ``table`` as in a proposal ("X1", a cross table with its number).

    "off" and "already-off" are said of what was read back. ``before`` and ``after`` are the acting compensation, in
    ``unit``; None where it could not be read. ``reasons`` are why it is still on, or every reason against it.
    """

    transaction: int
    axis: str
    table: str
    outcome: Literal["off", "already-off", "still-on", "refused"]
    unit: str
    before: float | None
    after: float | None
    steps: tuple[Message, ...] = ()
    reasons: tuple[Message, ...] = ()


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
    words: tuple[Message, ...]
    worse: bool = False


@dataclass(frozen=True, slots=True)
class ActingCheck:
    """A short capture of an axis while every table acts, cross tables too, against what was predicted; um or arcsec.

    ``predicted`` and ``measured`` (m,) are means of both directions at ``targets``, their common offset taken out of
    ``measured``; ``U`` (m,) the expanded uncertainty (k = 2) of their difference. ``M`` and ``M_predicted`` are the
    ranges over these targets, ``M_U`` and ``M_predicted_U`` theirs. ``held`` is None where the tables that acted were
    not those that were pushed.
    """

    axis: str
    unit: DeviationUnit
    targets: FloatArray
    predicted: FloatArray
    measured: FloatArray
    U: FloatArray
    M: float
    M_U: float
    M_predicted: float
    M_predicted_U: float
    held: bool | None
    words: Message


@dataclass(frozen=True, slots=True)
class Verdict:
    """The run's answer: every axis, and one word for all."""

    axes: tuple[AxisVerdict, ...]
    outcome: Literal["better", "unchanged", "worse", "not-pushed"]
    proofs: tuple[SignProof, ...] = ()
