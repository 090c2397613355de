"""The drift guard: is an approved curve still valid? From a short check of an axis, or from an inspected gear; pure."""

from __future__ import annotations

from gateway.guard.axis import Approved, Check, guard_axis
from gateway.guard.gear import Flanks, guard_gear, not_alike
from gateway.guard.verdict import Change, GuardVerdict

__all__ = ["Approved", "Change", "Check", "Flanks", "GuardVerdict", "guard_axis", "guard_gear", "not_alike"]
