"""Variables by their NC names: R, GUD, compensation tables, machine data and system variables, with protection.

``$AA_ENC_COMP`` and ``$AN_CEC`` are the tables in buffered memory. Writing is refused while the compensation is enabled
(17070 or what the switch says) and beyond the reserved points (17030); values are neither limited nor monitored. The
faults of a table memory (rounding, lost points) are played here too.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable

from simulators.nck.fault_injection import TABLE_SWITCHES
from simulators.nck.machine.compensation import CecTable, CylinderErrors, EecTable, Table, cylinder_end_values, shape_of
from simulators.nck.machine.core import Core
from simulators.nck.machine.data import CEC_ENABLE, DATA, ENC_ENABLE, LAYOUT, SCALING, check_value
from simulators.nck.spec import NckRefusal
from simulators.nck.values import AxisName, Value, to_bool, to_int, to_real

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
_TABLE_NAMES: dict[str, tuple[str, str] | None] = {
    _EEC: None,
    _CEC: None,
    **{f"{_EEC}_{part}": entry for part, entry in _TABLE_PARTS.items()},
    **{f"{_CEC}_{part}": entry for part, entry in _CEC_PARTS.items()},
}


def is_table(name: str) -> bool:
    """Whether it is a variable of a table."""
    return name in _TABLE_NAMES


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
        entry = _TABLE_NAMES[name]
        if entry is None:
            return self._point(table, to_int(indices[1]))
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
        encoder = to_int(indices[0])
        axis = self._axis(indices[-1])
        table = self._core.memory.eec.get((axis, encoder))
        if table is None:
            raise NckRefusal(17020, f"{name}: illegal array index 1: encoder {encoder}")
        return table, axis, encoder

    def _cec(self, name: str, indices: Indices) -> CecTable:
        count = 2 if name == _CEC else 1
        if len(indices) != count:
            raise NckRefusal(12400, f"{name} takes {count} indices")
        return self._core.memory.cec_table(to_int(indices[0]))

    # -- writing -----------------------------------------------------------------------------------

    def write(self, name: str, indices: Indices, value: Value) -> None:
        """Write a point or a parameter. Raises NckRefusal 12150, 12160, 12400, 17020, 17030, 17070."""
        self._core.memory.settle(self._core.clock.now())
        if name.startswith(_EEC):
            table: Table = self._free_eec(name, indices)
        else:
            table = self._free_cec(name, indices)
        entry = _TABLE_NAMES[name]
        if entry is None:
            self._write_point(table, to_int(indices[1]), value)
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
        return self._core.memory.kept(to_real(value))

    def _taken(self, name: str, kind: str, value: Value) -> Value:
        if kind == "axis":
            return self._core.spec.axes[self._axis(value)].name
        if kind == "real":
            return self._kept(value)
        if kind == "bool":
            return to_bool(value)
        plain = to_int(value)
        limits = {"sign": (-1, 1), "flag": (0, 1)}.get(kind, (0, 9999))
        if not limits[0] <= plain <= limits[1]:
            raise NckRefusal(12160, f"{name}: value lies beyond the value range")
        return plain


# All other variables. A machine datum written by a program without rights raises 4075 once, keeps its value, and the
# program runs on.

_NAME = re.compile(r"\s*(\$?[A-Za-z_][A-Za-z0-9_]*)\s*(?:\[([^\]]*)\])?\s*")
_INTEGER = re.compile(r"[+-]?\d{1,9}")
_R_NAME = re.compile(r"R(\d{1,5})")


@functools.lru_cache(maxsize=8192)
def split_name(text: str) -> tuple[str, Indices]:
    """``"$AA_ENC_COMP[0,3,X1]"`` -> name and indices (numbers as int). Raises NckRefusal 12550."""
    found = _NAME.fullmatch(text)
    if found is None:
        raise NckRefusal(12550, f"name {text!r} unknown")
    name = found[1].upper()
    plain_r = _R_NAME.fullmatch(name)
    if plain_r is not None and found[2] is None:
        return "R", (int(plain_r[1]),)
    parts = [part.strip() for part in found[2].split(",")] if found[2] is not None else []
    return name, tuple(int(part) if _INTEGER.fullmatch(part) else part.upper() for part in parts)


class Variables:
    """Reads and writes by name, for programs and for the outside."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self.on_switched_on: Callable[[str, tuple[int, ...]], None] = lambda _name, _index: None
        self._tables = TableVariables(core, self._axis)
        self._readers: dict[str, Callable[[Indices], Value]] = self._axis_readers()
        # Names of axes stay as long as the control: where a datum stands is found once.
        self._places: dict[tuple[str, Indices], tuple[int, ...]] = {}

    # -- reading -----------------------------------------------------------------------------------

    def known(self, name: str) -> bool:
        """Whether there is a variable of that name."""
        return name == "R" or is_table(name) or name in DATA or name in self._readers or name in self._core.gud

    def read(self, name: str, indices: Indices) -> Value:
        """The value of a variable. Raises NckRefusal 12550, 17020, 17030."""
        if name == "R":
            return self._core.r[self._r_index(indices)]
        if name in DATA:
            return self._core.data.stored(name, *self._data_index(name, indices))
        if is_table(name):
            return self._tables.read(name, indices)
        if name in self._core.gud:
            return self._core.gud[name][self._gud_index(name, indices)]
        reader = self._readers.get(name)
        if reader is None:
            raise NckRefusal(12550, f"name {name} not defined or option not available")
        return reader(indices)

    def _r_index(self, indices: Indices) -> int:
        if len(indices) != 1:
            raise NckRefusal(12400, "R takes one index")
        index = to_int(indices[0])
        if not 0 <= index < len(self._core.r):
            raise NckRefusal(17020, f"illegal array index 1: R{index}")
        return index

    def _gud_index(self, name: str, indices: Indices) -> int:
        index = to_int(indices[0]) if len(indices) == 1 else 0
        if len(indices) > 1 or not 0 <= index < len(self._core.gud[name]):
            raise NckRefusal(17020, f"illegal array index 1: {name}")
        return index

    def _axis(self, value: Value, *, machine_only: bool = True) -> int:
        if not isinstance(value, str):
            raise NckRefusal(12150, "an axis name is expected")
        found = self._core.axis_index(value, machine_only=machine_only)
        if found is None:
            raise NckRefusal(12550, f"axis {value} unknown")
        return found

    def _data_index(self, name: str, indices: Indices) -> tuple[int, ...]:
        found = self._places.get((name, indices))
        if found is None:
            found = self._places[name, indices] = self._found_index(name, indices)
        return found

    def _found_index(self, name: str, indices: Indices) -> tuple[int, ...]:
        shape = DATA[name].shape
        given = list(indices)
        if shape == "na" and len(given) == 1 and isinstance(given[0], str):
            given.insert(0, 0)
        if len(given) != len(shape):
            raise NckRefusal(12400, f"{name} takes {len(shape)} indices")
        return tuple(
            self._axis(value) if sign == "a" else to_int(value) for sign, value in zip(shape, given, strict=True)
        )

    # -- writing -----------------------------------------------------------------------------------

    def write(self, name: str, indices: Indices, value: Value, level: int, *, program: bool) -> None:
        """Write a variable. Raises NckRefusal: 12550, 12150, 12160, 17020, 17030, 17070, 17080, 17090.

        ``program``: a part program's way, where missing rights raise alarm 4075 and nothing stops; from
        outside they are refused with 4075 at once.
        """
        if name == "R":
            self._core.r[self._r_index(indices)] = to_real(value)
        elif name in DATA:
            self._write_datum(name, self._data_index(name, indices), value, level, program=program)
        elif is_table(name):
            self._tables.write(name, indices, value)
        elif name in self._core.gud:
            self._core.gud[name][self._gud_index(name, indices)] = to_real(value)
        elif name in self._readers:
            raise NckRefusal(17070, f"{name}: data write-protected")
        else:
            raise NckRefusal(12550, f"name {name} not defined or option not available")

    def _write_datum(self, name: str, index: tuple[int, ...], value: Value, level: int, *, program: bool) -> None:
        core, spec = self._core, DATA[name]
        before = core.data.stored(name, *index)
        if spec.effect == "never":
            raise NckRefusal(17070, f"{name}: data write-protected")
        needed = core.spec.level_of(name, spec.level)
        if level > needed:
            self._refused(4075, f"no access rights to write {name}: level {needed} needed, {level} active", program)
            return
        datum = check_value(spec, name, value)
        missing = self._missing_option(index) if name == CEC_ENABLE and datum else None
        if missing is not None:
            self._refused(*missing, program)
            return
        core.data.store(name, index, datum)
        if datum and name in TABLE_SWITCHES:
            self.on_switched_on(name, index)
        self._after_datum(name, index, bool(datum) and not before)

    def _refused(self, number: int, text: str, program: bool) -> None:
        """A program goes on with the old value and the alarm on the screen; from outside it is an error."""
        if program or number != 4075:
            self._core.alarms.raise_(number, text)
        if not program:
            raise NckRefusal(number, text)

    def _missing_option(self, index: tuple[int, ...]) -> tuple[int, str] | None:
        core = self._core
        name = core.spec.axes[index[0]].name
        if not core.spec.option_cec:
            return 8040, f"$MA_CEC_ENABLE of {name} reset: option not set"
        others = sum(bool(core.data.stored(CEC_ENABLE, axis.index)) for axis in core.axes if axis.index != index[0])
        if others >= core.spec.option_cec_axes:
            return 8041, f"axis {name}: $MA_CEC_ENABLE reset, option not sufficient"
        return None

    def _after_datum(self, name: str, index: tuple[int, ...], edge: bool) -> None:
        core = self._core
        if name in LAYOUT:
            text = "MD change will reorganise buffered memory: data loss"
            core.alarms.show_while(core.data.memory_changed(), 4400, text)
        if name in SCALING:
            core.alarms.show_while(core.data.scaling_changed(), 4070, "scaling machine data changed")
        if name == "$SN_CEC_CALC" and edge:
            self._calculate_cylinder(*index)
        if DATA[name].effect == "now":
            core.refresh()

    def _calculate_cylinder(self, number: int) -> None:
        data, table = self._core.data, self._core.memory.cec_table(number)
        names = ("BAS_0", "BAS_1", "COMP_0", "COMP_1")
        given = [to_real(data.stored(f"$SN_CEC_{name}", number)) for name in names]
        found = cylinder_end_values(CylinderErrors(*given), table.minimum, table.step)
        for place, value in enumerate(found):
            name = f"$SN_CEC_{place}"
            old = to_real(data.stored(name, number)) if data.stored("$SN_CEC_CALC_ADD", number) else 0.0
            data.store(name, (number,), old + value)
        for name, value in zip(names, given, strict=True):
            data.store(f"$SN_CEC_{name[:-2]}_STORE_{name[-1]}", (number,), value)
            data.store(f"$SN_CEC_{name}", (number,), 0.0)

    # -- system variables of an axis ---------------------------------------------------------------

    def _axis_readers(self) -> dict[str, Callable[[Indices], Value]]:
        core = self._core

        def reader(work: Callable[[int], Value]) -> Callable[[Indices], Value]:
            def read(indices: Indices) -> Value:
                if len(indices) != 1:
                    raise NckRefusal(12400, "one index, an axis, is expected")
                return work(self._axis(indices[0], machine_only=False))

            return read

        def place(index: int) -> float:
            return core.view(index).set_position

        def actual(index: int) -> float:
            return core.view(index).actual_position

        return {
            "$AA_IM": reader(place),
            "$AA_IW": reader(place),
            "$AA_IB": reader(place),
            "$VA_IM": reader(actual),
            "$VA_IM1": reader(actual),
            "$AA_STAT": reader(lambda index: core.axes[index].state(core.clock.now())),
            "$AA_INPOS_STAT": reader(lambda index: core.axes[index].state(core.clock.now())),
            "$AA_REF": reader(lambda index: int(core.axes[index].referenced)),
            "$AA_ENC_ACTIVE": reader(lambda index: core.axes[index].active_encoder + 1),
            "$VA_ENC1_COMP_VAL": reader(lambda index: core.eec_value(index, 0) / core.data.unit(index)),
            "$VA_ENC2_COMP_VAL": reader(lambda index: core.eec_value(index, 1) / core.data.unit(index)),
            "$VA_CEC_COMP_VAL": reader(lambda index: core.cec_value(index) / core.data.unit(index)),
            "$VA_TEMP_COMP_VAL": reader(lambda index: core.view(index).temperature_value),
        }


