"""A gear, a machine with its errors, and what these leave on every flank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.units import arcsec_to_rad, deg_to_rad, mm_to_um, rad_to_arcsec, rad_to_deg, um_to_mm
from gateway.correct.outlook.flank_uncertainty import FlankDoubts, doubts
from gateway.correct.outlook.prediction import point_u_um, without_rotation
from gateway.correct.plan.plan import Plan
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards.statistics import numbers
from gateway.gear.cycloid import CycloidGear, GearLimits
from gateway.gear.envelope import exact
from gateway.gear.first_order import ErrorParameter, bounded_first_order
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.wheel_passage import contact_condition, contact_line
from gateway.model.chain import Chain, Frame
from gateway.model.frames import RELATIVE, RelativeOrder, State
from gateway.model.frames import matrix as link_matrix
from gateway.study.calculate import prepare_study
from gateway.study.export import (
    FEWEST,
    MOST_TOLERANCE_UM,
    PROFILE_COLUMNS,
    TOLERANCE_UM,
    profile_rows,
    space_angles,
    write_dxf,
    write_rows,
)
from gateway.study.inputs import ErrorFile, GearFile, gear_of, is_run, load_gear, validate_file
from gateway.study.machine import (
    error_names,
    grid_of,
    grinding_of,
    is_angle,
    machine_of,
    table_grids,
)
from gateway.study.relative_errors import relative_u
from gateway.workflow.tooth.known_machine import KnownMachine, known_machine
from trueflank.frames import frame
from trueflank.given import (
    motion_name,
    numbers_given,
    of_kind,
    path_given,
    plain_numbers,
    real_given,
    units_fit,
    wholes_given,
)
from trueflank.kinematics import (
    UNITS,
    FrameOf,
    RelativeError,
    RelativeErrors,
    commands,
    frames_of,
    grinding_positions,
    one_of_six,
    relative,
)
from trueflank.measuring import ErrorMotion
from trueflank.surfaces import Contact, Profile, Surface, Wheel

ORDERS = ("first", "second", "exact")


@dataclass(frozen=True, slots=True, repr=False)
class Gear:
    """A cycloidal disc and how its flank is judged: points over profile and width; lengths in mm, limit in um.

    ``data`` is the gear file as it was read.
    """

    data: GearFile

    @classmethod
    def load(cls, path: str | Path) -> Gear:
        """From a gear file (TOML), lengths in mm. Raises ConfigError with file, key and why."""
        path_given(path, "Gear.load")
        return cls(load_gear(Path(path)))

    @classmethod
    def of(
        cls, *, rp: float, rrp: float, a: float, zp: int, zc: int, centre_distance: float, b: float = 10.0,
        drp: float = 0.0, drrp: float = 0.0, drot_arcsec: float = 0.0, name: str = "gear",
    ) -> Gear:  # fmt: skip
        """Pin circle radius ``rp``, pin radius ``rrp``, eccentricity ``a``, pins, lobes, face width ``b``, in mm.

        ``centre_distance``: gear axis to wheel axis. Modifications: shift ``drp`` and equidistant ``drrp`` in mm,
        rotation of each flank ``drot_arcsec``, which widens the spaces. Raises ConfigError (E-STUDY-VALUE), ModelError
        (E-GEAR-...).
        """
        data = {
            "rp": rp, "rrp": rrp, "a": a, "zp": zp, "zc": zc, "b": b, "drp": drp, "drrp": drrp,
            "drot_arcsec": drot_arcsec,
        }  # fmt: skip
        whole = {"name": name, "gear": data, "grinding": {"centre_distance_mm": centre_distance}}
        gear = cls(validate_file(whole, GearFile, name))
        gear_of(gear.data)
        return gear

    @property
    def limits(self) -> GearLimits:
        """Short amplitude coefficient K1, root and tip radius, largest pin radius without undercut, in mm."""
        return gear_of(self.data).limits()

    def modified(self, *, drp: float = 0.0, drrp: float = 0.0, drot_arcsec: float = 0.0) -> Gear:
        """The same disc with these modifications and no others: shift and equidistant in mm, rotation in arcsec.

        Raises ModelError (E-GEAR-...) naming the limit that it breaks.
        """
        changed = self.data.gear.model_copy(update={"drp": drp, "drrp": drrp, "drot_arcsec": drot_arcsec})
        gear = Gear(self.data.model_copy(update={"gear": changed}))
        gear_of(gear.data)
        return gear

    def profile(self, points: int = 201, *, space: int = 0) -> Profile:
        """Points, normals, curvature of one space from tip to tip, equal in arc length (mm, deg).

        ``space`` k is the k-th tooth space, from 0. Raises ConfigError (E-LIBRARY-KIND).
        """
        gear = _counted(self.data, "profile", points, space)
        return Profile.of(gear, space_angles(gear, points), space)

    def wheel(self, points: int = 201) -> Wheel:
        """The wheel that grinds this disc without errors: its dressed axial section in mm, and its surface.

        Raises ConfigError (E-LIBRARY-KIND), ModelError (E-GEAR-DISTANCE).
        """
        gear = _counted(self.data, "wheel", points, 0)
        return Wheel.of(gear, self.data.grinding.centre_distance_mm, space_angles(gear, points))

    def to_csv(self, path: str | Path, points: int = 201) -> Path:
        """Points of every space with normals, curvature and arc length as a CSV file, mm and deg. Raises StoreError."""
        path_given(path, "Gear.to_csv")
        gear = _counted(self.data, "to_csv", points, 0)
        return write_rows(Path(path), PROFILE_COLUMNS, profile_rows(gear, range(gear.zc), points))

    def to_dxf(self, path: str | Path, *, tolerance_um: float = TOLERANCE_UM) -> Path:
        """The disc as a DXF drawing in mm: the outline's chords leave the curve by at most ``tolerance_um``.

        Raises ConfigError (E-EXTRA-MISSING: `pip install 'trueflank[cad]'`), StoreError E-STUDY-WRITE.
        """
        path_given(path, "Gear.to_dxf")
        if not isinstance(tolerance_um, int | float) or not 0.0 < tolerance_um <= MOST_TOLERANCE_UM:
            how = Message.of("W-LIB-TOLERANCE", most_tolerance_um=MOST_TOLERANCE_UM)
            raise ConfigError(
                "E-LIBRARY-KIND", "to_dxf", call="tf.Gear.to_dxf", wanted="tolerance_um", given=repr(tolerance_um),
                how=how,
            )  # fmt: skip
        return write_dxf(Path(path), gear_of(self.data), tolerance_um)

    def plot(self) -> Any:
        """The disc, its first space with normals on equal scales, and its curvature, in mm; a matplotlib figure."""
        return self.profile(FEWEST).plot()

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in a gear file."""
        return self.data.model_dump()

    def __repr__(self) -> str:
        gear = self.data.gear
        return f"Gear({self.data.name}: {gear.zc} lobes, rp {gear.rp:g} mm, a {gear.a:g} mm, b {gear.b:g} mm)"


