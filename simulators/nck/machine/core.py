"""The control's machine: axes, data and compensation memory, which of it acts at a moment, and what survives power off.

Order of the signal path: CEC and temperature are additional setpoints, EEC and backlash act on the actual
value (K3 pp. 234-248). Nothing acts on an axis that is not referenced. Table content acts from the moment that
`Switches.activation` says; until then memory and what acts differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from simulators.nck.machine.axis import AxisView, MachineAxis
from simulators.nck.machine.compensation import Curve, Table, TableMemory, shift_curve
from simulators.nck.machine.data import (
    CEC_ENABLE,
    CEC_POINTS,
    EEC_POINTS,
    ENC_ENABLE,
    ENC_STATE,
    AlarmList,
    MachineData,
)
from simulators.nck.machine.files import FileSystem
from simulators.nck.machine.setpoints import Setpoints
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
        self.gud = self._empty_gud()
        self.memory = self._empty_memory()
        self._names: dict[str, int] = {}
        for place, axis in enumerate(spec.axes):
            for name in (axis.name.upper(), f"AX{spec.numbers[place]}"):
                self._names.setdefault(name, place)
        self._letters = {axis.letter.upper(): place for place, axis in enumerate(spec.axes)}
        self.axes = [MachineAxis(axis, place, 0.0) for place, axis in enumerate(spec.axes)]
        self.on_injected_fault: Callable[[str], None] = lambda _kind: None
        self.injected_faults: list[str] = []
        self.wheel_runs = False
        self._started = False
        self._eec: dict[tuple[int, int], Curve | None] = {}
        self._shifted: dict[tuple[int, int, bool], Curve | None] = {}
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
        """The tables in memory become those that act (see `Switches.activation`)."""
        self.memory.settle(self.clock.now())
        if self.spec.shortened_max_is_stored:
            self.memory.shorten(self.spec.uneven_step)
        acting = self.memory.copied()
        uneven = self.spec.uneven_step
        self._eec = {key: table.curve(uneven, self.data.unit(key[0])) for key, table in acting.eec.items()}
        self._shifted.clear()
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
        if self.spec.acts_from == "newconf":
            self.load_tables()
        self.refresh()

    def channel_data_reset(self) -> None:
        """Channel reset: data of the class RESET act, and those of NEWCONF."""
        self.data.activate("reset")
        self.newconf()

    def boot(self, *, power_on: bool = True) -> bool:
        """NCK start: everything stored acts, references are lost. Returns whether buffered memory was lost."""
        lost = self.data.memory_changed()
        if lost:
            self._rebuild_memory()
        if self.spec.enable_cleared_at_boot:
            self._clear_enables()
        converted = self.data.boot()
        if converted is not None:
            self.memory.convert(converted, [axis.spec.rotary for axis in self.axes])
        for axis in self.axes:
            self._boot_axis(axis, lost)
        self._exchange_points()
        if power_on or self.spec.acts_from != "power_on" or lost:
            self.load_tables()
        self.refresh()
        return lost

    def record_fault(self, kind: str) -> None:
        """Keep that the control does something by itself, before it does it."""
        self.injected_faults.append(kind)
        self.on_injected_fault(kind)

    def _exchange_points(self) -> None:
        """`Switches.swaps_points_at_reset`, at every start but the first."""
        started, self._started = self._started, True
        place = self.spec.swaps_points_at_reset
        if place is None or not started:
            return
        self.record_fault("swap")
        tables: list[Table] = [*self.memory.eec.values(), *self.memory.cec]
        for table in tables:
            if table.step > 0.0 and len(table.points) > place + 1:
                points = table.points
                points[place], points[place + 1] = points[place + 1], points[place]

    def _boot_axis(self, axis: MachineAxis, lost: bool) -> None:
        for encoder in (0, 1):
            adjusted = self.data.stored(ENC_STATE, encoder, axis.index) == 2 and not lost
            axis.encoders_referenced[encoder] = axis.spec.absolute_encoder and adjusted
        axis.moved = False
        axis.backlash.dynamic_on = False
        if not int(self.data.effective("$MA_BACKLASH_MODE", axis.active_encoder, axis.index)) & 1:
            axis.backlash.forget_direction()

    def _rebuild_memory(self) -> None:
        if self._layout_bytes() > self.spec.table_memory_bytes:
            self.alarms.raise_(6000, "memory allocation made with standard machine data")
            self.data.restore_layout(MachineData(self.spec).booted)
        self.alarms.raise_(6020, "machine data changed: memory reallocated, buffered data lost")
        self.memory = self._empty_memory()
        self.r = [0.0] * self.spec.r_count
        self.gud = self._empty_gud()

    def _empty_gud(self) -> dict[str, list[float]]:
        return {name.upper(): [0.0] * count for name, count in self.spec.gud}

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
        axis.moved = True
        axis.backlash.take_up(sign, self._setpoints.take_up(index), now)
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
            encoder = axis.active_encoder
            enabled = axis.referenced and bool(self.data.effective(ENC_ENABLE, encoder, axis.index))
            axis.curve_offset = axis.spec.encoder2_offset * encoder
            axis.compensate(self._curve(axis.index, encoder, enabled, axis.curve_offset), now)
            axis.backlash.take_up(0, self._setpoints.take_up(axis.index), now)
        self._setpoints.plan(now)

    def _curve(self, index: int, encoder: int, enabled: bool, offset: float) -> Curve | None:
        # One object for one state: the axis compares what acts by identity.
        key = (index, encoder, enabled)
        if key not in self._shifted:
            self._shifted[key] = shift_curve(self._eec[index, encoder] if enabled else None, offset)
        return self._shifted[key]

    def select_encoder(self, index: int, encoder: int) -> bool:
        """The PLC asks for a measuring system; refused with alarm 25100 when the two are too far apart."""
        axis = self.axes[index]
        if encoder >= self.data.effective("$MA_NUM_ENCS", index) or encoder < 0:
            return False
        difference = self._shown_more(index, encoder) - self._shown_more(index, axis.active_encoder)
        compared = axis.encoders_referenced[0] and axis.encoders_referenced[1]
        if compared and abs(difference) > self.data.effective("$MA_ENC_CHANGE_TOL", index):
            self.alarms.raise_(25100, f"axis {axis.spec.name}: measuring system switchover not possible")
            return False
        axis.active_encoder = encoder
        self.refresh()
        return True

    def _shown_more(self, index: int, encoder: int) -> float:
        """What an encoder's actual value, with its table, is more than encoder 1's bare one."""
        return self.eec_value(index, encoder) + self.axes[index].spec.encoder2_offset * encoder

    def eec_value(self, index: int, encoder: int) -> float:
        """What the table of an encoder gives at the axis's place in mm or deg, 0 when it does not act."""
        axis, now = self.axes[index], self.clock.now()
        if encoder == axis.active_encoder:
            return axis.table_value(now)
        acts = axis.encoders_referenced[encoder] and self.data.effective(ENC_ENABLE, encoder, index)
        curve = self._eec[index, encoder] if acts else None
        return curve.one(float(axis.actuals(np.array([now]))[0])) if curve is not None else 0.0

    def cec_value(self, index: int) -> float:
        """The sum of tables acting on an axis now in mm or deg, in the tables' sign."""
        return -self.spec.cec_sign * self.axes[index].additional.demand(self.clock.now()) + 0.0

    def standing(self, index: int, positions: Array, direction: int) -> Array:
        """Encoder positions (n,) if the axis stood at these base setpoints, come to in this direction.

        With what acts now, other axes where they are; nothing moves. Temperature compensation left out.
        """
        axis = self.axes[index]
        wanted = np.asarray(positions, dtype=np.float64)
        actual = wanted + self._setpoints.standing(axis, wanted, direction, self.clock.now())
        table = axis.curve.at(actual) if axis.curve is not None else 0.0
        return actual - table + self._setpoints.take_up(index).total(direction)

    def view(self, index: int) -> AxisView:
        """An axis as it is now."""
        return self.axes[index].view(self.clock.now(), self.cec_value(index), self.data.unit(index))


# Static memory, as plain values for a file. Tables, machine and setting data, R parameters, global user data and
# program files survive power off; references of incremental encoders, the mode and the running program do not.

FORMAT = 1


def save_static_memory(core: Core, files: FileSystem, selected: str) -> dict[str, Any]:
    """The content of static memory; fit for JSON."""
    return {
        "format": FORMAT,
        "axes": [axis.name for axis in core.spec.axes],
        "data": core.data.saved(),
        "tables": core.memory.saved(),
        "r": list(core.r),
        "gud": {name: list(values) for name, values in core.gud.items()},
        "files": files.saved(),
        "selected": selected,
    }


def restore_static_memory(content: dict[str, Any], core: Core, files: FileSystem) -> str:
    """Fill static memory before the control is switched on; returns the selected program.

    Raises ValueError for the memory of another control or another format.
    """
    if content.get("format") != FORMAT or content.get("axes") != [axis.name for axis in core.spec.axes]:
        raise ValueError("this static memory belongs to another control")
    core.data.restore(content["data"])
    core.memory.restore(content["tables"])
    core.r[:] = content["r"]
    core.gud.update({name: list(values) for name, values in content["gud"].items()})
    files.restore(content["files"])
    return str(content["selected"])
