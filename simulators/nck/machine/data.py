"""Machine data, setting data and alarms: names, kinds, limits, when a change acts, stored and effective values.

Numbers and meanings: MD texts of the vendor's data lists. Limits, defaults, activation classes and protection
levels are recalled values where the lists are not public.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from simulators.nck.spec import NckRefusal, NckSpec

Effect = Literal["now", "newconf", "reset", "power_on", "never"]
Datum = bool | int | float | str

INCH_MM = 25.4


@dataclass(frozen=True, slots=True)
class DataSpec:
    """One datum. ``shape``: "" single, "n" array, "a" per axis, "na" array per axis; ``count`` for the n.

    ``length``: for a linear axis the number is a length (or a velocity) in the basic system of units.
    """

    shape: str
    kind: Literal["bool", "int", "real", "text"]
    effect: Effect
    default: Datum = 0
    low: float = -math.inf
    high: float = math.inf
    count: int = 1
    level: int = 2
    length: bool = False


def _real(shape: str, default: float = 0.0, low: float = -math.inf, high: float = math.inf) -> DataSpec:
    return DataSpec(shape, "real", "newconf", default, low=low, high=high, count=2 if shape == "na" else 1)


def _length(shape: str, default: float = 0.0, low: float = -math.inf, high: float = math.inf) -> DataSpec:
    return replace(_real(shape, default, low, high), length=True)


def _setting(shape: str, kind: Literal["bool", "real"], default: float = 0.0) -> DataSpec:
    return DataSpec(shape, kind, "now", default, level=7)


BACKLASH = "$MA_BACKLASH"
ENC_ENABLE = "$MA_ENC_COMP_ENABLE"
CEC_ENABLE = "$MA_CEC_ENABLE"
EEC_POINTS = "$MA_MM_ENC_COMP_MAX_POINTS"
QEC_POINTS = "$MA_MM_QEC_MAX_POINTS"
CEC_POINTS = "$MN_MM_CEC_MAX_POINTS"
SAVED_SETTINGS = "$MN_PROG_SD_RESET_SAVE_TAB"
IS_METRIC = "$MN_SCALING_SYSTEM_IS_METRIC"
ENC_STATE = "$MA_ENC_REFP_STATE"
LAYOUT = (EEC_POINTS, QEC_POINTS, CEC_POINTS)
"""Data that lay out buffered memory: a change loses what is in it at the next boot (MD38000, 38010, 18342)."""
SCALING = (IS_METRIC, "$MN_CONVERT_SCALING_SYSTEM")

DATA: dict[str, DataSpec] = {
    ENC_ENABLE: DataSpec("na", "bool", "newconf", False, count=2),
    CEC_ENABLE: DataSpec("a", "bool", "newconf", False),
    BACKLASH: _length("na"),
    "$MA_BACKLASH_FACTOR": DataSpec("na", "real", "newconf", 1.0, low=0.01, high=100.0, count=6),
    "$MA_BACKLASH_MODE": DataSpec("na", "int", "newconf", 0, low=0, high=3, count=2),
    "$MA_BACKLASH_DYN": _length("na"),
    "$MA_BACKLASH_DYN_MAX_VELO": _real("a", 1.0, 0.0, 100.0),
    "$MA_ENC_CHANGE_TOL": _length("a", 0.1, 0.0),
    "$MA_NUM_ENCS": DataSpec("a", "int", "power_on", 2, low=0, high=2),
    ENC_STATE: DataSpec("na", "int", "now", 0, low=0, high=2, count=2, level=4),
    "$MA_REFP_CYCLE_NR": DataSpec("a", "int", "newconf", 1, low=-1, high=31),
    "$MA_CEC_MAX_SUM": _length("a", 1.0, 0.0, 10.0),
    "$MA_CEC_MAX_VELO": _real("a", 10.0, 0.0, 100.0),
    "$MA_CEC_SCALING_SYSTEM_METRIC": DataSpec("a", "bool", "power_on", True),
    "$MA_TEMP_COMP_TYPE": DataSpec("a", "int", "newconf", 0, low=0, high=7),
    "$MA_COMP_ADD_VELO_FACTOR": _real("a", 0.01, 0.0, 0.1),
    "$MA_MAX_AX_VELO": _length("a", 10000.0, 1e-6),
    "$MA_POS_LIMIT_PLUS": _length("a", 1e8),
    "$MA_POS_LIMIT_MINUS": _length("a", -1e8),
    "$MA_REFP_SET_POS": DataSpec("na", "real", "newconf", 0.0, count=4, length=True),
    "$MA_IS_ROT_AX": DataSpec("a", "bool", "never", False),
    "$MA_ROT_IS_MODULO": DataSpec("a", "bool", "never", False),
    EEC_POINTS: DataSpec("na", "int", "power_on", 0, low=0, high=5000, count=2),
    QEC_POINTS: DataSpec("na", "int", "power_on", 0, low=0, high=1040, count=2),
    CEC_POINTS: DataSpec("n", "int", "power_on", 0, low=0, high=2000),
    IS_METRIC: DataSpec("", "bool", "power_on", True),
    "$MN_CONVERT_SCALING_SYSTEM": DataSpec("", "bool", "power_on", False),
    "$MN_AXCONF_MACHAX_NAME_TAB": DataSpec("n", "text", "never", ""),
    "$MN_HW_SERIAL_NUMBER": DataSpec("n", "text", "never", "", count=2),
    "$MN_VERSION_INFO": DataSpec("n", "text", "never", "", count=4),
    "$MN_INFO_FREE_MEM_STATIC": DataSpec("", "int", "never", 1_000_000),
    "$MN_LEN_PROTOCOL_FILE": DataSpec("", "int", "now", 1, low=1, high=100000),
    "$MN_PROTOCOL_FILE_MODE": DataSpec("", "int", "now", 0, low=0, high=1),
    SAVED_SETTINGS: DataSpec("n", "int", "reset", 0, low=0, high=50000, count=10),
    "$MC_DIAMETER_AX_DEF": DataSpec("", "text", "never", ""),
    "$MN_INI_FILE_MODE": DataSpec("", "int", "now", 1, low=0, high=2),
    "$MN_MD_FILE_STYLE": DataSpec("", "int", "now", 3, low=0, high=31),
    "$MC_REFP_NC_START_LOCK": DataSpec("", "int", "reset", 1, low=0, high=2),
    "$SN_CEC_TABLE_ENABLE": _setting("n", "bool"),
    "$SN_CEC_TABLE_WEIGHT": _setting("n", "real", 1.0),
    "$SN_CEC_0": _setting("n", "real"),
    "$SN_CEC_1": _setting("n", "real"),
    "$SN_CEC_BAS_0": _setting("n", "real"),
    "$SN_CEC_BAS_1": _setting("n", "real"),
    "$SN_CEC_BAS_STORE_0": _setting("n", "real"),
    "$SN_CEC_BAS_STORE_1": _setting("n", "real"),
    "$SN_CEC_COMP_0": _setting("n", "real"),
    "$SN_CEC_COMP_1": _setting("n", "real"),
    "$SN_CEC_COMP_STORE_0": _setting("n", "real"),
    "$SN_CEC_COMP_STORE_1": _setting("n", "real"),
    "$SN_CEC_CALC": _setting("n", "bool"),
    "$SN_CEC_CALC_ADD": _setting("n", "bool"),
    "$SA_TEMP_COMP_ABS_VALUE": replace(_setting("a", "real"), length=True),
    "$SA_TEMP_COMP_SLOPE": _setting("a", "real"),
    "$SA_TEMP_COMP_REF_POSITION": replace(_setting("a", "real"), length=True),
}


# Stored and effective values, units, and what a boot makes of them.

Key = tuple[str, tuple[int, ...]]
SavedDatum = tuple[str, list[int], Datum]


def check_value(spec: DataSpec, name: str, value: Datum) -> Datum:
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
    """Stored and effective values; index tuples are (n,), (axis,) or (n, axis) with axes counted from 0.

    ``inch``: whether the basic system is inch (MD10240 = 0).
    """

    def __init__(self, spec: NckSpec) -> None:
        self._axes = len(spec.axes)
        self._rotary = [axis.rotary for axis in spec.axes]
        self._late = BACKLASH if spec.backlash_activation == "nck_reset" else ""
        self._counts = {name: datum.count for name, datum in DATA.items()}
        tables = len(spec.cec_points)
        for name in (CEC_POINTS, *(name for name in DATA if name.startswith("$SN_CEC"))):
            self._counts[name] = tables
        self._counts["$MN_AXCONF_MACHAX_NAME_TAB"] = len(spec.places)
        self._stored: dict[Key, Datum] = {}
        for name, datum in DATA.items():
            for index in self._indices(name):
                self._stored[name, index] = datum.default
        self._preset(spec)
        if spec.unit_system == "inch":
            self._stored[IS_METRIC, ()] = False
            self._convert(1.0 / INCH_MM)
        self._effective = dict(self._stored)
        self.booted = dict(self._stored)
        self.inch = not self._stored[IS_METRIC, ()]

    def _indices(self, name: str) -> list[tuple[int, ...]]:
        shape, count = DATA[name].shape, self._counts[name]
        ranges = [range(count if sign == "n" else self._axes) for sign in shape]
        found: list[tuple[int, ...]] = [()]
        for values in ranges:
            found = [(*front, value) for front in found for value in values]
        return found

    def _preset(self, spec: NckSpec) -> None:
        for place, axis in enumerate(spec.axes):
            self._stored["$MN_AXCONF_MACHAX_NAME_TAB", (spec.numbers[place] - 1,)] = axis.name
            self._stored["$MA_MAX_AX_VELO", (place,)] = axis.max_velocity
            self._stored["$MA_IS_ROT_AX", (place,)] = axis.rotary
            self._stored["$MA_ROT_IS_MODULO", (place,)] = axis.modulo
            self._stored["$MA_POS_LIMIT_MINUS", (place,)] = float(axis.travel[0])
            self._stored["$MA_POS_LIMIT_PLUS", (place,)] = float(axis.travel[1])
            self._stored["$MA_REFP_SET_POS", (0, place)] = axis.reference
            self._stored["$MA_REFP_CYCLE_NR", (place,)] = place + 1
            for encoder, points in enumerate(axis.eec_points):
                self._stored[EEC_POINTS, (encoder, place)] = points
        for table, points in enumerate(spec.cec_points):
            self._stored[CEC_POINTS, (table,)] = points
        self._stored["$MC_DIAMETER_AX_DEF", ()] = spec.diameter_axis
        self._stored["$MN_HW_SERIAL_NUMBER", (0,)] = spec.identity[0]
        self._stored["$MN_VERSION_INFO", (0,)] = spec.identity[1]
        self._stored[SAVED_SETTINGS, (0,)] = 41300
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
        """The value that acts, as a number; lengths in mm, whatever the basic system."""
        found = self._effective[name, index]
        value = 0.0 if isinstance(found, str) else float(found)
        return value * INCH_MM if self.inch and self._is_length((name, index)) else value

    def unit(self, axis: int) -> float:
        """mm (or deg) in one unit of an axis' numbers."""
        return INCH_MM if self.inch and not self._rotary[axis] else 1.0

    def _is_length(self, key: Key) -> bool:
        return DATA[key[0]].length and not self._rotary[key[1][-1]]

    def _convert(self, factor: float) -> None:
        for key, value in self._stored.items():
            if self._is_length(key) and not isinstance(value, str):
                self._stored[key] = value * factor

    def store(self, name: str, index: tuple[int, ...], value: Datum) -> None:
        """Put a checked value; data of the class "now" act at once."""
        self._stored[name, index] = value
        if DATA[name].effect == "now":
            self._effective[name, index] = value

    def activate(self, *effects: Effect, keep: frozenset[Key] = frozenset()) -> None:
        """Make stored values of these classes effective, but those in ``keep``."""
        for key, value in self._stored.items():
            if DATA[key[0]].effect in effects and key not in keep and key[0] != self._late:
                self._effective[key] = value

    def memory_changed(self) -> bool:
        """Whether a datum that lays out buffered memory differs from the last boot."""
        return any(value != self.booted[key] for key, value in self._stored.items() if key[0] in LAYOUT)

    def scaling_changed(self) -> bool:
        """Whether the basic system differs from the last boot's (alarm 4070)."""
        return self._stored[IS_METRIC, ()] != self.booted[IS_METRIC, ()]

    def boot(self) -> float | None:
        """Power on: everything stored acts. With MD10260 a change of the basic system converts all lengths:

        returns the factor that buffered tables of linear axes must be multiplied by, None for no conversion.
        """
        factor = None
        if self.scaling_changed() and self._stored["$MN_CONVERT_SCALING_SYSTEM", ()]:
            factor = INCH_MM if self._stored[IS_METRIC, ()] else 1.0 / INCH_MM
            self._convert(factor)
        self.booted = dict(self._stored)
        self._effective = dict(self._stored)
        self.inch = not self._stored[IS_METRIC, ()]
        return factor

    def saved(self) -> dict[str, list[SavedDatum]]:
        """Stored values, and what the memory is laid out by, for static memory."""
        layout = {key: value for key, value in self.booted.items() if key[0] in (*LAYOUT, IS_METRIC)}
        columns = {"stored": self._stored, "booted": layout}
        return {
            name: [(key[0], list(key[1]), value) for key, value in column.items()] for name, column in columns.items()
        }

    def restore(self, columns: dict[str, list[SavedDatum]]) -> None:
        """Take what `saved` gave; the stored values act from the next boot on."""
        for target, column in ((self._stored, "stored"), (self.booted, "booted")):
            for name, index, value in columns[column]:
                if (name, tuple(index)) in target:
                    target[name, tuple(index)] = value

    def restore_layout(self, layout: dict[Key, Datum]) -> None:
        """Put the memory-laying data back to another boot's."""
        for key, value in layout.items():
            if key[0] in LAYOUT:
                self._stored[key] = value