def _counted(data: GearFile, call: str, points: Any, space: Any) -> CycloidGear:
    """The disc, where points and space are whole numbers that it has. Raises ConfigError (E-LIBRARY-KIND)."""
    wholes_given(f"Gear.{call}", points=points, space=space)
    gear = gear_of(data)
    if points < FEWEST or space >= gear.zc:
        how, given = Message.of("W-LIB-POINTS", fewest=FEWEST, last=gear.zc - 1), f"{points} points, space {space}"
        raise ConfigError(
            "E-LIBRARY-KIND",
            call,
            call=f"tf.Gear.{call}",
            wanted=Message.of("W-LIB-POINTS-SPACE"),
            given=given,
            how=how,
        )
    return gear


Given = float | ErrorMotion | Mapping[str, Any] | tuple[Any, Any]


@dataclass(frozen=True, slots=True, repr=False)
class Machine:
    """The form grinder's chain (X, Z, C) with its errors: um or arcsec over mm or deg, as in an error file.

    ``motions`` are the fitted ones by name, with their covariance. ``run`` is the run that they came from, if one;
    ``known`` what it knows of them together.
    """

    data: ErrorFile
    motions: Mapping[str, ErrorMotion]
    run: Path | None
    known: KnownMachine

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
                "E-LIBRARY-KIND", "Machine", call="tf.Machine", wanted=Message.of("W-LIB-BY-NAMES"), given=f"a {kind}",
                how='a dictionary: {"EXX": 5.0}',
            )  # fmt: skip
        told: dict[str, Any] = {"name": name, **more}
        told["errors"] = {key: _function(key, one) for key, one in (errors or {}).items()}
        if seed is not None:
            told["seeded"] = {"seed": seed}
        elif not errors:
            told["errors"] = {"EXX": 0.0}
        data = validate_file(told, ErrorFile, name)
        machine_of(data)  # names and curves that cannot be are said now, not when a tooth is reckoned
        object.__setattr__(self, "data", data)
        fitted = {key: one for key, one in (errors or {}).items() if isinstance(one, ErrorMotion)}
        object.__setattr__(self, "motions", fitted)
        object.__setattr__(self, "run", None)
        object.__setattr__(self, "known", KnownMachine(data))

    @classmethod
    def load(cls, path: str | Path, *, height_mm: float | None = None) -> Machine:
        """From an error file (TOML), a run's folder or its errors.json (of a day too), in um, arcsec, mm and deg.

        A run brings fitted motions with their covariance (`motions`), location errors, and how all of them may be
        wrong together: u of flanks, relative errors, corrections and drives comes from it. It also brings the grids
        of its control's tables. A run's Z counts from the machine's own zero: ``height_mm`` is the position in it of
        the middle of the work's face; left out, it is `[work] height_mm` of the site file that the run keeps, and 0
        mm where there is none. A face where an error of Z was not measured is refused by what works it out
        (E-STUDY-HEIGHT). Raises ConfigError with file, key and why, StoreError, CorruptRecord.
        """
        path_given(path, "Machine.load")
        found, place = object.__new__(cls), Path(path)
        told = None if height_mm is None else float(plain_numbers(height_mm, "tf.Machine.load: height_mm"))
        known = known_machine(place, told)
        object.__setattr__(found, "data", known.errors)
        object.__setattr__(found, "known", known)
        fitted = () if known.model is None else known.model.motions
        object.__setattr__(found, "run", place if is_run(place) else None)
        object.__setattr__(found, "motions", {one.name: ErrorMotion(one) for one in fitted})
        return found

    def u(self, name: str) -> float:
        """Standard uncertainty of an error by its name, um or arcsec, as a run or an error file states it.

        Raises ConfigError (E-LIBRARY-KIND) where none is stated.
        """
        doubt = self.data.uncertainty
        if doubt is None or not isinstance(name, str) or name not in error_names(machine_of(self.data)):
            raise ConfigError(
                "E-LIBRARY-KIND", "u", call="tf.Machine.u", wanted=Message.of("W-LIB-UNCERTAIN"),
                given=repr(name), how=Message.of("W-LIB-UNCERTAINTY"),
            )  # fmt: skip
        return doubt.each.get(name, doubt.angular_arcsec if is_angle(name) else doubt.linear_um)

    @property
    def frames(self) -> tuple[FrameOf, ...]:
        """Every frame on its parent, the work side first, each side from the bed outward; axes in mm or deg."""
        return frames_of(machine_of(self.data))

    def matrix(
        self, frame: str = "wheel", into: str = "work", *, state: State = "actual", **positions: ArrayLike
    ) -> FloatArray:
        """Homogeneous matrix (..., 4, 4) that carries coordinates (mm) of ``frame`` into those of ``into``.

        Frames by their names (`frames`, and "bed"); the exchange of both is the inverse. ``state``: "ideal" without
        errors, "actual" exact, "small-angle" the product of the linear matrices I + hat. Positions of the axes between
        both frames, by axis, in mm and deg, of shapes that broadcast together:
        ``machine.matrix("C", "X", C=[0.0, 90.0])``. Raises ModelError (E-CHAIN-WORD, E-CHAIN-POSITION, E-CHAIN-AXIS,
        E-MODEL-RANGE), ConfigError (E-LIBRARY-KIND).
        """
        chain = machine_of(self.data)
        _, q = commands(chain, positions, "tf.Machine.matrix")
        return link_matrix(chain, frame, into, q, state=state)

    def relative(
        self, *, frame: Frame = "work", order: RelativeOrder = "exact", **positions: ArrayLike
    ) -> RelativeErrors:
        """The six relative errors of wheel to work in um and arcsec at positions (mm, deg) of every axis.

        ``frame`` "work": T_act = E T_id, or "wheel": T_act = T_id E. ``order`` "exact" is the logarithm of the exact E,
        "first" the sum of all errors by their levers, "small-angle" is read off the product of the linear matrices.
        Shapes broadcast together. `u` of the result is there where the errors' uncertainty is known, from all of them
        together for a run. Raises as `matrix`.
        """
        chain = machine_of(self.data)
        found = relative(chain, positions, frame, order)
        columns = self._columns(chain)
        if columns is None:
            return found
        _, q = commands(chain, positions, "tf.Machine.relative")
        u = np.moveaxis(relative_u(chain, columns, q, frame), -1, 0)
        shown = {
            name: np.asarray((mm_to_um if UNITS[name] == "um" else rad_to_arcsec)(one))
            for name, one in zip(RELATIVE, u, strict=True)
        }
        return replace(found, u=shown)

    def _columns(self, chain: Chain) -> Sequence[tuple[ErrorParameter | str, float]] | None:
        """How the errors may be wrong, in independent columns (mm, rad); None where nobody said."""
        if self.known.model is not None:
            return doubts(self.known.model, chain, Plan(table_grids(self.data)))
        if self.data.uncertainty is None:
            return None
        sizes = {name: self.u(name) for name in error_names(chain)}
        return [(name, arcsec_to_rad(u) if is_angle(name) else um_to_mm(u)) for name, u in sizes.items()]

    def relative_error(self, name: str, *, frame: Frame = "work", order: RelativeOrder = "exact") -> RelativeError:
        """One of dx, dy, dz (um), ea, eb, ec (arcsec) as a function of the positions (mm, deg) of every axis.

        Raises ConfigError (E-LIBRARY-KIND).
        """
        return RelativeError(machine_of(self.data), one_of_six(name, "relative_error"), frame, order)

    def positions(self, gear: Gear, space: ArrayLike = 0, height: ArrayLike = 0.0) -> dict[str, FloatArray]:
        """Where the axes stand (mm, deg) with the wheel in spaces of a gear at heights (mm) from mid face.

        Raises ConfigError (E-LIBRARY-KIND), ModelError (E-GEAR-GRINDER).
        """
        of_kind(gear, Gear, "Machine.positions")
        return grinding_positions(grinding_of(gear.data, self.data), space, height)

    def plot(self) -> Any:
        """The machine's bodies as a tree and its frames in space at a position (mm, deg); a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.kinematics import machine_frames

        chain = machine_of(self.data)
        return new_sheet((10.0, 5.0), lambda figure: machine_frames(figure, chain))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in an error file."""
        return self.data.model_dump()

    def __repr__(self) -> str:
        drawn = f", others drawn from seed {self.data.seeded.seed}" if self.data.seeded else ""
        return f"Machine({self.data.name}: {', '.join(self.data.errors) or 'no error given'}{drawn})"


