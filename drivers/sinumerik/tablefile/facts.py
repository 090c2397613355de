"""What machine data of a file say of its machine: names, units, encoders and memory of the axes, size of CEC tables.

MD10000 machine axis names (an empty name: no axis of that number), MD30200 encoders of an axis, MD30300 rotary, MD32700
which measuring system's table acts, MD38000 and MD18342 reserved points. A file may hold all of them, some or none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal

from drivers.sinumerik.tablefile.archive import Listing
from drivers.sinumerik.tablefile.grammar import Assignment
from drivers.units import AxisUnit

NAMES, ROTARY, ENCODERS = "$MN_AXCONF_MACHAX_NAME_TAB", "$MA_IS_ROT_AX", "$MA_NUM_ENCS"
ENABLED, RESERVED, CROSS = "$MA_ENC_COMP_ENABLE", "$MA_MM_ENC_COMP_MAX_POINTS", "$MN_MM_CEC_MAX_POINTS"


@dataclass(frozen=True, slots=True)
class Facts:
    """By axis as the file names it (AX1 or X1); ``names`` gives the machine axis name of AXn.

    ``reserved`` by (encoder index, axis), ``cross`` by table number; what is not in the file is not in here.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, AxisUnit] = field(default_factory=dict)
    acting: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    reserved: Mapping[tuple[int, str], int] = field(default_factory=dict)
    cross: Mapping[int, int] = field(default_factory=dict)


def facts_of(listings: Iterable[Listing]) -> Facts:
    """What the machine data of these texts say; the last word counts, as in the control."""
    items = [item for found in listings for item in found.assignments]
    names = {f"AX{item.numbers[0] + 1}": str(item.value) for item in items if item.name == NAMES and item.value}
    rotary = {item.axis: item.value for item in items if item.name == ROTARY}
    units: dict[str, AxisUnit] = {axis: "deg" if value else "mm" for axis, value in rotary.items()}
    units |= {names[axis]: unit for axis, unit in units.items() if axis in names}
    return Facts(
        names,
        units,
        acting=_acting(items),
        reserved={(item.numbers[0], item.axis): _whole(item) for item in items if item.name == RESERVED},
        cross={item.numbers[0]: _whole(item) for item in items if item.name == CROSS},
    )


def _acting(items: Iterable[Assignment]) -> dict[str, tuple[int, ...]]:
    """The encoder indices whose table is switched on by MD32700, for every axis of which the file says both."""
    on: dict[str, dict[int, bool]] = {}
    count = {item.axis: _whole(item) for item in items if item.name == ENCODERS}
    for item in items:
        if item.name == ENABLED:
            on.setdefault(item.axis, {})[item.numbers[0]] = bool(item.value)
    return {
        axis: tuple(encoder for encoder in sorted(switched) if switched[encoder] and encoder < count.get(axis, 2))
        for axis, switched in on.items()
    }


def _whole(item: Assignment) -> int:
    return int(item.value) if isinstance(item.value, Decimal) else 0
