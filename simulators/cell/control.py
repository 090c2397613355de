"""The cell's control: made from the cell file, loaded with the builder's tables, seen as panel and as truth."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.units import deviation_scale
from simulators.cellfile import CellAxis, CellFile, LoadedAxisTable, LoadedCrossTable, LoadedTable
from simulators.nck import OPEN, AxisSpec, Nck, NckRefusal, NckSpec
from simulators.truth import Truth, curve, generator

MAKER = 0
DECIMALS = 6


def load_builder_tables(nck: Nck, cell: CellFile, seed: int) -> None:
    """Load every table that the cell file names, and switch on what it says is on. Raises NckRefusal."""
    for axis in cell.axes:
        if axis.loaded is not None:
            _own(nck, axis, axis.loaded, seed)
    for number, cross in enumerate(cell.machine.cross):
        _cross(nck, cell, number, cross=cross, seed=seed)


def _own(nck: Nck, axis: CellAxis, table: LoadedAxisTable, seed: int) -> None:
    tail = f"{axis.encoder},{axis.name}"
    for place, value in _points(table, axis, axis, seed).items():
        nck.set(f"$AA_ENC_COMP[{axis.encoder},{place},{axis.name}]", value, MAKER)
    for part, number in _grid(table).items():
        nck.set(f"$AA_ENC_COMP_{part}[{tail}]", number, MAKER)
    nck.set(f"$AA_ENC_COMP_IS_MODULO[{tail}]", table.modulo, MAKER)
    nck.set(f"$MA_ENC_COMP_ENABLE[{tail}]", table.enabled, MAKER)


def _cross(nck: Nck, cell: CellFile, number: int, *, cross: LoadedCrossTable, seed: int) -> None:
    source, output = cell.axis(cross.input), cell.axis(cross.output)
    nck.set(f"$MA_CEC_ENABLE[{output.name}]", False, MAKER)
    for place, value in _points(cross, source, output, seed).items():
        nck.set(f"$AN_CEC[{number},{place}]", value, MAKER)
    for part, figure in _grid(cross).items():
        nck.set(f"$AN_CEC_{part}[{number}]", figure, MAKER)
    nck.set(f"$AN_CEC_INPUT_AXIS[{number}]", source.name, MAKER)
    nck.set(f"$AN_CEC_OUTPUT_AXIS[{number}]", output.name, MAKER)
    nck.set(f"$AN_CEC_DIRECTION[{number}]", cross.direction, MAKER)
    nck.set(f"$SN_CEC_TABLE_ENABLE[{number}]", cross.enabled, MAKER)
    on = any(one.enabled and one.output == cross.output for one in cell.machine.cross[: number + 1])
    nck.set(f"$MA_CEC_ENABLE[{output.name}]", on, MAKER)


def _points(table: LoadedTable, source: CellAxis, output: CellAxis, seed: int) -> dict[int, float]:
    """Values in mm or deg of the output axis, by point, without the gaps."""
    count = int((table.maximum - table.minimum) / table.step + 1e-9) + 1
    places = table.minimum + table.step * np.arange(count, dtype=np.float64)
    name = f"loaded {output.name} {source.name}"
    drawn = curve(table.values, source.travel, rotary=source.kind == "rotary", seed=seed, name=name, redraw=False)(
        places
    )
    scale = deviation_scale("deg" if output.kind == "rotary" else "mm")
    return {k: round(float(v) / scale, DECIMALS) for k, v in enumerate(drawn) if k not in table.gaps}


def _grid(table: LoadedTable) -> dict[str, float]:
    return {"STEP": table.step, "MIN": table.minimum, "MAX": table.maximum}


# The control itself.

FloatArray = NDArray[np.float64]


def spec_of(cell: CellFile, seed: int) -> NckSpec:
    """The NCK's spec; the sign of CEC is drawn by the seed unless the cell file names it.

    So is every open switch (`simulators.nck.switches.OPEN`) that says "seed". Raises ConfigError (E-CELL-VALUE).
    """
    machine = cell.machine
    drawn = int(generator(seed, "cec sign").choice((-1, 1)))
    axes = tuple(
        AxisSpec(
            name=axis.name,
            letter=axis.letter,
            rotary=axis.kind == "rotary",
            modulo=axis.modulo,
            travel=axis.travel,
            reference=axis.reference,
            max_velocity=axis.max_velocity,
            servo_time_s=axis.servo_time_s,
            eec_points=axis.eec_points,
            absolute_encoder=axis.absolute_encoder,
            encoder=axis.encoder,
            number=axis.number,
        )
        for axis in cell.axes
    )
    known: dict[str, Any] = {
        "axes": axes,
        "serial": machine.serial,
        "nck_version": machine.nck_version,
        "access_level": machine.access_level,
        "cec_sign": drawn if machine.cec_sign == "seed" else machine.cec_sign,
        "cec_points": machine.cec_points,
        "dresser": next((axis.name for axis in cell.axes if axis.letter == cell.wheel.dresser), ""),
    }
    chosen = {name: _chosen_switches(cell, seed, name, value) for name, value in machine.switches.items()}
    try:
        return NckSpec(**(known | chosen))
    except ValueError as error:
        raise ConfigError("E-CELL-VALUE", cell.name, key="machine.switches", why=str(error)) from error


def _chosen_switches(cell: CellFile, seed: int, name: str, value: Any) -> Any:
    """A switch of the NCK as the cell file has it; "seed" draws an open one. Raises ConfigError (E-CELL-VALUE)."""
    key = f"machine.switches.{name}"
    if name not in {entry.name for entry in fields(NckSpec)}:
        raise ConfigError("E-CELL-VALUE", cell.name, key=key, why="the NCK double has no such switch")
    if value == "seed":
        if name not in OPEN:
            raise ConfigError("E-CELL-VALUE", cell.name, key=key, why="only an open switch is drawn by the seed")
        return OPEN[name][int(generator(seed, key).integers(len(OPEN[name])))]
    return (
        tuple(tuple(item) if isinstance(item, list) else item for item in value) if isinstance(value, list) else value
    )


class CellNck(Nck):
    """The NCK of a cell: counts selections, and can be asked where an axis would stand."""

    def __init__(self, spec: NckSpec, clock: Clock) -> None:
        super().__init__(spec, clock)
        self.selections = 0

    def select(self, path: str, channel: int = 1) -> int:
        """Select a program, and count it for the operator, who sees the screen change."""
        answer = super().select(path, channel)
        self.selections += answer == 0
        return answer

    def jog(self, axis: str, position: float) -> float:
        """Move one axis in JOG to a position; seconds it takes.

        Raises NckRefusal 10720 beyond the software limits, 0 while a program runs or the control starts.
        """
        found = self.core.axis(axis)
        if self.booting or self.channel_status != 0 or not self.set_mode("JOG"):
            raise NckRefusal(0, "the channel is not in reset")
        target = float(position)
        if found.spec.modulo:
            target += 360.0 * round((found.end_point - target) / 360.0)
        self.core.check_travel(found.index, target)
        return self.core.move({found.index: target}, None)

    def compensated_encoder(self, axis: str, positions: FloatArray, direction: int) -> FloatArray:
        """Encoder positions (n,) if the axis stood at these commanded positions; nothing moves."""
        return self.core.standing(self.core.axis(axis).index, positions, direction)


class ControlPanel:
    """What the operator sees of an NCK, and the buttons."""

    def __init__(self, nck: CellNck) -> None:
        self._nck = nck

    @property
    def channel_status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        return int(self._nck.channel_status)

    @property
    def message(self) -> str:
        """The MSG line."""
        return str(self._nck.message)

    @property
    def selections(self) -> int:
        """How many programs have been selected so far."""
        return int(self._nck.selections)

    @property
    def selected(self) -> str:
        """The program on the screen."""
        return str(self._nck.selected)

    @property
    def in_alarm(self) -> bool:
        """Whether an alarm stands that RESET clears."""
        return any(alarm.clear == "reset" for alarm in self._nck.alarms)

    def select(self, path: str) -> bool:
        """Select a program; False when the control does not take it now."""
        return self._nck.select(path, 1) == 0

    def nc_start(self) -> None:
        """The green button."""
        self._nck.nc_start()

    def channel_reset(self) -> None:
        """The reset button."""
        self._nck.channel_reset()

    def nck_reset(self) -> None:
        """Restart the NCK."""
        self._nck.nck_reset()

    @property
    def ready(self) -> bool:
        """False while the NCK starts."""
        return not self._nck.booting

    def referenced(self, name: str) -> bool:
        """Whether the screen shows the axis as referenced."""
        return bool(self._nck.axis_state(name).referenced)

    def reference_axis(self, name: str) -> None:
        """Reference run of one axis."""
        self._nck.reference_axis(name)

    def jog(self, name: str, position: float) -> float:
        """Move one axis by the direction keys; seconds until it is there. Raises NckRefusal."""
        return self._nck.jog(name, position)

    def set_mode(self, mode: str) -> None:
        """AUTO, JOG or MDA."""
        self._nck.set_mode(cast(Literal["AUTO", "JOG", "MDA"], mode))  # the control refuses any other word itself


def live_deviation(
    truth: Truth, nck: CellNck, axis: str, positions: FloatArray, direction: int, t: float
) -> FloatArray:
    """True position - commanded, with what compensates in the NCK right now; um or arcsec, at 20 degC.

    Pure: nothing moves. `positions` (n,) are commanded machine coordinates, approached in `direction`.
    """
    spec = truth.cell.axis(axis)
    wanted = np.asarray(positions, dtype=np.float64)
    encoder = np.asarray(nck.compensated_encoder(spec.name, wanted, direction), dtype=np.float64)
    scale = deviation_scale("deg" if spec.kind == "rotary" else "mm")
    return (encoder - wanted) * scale + truth.deviation(spec.name, encoder, direction, t)


def with_serial_number(nck: CellNck, serial: str) -> None:
    """Make the control answer with another serial number, as after an exchanged card."""
    nck.spec = replace(nck.spec, card_exchanged=serial)
