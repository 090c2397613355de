"""The judge of a push: what acts and what is enabled in the control, watched at every change of it.

Written from the invariant alone: while a table's compensation is enabled, stored or acting, its memory holds the old
table or the new one, value for value; and the curve that acts is the old one, the new one or none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.types.tables import CompensationTable, LiveTable
from simulators.nck import Nck
from simulators.nck.fault_injection import TABLE_SWITCHES
from simulators.nck.machine.compensation import CecTable
from simulators.nck.machine.data import CEC_ENABLE, ENC_ENABLE

# Values are kept to a nanometre or 1e-7 deg: below half of that a value is the same.
LAST_PLACE = {"mm": 1e-6, "deg": 1e-7}
PER_UNIT = {"mm": 1000.0, "deg": 3600.0}


@dataclass(frozen=True)
class Content:
    """One table as memory holds it: points in mm or deg, MIN, MAX, STEP, modulo, and for CEC what else it is."""

    points: tuple[float, ...]
    shape: tuple[float, float, float, bool]
    rest: tuple[Any, ...] = ()

    @property
    def within(self) -> tuple[float, ...]:
        """The points that can act: those of its grid, whatever is left above; none where there is no grid."""
        minimum, maximum, step, _modulo = self.shape
        return self.points[: round((maximum - minimum) / step) + 1] if step > 0.0 else ()

    def same(self, other: Content, last_place: float) -> bool:
        """Value for value; NaN is never the same."""
        if (self.shape, self.rest) != (other.shape, other.rest) or len(self.points) != len(other.points):
            return False
        return all(abs(a - b) <= 0.5 * last_place for a, b in zip(self.points, other.points, strict=True))


def content_of(table: CompensationTable, memory: int, sign: int = 1) -> Content:
    """What memory of that many points must hold for a table; ``sign`` is that of the control's CEC."""
    if table.step <= 0.0:
        return Content((0.0,) * memory, (0.0, 0.0, 0.0, False))
    scale = PER_UNIT[table.output_unit]
    turn = sign if table.kind == "cross" else 1
    points = [turn * value / scale + 0.0 for value in table.deviations]
    shape = (table.minimum, table.maximum, table.step, table.modulo)
    rest: tuple[Any, ...] = ()
    if table.kind == "cross":
        rest = (table.input_axis, table.output_axis, table.direction, table.multiply_by, table.table_type)
    return Content((*points, *[0.0] * (memory - len(points))), shape, rest)


