"""Machine and setting data: their table, stored and effective values, and who may write them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from simulators.nck.spec import NckRefusal, NckSpec

Effect = Literal["now", "newconf", "reset", "power_on", "never"]
Datum = bool | int | float | str
Key = tuple[str, tuple[int, ...]]

METRIC = 1


@dataclass(frozen=True, slots=True)
class DataSpec:
    """One datum. ``shape``: "" single, "n" array, "a" per axis, "na" array per axis; ``count`` for the n."""

    shape: str
    kind: Literal["bool", "int", "real", "text"]
    effect: Effect
    default: Datum = 0
    low: float = -math.inf
    high: float = math.inf
    count: int = 1
    level: int = 2


def _real(shape: str, default: float = 0.0, low: float = -math.inf, high: float = math.inf) -> DataSpec:
    return DataSpec(shape, "real", "newconf", default, low, high, 2 if shape == "na" else 1)


def _setting(shape: str, kind: Literal["bool", "real"], default: float = 0.0) -> DataSpec:
    return DataSpec(shape, kind, "now", default, level=7)


ENC_ENABLE = "$MA_ENC_COMP_ENABLE"
CEC_ENABLE = "$MA_CEC_ENABLE"
EEC_POINTS = "$MA_MM_ENC_COMP_MAX_POINTS"
CEC_POINTS = "$MN_MM_CEC_MAX_POINTS"

DATA: dict[str, DataSpec] = {
    ENC_ENABLE: DataSpec("na", "bool", "newconf", False, count=2),
    CEC_ENABLE: DataSpec("a", "bool", "newconf", False),
    "$MA_BACKLASH": _real("na"),
    "$MA_BACKLASH_FACTOR": DataSpec("na", "real", "newconf", 1.0, 0.01, 100.0, 6),
    "$MA_BACKLASH_MODE": DataSpec("a", "int", "newconf", 0, 0, 3),
    "$MA_CEC_MAX_SUM": _real("a", 1.0, 0.0, 10.0),
    "$MA_CEC_MAX_VELO": _real("a", 10.0, 0.0, 100.0),
    "$MA_CEC_SCALING_SYSTEM_METRIC": DataSpec("a", "bool", "power_on", True),
    "$MA_TEMP_COMP_TYPE": DataSpec("a", "int", "newconf", 0, 0, 7),
    "$MA_COMP_ADD_VELO_FACTOR": _real("a", 0.01, 0.0, 0.1),
    "$MA_MAX_AX_VELO": _real("a", 10000.0, 1e-6),
    "$MA_POS_LIMIT_PLUS": _real("a", 1e8),
    "$MA_POS_LIMIT_MINUS": _real("a", -1e8),
    "$MA_REFP_SET_POS": DataSpec("na", "real", "newconf", 0.0, count=4),
    "$MA_IS_ROT_AX": DataSpec("a", "bool", "never", False),
    "$MA_ROT_IS_MODULO": DataSpec("a", "bool", "never", False),
    EEC_POINTS: DataSpec("na", "int", "power_on", 0, 0, 5000, 2),
    CEC_POINTS: DataSpec("n", "int", "power_on", 0, 0, 2000),
    "$MN_SCALING_SYSTEM_IS_METRIC": DataSpec("", "bool", "never", True),
    "$MN_AXCONF_MACHAX_NAME_TAB": DataSpec("n", "text", "never", ""),
    "$MN_LEN_PROTOCOL_FILE": DataSpec("", "int", "now", 1, 1, 100000),
    "$MC_REFP_NC_START_LOCK": DataSpec("", "int", "reset", 1, 0, 2),
    "$SN_CEC_TABLE_ENABLE": _setting("n", "bool"),
    "$SN_CEC_TABLE_WEIGHT": _setting("n", "real", 1.0),
    "$SN_CEC_0": _setting("n", "real"),
    "$SN_CEC_1": _setting("n", "real"),
    "$SA_TEMP_COMP_ABS_VALUE": _setting("a", "real"),
    "$SA_TEMP_COMP_SLOPE": _setting("a", "real"),
    "$SA_TEMP_COMP_REF_POSITION": _setting("a", "real"),
}


def checked(spec: DataSpec, name: str, value: Datum) -> Datum:
    """The value in the datum's type. Raises NckRefusal 12150 (type), 17080, 17090 (limits)."""
    if spec.kind == "text" or isinstance(value, str):
        raise NckRefusal(12150, f"{name}: operation does not fit the data type")
    if isinstance(value, float) and not math.isfinite(value):
        raise NckRefusal(12160, f"{name}: value lies beyond the value range")
    if value < spec.low:
        raise NckRefusal(17080, f"{name}: value below the lower limit {spec.low:g}")
    if value > spec.high:
        raise NckRefusal(17090, f"{name}: value above the upper limit {spec.high:g}")
    if spec.kind == "bool":
        if value not in (0, 1):
            raise NckRefusal(12160, f"{name}: value lies beyond the value range")
        return bool(value)
    return round(value) if spec.kind == "int" else float(value)


