"""The NCK double of a cell: made from the cell file, and seen as the operator's panel and as the truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.units import deviation_scale
from simulators.cellfile import CellFile
from simulators.nck.machine import AxisSpec, Nck, NckSpec
from simulators.truth import Truth, generator

FloatArray = NDArray[np.float64]


def spec_of(cell: CellFile, seed: int) -> NckSpec:
    """The NCK's spec; the sign of CEC is drawn by the seed unless the cell file names it."""
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
    }
    return NckSpec(**(known | machine.switches))


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

    def r_parameter(self, number: int) -> float:
        """An R parameter as the screen shows it."""
        return float(self._nck.get(f"R[{number}]"))

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


def with_serial(nck: CellNck, serial: str) -> None:
    """Make the control answer with another serial number, as after an exchanged NCU."""
    nck.spec = replace(nck.spec, serial=serial)
