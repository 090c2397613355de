"""Buffered memory for compensation tables: what was written, left-overs and all, whether it acts or not."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np

from simulators.nck.compensation import Curve, curve_of
from simulators.nck.spec import NckRefusal


@dataclass(slots=True)
class EecTable:
    """``$AA_ENC_COMP`` of one axis and encoder."""

    points: list[float]
    minimum: float = 0.0
    maximum: float = 0.0
    step: float = 0.0
    is_modulo: bool = False

    def curve(self) -> Curve | None:
        """The curve these values mean."""
        return curve_of(self.points, self.minimum, self.maximum, self.step, self.is_modulo)


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

    def curve(self, first: float = 0.0, second: float = 0.0) -> Curve | None:
        """The curve these values mean; for TYPE 1 the two setting data are added to points 0 and 1."""
        points = list(self.points)
        if self.kind == 1:
            for place, extra in enumerate((first, second)[: len(points)]):
                points[place] += extra
        return curve_of(points, self.minimum, self.maximum, self.step, self.is_modulo)


@dataclass(slots=True)
class TableMemory:
    """All tables of the control: EEC by (axis index, encoder), CEC by table number."""

    eec: dict[tuple[int, int], EecTable] = field(default_factory=dict)
    cec: list[CecTable] = field(default_factory=list)
    single_precision: bool = False

    @classmethod
    def empty(
        cls, eec_points: dict[tuple[int, int], int], cec_points: list[int], single_precision: bool
    ) -> TableMemory:
        """Fresh memory, every point zero."""
        eec = {key: EecTable([0.0] * count) for key, count in eec_points.items()}
        return cls(eec, [CecTable([0.0] * count) for count in cec_points], single_precision)

    def copied(self) -> TableMemory:
        """The content as it stands."""
        return copy.deepcopy(self)

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
