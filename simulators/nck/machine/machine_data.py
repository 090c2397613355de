"""Machine and setting data: stored and effective values, units, and what a boot makes of them."""

from __future__ import annotations

import math

from simulators.nck.machine.data_table import (
    BACKLASH,
    CEC_POINTS,
    DATA,
    EEC_POINTS,
    INCH_MM,
    IS_METRIC,
    LAYOUT,
    SAVED_SETTINGS,
    DataSpec,
    Datum,
    Effect,
)
from simulators.nck.spec import NckRefusal, NckSpec

Key = tuple[str, tuple[int, ...]]
SavedDatum = tuple[str, list[int], Datum]


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
        self._stored["$MN_HW_SERIAL_NUMBER", (0,)] = spec.told[0]
        self._stored["$MN_VERSION_INFO", (0,)] = spec.told[1]
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
