"""A gear, a machine with its errors, and what these leave on every flank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.units import mm_to_um, rad_to_arcsec, rad_to_deg
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards.readings import numbers
from gateway.gear.envelope import exact
from gateway.gear.first_order import judged
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.study.files import ErrorFile, GearFile, load_errors, load_gear, validated
from gateway.study.machine import gear_of, grid_of, grinding_of, machine_of
from trueflank.frames import frame
from trueflank.given import motion_name, of_kind, path_given, units_fit
from trueflank.measuring import ErrorMotion

ORDERS = ("first", "second", "exact")


@dataclass(frozen=True, slots=True, repr=False)
class Gear:
    """A cycloidal disc and how its flank is judged; lengths in mm."""

    data: GearFile

    @classmethod
    def load(cls, path: str | Path) -> Gear:
        """From a gear file (TOML), lengths in mm. Raises ConfigError with file, key and why."""
        path_given(path, "Gear.load")
        return cls(load_gear(Path(path)))

    @classmethod
    def of(
        cls, *, rp: float, rrp: float, a: float, zp: int, zc: int, centre_distance: float, b: float = 10.0,
        name: str = "gear",
    ) -> Gear:  # fmt: skip
        """Pin circle radius ``rp``, pin radius ``rrp``, eccentricity ``a``, pins, lobes, face width ``b``, in mm.

        ``centre_distance``: gear axis to wheel axis. Raises ConfigError (E-STUDY-VALUE), ModelError (E-GEAR-...).
        """
        data = {"rp": rp, "rrp": rrp, "a": a, "zp": zp, "zc": zc, "b": b}
        whole = {"name": name, "gear": data, "grinding": {"centre_distance_mm": centre_distance}}
        gear = cls(validated(whole, GearFile, name))
        gear_of(gear.data)
        return gear

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in a gear file."""
        return self.data.model_dump()

    def __repr__(self) -> str:
        gear = self.data.gear
        return f"Gear({self.data.name}: {gear.zc} lobes, rp {gear.rp:g} mm, a {gear.a:g} mm, b {gear.b:g} mm)"


Given = float | ErrorMotion | Mapping[str, Any] | tuple[Any, Any]


