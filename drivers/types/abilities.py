"""What a road to a control can do and hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from drivers.message import Message
from drivers.terms import TableKind


@dataclass(frozen=True, slots=True)
class TableAbility:
    """One kind of table that a control holds.

    ``grid``: points of equal step, or at free positions. ``most_points`` of one table; None where the control's own
    memory says (`Controller.table_limits`). ``directions``: how the two directions of travel differ: not at all, by a
    table for each, or by a second column of the same table.
    """

    kind: TableKind
    grid: Literal["equal-step", "free"] = "equal-step"
    directions: Literal["none", "tables", "columns"] = "none"
    most_points: int | None = None


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What the road to a controller can do; whoever works with it asks before it begins.

    ``stops``: runs motion programs of ours (stops, hand-shake, saved tables); without them the tables are read
    directly and the axis is moved by the operator. ``tables`` are the kinds it holds. ``switched``: how a table is
    switched on and off: at a stop of such a program, by itself, or only by a restart of the control. ``marker``: the
    controller keeps the number and state of the transaction where it outlives the gateway's PC. ``consent`` is how
    the person at the machine agrees. ``grinding``: grinds a test part. ``alarms``: its state names alarms.
    ``acting_tables``: the tables that act can be read; else only what was loaded, and the acting value.
    ``cross_shown``: whether the acting value of cross tables counts as their deviations do, or nobody knows which way.
    ``off_anyhow``: a table can be switched off while a program is at work or an axis moves, a person confirming.
    ``self_test``: it tries the words of its programs (`drivers.programs.SelfTests`); a push asks for it.
    ``together``: one start loads all tables of a batch and one switches them; else the person agrees table by table.
    ``one_start``: the start that loads them leads to their switching too, once they are released.
    ``unprotected`` says why others on the network could read or change what passes; None where they cannot.
    """

    stops: bool
    tables: tuple[TableAbility, ...]
    switched: Literal["at-stop", "by-itself", "by-restart"]
    marker: bool
    consent: Literal["start", "panel", "restart"]
    grinding: bool = False
    alarms: bool = True
    acting_tables: bool = True
    cross_shown: Literal["as-is", "either-way"] = "as-is"
    self_test: bool = False
    together: bool = False
    one_start: bool = False
    off_anyhow: bool = False
    unprotected: Message | None = None

    @property
    def switches_now(self) -> bool:
        """Whether a table can be switched while the control runs."""
        return self.switched != "by-restart"

    @property
    def proves_signs(self) -> bool:
        """Whether a sign can be proved: by switching a table, or by the same stops before and after a restart."""
        return self.switches_now or self.stops

    def shown(self, kind: TableKind, value: float) -> tuple[float, ...]:
        """What the control may show where tables of a kind add up to a value; the ways keep their order."""
        return (value, -value) if kind == "cross" and self.cross_shown == "either-way" else (value,)

    def table(self, kind: TableKind) -> TableAbility | None:
        """What the control can do with tables of a kind; None where it has none."""
        return next((one for one in self.tables if one.kind == kind), None)


@dataclass(frozen=True, slots=True)
class Marker:
    """What the controller itself remembers of the last push: transaction number (0 none) and its state.

    ``head`` is what it was told of the audit log's end, 64 bits; None where the road carries none. It is no part of
    what makes two markers the same.
    """

    transaction: int
    state: Literal["none", "in-progress", "committed", "held"]
    head: int | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class TableLimits:
    """What the controller can hold for one axis or table: reserved points and the resolution of a value.

    ``resolution`` and ``max_value`` in the output axis' unit; ``max_sum`` (cross tables only) is the largest sum of
    all tables of that axis the control lets through, in the same unit; None where it cannot be read.
    """

    reserved_points: int
    resolution: float
    max_value: float
    max_sum: float | None = None
