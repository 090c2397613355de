"""Compensation tables as deviations, and what of them is live."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.terms import TableKind
from drivers.types.values import Approach, FloatArray, Sense
from drivers.units import AxisUnit, DeviationUnit, deviation_scale, deviation_unit


@dataclass(frozen=True, slots=True)
class CompensationTable:
    """A compensation table as *deviations* d = -q that it cancels, in um (linear) or arcsec (rotary).

    ``minimum``, ``maximum``, ``step`` are in the input axis' unit; ``deviations`` has k+1 values for
    k = (maximum-minimum)/step, in the deviation unit of the *output* axis. ``kind`` "axis": an axis' own table (input =
    output); "cross": of one axis over another; "reversal": the constant reversal B of an axis, one value, no grid
    (step 0). ``index`` is the encoder of an axis' own and the number of a cross table. ``direction`` 0 both, +1/-1 one
    travel direction of the input axis (cross tables only). ``places`` are points at free positions, rising, () where
    the step is equal; ``reverse`` is the curve of the negative direction of travel, () where ``deviations`` holds for
    both. A control takes what its `TableAbility` says and refuses the rest.
    """

    kind: TableKind
    input_axis: str
    output_axis: str
    minimum: float
    maximum: float
    step: float
    deviations: tuple[float, ...]
    modulo: bool = False
    index: int = 0
    input_unit: AxisUnit = "mm"
    output_unit: AxisUnit = "mm"
    direction: Literal[-1, 0, 1] = 0
    multiply_by: int = 0
    table_type: int = 0
    places: tuple[float, ...] = ()
    reverse: tuple[float, ...] = ()

    @property
    def deviation_unit(self) -> DeviationUnit:
        """Unit of ``deviations``."""
        return deviation_unit(self.output_unit)

    @property
    def positions(self) -> FloatArray:
        """Interpolation points in the input axis' unit, shape (k+1,)."""
        if self.places:
            return np.asarray(self.places, dtype=np.float64)
        return self.minimum + self.step * np.arange(len(self.deviations), dtype=np.float64)

    @property
    def name(self) -> str:
        """Short name, output first: X(X), C(Z)."""
        return f"{self.output_axis}({self.input_axis})"

    @property
    def called(self) -> str:
        """As people call it: the axis table by its axis, a cross table by both: X1, C1-reversal, X1(Z1)."""
        own = {"axis": self.output_axis, "reversal": f"{self.output_axis}-reversal"}
        return own.get(self.kind, self.name)

    @property
    def is_plain(self) -> bool:
        """Whether points of equal step and one curve for both directions are all there is to it."""
        return not self.places and not self.reverse

    def at(self, positions: FloatArray, approach: Approach = 1) -> FloatArray:
        """Deviation at input positions, shape as given: linear between points, clamped or modulo outside.

        ``approach`` chooses the curve where the table has one for each direction.
        """
        curve = self.reverse if approach < 0 and self.reverse else self.deviations
        values = np.asarray(curve, dtype=np.float64)
        wanted = np.asarray(positions, dtype=np.float64)
        if self.modulo:
            wanted = self.minimum + np.mod(wanted - self.minimum, self.maximum - self.minimum)
        return np.interp(wanted, self.positions, values)


def factors_of(tables: Iterable[CompensationTable]) -> frozenset[int]:
    """Numbers of tables that take part in a product: one that multiplies by another, and that other one.

    What a factor does by itself besides is not public, so none of them counts as a table of its own.
    """
    multiplied = [one for one in tables if one.multiply_by]
    return frozenset(number for one in multiplied for number in (one.index, one.multiply_by - 1))


def reversal_of(axis: str, unit: AxisUnit, value: float, encoder: int = 0) -> CompensationTable:
    """The constant reversal of an axis that cancels B = ``value``, um or arcsec."""
    return CompensationTable(
        "reversal",
        axis,
        output_axis=axis,
        minimum=0.0,
        maximum=0.0,
        step=0.0,
        deviations=(value,),
        index=encoder,
        input_unit=unit,
        output_unit=unit,
    )


@dataclass(frozen=True, slots=True)
class LiveTable:
    """A table found in the controller with its switch; ``enabled`` is true where every switch of it is on."""

    table: CompensationTable
    enabled: bool


@dataclass(frozen=True, slots=True)
class TemperatureShift:
    """What temperature compensation is worth on an axis: ``constant`` + ``slope`` (position - ``reference``).

    In the axis unit, and per unit. Only the parts that the control has switched on, the slope as far as it lets it
    act; all 0 where nothing acts.
    """

    constant: float = 0.0
    slope: float = 0.0
    reference: float = 0.0

    def at(self, position: float) -> float:
        """Its worth at a position, in the axis unit."""
        return self.constant + self.slope * (position - self.reference)


@dataclass(frozen=True, slots=True)
class LiveSet:
    """Everything that compensates one axis right now: tables, switches, backlash; and the text as read.

    ``backlash`` is the constant reversal the control takes up, in the axis unit, positive for an axis that lags behind
    its encoder (B < 0); `reversal` is the same as a deviation. ``native`` is the loadable back-up
    exactly as the controller wrote it; ``digest`` is the same as long as the tables are. ``own`` is the axis' own
    table; that of an axis that never had one is all zero and disabled. ``cross`` are the cross tables whose output is
    this axis, ``others`` those of other outputs, as far as they are known. Cross tables are deviations by the proof
    that was given with the question or order, in its ``sense``; without a proof they hold the stored values.
    ``temperature`` is what else moves the axis, read beside the tables and no part of the digest; None where the road
    cannot tell. ``waits``: ``own`` is off until the control's next start puts it to work; another acts until then.
    """

    axis: str
    own: LiveTable
    cross: tuple[LiveTable, ...]
    backlash: float
    native: str
    digest: str
    others: tuple[LiveTable, ...] = ()
    sense: Sense = 1
    temperature: TemperatureShift | None = None
    waits: bool = False

    @property
    def reversal(self) -> LiveTable:
        """The constant reversal as a table of one value: the deviation B that it cancels; on where it is not 0."""
        unit, encoder = self.own.table.output_unit, self.own.table.index
        value = round(-self.backlash * deviation_scale(unit), 9) + 0.0
        return LiveTable(reversal_of(self.axis, unit, value, encoder), enabled=value != 0.0)