@dataclass
class Oracle:
    """Watches one table of one control. ``broken`` says every moment at which the invariant did not hold.

    ``foreign`` once somebody else has written the table: what it holds is no longer the push's doing alone. ``whims``
    are what the control did by itself; after one, an enabled wrong table is the push's doing only if the push
    switched it on. ``unseen`` while the control did something after the gateway's last look had begun: no gateway
    can know of that.
    """

    nck: Nck
    old: LiveTable
    new: CompensationTable
    sign: int = 1
    broken: list[str] = field(default_factory=list)
    looked: int = 0
    writes: int = 0
    foreign: bool = False
    unseen: bool = False
    backed_up: bool = False
    plc_lied: bool = False

    def __post_init__(self) -> None:
        count = len(self._table.points)
        self._old = content_of(self.old.table, count, self.sign)
        self._new = content_of(self.new, count, self.sign)
        self._last = LAST_PLACE[self.new.output_unit]
        self._axis = self.nck.core.axis(self.new.output_axis)
        core = self.nck.core
        for owner, name in ((core.data, "store"), (core.data, "activate"), (core, "refresh"), (core, "load_tables")):
            self._watch(owner, name)
        self._watch(core, "boot")
        core.on_injected_fault = self._whim
        writes = self.nck.variables.write

        def counted(plain: str, indices: Any, value: Any, level: int, **more: Any) -> Any:
            if plain.startswith("$"):
                self.writes += 1
            found = writes(plain, indices, value, level, **more)
            if plain in TABLE_SWITCHES and value and not self.foreign:
                self._check_switching_on()
            self.look(f"{plain}{list(indices)} = {value}")
            return found

        self.nck.variables.write = counted  # type: ignore[method-assign, assignment]

    @property
    def whims(self) -> list[str]:
        """What the control did by itself, in order."""
        return self.nck.core.injected_faults

    def _whim(self, kind: str) -> None:
        """What it changes before the back-up is made is the push's base from then on."""
        self.unseen = True
        self.foreign = self.foreign or (not self.backed_up and kind != "forget words")

    def _check_switching_on(self) -> None:
        """The gateway, or who acts for it, switches on: that is never a torn table that it could have compared."""
        changed = {"swap", "forget memory"} & set(self.whims)
        if self.whims and not changed and self.switched_on and not (self.is_old() or self.is_new()):
            self.broken.append(f"a torn table was switched on after {self.whims}: {self.content}")

    def _watch(self, owner: Any, name: str) -> None:
        real: Callable[..., Any] = getattr(owner, name)

        def watched(*args: Any, **more: Any) -> Any:
            found = real(*args, **more)
            self.look(name)
            return found

        setattr(owner, name, watched)

    # -- what is there -----------------------------------------------------------------------------

    @property
    def _table(self) -> Any:
        memory = self.nck.core.memory
        if self.new.kind == "cross":
            return memory.cec[self.new.index]
        return memory.eec[self.nck.core.axis(self.new.output_axis).index, self.new.index]

    @property
    def content(self) -> Content:
        """What memory holds now."""
        self.nck.core.memory.settle(self.nck.core.clock.now())
        table = self._table
        shape = (table.minimum, table.maximum, table.step, bool(table.is_modulo))
        rest: tuple[Any, ...] = ()
        if isinstance(table, CecTable):
            what = (table.input_axis, table.output_axis, table.direction, table.mult_by_table, table.kind)
            rest = what if table.step > 0 else ()
        return Content(tuple(table.points), shape, rest)

    def is_old(self) -> bool:
        """Whether memory holds the old table; where none was ever loaded, whether it is empty."""
        content = self.content
        empty = not any(self._old.points) and not any(content.within)
        return empty or content.same(self._old, self._last)

    def is_new(self) -> bool:
        """Whether memory holds the new one."""
        return self.content.same(self._new, self._last)

    @property
    def switched_on(self) -> bool:
        """The switch, as it is stored."""
        return self._enabled(self.nck.core.data.stored)

    @property
    def acts(self) -> bool:
        """The switch, as it acts."""
        return self._enabled(self.nck.core.data.effective)

    def _enabled(self, value: Callable[..., Any]) -> bool:
        if self.new.kind == "axis":
            return bool(value(ENC_ENABLE, self.new.index, self._axis.index))
        table = bool(value("$SN_CEC_TABLE_ENABLE", self.new.index))
        return table and bool(value(CEC_ENABLE, self._axis.index))

    @property
    def as_before(self) -> bool:
        """The old table with its switch as it was."""
        return self.is_old() and self.switched_on == self.old.enabled

    @property
    def as_wanted(self) -> bool:
        """The new table, on."""
        return self.is_new() and self.switched_on

    @property
    def off(self) -> bool:
        """Switched off, and so it acts."""
        return not self.switched_on and not self.acts

    # -- the invariant -----------------------------------------------------------------------------

    def look(self, why: str = "asked") -> None:
        """Judge this very moment."""
        self.looked += 1
        if self.foreign or self.whims:
            return
        # A control that lies about its switch goes on with the content it had: that is judged by what acts.
        on = self.switched_on or (self.acts and not self.nck.spec.lies_about_disable)
        if on and not (self.is_old() or self.is_new()):
            self.broken.append(f"{why}: enabled with neither the old nor the new table: {self.content}")
        if self.new.kind == "axis" and not self._curve_is_known():
            self.broken.append(f"{why}: what acts is neither the old nor the new table nor nothing")

    def _curve_is_known(self) -> bool:
        curve = self._axis.curve
        if curve is None:
            return True
        known = any(self._curve_is(curve, content) for content in (self._old, self._new))
        return known or not np.any(curve.values)

    def _curve_is(self, curve: Any, content: Content) -> bool:
        minimum, maximum, step, _modulo = content.shape
        if step <= 0.0:
            return False
        count = round((maximum - minimum) / step) + 1
        wanted = np.array(content.points[:count])
        if curve.values.shape != wanted.shape or abs(curve.step - step) > 1e-9:
            return False
        return bool(np.all(np.abs(curve.values - wanted) <= 0.5 * self._last))
