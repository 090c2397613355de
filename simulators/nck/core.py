"""The control's machine: axes, data and compensation memory, and which of it acts at a moment.

Order of the signal path: CEC and temperature are additional setpoints, EEC and backlash act on the actual
value (K3 pp. 234-248). Nothing acts on an axis that is not referenced.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from simulators.nck.alarms import AlarmList
from simulators.nck.axis import AxisView, MachineAxis
from simulators.nck.compensation import Curve
from simulators.nck.machine_data import CEC_ENABLE, CEC_POINTS, EEC_POINTS, ENC_ENABLE, MachineData
from simulators.nck.memory import TableMemory
from simulators.nck.setpoints import Setpoints
from simulators.nck.spec import NckRefusal, NckSpec

Array = NDArray[np.float64]

_BYTES_A_POINT = 8
_TINY = 1e-9


class Core:
    """Axes in motion and the compensations acting on them."""

    def __init__(self, spec: NckSpec, clock: Clock) -> None:
        self.spec = spec
        self.clock = clock
        self.alarms = AlarmList()
        self.access_level = spec.access_level
        self.override_percent = 100.0
        self.data = MachineData(spec)
        self.r = [0.0] * spec.r_count
        self.memory = self._empty_memory()
        self._names: dict[str, int] = {}
        for place, axis in enumerate(spec.axes):
            for name in (axis.name.upper(), f"AX{place + 1}"):
                self._names.setdefault(name, place)
        self._letters = {axis.letter.upper(): place for place, axis in enumerate(spec.axes)}
        self.axes = [MachineAxis(axis, place, 0.0) for place, axis in enumerate(spec.axes)]
        self._eec: dict[tuple[int, int], Curve | None] = {}
        self._setpoints = Setpoints(spec, self.data, self.alarms, self.axes)
        self.load_tables()

    # -- names -------------------------------------------------------------------------------------

    def axis_index(self, name: str, *, machine_only: bool = False) -> int | None:
        """Index of an axis by machine name, AXn, or (unless ``machine_only``) channel letter."""
        upper = name.upper()
        found = self._names.get(upper)
        return found if found is not None or machine_only else self._letters.get(upper)

    def axis(self, name: str) -> MachineAxis:
        """An axis by any of its names. Raises NckRefusal 12550."""
        found = self.axis_index(name)
        if found is None:
            raise NckRefusal(12550, f"axis {name} unknown")
        return self.axes[found]

    # -- what acts ---------------------------------------------------------------------------------

    def load_tables(self) -> None:
        """The tables in memory become those that act (boot, or NEWCONF where activation is not strict)."""
        acting = self.memory.copied()
        self._eec = {key: table.curve() for key, table in acting.eec.items()}
        self._setpoints.load(acting.cec)

    def newconf(self) -> None:
        """NEWCONF: machine data of that class act; table content too where activation is not strict."""
        keep = frozenset(
            (ENC_ENABLE, (encoder, axis.index))
            for axis in self.axes
            for encoder in (0, 1)
            if self.spec.lies_about_disable and self.data.effective(ENC_ENABLE, encoder, axis.index)
        )
        self.data.activate("newconf", keep=keep)
        if not self.spec.strict_activation:
            self.load_tables()
        self.refresh()

    def channel_data_reset(self) -> None:
        """Channel reset: data of the class RESET act, and those of NEWCONF."""
        self.data.activate("reset")
        self.newconf()

    def boot(self) -> bool:
        """NCK start: everything stored acts, references are lost. Returns whether buffered memory was lost."""
        lost = self.data.memory_changed()
        if lost:
            self._rebuild_memory()
        if self.spec.enable_cleared_at_boot:
            self._clear_enables()
        self.data.boot()
        for axis in self.axes:
            axis.referenced = axis.spec.absolute_encoder and axis.referenced and not lost
        self.load_tables()
        self.refresh()
        return lost

    def _rebuild_memory(self) -> None:
        if self._layout_bytes() > self.spec.table_memory_bytes:
            self.alarms.raise_(6000, "memory allocation made with standard machine data")
            self.data.restore_layout(MachineData(self.spec).booted)
        self.alarms.raise_(6020, "machine data changed: memory reallocated, buffered data lost")
        self.memory = self._empty_memory()
        self.r = [0.0] * self.spec.r_count

    def _clear_enables(self) -> None:
        for axis in self.axes:
            self.data.store(CEC_ENABLE, (axis.index,), value=False)
            for encoder in (0, 1):
                self.data.store(ENC_ENABLE, (encoder, axis.index), value=False)

    def _empty_memory(self) -> TableMemory:
        eec = {
            (place, encoder): int(self.data.stored(EEC_POINTS, encoder, place))
            for place in range(len(self.spec.axes))
            for encoder in (0, 1)
        }
        cec = [int(self.data.stored(CEC_POINTS, table)) for table in range(len(self.spec.cec_points))]
        return TableMemory.empty(eec, cec, self.spec.float32_tables)

    def _layout_bytes(self) -> int:
        fresh = self._empty_memory()
        points = sum(len(table.points) for table in fresh.eec.values())
        points += sum(len(table.points) for table in fresh.cec)
        return points * _BYTES_A_POINT

    # -- motion ------------------------------------------------------------------------------------

    def move(self, targets: Mapping[int, float], rate: float | None) -> float:
        """Start a straight move of the base setpoints; returns its duration in s.

        ``targets`` by axis index, turns unlimited; ``rate`` in units per minute along the path, None: rapid.
        """
        now = self.clock.now()
        distances = {index: target - self.axes[index].end_point for index, target in targets.items()}
        seconds = self._duration(distances, rate)
        for index, distance in distances.items():
            if distance != 0.0:
                self._set_off(index, targets[index], 1 if distance > 0.0 else -1, seconds)
        self._setpoints.plan(now)
        return seconds

    def _set_off(self, index: int, target: float, sign: int, seconds: float) -> None:
        now = self.clock.now()
        axis = self.axes[index]
        axis.travel.turn(now, sign)
        axis.take_up(sign, self._setpoints.half_backlash(index), now)
        axis.travel_to(target, seconds, now)

    def _duration(self, distances: Mapping[int, float], rate: float | None) -> float:
        override = self.override_percent / 100.0
        limits = [
            abs(distance) / (self.data.effective("$MA_MAX_AX_VELO", index) / 60.0)
            for index, distance in distances.items()
        ]
        slowest = max(limits, default=0.0)
        if rate is None:
            return slowest / min(override, 1.0)
        linear = [d for index, d in distances.items() if not self.spec.axes[index].rotary]
        path = math.hypot(*linear) if any(linear) else math.hypot(*distances.values())
        return max(slowest, path / (rate * override / 60.0))

    def check_travel(self, index: int, target: float) -> None:
        """Raises NckRefusal 10720 when the target lies outside the software limits."""
        axis = self.axes[index].spec
        if axis.modulo:
            return
        low = self.data.effective("$MA_POS_LIMIT_MINUS", index)
        high = self.data.effective("$MA_POS_LIMIT_PLUS", index)
        if not low - _TINY <= target <= high + _TINY:
            raise NckRefusal(10720, f"{axis.name}: programmed end point {target:g} behind the software limit")

    def halt(self) -> None:
        """Stop all motion where it is."""
        now = self.clock.now()
        for axis in self.axes:
            axis.halt(now)
        self._setpoints.plan(now)

    # -- compensation ------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Work out anew what acts on each axis, from now on."""
        now = self.clock.now()
        for axis in self.axes:
            enabled = axis.referenced and self.data.effective(ENC_ENABLE, 0, axis.index)
            axis.compensate(self._eec[axis.index, 0] if enabled else None, now)
            axis.take_up(0, self._setpoints.half_backlash(axis.index), now)
        self._setpoints.plan(now)

    def eec_value(self, index: int, encoder: int) -> float:
        """What the table of an encoder gives at the axis's place, 0 when it does not act."""
        axis = self.axes[index]
        if encoder == 0:
            curve = axis.curve
        else:
            acts = axis.referenced and self.data.effective(ENC_ENABLE, encoder, index)
            curve = self._eec[index, encoder] if acts else None
        return curve.one(float(axis.actuals(np.array([self.clock.now()]))[0])) if curve is not None else 0.0

    def cec_value(self, index: int) -> float:
        """The sum of tables acting on an axis now, in the tables' sign."""
        return -self.spec.cec_sign * self.axes[index].additional.demand(self.clock.now()) + 0.0

    def standing(self, index: int, positions: Array, direction: int) -> Array:
        """Encoder positions (n,) if the axis stood at these base setpoints, come to in this direction.

        With what acts now, other axes where they are; nothing moves. Temperature compensation left out.
        """
        axis = self.axes[index]
        wanted = np.asarray(positions, dtype=np.float64)
        actual = wanted + self._setpoints.standing(axis, wanted, direction, self.clock.now())
        table = axis.curve.at(actual) if axis.curve is not None else 0.0
        return actual - table + direction * self._setpoints.half_backlash(index)

    def view(self, index: int) -> AxisView:
        """An axis as it is now."""
        return self.axes[index].view(self.clock.now(), self.cec_value(index))
