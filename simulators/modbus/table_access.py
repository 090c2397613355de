"""The PLC's access to the NCK: tables, switches and states in mailbox units; refusals become mailbox errors."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from simulators.modbus.registers import (
    BACKLASH_KIND,
    CEC,
    DINT_HIGH,
    DINT_LOW,
    EEC,
    INEXPRESSIBLE,
    NCK_REFUSED,
    PROTECTED,
    RANGE,
    TEMPERATURE,
    TIME_OVER,
    TOO_MANY,
    UNKNOWN,
    PlcFault,
    TableAddress,
    TableParameters,
)
from simulators.nck import AxisSpec, Nck, NckRefusal

_POSITION = {False: 1e4, True: 1e6}  # 0.1 um, 1e-6 deg
_VALUE = {False: 1e6, True: 1e7}  # nm, 1e-7 deg
_SLOPE = 1e9
_MOST_TABLES = 62
_TEMPERATURE_NAMES = ("$SA_TEMP_COMP_ABS_VALUE", "$SA_TEMP_COMP_SLOPE", "$SA_TEMP_COMP_REF_POSITION")
_ALARM_ERRORS = {17070: PROTECTED, 17180: PROTECTED, 17030: TOO_MANY}


@contextlib.contextmanager
def _translate_refusals() -> Iterator[None]:
    try:
        yield
    except NckRefusal as refusal:
        raise PlcFault(_ALARM_ERRORS.get(refusal.number, NCK_REFUSED), refusal.number) from refusal


class TableAccess:
    """Reads and writes one NCK. ``write_level`` is the protection level the PLC has for machine data.

    ``axes``: the machine axes by their numbers in the NCK, which may leave some out.
    """

    def __init__(self, nck: Nck, write_level: int) -> None:
        self._nck = nck
        self._level = write_level
        self.axes = dict(zip(nck.spec.numbers, nck.spec.axes, strict=True))

    # -- what there is -----------------------------------------------------------------------------

    @property
    def nck(self) -> Nck:
        """The control itself."""
        return self._nck

    @property
    def tables(self) -> int:
        """Number of CEC tables."""
        return min(len(self._nck.spec.cec_points), _MOST_TABLES)

    def axis(self, number: int) -> AxisSpec:
        """An axis by its number. Raises PlcFault (9)."""
        found = self.axes.get(number)
        if found is None:
            raise PlcFault(UNKNOWN)
        return found

    def check(self, target: TableAddress) -> None:
        """Whether there is such a table. Raises PlcFault (9)."""
        self.axis(target.axis)
        tables = range(self.tables) if target.kind == CEC else self.axes
        kinds = (EEC, CEC, BACKLASH_KIND, TEMPERATURE)
        if target.kind not in kinds or target.index not in tables or target.encoder not in (0, 1):
            raise PlcFault(UNKNOWN)

    def reserved(self, target: TableAddress) -> int:
        """Points the control has room for."""
        if target.kind in (BACKLASH_KIND, TEMPERATURE):
            return 1 if target.kind == BACKLASH_KIND else 3
        if target.kind == CEC:
            return self._number(f"$MN_MM_CEC_MAX_POINTS[{target.index}]")
        return self._number(f"$MA_MM_ENC_COMP_MAX_POINTS[{target.encoder},{self._name(target)}]")

    # -- state -------------------------------------------------------------------------------------

    @property
    def ready(self) -> bool:
        """Whether the NCK can be reached."""
        return not self._nck.booting

    @property
    def in_reset(self) -> bool:
        """Channel in reset, nothing running."""
        return self.ready and self._nck.channel_status == 0

    @property
    def standstill(self) -> bool:
        """Whether no axis moves."""
        return all(self.stands(number) for number in self.axes)

    def stands(self, number: int) -> bool:
        """Whether one axis stands (in position, coarse or fine)."""
        axis = self._nck.core.axis(self.axis(number).name)
        return axis.state(self._nck.core.clock.now()) in (3, 4)

    @property
    def referenced(self) -> bool:
        """Whether all axes are referenced."""
        return all(axis.referenced for axis in self._nck.core.axes)

    def referenced_by(self, number: int, encoder: int) -> bool:
        """Whether one measuring system of an axis is referenced, the acting one or not."""
        return self._nck.core.axis(self.axis(number).name).encoders_referenced[encoder]

    @property
    def first_alarm(self) -> int:
        """Number of the alarm shown first, 0 for none."""
        alarms = self._nck.alarms
        return alarms[0].number if alarms else 0

    # -- points ------------------------------------------------------------------------------------

    def points(self, target: TableAddress, first: int, count: int) -> list[int]:
        """Points from the NCK, rounded to the unit. Raises PlcFault (4: does not fit, 11)."""
        with _translate_refusals():
            found = [
                round(float(self._nck.get(self._point(target, place))) * self._point_scale(target, place))
                for place in range(first, first + count)
            ]
        if any(not DINT_LOW <= value <= DINT_HIGH for value in found):
            raise PlcFault(RANGE)
        return found

    def put_point(self, target: TableAddress, place: int, value: int, *, float32: bool = False) -> None:
        """Write one point. Raises PlcFault (7, 8, 11)."""
        plain = value / self._point_scale(target, place)
        with _translate_refusals():
            self._write(self._point(target, place), float(np.float32(plain)) if float32 else plain)

    def _point(self, target: TableAddress, place: int) -> str:
        if target.kind == CEC:
            return f"$AN_CEC[{target.index},{place}]"
        name = self._name(target)
        if target.kind == BACKLASH_KIND:
            return f"$MA_BACKLASH[{target.encoder},{name}]"
        if target.kind == TEMPERATURE:
            return f"{_TEMPERATURE_NAMES[place]}[{name}]"
        return f"$AA_ENC_COMP[{target.encoder},{place},{name}]"

    def _point_scale(self, target: TableAddress, place: int) -> float:
        rotary = self.axis(target.axis).rotary
        if target.kind == TEMPERATURE and place > 0:
            return _SLOPE if place == 1 else _POSITION[rotary]
        return _VALUE[rotary]

    # -- parameters --------------------------------------------------------------------------------

    def parameters(self, target: TableAddress) -> TableParameters:
        """An EEC or CEC table's parameters; MIN, STEP and MAX are 0 where they are no whole units."""
        inner = self._axis_number(target, "INPUT_AXIS")
        outer = self._axis_number(target, "OUTPUT_AXIS")
        scale = _POSITION[self.axis(inner).rotary if inner else False]
        places = [float(self._nck.get(self._part(target, part))) * scale for part in ("MIN", "STEP", "MAX")]
        # float noise of the conversion is far below, single precision far above this limit
        odd = any(abs(place - round(place)) > 1e-6 or abs(place) > DINT_HIGH for place in places)
        minimum, step, maximum = (0, 0, 0) if odd else (round(place) for place in places)
        flags = self._flags(target) | odd * INEXPRESSIBLE
        factor = self._number(self._part(target, "MULT_BY_TABLE")) if target.kind == CEC else 0
        axes = {"input_axis": inner, "output_axis": outer, "factor": factor}
        return TableParameters(flags, minimum=minimum, step=step, maximum=maximum, **axes)

    def _flags(self, target: TableAddress) -> int:
        flags = int(bool(self._nck.get(self._part(target, "IS_MODULO"))))
        if target.kind == CEC:
            flags |= self._number(self._part(target, "DIRECTION")) % 3 << 1
            flags |= self._number(self._part(target, "TYPE")) << 3
        return flags

    def put_parameters(self, target: TableAddress, wanted: TableParameters) -> None:
        """Write them all. Raises PlcFault (7, 11)."""
        places = {"MIN": wanted.minimum, "STEP": wanted.step, "MAX": wanted.maximum}
        scale = _POSITION[self.axis(wanted.input_axis).rotary]
        values: dict[str, bool | int | float | str] = {part: place / scale for part, place in places.items()}
        values["IS_MODULO"] = wanted.flags & 1
        if target.kind == CEC:
            values["INPUT_AXIS"] = self.axis(wanted.input_axis).name
            values["OUTPUT_AXIS"] = self.axis(wanted.output_axis).name
            values["DIRECTION"] = (0, 1, -1)[wanted.flags >> 1 & 3]
            values["TYPE"] = wanted.flags >> 3 & 1
            values["MULT_BY_TABLE"] = wanted.factor
        with _translate_refusals():
            for part, value in values.items():
                self._write(self._part(target, part), value)

    def _part(self, target: TableAddress, part: str) -> str:
        if target.kind == CEC:
            return f"$AN_CEC_{part}[{target.index}]"
        return f"$AA_ENC_COMP_{part}[{target.encoder},{self._name(target)}]"

    def _axis_number(self, target: TableAddress, part: str) -> int:
        if target.kind != CEC:
            return target.index
        name = str(self._nck.get(self._part(target, part)))
        return next((number for number, axis in self.axes.items() if axis.name == name), 0)

    # -- switches ----------------------------------------------------------------------------------

    def switches(self, target: TableAddress) -> int:
        """b0 EEC of axis and encoder, b1 CEC of the axis, b2 the CEC table, b3 a backlash that is not 0."""
        name = self._name(target)
        eec = bool(self._nck.get(f"$MA_ENC_COMP_ENABLE[{target.encoder},{name}]"))
        cec = bool(self._nck.get(f"$MA_CEC_ENABLE[{name}]"))
        table = target.kind == CEC and bool(self._nck.get(f"$SN_CEC_TABLE_ENABLE[{target.index}]"))
        return eec | cec << 1 | table << 2 | bool(self.backlash(target)) << 3

    def is_off(self, target: TableAddress) -> bool:
        """Whether the table may be written: no switch of it is on, for CEC neither its own nor an output axis's."""
        if target.kind == EEC:
            return not self.switches(target) & 1
        if target.kind == BACKLASH_KIND:
            return not self.backlash(target)
        axes = {target.axis, self._axis_number(target, "OUTPUT_AXIS")} - {0}
        table = bool(self._nck.get(f"$SN_CEC_TABLE_ENABLE[{target.index}]"))
        return not table and not any(self._nck.get(f"$MA_CEC_ENABLE[{self.axis(number).name}]") for number in axes)

    def switch(self, target: TableAddress, *, on: bool, axis_alone: bool = False, table_alone: bool = False) -> None:
        """Switch a table; it acts with `activate_switches`. Raises PlcFault (11)."""
        name = self._name(target)
        with _translate_refusals():
            if target.kind == EEC:
                self._write(f"$MA_ENC_COMP_ENABLE[{target.encoder},{name}]", on)
                return
            if not axis_alone:
                self._switch_table(target.index, on)
            if not table_alone:
                self._write(f"$MA_CEC_ENABLE[{name}]", on)

    def set_backlash(self, target: TableAddress, value: int) -> None:
        """MD32450 of an axis and measuring system, in value units. Raises PlcFault (11)."""
        self.put_point(target, 0, value)

    def backlash(self, target: TableAddress) -> int:
        """MD32450 of an axis and measuring system, in value units."""
        return self.value(f"$MA_BACKLASH[{target.encoder},", target.axis)

    def activate_switches(self) -> None:
        """NEWCONF. Raises PlcFault (11)."""
        with _translate_refusals():
            self._nck.core.newconf()

    def _switch_table(self, table: int, on: bool) -> None:
        if on:
            self._write(f"$SN_CEC_TABLE_WEIGHT[{table}]", 1.0)
        self._write(f"$SN_CEC_TABLE_ENABLE[{table}]", on)

    # -- what acts ---------------------------------------------------------------------------------

    def value(self, name: str, axis: int, *, position: bool = False) -> int:
        """A system variable or datum of an axis, ``name`` without its axis, in value or position units."""
        spec = self.axis(axis)
        plain = float(self._nck.get(f"{name}{spec.name}]"))
        return min(max(round(plain * (_POSITION if position else _VALUE)[spec.rotary]), DINT_LOW), DINT_HIGH)

    def encoders(self, axis: int) -> int:
        """MD30200: how many measuring systems the axis has."""
        return self._number(f"$MA_NUM_ENCS[{self.axis(axis).name}]")

    def acts_by(self, axis: int, encoder: int) -> bool:
        """Whether the axis is controlled by this measuring system now."""
        return self._nck.core.axis(self.axis(axis).name).active_encoder == encoder

    def backlash_factor(self, axis: int) -> int:
        """MD32452 of the first parameter set, times 1 000 000."""
        return round(float(self._nck.get(f"$MA_BACKLASH_FACTOR[0,{self.axis(axis).name}]")) * 1e6)

    def weight(self, target: TableAddress) -> int:
        """SD41310 of a CEC table times 1 000 000, 0 for other kinds."""
        if target.kind != CEC:
            return 0
        return round(float(self._nck.get(f"$SN_CEC_TABLE_WEIGHT[{target.index}]")) * 1e6)

    def _name(self, target: TableAddress) -> str:
        return self.axis(target.axis).name

    def _number(self, name: str) -> int:
        return round(float(self._nck.get(name)))

    def _write(self, name: str, value: bool | int | float | str) -> None:
        if self._nck.booting:
            raise PlcFault(TIME_OVER)
        self._nck.set(name, value, self._level)
