"""Rules on switching a table off: the right machine, the right axis, and no program at work. Pure.

What else must hold before a write is not asked: off is where every doubt leads, and alarms, modes or a missing
reference must not keep a table on. What the control itself asks for (release, standstill) it refuses by itself.
"""

from __future__ import annotations

from drivers.types.identity import MachineIdentity
from gateway.interlocks.facts import Refusal, no


def switching_refusals(
    expected: MachineIdentity, found: MachineIdentity, axis: str, axes: tuple[str, ...], *, in_reset: bool
) -> tuple[Refusal, ...]:
    """Every reason not to switch off now, by catalogue code (E-INT-MACHINE, E-INT-AXIS, E-INT-CHANNEL)."""
    reasons: list[Refusal] = []
    different = expected.differences(found)
    if different:
        wanted = ", ".join(str(getattr(expected, name)) for name in different)
        told = ", ".join(str(getattr(found, name)) for name in different)
        reasons += no("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=told)
    if axis not in axes:
        reasons += no("E-INT-AXIS", axis=axis, known=", ".join(sorted(axes)))
    if not in_reset:
        reasons += no("E-INT-CHANNEL", found="active")
    return tuple(reasons)
