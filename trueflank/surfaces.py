"""The disc's profile, the wheel that grinds it, and where both touch: points, normals and curves in mm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import WheelSection, wheel_section, wheel_surface
from gateway.gear.wheel_passage import ContactCondition
from gateway.study.export import WHEEL_COLUMNS, wheel_rows, write_rows
from trueflank.frames import frame
from trueflank.given import numbers_given, path_given


@dataclass(frozen=True, slots=True, repr=False)
class Profile:
    """Points (T,) of one space's profile: angle in deg, x and y in mm, outward unit normal, curvature, arc length.

    ``curvature`` in 1/mm, positive where the tooth is convex; ``arc`` in mm from the bottom of the space, signed like
    the angle. ``space`` k is turned by 360 k/z_c deg.
    """

    gear: CycloidGear
    space: int
    angle: FloatArray
    x: FloatArray
    y: FloatArray
    nx: FloatArray
    ny: FloatArray
    curvature: FloatArray
    arc: FloatArray

    @classmethod
    def of(cls, gear: CycloidGear, theta: FloatArray, space: int) -> Profile:
        """The profile of a space at angles (T,) in rad; lengths in mm."""
        s = gear.space(theta, space)
        return cls(
            gear=gear, space=space, angle=np.asarray(np.rad2deg(theta)), x=s.x, y=s.y, nx=s.nx, ny=s.ny,
            curvature=s.curvature, arc=gear.arc(theta),
        )  # fmt: skip

    @property
    def points(self) -> FloatArray:
        """Coordinates (T, 2), mm."""
        return np.stack([self.x, self.y], axis=-1)

    @property
    def normals(self) -> FloatArray:
        """Outward unit normals (T, 2); those of points in mm."""
        return np.stack([self.nx, self.ny], axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names."""
        return {key: value.tolist() for key, value in self._columns().items()} | {"space": self.space}

    def to_pandas(self) -> Any:
        """One row a point, in mm and deg. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame(self._columns())

    def plot(self) -> Any:
        """The disc, this space with its normals on equal scales, and the curvature over the arc (mm, 1/mm)."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.surfaces import profile_sheet

        return new_sheet((11.0, 4.2), lambda figure: profile_sheet(figure, self.gear, self.space))

    def _columns(self) -> dict[str, FloatArray]:
        return {
            "theta_deg": self.angle, "x_mm": self.x, "y_mm": self.y, "nx": self.nx, "ny": self.ny,
            "curvature_per_mm": self.curvature, "arc_mm": self.arc,
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"Profile(space {self.space}: {self.angle.size} points, arc {self.arc[0]:.3f} .. {self.arc[-1]:.3f} mm)"


@dataclass(frozen=True, slots=True, repr=False)
class Surface:
    """A surface as points and unit normals, both (..., 3), in mm, in the frame that its maker names."""

    points: FloatArray
    normals: FloatArray

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names."""
        return {"points_mm": self.points.tolist(), "normals": self.normals.tolist()}

    def to_pandas(self) -> Any:
        """One row a point: x, y, z in mm and its normal. Raises ConfigError (E-LIBRARY-PANDAS)."""
        parts = (self.points.reshape(-1, 3).T, self.normals.reshape(-1, 3).T)
        names = (("x_mm", "y_mm", "z_mm"), ("nx", "ny", "nz"))
        return frame(
            {name: one for keys, rows in zip(names, parts, strict=True) for name, one in zip(keys, rows, strict=True)}
        )

    def plot(self) -> Any:
        """The surface in space on equal scales, mm, with some of its normals; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.surfaces import surface_sheet

        return new_sheet((7.0, 6.0), lambda figure: surface_sheet(figure, self.points, self.normals))

    def __repr__(self) -> str:
        return f"Surface({' x '.join(str(one) for one in self.points.shape[:-1])} points, mm)"


@dataclass(frozen=True, slots=True, repr=False)
class Wheel:
    """The dressed wheel of a gear at its centre distance (mm): axial section y and radius R in mm, each (T,).

    ``ny`` and ``nR`` are the normal's axial and radial parts; it points out of the gear, which is into the wheel.
    ``angle`` is the profile angle in deg of the gear's point that this one grinds.
    """

    gear: CycloidGear
    centre_distance: float
    angle: FloatArray
    y: FloatArray
    R: FloatArray
    ny: FloatArray
    nR: FloatArray

    @classmethod
    def of(cls, gear: CycloidGear, centre_distance: float, theta: FloatArray) -> Wheel:
        """The wheel at profile angles (T,) in rad and a centre distance in mm. Raises ModelError E-GEAR-DISTANCE."""
        s = wheel_section(gear, centre_distance, theta)
        angle = np.asarray(np.rad2deg(theta))
        return cls(gear=gear, centre_distance=centre_distance, angle=angle, y=s.y, R=s.R, ny=s.ny, nR=-s.nx)

    def surface(self, turn: ArrayLike = 0.0) -> Surface:
        """Points and normals (..., T, 3) in mm in the wheel's frame (axis y), at wheel angles ``turn`` (...) in deg.

        Turn 0 is the side that faces the gear. Raises ConfigError (E-LIBRARY-KIND).
        """
        at = np.deg2rad(numbers_given(turn, "deg", "tf.Wheel.surface"))[..., None]
        return Surface(*wheel_surface(WheelSection(self.y, self.R, -self.nR, self.ny), at))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names."""
        return {"centre_distance_mm": self.centre_distance, **{k: v.tolist() for k, v in self._columns().items()}}

    def to_pandas(self) -> Any:
        """One row a point of the section, in mm and deg. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame(self._columns())

    def to_csv(self, path: str | Path) -> Path:
        """The axial section as a CSV file in mm. Raises StoreError E-STUDY-WRITE."""
        path_given(path, "Wheel.to_csv")
        return write_rows(Path(path), WHEEL_COLUMNS, wheel_rows(self.gear, self.centre_distance, self.angle.size))

    def plot(self) -> Any:
        """The axial section with its normals on equal scales, and the surface in space (mm)."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.surfaces import wheel_sheet

        return new_sheet((10.0, 4.4), lambda figure: wheel_sheet(figure, self.gear, self.centre_distance))

    def _columns(self) -> dict[str, FloatArray]:
        return dict(zip(WHEEL_COLUMNS, (self.angle, self.y, self.R, self.ny, self.nR), strict=True))

    def __repr__(self) -> str:
        wide = float(np.ptp(self.y))
        return f"Wheel({wide:.3f} mm wide, R {np.min(self.R):.3f} .. {np.max(self.R):.3f} mm)"


@dataclass(frozen=True, slots=True, repr=False)
class Contact:
    """Where wheel and tooth touch: lines (K, S, T) over spaces, stroke heights (mm) and profile angles (deg).

    ``points`` and unit ``normals`` (K, S, T, 3) are in the work, mm; ``turn`` (K, S, T) is the wheel's angle of the
    contact in deg, 0 towards the gear. ``ideal`` (K, S, T, 3) are the same points of the machine without errors.
    """

    spaces: FloatArray
    heights: FloatArray
    angle: FloatArray
    points: FloatArray
    normals: FloatArray
    turn: FloatArray
    ideal: FloatArray
    terms: ContactCondition

    def condition(self, turn: ArrayLike) -> FloatArray:
        """n . v of the wheel's surface, mm per mm of stroke, at wheel angles ``turn`` (...) in deg: (..., K, S, T).

        It is zero where wheel and tooth touch. Raises ConfigError (E-LIBRARY-KIND).
        """
        at = numbers_given(turn, "deg", "tf.Contact.condition")
        return self.terms.at(np.deg2rad(at)[..., None, None, None])

    def to_dict(self) -> dict[str, Any]:
        """Plain data, units in the names."""
        return {
            "space": self.spaces.tolist(), "height_mm": self.heights.tolist(), "angle_deg": self.angle.tolist(),
            "points_mm": self.points.tolist(), "normals": self.normals.tolist(), "turn_deg": self.turn.tolist(),
        }  # fmt: skip

    def to_pandas(self) -> Any:
        """One row a point: space, height, angle, x, y, z in mm, wheel angle. Raises ConfigError (E-LIBRARY-PANDAS)."""
        k, s, t = (one.ravel() for one in np.indices(self.turn.shape))
        x, y, z = self.points.reshape(-1, 3).T
        columns = {"space": self.spaces[k], "height_mm": self.heights[s], "angle_deg": self.angle[t]}
        return frame({**columns, "x_mm": x, "y_mm": y, "z_mm": z, "turn_deg": self.turn.ravel()})

    def plot(self, scale: float = 0.0) -> Any:
        """The lines of the first space in mm, what errors change enlarged ``scale`` times (0: chosen)."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.surfaces import contact_sheet

        return new_sheet(
            (7.0, 5.2), lambda figure: contact_sheet(figure, self.ideal[0], self.points[0], enlarged=scale)
        )

    def __repr__(self) -> str:
        k, s, t = self.turn.shape
        return f"Contact({k} spaces, {s} lines of {t} points; wheel angle within {np.max(np.abs(self.turn)):.3g} deg)"