# System variables that a running program reads of itself and the time.

_TIMERS = 200
_PROGRAM_NAMES = frozenset(
    {"$AC_TIMER", "$P_PROG", "$P_PROGPATH", "$P_SIM", "$P_SEARCH", "$P_ISTEST", "$AC_PROG"}
    | {"$AC_STAT", "$AC_OVR", "$A_YEAR", "$A_MONTH", "$A_DAY", "$A_HOUR", "$A_MINUTE", "$A_SECOND"}
)


class ProgramData:
    """Reads and writes those names; ``paths`` gives the programs under execution, outermost first."""

    def __init__(self, core: Core, paths: Callable[[], list[str]]) -> None:
        self._core = core
        self._paths = paths
        self._timers: dict[int, tuple[float, float | None]] = {}

    def knows(self, name: str) -> bool:
        """Whether the name is one of these."""
        return name in _PROGRAM_NAMES

    def read(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value. Raises NckRefusal 17020 for an index out of range."""
        if name == "$AC_TIMER":
            value, since = self._timers.get(self._timer(indices), (0.0, None))
            return value if since is None else value + self._core.clock.now() - since
        if name == "$P_PROG":
            return self._program(indices).rpartition("/")[2]
        if name == "$P_PROGPATH":
            return self._program(()).rpartition("/")[0] + "/"
        if name.startswith("$A_"):
            return int(getattr(self._core.clock.utc(), name.removeprefix("$A_").lower()))
        fixed: dict[str, Value] = {"$AC_PROG": 2, "$AC_STAT": 1, "$AC_OVR": self._core.override_percent}
        return fixed.get(name, 0)

    def write(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Set a timer: running from a value >= 0, standing after -1. Others raise NckRefusal 17070."""
        if name != "$AC_TIMER":
            raise NckRefusal(17070, f"{name}: data write-protected")
        timer, plain = self._timer(indices), to_real(value)
        if plain < 0.0:
            standing = to_real(self.read(name, indices))
            self._timers[timer] = (standing, None)
        else:
            self._timers[timer] = (plain, self._core.clock.now())

    def _timer(self, indices: tuple[Value, ...]) -> int:
        number = to_int(indices[0]) if len(indices) == 1 else -1
        if not 0 <= number < _TIMERS:
            raise NckRefusal(17020, "$AC_TIMER: illegal array index 1")
        return number

    def _program(self, indices: tuple[Value, ...]) -> str:
        paths = self._paths()
        level = to_int(indices[0]) if indices else len(paths) - 1
        if not 0 <= level < len(paths):
            raise NckRefusal(17020, "illegal array index 1: program level")
        return paths[level]
