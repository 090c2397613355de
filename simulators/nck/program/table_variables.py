"""``$AA_ENC_COMP`` and ``$AN_CEC``: reading and writing the compensation tables in buffered memory.

Refused while the compensation is enabled (17070 or what the switch says) and beyond the reserved points
(17030); values are neither limited nor monitored. The hostile manners of a table memory live here too.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from simulators.nck.machine.core import Core
from simulators.nck.machine.data_table import CEC_ENABLE, ENC_ENABLE
from simulators.nck.machine.memory import CecTable, EecTable, Table, shape_of
from simulators.nck.spec import NckRefusal
from simulators.nck.values import AxisName, Value, real, truth, whole

Indices = tuple[Value, ...]

_EEC, _CEC = "$AA_ENC_COMP", "$AN_CEC"
_TABLE_PARTS: dict[str, tuple[str, str]] = {
    "STEP": ("step", "real"),
    "MIN": ("minimum", "real"),
    "MAX": ("maximum", "real"),
    "IS_MODULO": ("is_modulo", "bool"),
}
_CEC_PARTS: dict[str, tuple[str, str]] = {
    **_TABLE_PARTS,
    "INPUT_AXIS": ("input_axis", "axis"),
    "OUTPUT_AXIS": ("output_axis", "axis"),
    "INPUT_NCU": ("input_ncu", "int"),
    "OUTPUT_NCU": ("output_ncu", "int"),
    "DIRECTION": ("direction", "sign"),
    "MULT_BY_TABLE": ("mult_by_table", "int"),
    "TYPE": ("kind", "flag"),
}
_NAMES: dict[str, tuple[str, str] | None] = {
    _EEC: None,
    _CEC: None,
    **{f"{_EEC}_{part}": entry for part, entry in _TABLE_PARTS.items()},
    **{f"{_CEC}_{part}": entry for part, entry in _CEC_PARTS.items()},
}


def is_table(name: str) -> bool:
    """Whether it is a variable of a table."""
    return name in _NAMES


class TableVariables:
    """Reads and writes them by name; ``axis`` finds a machine axis (NckRefusal 12150, 12550)."""

    def __init__(self, core: Core, axis: Callable[[Value], int]) -> None:
        self._core = core
        self._axis = axis

    # -- reading -----------------------------------------------------------------------------------

    def read(self, name: str, indices: Indices) -> Value:
        """The value. Raises NckRefusal 12400, 17020, 17030."""
        self._core.memory.settle(self._core.clock.now())
        table = self._eec_read(name, indices) if name.startswith(_EEC) else self._cec(name, indices)
        entry = _NAMES[name]
        if entry is None:
            return self._point(table, whole(indices[1]))
        found: Value = getattr(table, entry[0])
        return AxisName(found) if entry[1] == "axis" else found

    def _point(self, table: Table, number: int) -> float:
        spec = self._core.spec
        beyond = not 0 <= number < len(table.points)
        if beyond and number >= 0 and (spec.accepts_points_beyond or spec.reads_another_axis):
            return 0.0
        return table.points[self._core.memory.place(table.points, number)]

    def _eec_read(self, name: str, indices: Indices) -> EecTable:
        table, axis, encoder = self._eec(name, indices)
        if not self._core.spec.reads_another_axis:
            return table
        others = [key for key, one in self._core.memory.eec.items() if one.points and key[1] == encoder]
        later = [key for key in others if key[0] > axis] + [key for key in others if key[0] < axis]
        return self._core.memory.eec[later[0]] if later else table

    def _eec(self, name: str, indices: Indices) -> tuple[EecTable, int, int]:
        count = 3 if name == _EEC else 2
        if len(indices) != count:
            raise NckRefusal(12400, f"{name} takes {count} indices")
        encoder = whole(indices[0])
        axis = self._axis(indices[-1])
        table = self._core.memory.eec.get((axis, encoder))
        if table is None:
            raise NckRefusal(17020, f"{name}: illegal array index 1: encoder {encoder}")
        return table, axis, encoder

    def _cec(self, name: str, indices: Indices) -> CecTable:
        count = 2 if name == _CEC else 1
        if len(indices) != count:
            raise NckRefusal(12400, f"{name} takes {count} indices")
        return self._core.memory.cec_table(whole(indices[0]))

    # -- writing -----------------------------------------------------------------------------------

    def write(self, name: str, indices: Indices, value: Value) -> None:
        """Write a point or a parameter. Raises NckRefusal 12150, 12160, 12400, 17020, 17030, 17070."""
        self._core.memory.settle(self._core.clock.now())
        if name.startswith(_EEC):
            table: Table = self._free_eec(name, indices)
        else:
            table = self._free_cec(name, indices)
        entry = _NAMES[name]
        if entry is None:
            self._write_point(table, whole(indices[1]), value)
            return
        part, kind = entry
        taken = self._taken(name, kind, value)
        if part == "output_axis" and isinstance(taken, str):
            self._check_cec_free(name, taken)
        self._put(lambda: setattr(table, part, taken))

    def _free_eec(self, name: str, indices: Indices) -> EecTable:
        core = self._core
        table, axis, encoder = self._eec(name, indices)
        acting = not core.spec.lies_about_disable and core.data.effective(ENC_ENABLE, encoder, axis)
        if core.data.stored(ENC_ENABLE, encoder, axis) or acting:
            axis_name = core.spec.axes[axis].name
            text = f"{name}: data write-protected while MD32700 of {axis_name} is 1"
            raise NckRefusal(core.spec.locked_alarm, text)
        return table

    def _free_cec(self, name: str, indices: Indices) -> CecTable:
        table = self._cec(name, indices)
        self._check_cec_free(name, table.output_axis)
        return table

    def _check_cec_free(self, name: str, output: str) -> None:
        core = self._core
        axis = core.axis_index(output) if output else None
        if axis is None:
            return
        if core.data.stored(CEC_ENABLE, axis) or core.data.effective(CEC_ENABLE, axis):
            text = f"{name}: data write-protected while MD32710 of {output} is 1"
            raise NckRefusal(core.spec.locked_alarm, text)

    def _write_point(self, table: Table, number: int, value: Value) -> None:
        kept = self._kept(value)
        if self._swallowed(table, number):
            return
        place = self._core.memory.place(table.points, number)
        if self._core.spec.writes_late_s == 0.0:
            table.points[place] = kept
        else:
            self._put(lambda: table.points.__setitem__(place, kept))

    def _swallowed(self, table: Table, number: int) -> bool:
        spec = self._core.spec
        if spec.accepts_points_beyond and number >= len(table.points):
            return True
        if spec.loses_last_points == 0:
            return False
        last = shape_of(table, spec.uneven_step).last_point(len(table.points))
        return last is not None and last - spec.loses_last_points < number <= last

    def _put(self, write: Callable[[], None]) -> None:
        late = self._core.spec.writes_late_s
        if late == 0.0:
            write()
        else:
            self._core.memory.late.append((self._core.clock.now() + late, write))

    def _kept(self, value: Value) -> float:
        if self._core.spec.accepts_nan and isinstance(value, float) and math.isnan(value):
            return value
        return self._core.memory.kept(real(value))

    def _taken(self, name: str, kind: str, value: Value) -> Value:
        if kind == "axis":
            return self._core.spec.axes[self._axis(value)].name
        if kind == "real":
            return self._kept(value)
        if kind == "bool":
            return truth(value)
        plain = whole(value)
        limits = {"sign": (-1, 1), "flag": (0, 1)}.get(kind, (0, 9999))
        if not limits[0] <= plain <= limits[1]:
            raise NckRefusal(12160, f"{name}: value lies beyond the value range")
        return plain