def _function(name: str, one: Given) -> Any:
    if isinstance(one, ErrorMotion):
        units_fit(motion_name(name, "Machine"), one.component.axis_unit, one.unit, "Machine")
        if one.name != name:
            raise ConfigError(
                "E-LIBRARY-KIND", name, call="tf.Machine", wanted=Message.of("W-LIB-FIT-OF", name=name),
                given=Message.of("W-LIB-FIT-OF", name=one.name),
                how=Message.of("W-LIB-FIT", name=name),
            )  # fmt: skip
        return one.function()
    real_given(one, f"tf.Machine: {name}")
    if isinstance(one, np.ndarray) and one.ndim == 0:
        return float(one)
    parts = list(one) if isinstance(one, list | tuple | np.ndarray) else []
    bare = bool(parts) and all(np.ndim(part) == 0 and not isinstance(part, Mapping) for part in parts)
    if isinstance(one, bool | str | np.bool_) or bare:
        given = f"{len(parts)} plain numbers" if bare else repr(one)
        raise ConfigError(
            "E-LIBRARY-KIND", name, call="tf.Machine", wanted=f"an error {name}", given=given,
            how=Message.of("W-LIB-MOTION"),
        )  # fmt: skip
    if isinstance(one, tuple):
        if len(one) != 2:
            raise ConfigError(
                "E-LIBRARY-KIND", name, call="tf.Machine", wanted=Message.of("W-LIB-PAIR"),
                given=f"{len(one)} parts", how="([0.0, 100.0], [0.0, 5.0])",
            )  # fmt: skip
        for part in one:
            real_given(part, f"tf.Machine: {name}")
        at, values = (numbers(key, part) for key, part in zip(("positions", "values"), one, strict=True))
        return {"type": "pl", "q": at.tolist(), "v": values.tolist()}
    return dict(one) if isinstance(one, Mapping) else one


