"""The kinds of tables that an 840D holds, whichever road leads to it."""

from __future__ import annotations

from drivers.types.abilities import TableAbility

HELD = (TableAbility("axis"), TableAbility("cross", directions="tables"))
"""Points of equal step, as many as the machine data reserve; a direction of travel has a cross table of its own."""
REVERSAL = TableAbility("reversal")
"""MD32450: one value for an axis, on the roads that can write it."""
