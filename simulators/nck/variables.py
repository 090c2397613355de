"""NC names -> values: R parameters, compensation tables, machine data and system variables, with protection.

Tables are refused while their compensation is enabled (17070), points beyond the memory with 17030. A machine
datum written by a program without rights raises 4075 once, keeps its value, and the program runs on.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable

from simulators.nck.core import Core
from simulators.nck.machine_data import CEC_ENABLE, DATA, EEC_POINTS, ENC_ENABLE, checked
from simulators.nck.memory import CecTable, EecTable
from simulators.nck.spec import NckRefusal
from simulators.nck.values import AxisName, Value, real, truth, whole

_NAME = re.compile(r"\s*(\$?[A-Za-z_][A-Za-z0-9_]*)\s*(?:\[([^\]]*)\])?\s*")
_INTEGER = re.compile(r"[+-]?\d{1,9}")
_R_NAME = re.compile(r"R(\d{1,5})")

Indices = tuple[Value, ...]

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
        self._readers: dict[str, Callable[[Indices], Value]] = self._axis_readers()

    # -- reading -----------------------------------------------------------------------------------

    def known(self, name: str) -> bool:
        """Whether there is a variable of that name."""
        table = name.startswith(("$AA_ENC_COMP", "$AN_CEC")) and self._is_table(name)
        return name == "R" or table or name in DATA or name in self._readers

    def read(self, name: str, indices: Indices) -> Value:
        """The value of a variable. Raises NckRefusal 12550, 17020, 17030."""
        if name == "R":
            return self._core.r[self._r_index(indices)]
        if name in DATA:
            return self._core.data.stored(name, *self._data_index(name, indices))
        if name.startswith("$AA_ENC_COMP") and self._is_table(name):
            return self._read_eec(name, indices)
        if name.startswith("$AN_CEC") and self._is_table(name):
            return self._read_cec(name, indices)
        reader = self._readers.get(name)
        if reader is None:
            raise NckRefusal(12550, f"name {name} not defined or option not available")
        return reader(indices)

    def _is_table(self, name: str) -> bool:
        if name in ("$AA_ENC_COMP", "$AN_CEC"):
            return True
        front, parts = ("$AA_ENC_COMP_", _TABLE_PARTS) if name.startswith("$AA") else ("$AN_CEC_", _CEC_PARTS)
        return name.startswith(front) and name.removeprefix(front) in parts

    def _r_index(self, indices: Indices) -> int:
        if len(indices) != 1:
            raise NckRefusal(12400, "R takes one index")
        index = whole(indices[0])
        if not 0 <= index < len(self._core.r):
            raise NckRefusal(17020, f"illegal array index 1: R{index}")
        return index

    def _axis(self, value: Value, *, machine_only: bool = True) -> int:
        if not isinstance(value, str):
            raise NckRefusal(12150, "an axis name is expected")
        found = self._core.axis_index(value, machine_only=machine_only)
        if found is None:
            raise NckRefusal(12550, f"axis {value} unknown")
        return found

    def _data_index(self, name: str, indices: Indices) -> tuple[int, ...]:
        shape = DATA[name].shape
        given = list(indices)
        if shape == "na" and len(given) == 1 and isinstance(given[0], str):
            given.insert(0, 0)
        if len(given) != len(shape):
            raise NckRefusal(12400, f"{name} takes {len(shape)} indices")
        return tuple(
            self._axis(value) if sign == "a" else whole(value) for sign, value in zip(shape, given, strict=True)
        )

    def _eec_table(self, name: str, indices: Indices, count: int) -> tuple[EecTable, int, int]:
        if len(indices) != count:
            raise NckRefusal(12400, f"{name} takes {count} indices")
        encoder = whole(indices[0])
        axis = self._axis(indices[-1])
        table = self._core.memory.eec.get((axis, encoder))
        if table is None:
            raise NckRefusal(17020, f"{name}: illegal array index 1: encoder {encoder}")
        return table, axis, encoder

    def _read_eec(self, name: str, indices: Indices) -> Value:
        if name == "$AA_ENC_COMP":
            table, _, _ = self._eec_table(name, indices, 3)
            return table.points[self._core.memory.place(table.points, whole(indices[1]))]
        table, _, _ = self._eec_table(name, indices, 2)
        found: Value = getattr(table, _TABLE_PARTS[name.removeprefix("$AA_ENC_COMP_")][0])
        return found

    def _cec_table(self, name: str, indices: Indices, count: int) -> CecTable:
        if len(indices) != count:
            raise NckRefusal(12400, f"{name} takes {count} indices")
        return self._core.memory.cec_table(whole(indices[0]))

    def _read_cec(self, name: str, indices: Indices) -> Value:
        if name == "$AN_CEC":
            table = self._cec_table(name, indices, 2)
            return table.points[self._core.memory.place(table.points, whole(indices[1]))]
        table = self._cec_table(name, indices, 1)
        part, kind = _CEC_PARTS[name.removeprefix("$AN_CEC_")]
        found: Value = getattr(table, part)
        return AxisName(found) if kind == "axis" else found

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
        elif name.startswith("$AA_ENC_COMP") and self._is_table(name):
            self._write_eec(name, indices, value)
        elif name.startswith("$AN_CEC") and self._is_table(name):
            self._write_cec(name, indices, value)
        elif name in self._readers:
            raise NckRefusal(17070, f"{name}: data write-protected")
        else:
            raise NckRefusal(12550, f"name {name} not defined or option not available")

    def _write_datum(self, name: str, index: tuple[int, ...], value: Value, level: int, *, program: bool) -> None:
        core, spec = self._core, DATA[name]
        core.data.stored(name, *index)
        if spec.effect == "never":
            raise NckRefusal(17070, f"{name}: data write-protected")
        if level > spec.level:
            text = f"no access rights to write {name}: level {spec.level} needed, {level} active"
            if not program:
                raise NckRefusal(4075, text)
            core.alarms.raise_(4075, text)
            return
        datum = checked(spec, name, value)
        if name == CEC_ENABLE and datum and not core.spec.option_cec:
            text = f"{name} reset: option not set"
            core.alarms.raise_(8040, text)
            if not program:
                raise NckRefusal(8040, text)
            return
        core.data.store(name, index, datum)
        self._after_datum(name)

    def _after_datum(self, name: str) -> None:
        core = self._core
        if name == EEC_POINTS or DATA[name].effect == "power_on":
            if core.data.memory_changed():
                core.alarms.raise_(4400, "MD change will reorganise buffered memory: data loss", "power_on")
            else:
                core.alarms.drop(4400)
        if DATA[name].effect == "now":
            core.refresh()

    def _write_eec(self, name: str, indices: Indices, value: Value) -> None:
        core = self._core
        table, axis, encoder = self._eec_table(name, indices, 3 if name == "$AA_ENC_COMP" else 2)
        acting = not core.spec.lies_about_disable and core.data.effective(ENC_ENABLE, encoder, axis)
        if core.data.stored(ENC_ENABLE, encoder, axis) or acting:
            axis_name = core.spec.axes[axis].name
            raise NckRefusal(17070, f"{name}: data write-protected while MD32700 of {axis_name} is 1")
        if name == "$AA_ENC_COMP":
            place = core.memory.place(table.points, whole(indices[1]))
            table.points[place] = core.memory.kept(real(value))
            return
        part, kind = _TABLE_PARTS[name.removeprefix("$AA_ENC_COMP_")]
        setattr(table, part, self._table_value(name, kind, value))

    def _write_cec(self, name: str, indices: Indices, value: Value) -> None:
        table = self._cec_table(name, indices, 2 if name == "$AN_CEC" else 1)
        self._check_cec_free(name, table.output_axis)
        if name == "$AN_CEC":
            place = self._core.memory.place(table.points, whole(indices[1]))
            table.points[place] = self._core.memory.kept(real(value))
            return
        part, kind = _CEC_PARTS[name.removeprefix("$AN_CEC_")]
        taken = self._table_value(name, kind, value)
        if part == "output_axis" and isinstance(taken, str):
            self._check_cec_free(name, taken)
        setattr(table, part, taken)

    def _check_cec_free(self, name: str, output: str) -> None:
        core = self._core
        axis = core.axis_index(output) if output else None
        if axis is None:
            return
        if core.data.stored(CEC_ENABLE, axis) or core.data.effective(CEC_ENABLE, axis):
            raise NckRefusal(17070, f"{name}: data write-protected while MD32710 of {output} is 1")

    def _table_value(self, name: str, kind: str, value: Value) -> Value:
        if kind == "axis":
            return self._core.spec.axes[self._axis(value)].name
        if kind == "real":
            return self._core.memory.kept(real(value))
        if kind == "bool":
            return truth(value)
        plain = whole(value)
        limits = {"sign": (-1, 1), "flag": (0, 1)}.get(kind, (0, 9999))
        if not limits[0] <= plain <= limits[1]:
            raise NckRefusal(12160, f"{name}: value lies beyond the value range")
        return plain

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
            "$P_EP": reader(place),
            "$VA_IM": reader(actual),
            "$VA_IM1": reader(actual),
            "$AA_STAT": reader(lambda index: core.view(index).aa_stat),
            "$AA_INPOS_STAT": reader(lambda index: core.view(index).aa_stat),
            "$AA_REF": reader(lambda index: int(core.axes[index].referenced)),
            "$VA_ENC1_COMP_VAL": reader(lambda index: core.eec_value(index, 0)),
            "$VA_ENC2_COMP_VAL": reader(lambda index: core.eec_value(index, 1)),
            "$VA_CEC_COMP_VAL": reader(core.cec_value),
            "$VA_TEMP_COMP_VAL": reader(lambda index: core.view(index).temperature_value),
        }