@dataclass(frozen=True, slots=True, repr=False)
class Flank:
    """Normal deviations (spaces, profile, width) in um, surplus positive; one rotation about the axis is taken out.

    ``height`` (width,) in mm; ``angle`` (profile,) is the profile angle in deg; ``rms`` and ``largest`` in um.
    ``gear`` is the disc. ``doubts`` are how the machine's errors may be wrong, as patterns of the flank; None where
    nobody said.
    """

    deviation: FloatArray
    angle: FloatArray
    height: FloatArray
    rms: float
    largest: float
    rotation_arcsec: float
    gear: GearFile
    doubts: FlankDoubts | None = None

    @property
    def u(self) -> FloatArray | None:
        """Standard uncertainty of each point (spaces, profile, width), um, by the errors together; None: not known.

        One rotation is taken out of each way to be wrong too; clamping and drift of the shop are not in it.
        """
        return None if self.doubts is None else point_u_um(without_rotation(self.doubts)).reshape(self.deviation.shape)

    @property
    def rms_u(self) -> float | None:
        """Standard uncertainty of the RMS, um, from mean and variance of the mean square of normal errors.

        None: not known.
        """
        if self.doubts is None:
            return None
        doubt, e = without_rotation(self.doubts), self.deviation.ravel()
        parts = np.moveaxis(doubt.patterns, -1, 0)
        moved = (
            np.stack([mm_to_um(doubt.places.along_normal(one)) for one in parts])
            if len(parts)
            else np.zeros((1, e.size))
        )
        mean = np.sum(e**2) + np.sum(moved**2)
        variance = 4.0 * np.sum((moved @ e) ** 2) + 2.0 * np.sum((moved @ moved.T) ** 2)
        return float(0.5 * np.sqrt(variance / max(mean, 1e-18) / e.size))

    def surface(self, scale: float = 1.0) -> Surface:
        """The actual flank in space: points and nominal normals (spaces, profile, width, 3), mm in the gear's frame.

        Deviations are enlarged ``scale`` times; with 0 it is the theoretical flank.
        """
        spaces = gear_of(self.gear).space(
            deg_to_rad(self.angle)[:, None], np.arange(self.deviation.shape[0])[:, None, None]
        )
        parts = [np.broadcast_to(one, self.deviation.shape) for one in (spaces.x, spaces.y, self.height)]
        flat = np.zeros(self.deviation.shape)
        normals = np.stack([np.broadcast_to(spaces.nx, flat.shape), np.broadcast_to(spaces.ny, flat.shape), flat], -1)
        moved = scale * um_to_mm(self.deviation)[..., None] * normals
        return Surface(np.stack(parts, axis=-1) + moved, normals)

    def plot(self, space: int | None = None) -> Any:
        """All flanks unrolled in um; or one ``space`` (from 0): theoretical and actual surface in mm, enlarged.

        Returns a matplotlib figure. Raises ConfigError (E-LIBRARY-KIND).
        """
        from gateway.study.plots.charts import new_sheet, one_map
        from gateway.study.plots.surfaces import error_surfaces

        gear = gear_of(self.gear)
        if space is None:
            return new_sheet((10.0, 2.4), lambda figure: one_map(figure, gear, self.deviation, self.height))
        wholes_given("Flank.plot", space=space)
        nominal = self.surface(0.0)
        case = (f"space {space}", nominal.points[space], nominal.normals[space], um_to_mm(self.deviation[space]))
        title = f"{self.gear.name}: tooth space {space}"
        return new_sheet((6.0, 5.0), lambda figure: error_surfaces(figure, [case], columns=1, title=title))

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
        sure = "" if self.rms_u is None else f" ± {self.rms_u:.3f} (u)"
        return f"Flank({self.deviation.shape[0]} spaces: RMS {self.rms:.3f}{sure} µm, largest {self.largest:.3f} µm)"


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
        found = bounded_first_order(grinding, grid.k, grid.theta, grid.z)
        e = found.deviation if order == "first" else found.second
    return flank_of(gear.data, grid, np.broadcast_to(e, grid.shape), doubts_of(machine, gear))