@dataclass(frozen=True, slots=True, repr=False)
class Machine:
    """The form grinder's chain (X, Z, C) with its errors: um or arcsec over mm or deg, as in an error file."""

    data: ErrorFile

    def __init__(
        self, errors: Mapping[str, Given] | None = None, *, seed: int | None = None, name: str = "machine", **more: Any
    ) -> None:
        """Errors by ISO 230-1 name: a constant, a fitted motion, positions and values, or a function of an error file.

        Constants and values in um or arcsec, positions in mm or deg. ``seed`` draws those that are not given. ``more``
        are other sections of an error file (``tables``, ``uncertainty``, ``bounds``, ``goal``, ``machine``).
        Raises ConfigError (E-STUDY-VALUE, E-LIBRARY-KIND, E-LIBRARY-UNIT), ModelError (E-CHAIN-...).
        """
        if errors is not None and not isinstance(errors, Mapping):
            kind = type(errors).__name__
            raise ConfigError(
                "E-LIBRARY-KIND", "Machine", call="tf.Machine", wanted="errors by their names", given=f"a {kind}",
                how='a dictionary: {"EXX": 5.0}',
            )  # fmt: skip
        told: dict[str, Any] = {"name": name, **more}
        told["errors"] = {key: _function(key, one) for key, one in (errors or {}).items()}
        if seed is not None:
            told["seeded"] = {"seed": seed}
        elif not errors:
            told["errors"] = {"EXX": 0.0}
        data = validated(told, ErrorFile, name)
        machine_of(data)  # names and curves that cannot be are said now, not when a tooth is reckoned
        object.__setattr__(self, "data", data)

    @classmethod
    def load(cls, path: str | Path) -> Machine:
        """From an error file (TOML), in um, arcsec, mm and deg. Raises ConfigError with file, key and why."""
        path_given(path, "Machine.load")
        found = object.__new__(cls)
        object.__setattr__(found, "data", load_errors(Path(path)))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in an error file."""
        return self.data.model_dump()

    def __repr__(self) -> str:
        drawn = f", others drawn from seed {self.data.seeded.seed}" if self.data.seeded else ""
        return f"Machine({self.data.name}: {', '.join(self.data.errors) or 'no error given'}{drawn})"


def _function(name: str, one: Given) -> Any:
    if isinstance(one, ErrorMotion):
        units_fit(motion_name(name, "Machine"), one.component.axis_unit, one.unit, "Machine")
        return one.function()
    if isinstance(one, tuple):
        if len(one) != 2:
            raise ConfigError(
                "E-LIBRARY-KIND", name, call="tf.Machine", wanted="a pair of positions and values",
                given=f"{len(one)} parts", how="([0.0, 100.0], [0.0, 5.0])",
            )  # fmt: skip
        at, values = (numbers(key, part) for key, part in zip(("positions", "values"), one, strict=True))
        return {"type": "pl", "q": at.tolist(), "v": values.tolist()}
    return dict(one) if isinstance(one, Mapping) else one


@dataclass(frozen=True, slots=True, repr=False)
class Flank:
    """Normal deviations (spaces, profile, width) in um, surplus positive; one rotation about the axis is taken out.

    ``height`` (width,) in mm; ``angle`` (profile,) is the profile angle in deg; ``rms`` and ``largest`` in um.
    """

    deviation: FloatArray
    angle: FloatArray
    height: FloatArray
    rms: float
    largest: float
    rotation_arcsec: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "deviation_um": self.deviation.tolist(),
            "angle_deg": self.angle.tolist(),
            "height_mm": self.height.tolist(),
            "rms_um": self.rms,
            "largest_um": self.largest,
            "rotation_arcsec": self.rotation_arcsec,
        }

    def to_pandas(self) -> Any:
        """One row a point: space, profile angle, height, deviation. Raises ConfigError (E-LIBRARY-PANDAS)."""
        k, t, z = np.indices(self.deviation.shape)
        columns = {"space": k.ravel() + 1, "angle_deg": self.angle[t.ravel()], "height_mm": self.height[z.ravel()]}
        return frame({**columns, "deviation_um": self.deviation.ravel()})

    def __repr__(self) -> str:
        return f"Flank({self.deviation.shape[0]} spaces: RMS {self.rms:.3f} µm, largest {self.largest:.3f} µm)"


def flank(machine: Machine, gear: Gear, *, order: str = "second") -> Flank:
    """What the machine's errors leave on every flank of the gear, in um along its normal, surplus positive.

    ``order``: "first", "second", or "exact" for the envelope itself. Raises ConfigError (E-LIBRARY-KIND), ModelError
    (E-SENS-ORDER; those of chain and gear).
    """
    of_kind(machine, Machine, "flank")
    of_kind(gear, Gear, "flank")
    if order not in ORDERS:
        raise ModelError("E-SENS-ORDER", "flank", order=order, known=", ".join(ORDERS))
    grinding = grinding_of(gear.data, machine.data)
    grid = grid_of(gear.data, grinding.gear)
    if order == "exact":
        e = exact(grinding, grid.k, grid.theta, grid.z)
    else:
        found = judged(grinding, grid.k, grid.theta, grid.z)
        e = found.deviation if order == "first" else found.second
    return _flank(grid, np.broadcast_to(e, grid.shape))


def _flank(grid: FlankGrid, e: FloatArray) -> Flank:
    h = grid.section.h
    figure = flank_figure(e, h)
    return Flank(
        deviation=np.asarray(mm_to_um(e - figure.rotation * h)),
        angle=rad_to_deg(grid.thetas),
        height=grid.zs,
        rms=mm_to_um(figure.rms),
        largest=mm_to_um(figure.largest),
        rotation_arcsec=rad_to_arcsec(figure.rotation),
    )
