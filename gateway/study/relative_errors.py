"""The six relative errors of wheel to work wherever a gear is ground, for people, programs and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um, rad_to_arcsec
from gateway.gear.first_order import ErrorParameter
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain, Frame, Positions
from gateway.model.frames import RELATIVE, relative_errors

HEIGHTS = 21
Row = tuple[str, ...]


@dataclass(frozen=True)
class RelativeSweep:
    """The six in um and arcsec, each (spaces, heights), at index positions ``turn`` (deg) and heights ``z`` (mm).

    ``missed`` is the largest difference of first order and exact, by name.
    """

    turn: FloatArray
    z: FloatArray
    values: Mapping[str, FloatArray]
    missed: Mapping[str, float]
    frame: Frame


def relative_sweep(grinding: Grinding, frame: Frame = "work", heights: int = HEIGHTS) -> RelativeSweep:
    """The relative errors of a machine in every space of a gear over its face."""
    z = np.linspace(-0.5, 0.5, heights) * grinding.gear.b
    k = np.arange(grinding.gear.zc)[:, None]
    q = grinding.commands(k, z)
    exact, first = (_displayed(relative_errors(grinding.chain, q, frame, order)) for order in ("exact", "first"))
    missed = {name: float(np.max(np.abs(exact[name] - first[name]))) for name in RELATIVE}
    turn = np.asarray(np.rad2deg(grinding.gear.space_angle(k[:, 0])))
    return RelativeSweep(turn=turn, z=z, values=exact, missed=missed, frame=frame)


def relative_u(
    chain: Chain, columns: Sequence[tuple[ErrorParameter | str, float]], q: Positions, frame: Frame = "work"
) -> FloatArray:
    """Standard uncertainty (..., 6) of the six, mm and rad, of columns of one standard uncertainty each (mm, rad).

    First order: each column alone on the perfect machine, then the root of the sum of squares.
    """
    clean = chain.without_errors()
    square: FloatArray = np.zeros(6)
    for one, size in columns:
        parameter = ErrorParameter(one) if isinstance(one, str) else one
        motion = ScaledShape(parameter.basis, size) if parameter.basis is not None else size
        twist = relative_errors(clean.with_errors({parameter.source: motion}), q, frame, "first")
        square = square + twist**2
    return np.asarray(np.sqrt(square))


@dataclass(frozen=True)
class ScaledShape:
    """A shape times its size."""

    shape: Callable[..., FloatArray]
    size: float

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        return np.asarray(self.size * self.shape(q))


def relative_rows(sweep: RelativeSweep) -> list[Row]:
    """Each of the six: in space 0 at mid face, least, greatest and RMS over all places, what first order misses."""
    middle = int(np.argmin(np.abs(sweep.z)))
    rows = []
    for name in RELATIVE:
        values = sweep.values[name]
        shown = (values[0, middle], np.min(values), np.max(values), np.sqrt(np.mean(values**2)))
        unit = "um" if name[0] == "d" else "arcsec"
        rows.append((name, *(f"{float(one):.3f}" for one in shown), f"{sweep.missed[name]:.4f}", unit))
    return rows


def relative_data(sweep: RelativeSweep) -> dict[str, Any]:
    """Everything as plain data, units in the names."""
    return {
        "frame": sweep.frame,
        "turn_deg": sweep.turn.tolist(),
        "z_mm": sweep.z.tolist(),
        **{f"{name}_{'um' if name[0] == 'd' else 'arcsec'}": sweep.values[name].tolist() for name in RELATIVE},
        "first_order_misses": dict(sweep.missed),
    }


def relative_lines(sweep: RelativeSweep) -> tuple[FloatArray, dict[str, FloatArray], list[str]]:
    """Turn (3, spaces), values (3, spaces) and names of the curves below, in the middle and above, for a drawing."""
    at = [0, int(np.argmin(np.abs(sweep.z))), sweep.z.size - 1]
    names = [f"z {sweep.z[i]:+.1f} mm" for i in at]
    return np.stack([sweep.turn] * 3), {name: one[:, at].T for name, one in sweep.values.items()}, names


def _displayed(six: FloatArray) -> dict[str, FloatArray]:
    return {
        name: np.asarray(mm_to_um(six[..., i]) if i < 3 else rad_to_arcsec(six[..., i]))
        for i, name in enumerate(RELATIVE)
    }