def contact(
    machine: Machine, gear: Gear, *, spaces: ArrayLike = 0, heights: ArrayLike = 0.0, points: int = 101
) -> Contact:
    """Where wheel and tooth touch, as lines in the work: points and normals in mm, wheel angle in deg.

    ``spaces`` and ``heights`` (mm, of the wheel's centre from mid face) are numbers or lists; all lines of a stroke
    together are the actual flank. Raises ConfigError (E-LIBRARY-KIND), ModelError (E-GEAR-CONTACT).
    """
    of_kind(machine, Machine, "contact")
    of_kind(gear, Gear, "contact")
    grinding = grinding_of(gear.data, machine.data)
    k, s = (np.atleast_1d(numbers_given(one, "mm", "tf.contact")) for one in (spaces, heights))
    if k.ndim != 1 or s.ndim != 1 or not np.isin(k, np.arange(grinding.gear.zc)).all():
        how = Message.of("W-LIB-SPACES", last=grinding.gear.zc - 1)
        given = f"shapes {k.shape}, {s.shape}"
        raise ConfigError("E-LIBRARY-KIND", "contact", call="tf.contact", wanted="spaces", given=given, how=how)
    theta = space_angles(_counted(gear.data, "contact", points, 0), points)
    clean = replace(grinding, chain=grinding.chain.without_errors())
    at = (k[:, None, None], s[:, None], theta)
    line, ideal = contact_line(grinding, *at), contact_line(clean, *at)
    shape = (k.size, s.size, theta.size)
    turn = np.asarray(rad_to_deg(np.broadcast_to(line.beta, shape)))
    whole = [np.broadcast_to(one, (*shape, 3)) for one in (line.points, line.normals, ideal.points)]
    return Contact(
        spaces=k, heights=s, angle=np.asarray(rad_to_deg(theta)), points=whole[0], normals=whole[1], turn=turn,
        ideal=whole[2], terms=contact_condition(grinding, *at).spread(shape),
    )  # fmt: skip


def doubts_of(machine: Machine, gear: Gear) -> FlankDoubts | None:
    """How the machine's errors may be wrong, as patterns of the gear's flank; None where nobody said."""
    if machine.known.model is None and machine.data.uncertainty is None:
        return None
    return prepare_study(gear.data, machine.data, machine.known.model).doubt


def flank_of(file: GearFile, grid: FlankGrid, e: FloatArray, doubt: FlankDoubts | None = None) -> Flank:
    """Deviations (K, T, Z) in mm as the library shows them."""
    h = grid.section.h
    figure = flank_figure(e, h)
    return Flank(
        deviation=np.asarray(mm_to_um(e - figure.rotation * h)),
        angle=rad_to_deg(grid.thetas),
        height=grid.zs,
        rms=mm_to_um(figure.rms),
        largest=mm_to_um(figure.largest),
        rotation_arcsec=rad_to_arcsec(figure.rotation),
        gear=file,
        doubts=doubt,
    )