# Alarms: number, text, and what clears them.

Clear = Literal["start", "cancel", "reset", "power_on"]

STOPPING = frozenset({"reset", "power_on"})
POWER_ON_LOCK = 4076


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm; ``clear``: the next NC start, the cancel key, channel reset, or power on."""

    number: int
    text: str
    clear: Clear


class AlarmList:
    """The alarms standing, oldest first; one entry for each number."""

    def __init__(self) -> None:
        self._standing: list[Alarm] = []

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """All alarms standing."""
        return tuple(self._standing)

    def __contains__(self, number: int) -> bool:
        return any(alarm.number == number for alarm in self._standing)

    def raise_(self, number: int, text: str, clear: Clear = "cancel") -> None:
        """Show an alarm; a number already standing is not shown twice."""
        if number not in self:
            self._standing.append(Alarm(number, text, clear))

    def show_while(self, cause: bool, number: int, text: str) -> None:
        """Show an alarm as long as its cause is there; power on clears it too."""
        if cause:
            self.raise_(number, text, "power_on")
        else:
            self.drop(number)

    def drop(self, number: int) -> None:
        """Its cause has gone."""
        self._standing = [alarm for alarm in self._standing if alarm.number != number]

    def clear(self, *kinds: Clear) -> tuple[Alarm, ...]:
        """Clear the alarms of these kinds; returns what was cleared."""
        gone = tuple(alarm for alarm in self._standing if alarm.clear in kinds)
        self._standing = [alarm for alarm in self._standing if alarm.clear not in kinds]
        return gone

    @property
    def lock_start(self) -> bool:
        """Whether NC start is locked."""
        return any(alarm.clear == "reset" or alarm.number == POWER_ON_LOCK for alarm in self._standing)
