"""The controller that is judged, who acts at its machine, and how a broken rule is told."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from drivers.errors import TrueflankError
from drivers.ports.controller import Controller
from drivers.ports.devices import Tell
from drivers.types.orders import DisableOrder, PushOrder, TableQuestion
from drivers.types.tables import CompensationTable, LiveSet, LiveTable

T = TypeVar("T")


Moment = Literal["read", "start", "release", "restart"]
"""When a person acts: tables are read, the load begins, the loaded table is released, the control takes it over."""


Act = Callable[[Moment, Coroutine[Any, Any, Any]], Awaitable[Any]]


class ContractBroken(TrueflankError):
    """A controller does not do what the port promises; rule and finding are in the fields."""


def _unheard(_code: str, /, **_fields: object) -> None:
    """Nobody needs to be told."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A controller to be judged, open, its machine ready and without a table in the place of ``table``.

    ``table`` is one it can hold, at its resolution, zero at ``agreeing_position``; ``letter`` and ``rotary`` are those
    of its input axis. ``person`` runs a piece of the talk while somebody does at the machine what that moment asks: at
    "read" and "start" where a program is selected, start it; ``tell`` hears what the driver says of that.
    ``allowed`` (um or arcsec) is the control's resolution.
    Timeouts in s of the controller's clock;
    """

    controller: Controller
    table: CompensationTable
    letter: str
    rotary: bool
    agreeing_position: float
    person: Act
    tell: Tell = _unheard
    allowed: float = 0.001
    timeout_s: float = 200.0

    async def live(self, axis: str) -> LiveSet:
        """The live tables of an axis by the port's own call."""
        table = self.table
        question = TableQuestion(
            axis=axis,
            letter=self.letter,
            unit=table.output_unit,
            rotary=self.rotary,
            encoder=table.index if table.kind == "axis" else 0,
            start_s=self.timeout_s,
        )
        found: LiveSet = await self.person("read", self.controller.live_tables(question, self.tell))
        return found

    @property
    def place(self) -> DisableOrder:
        """The table's place, for looking at its switch."""
        table = self.table
        return DisableOrder(1, table.kind, table.output_axis, table.index)

    def order(self, number: int, table: CompensationTable, *, enable: bool = True, restore: bool = False) -> PushOrder:
        """An order for a table as it is stored, without any proof."""
        purpose: Literal["sign-proof", "restore"] = "restore" if restore else "sign-proof"
        return PushOrder(
            number,
            table,
            letter=self.letter,
            rotary=self.rotary,
            enable=enable,
            agreeing_position=self.agreeing_position,
            purpose=purpose,
        )


def demand(rule: str, held: bool, found: object) -> None:
    if not held:
        raise ContractBroken("E-PORT-CONTRACT", "contract", rule=rule, found=found)


def held_in(live: LiveSet, table: CompensationTable) -> LiveTable | None:
    if table.kind == "axis":
        return live.own
    return next((one for one in live.cross if one.table.index == table.index), None)


def same_tables(subject: Subject, one: CompensationTable, two: CompensationTable) -> bool:
    """Whether two tables have one place, one grid and values within the control's resolution."""
    grids = [(t.kind, t.input_axis, t.output_axis, t.index, len(t.deviations), len(t.reverse)) for t in (one, two)]
    if grids[0] != grids[1] or any(abs(a - b) > 1e-6 for a, b in zip(one.positions, two.positions, strict=True)):
        return False
    pairs = (*zip(one.deviations, two.deviations, strict=True), *zip(one.reverse, two.reverse, strict=True))
    return all(abs(a - b) <= subject.allowed for a, b in pairs)


def holds_nothing(table: LiveTable | None) -> bool:
    return table is None or not table.enabled or not any((*table.table.deviations, *table.table.reverse))
