"""The machine's frames and matrices, and the six relative errors of wheel to work as numbers, functions and arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.units import DeviationUnit, deg_to_rad, mm_to_um, rad_to_arcsec
from gateway.domain.values import FloatArray
from gateway.gear.grinding import Grinding
from gateway.model import transforms
from gateway.model.chain import Chain, Frame
from gateway.model.frames import RELATIVE, RelativeOrder, joints, relative_errors
from trueflank.frames import frame as table
from trueflank.given import numbers_given

UNITS: Mapping[str, DeviationUnit] = {
    "dx": "um", "dy": "um", "dz": "um", "ea": "arcsec", "eb": "arcsec", "ec": "arcsec",
}  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class RelativeErrors:
    """The six relative errors of wheel to work: dx, dy, dz in um and ea, eb, ec in arcsec, one shape (...) for all.

    Angles are counter-clockwise about X, Y, Z of ``frame``: "work" (T_act = E T_id) or "wheel" (T_act = T_id E).
    ``positions`` of the axes in mm and deg. ``order`` is how they were calculated. ``u`` are their standard
    uncertainties by name, of the same shape and unit; None where nobody said.
    """

    dx: FloatArray
    dy: FloatArray
    dz: FloatArray
    ea: FloatArray
    eb: FloatArray
    ec: FloatArray
    positions: Mapping[str, FloatArray]
    frame: Frame
    order: RelativeOrder
    u: Mapping[str, FloatArray] | None = None

    def __getitem__(self, name: str) -> FloatArray:
        """One of the six by its name. Raises ConfigError (E-LIBRARY-KIND)."""
        return np.asarray(getattr(self, one_of_six(name, "relative(...)[...]")))

    @property
    def matrix(self) -> FloatArray:
        """E to first order, I + hat, (..., 4, 4), with lengths in mm and angles in rad; exactly of "first" order."""
        e = np.stack([self[name] / (mm_to_um(1.0) if name[0] == "d" else rad_to_arcsec(1.0)) for name in RELATIVE], -1)
        return transforms.rigid(np.eye(3) + transforms.hat(e[..., 3:]), e[..., :3])

    def to_dict(self) -> dict[str, Any]:
        """Plain data, with units in the names."""
        return {
            "frame": self.frame,
            "order": self.order,
            "positions": {name: np.asarray(one).tolist() for name, one in self.positions.items()},
            **{f"{name}_{UNITS[name]}": self[name].tolist() for name in RELATIVE},
            **{f"u_{name}_{UNITS[name]}": one.tolist() for name, one in (self.u or {}).items()},
        }

    def to_pandas(self) -> Any:
        """One row a position: the axes in mm or deg, the six in um or arcsec. Raises ConfigError (E-LIBRARY-PANDAS)."""
        shape = self.dx.shape
        at = {name: np.broadcast_to(one, shape).ravel() for name, one in self.positions.items()}
        return table({**at, **{f"{name}_{UNITS[name]}": self[name].ravel() for name in RELATIVE}})

    def plot(self, along: str = "") -> Any:
        """Six panels in um and arcsec over the positions (mm or deg) of one axis, ``along``; else of one that moves.

        Returns a matplotlib figure. Raises ConfigError (E-LIBRARY-KIND) where no axis moves.
        """
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.kinematics import relative_curves

        label, at = moved_axis(self, along, "RelativeErrors.plot")
        values = {name: self[name] for name in RELATIVE}
        return new_sheet((9.0, 4.8), lambda figure: relative_curves(figure, label, at, values, frame=self.frame))

    def __repr__(self) -> str:
        largest = ", ".join(f"{name} {np.max(np.abs(self[name])):.3g}" for name in RELATIVE)
        return f"RelativeErrors({self.dx.size} positions, in the {self.frame}; largest, µm and arcsec: {largest})"


def moved_axis(found: RelativeErrors, along: str, call: str) -> tuple[str, FloatArray]:
    """Label and positions (...) in mm or deg of the axis ``along``, or of the one that moves to most places.

    Raises ConfigError (E-LIBRARY-KIND) where it does not move.
    """
    moving = {name: np.unique(one).size for name, one in found.positions.items()}
    axis = along or max(moving, key=lambda name: moving[name])
    if moving.get(axis, 1) < 2:
        raise ConfigError(
            "E-LIBRARY-KIND", "relative", call=f"tf.{call}", wanted=Message.of("W-LIB-AXIS-MOVES"), given=repr(axis),
            how=Message.of("W-LIB-POSITIONS"),
        )  # fmt: skip
    unit = "deg" if axis[:1] in "ABC" else "mm"
    return f"{axis}  {unit}", np.asarray(np.broadcast_to(found.positions[axis], found.dx.shape))


@dataclass(frozen=True, slots=True, repr=False)
class RelativeError:
    """One of the six relative errors of a machine as a function: call it with positions in mm and deg, um or arcsec."""

    chain: Chain
    name: str
    frame: Frame
    order: RelativeOrder

    @property
    def unit(self) -> DeviationUnit:
        """Unit of its values."""
        return UNITS[self.name]

    def __call__(self, **positions: ArrayLike) -> FloatArray:
        """Values in um or arcsec at positions (mm, deg) of every axis, of the shape they broadcast to."""
        return relative(self.chain, positions, self.frame, self.order)[self.name]

    def plot(self, **positions: ArrayLike) -> Any:
        """The function in um or arcsec over the axis (mm or deg) that moves most; a matplotlib figure.

        ``positions`` as in a call. Raises ConfigError (E-LIBRARY-KIND) where no axis moves.
        """
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.kinematics import one_relative_curve

        found = relative(self.chain, positions, self.frame, self.order)
        label, at = moved_axis(found, "", "RelativeError.plot")
        return new_sheet(
            (7.5, 3.4),
            lambda figure: one_relative_curve(
                figure, label, at, name=self.name, values=found[self.name], frame=self.frame
            ),
        )

    def __repr__(self) -> str:
        return f"RelativeError({self.name} in the {self.frame}, {self.unit})"


@dataclass(frozen=True, slots=True)
class FrameOf:
    """One frame of the machine: its ``name``, the frame it stands on, and the axis that moves it ("" where none does).

    The axis' positions are in mm or deg.
    """

    name: str
    parent: str
    axis: str
    side: Literal["work", "tool"]


def frames_of(chain: Chain) -> tuple[FrameOf, ...]:
    """Every frame but the bed."""
    return tuple(FrameOf(one.frame, one.parent, one.frame if one.moving else "", one.side) for one in joints(chain))


def one_of_six(name: Any, call: str) -> str:
    """A name of `RELATIVE`. Raises ConfigError (E-LIBRARY-KIND)."""
    if not isinstance(name, str) or name not in RELATIVE:
        how = f"one of {', '.join(RELATIVE)}"
        raise ConfigError(
            "E-LIBRARY-KIND",
            "relative",
            call=f"tf.Machine.{call}",
            wanted="a relative error",
            given=repr(name),
            how=how,
        )
    return name


def commands(chain: Chain, positions: Mapping[str, ArrayLike], call: str) -> tuple[dict[str, FloatArray], ...]:
    """Positions as given (mm, deg) and as the chain counts (mm, rad). Raises ConfigError (E-LIBRARY-KIND)."""
    shown: dict[str, FloatArray] = {}
    counted: dict[str, FloatArray] = {}
    for name, one in positions.items():
        turning = chain.axis(name).kind == "revolute"
        shown[name] = numbers_given(one, "deg" if turning else "mm", call)
        counted[name] = np.asarray(deg_to_rad(shown[name])) if turning else shown[name]
    try:
        np.broadcast_shapes(*(one.shape for one in shown.values()))
    except ValueError as error:
        shapes = ", ".join(f"{name} {one.shape}" for name, one in shown.items())
        how = Message.of("W-LIB-BROADCAST")
        raise ConfigError(
            "E-LIBRARY-KIND", call, call=call, wanted=Message.of("W-LIB-TOGETHER"), given=shapes, how=how
        ) from error
    return shown, counted


def relative(chain: Chain, positions: Mapping[str, ArrayLike], frame: Frame, order: RelativeOrder) -> RelativeErrors:
    """`gateway.model.frames.relative_errors` in the library's units."""
    shown, counted = commands(chain, positions, "tf.Machine.relative")
    six = np.moveaxis(relative_errors(chain, counted, frame, order), -1, 0)
    values = {
        name: np.asarray(mm_to_um(one) if UNITS[name] == "um" else rad_to_arcsec(one))
        for name, one in zip(RELATIVE, six, strict=True)
    }
    dx, dy, dz, ea, eb, ec = (values[name] for name in RELATIVE)
    return RelativeErrors(dx=dx, dy=dy, dz=dz, ea=ea, eb=eb, ec=ec, positions=shown, frame=frame, order=order)


def grinding_positions(grinding: Grinding, space: ArrayLike, height: ArrayLike) -> dict[str, FloatArray]:
    """Positions in mm and deg of every axis where the wheel grinds spaces at heights (mm)."""
    spaces, heights = (numbers_given(one, "mm", "tf.Machine.positions") for one in (space, height))
    q = grinding.commands(spaces, heights)
    turning = {axis.name: axis.kind == "revolute" for axis in grinding.chain.axes}
    return {name: np.asarray(np.rad2deg(one)) if turning[name] else np.asarray(one) for name, one in q.items()}
