"""Buffered memory for compensation tables: what was written, left-overs and all, whether it acts or not."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from simulators.nck.machine.compensation import Curve, TableShape, curve_of
from simulators.nck.spec import NckRefusal


@dataclass(slots=True)
class EecTable:
    """``$AA_ENC_COMP`` of one axis and encoder."""

    points: list[float]
    minimum: float = 0.0
    maximum: float = 0.0
    step: float = 0.0
    is_modulo: bool = False

    def curve(self, uneven: str, unit: float = 1.0) -> Curve | None:
        """The curve these values mean; ``unit``: mm or deg in one of its units; ``uneven``: see `TableShape`."""
        return curve_of(self.points, shape_of(self, uneven), unit=unit, value_unit=unit)

    def convert(self, factor: float) -> None:
        """Change to another system of units."""
        self.points = [value * factor for value in self.points]
        self.minimum, self.maximum, self.step = (value * factor for value in (self.minimum, self.maximum, self.step))


@dataclass(slots=True)
class CecTable:
    """``$AN_CEC`` of one table; axes by machine name, empty when never set."""

    points: list[float]
    minimum: float = 0.0
    maximum: float = 0.0
    step: float = 0.0
    is_modulo: bool = False
    input_axis: str = ""
    output_axis: str = ""
    input_ncu: int = 1
    output_ncu: int = 1
    direction: int = 0
    mult_by_table: int = 0
    kind: int = 0

    def curve(
        self, ends: tuple[float, float] = (0.0, 0.0), unit: float = 1.0, value_unit: float = 1.0, uneven: str = "floor"
    ) -> Curve | None:
        """The curve these values mean; for TYPE 1 the two setting data ``ends`` are added to points 0 and 1."""
        points = list(self.points)
        if self.kind == 1:
            for place, extra in enumerate(ends[: len(points)]):
                points[place] += extra
        return curve_of(points, shape_of(self, uneven), unit=unit, value_unit=value_unit)


Table = EecTable | CecTable


def shape_of(table: Table, uneven: str) -> TableShape:
    """The grid of a table as the control takes it."""
    return TableShape(table.minimum, table.maximum, step=table.step, is_modulo=table.is_modulo, uneven=uneven)


@dataclass(slots=True)
class TableMemory:
    """All tables of the control: EEC by (axis index, encoder), CEC by table number.

    ``late``: writes that have been taken but do not show yet, each with the time from which it does.
    """

    eec: dict[tuple[int, int], EecTable] = field(default_factory=dict)
    cec: list[CecTable] = field(default_factory=list)
    single_precision: bool = False
    late: list[tuple[float, Callable[[], None]]] = field(default_factory=list)

    @classmethod
    def empty(
        cls, eec_points: dict[tuple[int, int], int], cec_points: list[int], single_precision: bool
    ) -> TableMemory:
        """Fresh memory, every point zero."""
        eec = {key: EecTable([0.0] * count) for key, count in eec_points.items()}
        return cls(eec, [CecTable([0.0] * count) for count in cec_points], single_precision)

    def copied(self) -> TableMemory:
        """The content as it stands."""
        return TableMemory(copy.deepcopy(self.eec), copy.deepcopy(self.cec), self.single_precision)

    def settle(self, now_s: float) -> None:
        """Let the writes show whose time has come."""
        if self.late:
            due = [write for time_s, write in self.late if time_s <= now_s]
            self.late = [entry for entry in self.late if entry[0] > now_s]
            for write in due:
                write()

    def convert(self, factor: float, rotary: list[bool]) -> None:
        """EEC tables of linear axes to another system of units (MD10260); CEC has MD32711 instead."""
        for (axis, _), table in self.eec.items():
            if not rotary[axis]:
                table.convert(factor)

    def shorten(self, uneven: str) -> None:
        """Put MAX of every table back to where its memory ends."""
        tables: list[Table] = [*self.eec.values(), *self.cec]
        for table in tables:
            last = shape_of(table, uneven).last_point(len(table.points))
            if last is not None and table.maximum > table.minimum + table.step * (last + 1 - 1e-9):
                table.maximum = table.minimum + table.step * last

    def saved(self) -> dict[str, Any]:
        """The content as plain values, for static memory."""
        eec = [[*key, asdict(table)] for key, table in self.eec.items()]
        return {"eec": eec, "cec": [asdict(table) for table in self.cec]}

    def restore(self, content: dict[str, Any]) -> None:
        """Take what `saved` gave."""
        self.eec = {(axis, encoder): EecTable(**table) for axis, encoder, table in content["eec"]}
        self.cec = [CecTable(**table) for table in content["cec"]]

    def kept(self, value: float) -> float:
        """A value as the memory keeps it."""
        return float(np.float32(value)) if self.single_precision else value

    def cec_table(self, number: int) -> CecTable:
        """A CEC table. Raises NckRefusal 17020 when there is none of that number."""
        if not 0 <= number < len(self.cec):
            raise NckRefusal(17020, f"illegal array index 1: table {number} of {len(self.cec)}")
        return self.cec[number]

    @staticmethod
    def place(points: list[float], number: int) -> int:
        """Check a point's number against the reserved memory. Raises NckRefusal 17030."""
        if not 0 <= number < len(points):
            raise NckRefusal(17030, f"illegal array index 2: point {number} of {len(points)} reserved")
        return number
