"""Additional setpoints: CEC sums and temperature, laid along the moves with their limits and alarms.

MD32720 limits the sum (20124), MD32730 its rate (20125, missing path made up later), MD32760 the rate of the
temperature compensation (no alarm). Sources: K3 pp. 228, 243-249; texts of MD32711 to MD32760.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulators.nck.machine.axis import MachineAxis, TakeUp
from simulators.nck.machine.compensation import CecTable, CrossTable, cross_path, cross_sum, follow
from simulators.nck.machine.data import CEC_ENABLE, INCH_MM, AlarmList, MachineData
from simulators.nck.spec import NckSpec

Array = NDArray[np.float64]

_TINY = 1e-9


class Setpoints:
    """What is added to the base setpoints of the axes."""

    def __init__(self, spec: NckSpec, data: MachineData, alarms: AlarmList, axes: Sequence[MachineAxis]) -> None:
        self._spec = spec
        self._data = data
        self._alarms = alarms
        self._axes = axes
        self._names = {axis.spec.name: axis.index for axis in axes}
        self._tables: Sequence[CecTable] = ()

    def load(self, tables: Sequence[CecTable]) -> None:
        """These table contents act from now on."""
        self._tables = tables

    def take_up(self, index: int) -> TakeUp:
        """How the backlash of an axis is taken up: MD32450 x MD32452, and MD32456; nothing unreferenced."""
        axis, data = self._axes[index], self._data
        if not axis.referenced:
            return TakeUp()
        encoder = axis.active_encoder
        lead = data.effective("$MA_BACKLASH", encoder, index) * data.effective("$MA_BACKLASH_FACTOR", 0, index)
        lead *= self._spec.backlash_sign
        plus, minus = (lead / 2.0, -lead / 2.0) if self._spec.encoder_lead_shared else (0.0, -lead)
        step = data.effective("$MA_ENC_CHANGE_TOL", index)
        dynamic = data.effective("$MA_BACKLASH_DYN", encoder, index) / 2.0 if axis.backlash.dynamic_on else 0.0
        velocity = data.effective("$MA_MAX_AX_VELO", index) / 60.0
        slowly = max(velocity * data.effective("$MA_BACKLASH_DYN_MAX_VELO", index) / 100.0, _TINY)
        rate = max(step / self._spec.ipo_cycle_s, _TINY)
        return TakeUp(plus, minus, step=step, rate=rate, dynamic=dynamic, dynamic_rate=slowly)

    def plan(self, now: float) -> None:
        """Lay the additional setpoints of all axes from now on, along the moves under way."""
        tables = self._cross_tables()
        for axis in self._axes:
            self._plan_cross(axis, tables, now)
            self._plan_temperature(axis, now)

    def standing(self, axis: MachineAxis, wanted: Array, direction: int, now: float) -> Array:
        """What CEC would add (n,) if the axis stood at ``wanted``, others where they are."""
        if not (self._data.effective(CEC_ENABLE, axis.index) and axis.referenced):
            return np.zeros_like(wanted)
        first = self._spec.cec_direction_at_start
        ways = {
            other.index: (
                np.full_like(wanted, other.base.demand(now)),
                self._standing_direction(other.travel.latest if other.moved else first),
            )
            for other in self._axes
        }
        ways[axis.index] = (wanted, self._standing_direction(direction))
        total = cross_sum(self._cross_tables(), axis.index, ways, self._spec.cec_factor_tables_count)
        largest = self._data.effective("$MA_CEC_MAX_SUM", axis.index)
        return -self._spec.cec_sign * np.clip(total, -largest, largest)

    def _standing_direction(self, direction: int) -> int:
        return direction if self._spec.cec_direction_at_standstill else 0

    def _cross_tables(self) -> dict[int, CrossTable]:
        found: dict[int, CrossTable] = {}
        for number, table in enumerate(self._tables):
            if not self._data.effective("$SN_CEC_TABLE_ENABLE", number):
                continue
            source = self._names.get(table.input_axis)
            output = self._names.get(table.output_axis)
            if source is None or output is None:
                continue
            ends = (self._data.effective("$SN_CEC_0", number), self._data.effective("$SN_CEC_1", number))
            units = {"unit": self._cec_unit(source, output), "value_unit": self._cec_unit(output, output)}
            curve = table.curve(ends, **units, uneven=self._spec.uneven_step)
            if curve is None:
                continue
            if self._axes[source].referenced and self._axes[output].referenced:
                weight = self._data.effective("$SN_CEC_TABLE_WEIGHT", number)
                factor = table.mult_by_table - 1 if table.mult_by_table > 0 else None
                found[number] = CrossTable(
                    curve, source, output, weight=weight, direction=table.direction, factor=factor
                )
        return found

    def _cec_unit(self, axis: int, output: int) -> float:
        """mm in one unit of a table's numbers: MD32711 of the compensation axis; deg stay deg."""
        metric = self._data.effective("$MA_CEC_SCALING_SYSTEM_METRIC", output)
        return 1.0 if metric or self._axes[axis].spec.rotary else INCH_MM

    def _plan_cross(self, axis: MachineAxis, tables: dict[int, CrossTable], now: float) -> None:
        index = axis.index
        acting = bool(self._data.effective(CEC_ENABLE, index)) and axis.referenced
        times, values = np.array([now]), np.array([0.0])
        if acting and tables:
            inputs = {table.input_axis for table in tables.values()}
            first, kept = self._spec.cec_direction_at_start, self._spec.cec_direction_at_standstill
            ways = {place: self._axes[place].way(now, first, kept=kept) for place in inputs}
            times, values = cross_path(tables, index, ways, self._spec.cec_factor_tables_count)
            values = self._limited(axis, values)
        current = axis.additional.demand(now)
        if not values.any() and current == 0.0 and axis.additional.final()[1] == 0.0:
            return
        limit = self._data.effective("$MA_CEC_MAX_VELO", index) / 100.0
        limit *= self._data.effective("$MA_MAX_AX_VELO", index) / 60.0
        signed = -self._spec.cec_sign * values
        pieces, held_back = follow(
            times, signed, current, limit=limit, step_limit=limit * self._spec.ipo_cycle_s + _TINY
        )
        if held_back:
            self._alarms.raise_(20125, f"axis {axis.spec.name}: rate of change of the CEC value too high")
        axis.additional.halt(now)
        for piece in pieces:
            axis.additional.add(*piece)
        self._reverse_by_compensation(axis, pieces, current, now)

    def _limited(self, axis: MachineAxis, values: Array) -> Array:
        largest = self._data.effective("$MA_CEC_MAX_SUM", axis.index)
        if np.any(np.abs(values) > largest):
            self._alarms.raise_(20124, f"axis {axis.spec.name}: sum of CEC values too high, limited")
        clipped: Array = np.clip(values, -largest, largest)
        return clipped

    def _reverse_by_compensation(
        self, axis: MachineAxis, pieces: list[tuple[float, float, float]], current: float, now: float
    ) -> None:
        """MD32454 bit 1 = 0: movements of the additional setpoint take up backlash too."""
        how = self.take_up(axis.index)
        deaf = int(self._data.effective("$MA_BACKLASH_MODE", axis.active_encoder, axis.index)) & 2
        if how.total(1) == how.total(-1) or deaf or not self._spec.backlash_reacts_to_cec:
            return
        axis.backlash.forget_plans(how, now)
        before, speed, since = current, 0.0, now
        for start, value, slope in pieces:
            jump = value - (before + speed * (start - since))
            moved = jump if abs(jump) > _TINY else slope + axis.base.slope(start)
            if abs(moved) > _TINY:
                axis.backlash.take_up(1 if moved > 0.0 else -1, how, start)
            before, speed, since = value, slope, start

    def _plan_temperature(self, axis: MachineAxis, now: float) -> None:
        index = axis.index
        kind = int(self._data.effective("$MA_TEMP_COMP_TYPE", index)) if axis.referenced else 0
        current = axis.temperature.demand(now)
        if kind == 0 and current == 0.0:
            return
        rate = self._data.effective("$MA_COMP_ADD_VELO_FACTOR", index)
        slope = self._data.effective("$SA_TEMP_COMP_SLOPE", index)
        slope = min(max(slope, -rate), rate) if kind & 2 else 0.0
        offset = self._data.effective("$SA_TEMP_COMP_ABS_VALUE", index) if kind & 1 else 0.0
        reference = self._data.effective("$SA_TEMP_COMP_REF_POSITION", index)
        way = axis.way(now)
        times = np.array([stretch.start_s for stretch in way])
        values = -(offset + slope * (np.array([stretch.position for stretch in way]) - reference))
        limit = rate * self._data.effective("$MA_MAX_AX_VELO", index) / 60.0
        pieces, _ = follow(times, values, current, limit=limit, step_limit=limit * self._spec.ipo_cycle_s)
        axis.temperature.halt(now)
        for piece in pieces:
            axis.temperature.add(*piece)
