"""May we write? Every reason against it at once, from facts read before; pure.

`drivers.limits` contains the limits of a table, `gateway.interlocks.facts` the others; what only warns asks for a
second person. Rules by subject: `machine`, `table`, `measurement`, `approval`; each yields one refusal per reason.
"""

from __future__ import annotations

from gateway.interlocks.approval import APPROVED, people_needed, warnings
from gateway.interlocks.checker import ApprovedCurve, faults_of, mean_readings
from gateway.interlocks.facts import (
    APPROVED_AHEAD,
    APPROVED_FOR,
    MAX_JUMP,
    MAX_SUSPECT_SHARE,
    MIN_REPETITIONS,
    MarkerCheck,
    PushFacts,
    Refusal,
    Rule,
    other_cross_tables,
    refuse,
    value_at,
)
from gateway.interlocks.machine import CONSENT, MACHINE, NAMED, RELEASE, proves, switching_refusals
from gateway.interlocks.measurement import (
    MEASURED,
    MEASURED_CROSS,
    MEASURED_REVERSAL,
    age_refusals,
    gain_refusals,
    suspect_refusals,
)
from gateway.interlocks.setup import setup_refusals
from gateway.interlocks.table import CROSS, CROSS_RELEASE, FITS, TABLE, largest_change, steepest

__all__ = [
    "APPROVED_AHEAD",
    "APPROVED_FOR",
    "MAX_JUMP",
    "MAX_SUSPECT_SHARE",
    "MIN_REPETITIONS",
    "ApprovedCurve",
    "MarkerCheck",
    "PushFacts",
    "Refusal",
    "age_refusals",
    "faults_of",
    "gain_refusals",
    "largest_change",
    "mean_readings",
    "other_cross_tables",
    "people_needed",
    "proves",
    "refusals",
    "refuse",
    "setup_refusals",
    "steepest",
    "suspect_refusals",
    "switching_refusals",
    "value_at",
    "warnings",
]


def refusals(facts: PushFacts) -> tuple[Refusal, ...]:
    """Every reason not to write now, none left out; empty means yes."""
    return tuple(refusal for rule in rules_for(facts) for refusal in rule(facts))


def rules_for(facts: PushFacts) -> tuple[Rule, ...]:
    """The rules that this purpose and moment must pass."""
    if facts.moment == "release":
        return (*RELEASE, *CROSS_RELEASE)
    if facts.purpose == "restore":
        return (*MACHINE, *NAMED, *FITS, *CROSS_RELEASE)
    if facts.purpose == "sign-proof":
        return (*MACHINE, *CONSENT, *TABLE, *CROSS)
    measured = {"axis": MEASURED, "cross": MEASURED_CROSS, "reversal": MEASURED_REVERSAL}[facts.table.kind]
    return (*MACHINE, *CONSENT, *TABLE, *CROSS, *measured, *APPROVED)
