"""May we write? Every reason against it at once, from facts read before; pure.

`drivers.limits` holds the limits of a table, `gateway.interlocks.limits` the others; what only warns asks for a second
person.
"""

from __future__ import annotations

from gateway.interlocks.approval import APPROVED, needed, warnings
from gateway.interlocks.cross import CROSS, CROSS_RELEASE
from gateway.interlocks.facts import MAX_JUMP, PushFacts, Refusal, Rule, value_at
from gateway.interlocks.machine import CONSENT, MACHINE, NAMED, RELEASE, proves
from gateway.interlocks.measured import MEASURED, MEASURED_CROSS, MEASURED_REVERSAL, aged, crowded, not_worth_it
from gateway.interlocks.table import FITS, TABLE

__all__ = [
    "MAX_JUMP",
    "PushFacts",
    "Refusal",
    "aged",
    "crowded",
    "needed",
    "not_worth_it",
    "proves",
    "refusals",
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
