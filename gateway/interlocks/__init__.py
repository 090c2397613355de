"""May we write? Every reason against it at once, from facts read before; pure.

Limits: |value| 0.200 mm / 0.050 deg; slope 1.0 um/mm / 10 arcsec per deg; change against the live table
0.120 mm / 0.015 deg; zero at the reference position within 0.1 um / arcsec; old and new agree within
1 um / 1 arcsec where the axis stands. A measurement older than 24 h or taken more than 2 K away is stale.
"""

from __future__ import annotations

from gateway.interlocks.facts import MAX_JUMP, PushFacts, Refusal, Rule, value_at
from gateway.interlocks.machine import CONSENT, MACHINE, NAMED, RELEASE
from gateway.interlocks.measured import MEASURED
from gateway.interlocks.table import FITS, TABLE

__all__ = ["MAX_JUMP", "PushFacts", "Refusal", "refusals", "value_at"]


def refusals(facts: PushFacts) -> tuple[Refusal, ...]:
    """Every reason not to write now, none left out; empty means yes."""
    return tuple(refusal for rule in rules_for(facts) for refusal in rule(facts))


def rules_for(facts: PushFacts) -> tuple[Rule, ...]:
    """The rules that this purpose and moment must pass."""
    if facts.moment == "release":
        return RELEASE
    if facts.purpose == "restore":
        return (*MACHINE, *NAMED, *FITS)
    if facts.purpose == "sign-proof":
        return (*MACHINE, *CONSENT, *TABLE)
    return (*MACHINE, *CONSENT, *TABLE, *MEASURED)