class MachineData:
    """Stored and effective values; index tuples are (n,), (axis,) or (n, axis) with axes counted from 0."""

    def __init__(self, spec: NckSpec) -> None:
        self._axes = len(spec.axes)
        self._counts = {name: datum.count for name, datum in DATA.items()}
        tables = len(spec.cec_points)
        for name in (CEC_POINTS, *(name for name in DATA if name.startswith("$SN_CEC"))):
            self._counts[name] = tables
        self._counts["$MN_AXCONF_MACHAX_NAME_TAB"] = self._axes
        self._stored: dict[Key, Datum] = {}
        for name, datum in DATA.items():
            for index in self._indices(name):
                self._stored[name, index] = datum.default
        self._preset(spec)
        self._effective = dict(self._stored)
        self.booted = dict(self._stored)

    def _indices(self, name: str) -> list[tuple[int, ...]]:
        shape, count = DATA[name].shape, self._counts[name]
        ranges = [range(count if sign == "n" else self._axes) for sign in shape]
        found: list[tuple[int, ...]] = [()]
        for values in ranges:
            found = [(*front, value) for front in found for value in values]
        return found

    def _preset(self, spec: NckSpec) -> None:
        for place, axis in enumerate(spec.axes):
            self._stored["$MN_AXCONF_MACHAX_NAME_TAB", (place,)] = axis.name
            self._stored["$MA_MAX_AX_VELO", (place,)] = axis.max_velocity
            self._stored["$MA_IS_ROT_AX", (place,)] = axis.rotary
            self._stored["$MA_ROT_IS_MODULO", (place,)] = axis.modulo
            self._stored["$MA_POS_LIMIT_MINUS", (place,)] = float(axis.travel[0])
            self._stored["$MA_POS_LIMIT_PLUS", (place,)] = float(axis.travel[1])
            self._stored["$MA_REFP_SET_POS", (0, place)] = axis.reference
            for encoder, points in enumerate(axis.eec_points):
                self._stored[EEC_POINTS, (encoder, place)] = points
        for table, points in enumerate(spec.cec_points):
            self._stored[CEC_POINTS, (table,)] = points
        self._stored["$MN_SCALING_SYSTEM_IS_METRIC", ()] = spec.unit_system == "metric"
        self._stored["$MN_LEN_PROTOCOL_FILE", ()] = max(spec.files_max_bytes // 1024, 1)

    def known(self, name: str) -> bool:
        """Whether there is such a datum."""
        return name in DATA

    def stored(self, name: str, *index: int) -> Datum:
        """The value in memory. Raises NckRefusal 17020 for an index out of range."""
        found = self._stored.get((name, index))
        if found is None:
            raise NckRefusal(17020, f"{name}: illegal array index {index}")
        return found

    def effective(self, name: str, *index: int) -> float:
        """The value that acts, as a number."""
        found = self._effective[name, index]
        return 0.0 if isinstance(found, str) else float(found)

    def store(self, name: str, index: tuple[int, ...], value: Datum) -> None:
        """Put a checked value; data of the class "now" act at once."""
        self._stored[name, index] = value
        if DATA[name].effect == "now":
            self._effective[name, index] = value

    def activate(self, *effects: Effect, keep: frozenset[Key] = frozenset()) -> None:
        """Make stored values of these classes effective, but those in ``keep``."""
        for key, value in self._stored.items():
            if DATA[key[0]].effect in effects and key not in keep:
                self._effective[key] = value

    def memory_changed(self) -> bool:
        """Whether a datum that lays out buffered memory differs from the last boot."""
        return any(
            value != self.booted[key] for key, value in self._stored.items() if key[0] in (EEC_POINTS, CEC_POINTS)
        )

    def boot(self) -> None:
        """Power on: everything stored acts."""
        self.booted = dict(self._stored)
        self._effective = dict(self._stored)

    def restore_layout(self, layout: dict[Key, Datum]) -> None:
        """Put the memory-laying data back to another boot's."""
        for key, value in layout.items():
            if key[0] in (EEC_POINTS, CEC_POINTS):
                self._stored[key] = value
