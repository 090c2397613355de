"""NC names -> values: R parameters, GUD, compensation tables, machine data and system variables, with protection.

A machine datum written by a program without rights raises 4075 once, keeps its value, and the program runs on.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable

from simulators.nck.machine.core import Core
from simulators.nck.machine.cylinder import Measured, end_values
from simulators.nck.machine.data_table import CEC_ENABLE, DATA, LAYOUT, SCALING
from simulators.nck.machine.machine_data import checked
from simulators.nck.program.table_variables import TableVariables, is_table
from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, real, whole
from simulators.nck.whims import SWITCHES

_NAME = re.compile(r"\s*(\$?[A-Za-z_][A-Za-z0-9_]*)\s*(?:\[([^\]]*)\])?\s*")
_INTEGER = re.compile(r"[+-]?\d{1,9}")
_R_NAME = re.compile(r"R(\d{1,5})")

Indices = tuple[Value, ...]


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
        index = whole(indices[0])
        if not 0 <= index < len(self._core.r):
            raise NckRefusal(17020, f"illegal array index 1: R{index}")
        return index

    def _gud_index(self, name: str, indices: Indices) -> int:
        index = whole(indices[0]) if len(indices) == 1 else 0
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
            self._axis(value) if sign == "a" else whole(value) for sign, value in zip(shape, given, strict=True)
        )

    # -- writing -----------------------------------------------------------------------------------

    def write(self, name: str, indices: Indices, value: Value, level: int, *, program: bool) -> None:
        """Write a variable. Raises NckRefusal: 12550, 12150, 12160, 17020, 17030, 17070, 17080, 17090.

        ``program``: a part program's way, where missing rights raise alarm 4075 and nothing stops; from
        outside they are refused with 4075 at once.
        """
        if name == "R":
            self._core.r[self._r_index(indices)] = real(value)
        elif name in DATA:
            self._write_datum(name, self._data_index(name, indices), value, level, program=program)
        elif is_table(name):
            self._tables.write(name, indices, value)
        elif name in self._core.gud:
            self._core.gud[name][self._gud_index(name, indices)] = real(value)
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
        datum = checked(spec, name, value)
        missing = self._missing_option(index) if name == CEC_ENABLE and datum else None
        if missing is not None:
            self._refused(*missing, program)
            return
        core.data.store(name, index, datum)
        if datum and name in SWITCHES:
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
        given = [real(data.stored(f"$SN_CEC_{name}", number)) for name in names]
        found = end_values(Measured(*given), table.minimum, table.step)
        for place, value in enumerate(found):
            name = f"$SN_CEC_{place}"
            old = real(data.stored(name, number)) if data.stored("$SN_CEC_CALC_ADD", number) else 0.0
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
