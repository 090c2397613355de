"""The disc and its wheel as files for other programs: points as CSV, the outline as DXF."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.types.values import FloatArray
from drivers.units import um_to_mm
from gateway.errors import StoreError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import wheel_section

PROFILE_COLUMNS = ("space", "theta_deg", "x_mm", "y_mm", "nx", "ny", "curvature_per_mm", "arc_mm")
WHEEL_COLUMNS = ("theta_deg", "y_mm", "R_mm", "normal_y", "normal_R")
FEWEST = 9
TOLERANCE_UM, MOST_TOLERANCE_UM = 0.5, 100.0
CIRCLES = {"PIN_CIRCLE": "pin_circle", "TIP": "r_tip", "ROOT": "r_root"}


def space_angles(gear: CycloidGear, points: int) -> FloatArray:
    """Profile angles (points,) in rad from tip to tip of one space, equal in arc length."""
    half = gear.limits().half_lobe_arc
    inner = gear.theta_at(np.linspace(-half, half, points)[1:-1])
    return np.concatenate([[-gear.half_pitch], inner, [gear.half_pitch]])


def profile_rows(gear: CycloidGear, spaces: Sequence[int], points: int) -> list[tuple[float, ...]]:
    """Rows of `PROFILE_COLUMNS`: every point of the spaces, each from tip to tip."""
    theta = space_angles(gear, points)
    rows: list[tuple[float, ...]] = []
    for k in spaces:
        s = gear.space(theta, k)
        columns = (np.rad2deg(theta), s.x, s.y, s.nx, s.ny, s.curvature, gear.arc(theta))
        rows += [(k, *row) for row in np.stack(columns, axis=-1).tolist()]
    return rows


def wheel_rows(gear: CycloidGear, centre_distance: float, points: int) -> list[tuple[float, ...]]:
    """Rows of `WHEEL_COLUMNS`: the dressed axial section; the normal points out of the gear, into the wheel."""
    theta = space_angles(gear, points)
    section = wheel_section(gear, centre_distance, theta)
    columns = (np.rad2deg(theta), section.y, section.R, section.ny, -section.nx)
    return [tuple(row) for row in np.stack(columns, axis=-1).tolist()]


def write_rows(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> Path:
    """A CSV file with a heading; numbers to nine decimals, which is a nanometre's thousandth. Raises StoreError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(rows_text(columns, rows), encoding="utf-8", newline="")
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=error.strerror or str(error)) from error
    return path


def rows_text(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """The same as text."""
    file = io.StringIO()
    out = csv.writer(file, lineterminator="\n")
    out.writerow(columns)
    out.writerows([f"{one:.9f}" if isinstance(one, float) else one for one in row] for row in rows)
    return file.getvalue()


def outline(gear: CycloidGear, tolerance_um: float = TOLERANCE_UM) -> FloatArray:
    """Closed outline (N, 2) in mm; its chords leave the curve by at most the tolerance: curvature x chord^2 / 8."""
    half = gear.limits().half_lobe_arc
    sharpest = float(np.max(np.abs(gear.section(space_angles(gear, 721)).curvature)))
    chord = float(np.sqrt(8.0 * um_to_mm(tolerance_um) / sharpest))
    theta = space_angles(gear, max(FEWEST, int(np.ceil(2.0 * half / chord)) + 1))
    spaces = gear.space(theta[None, :], np.arange(gear.zc)[:, None])
    points = spaces.xy if gear.drot else spaces.xy[:, :-1]  # without rotation the tips of neighbours are one point
    return np.asarray(points.reshape(-1, 2))


def write_dxf(path: Path, gear: CycloidGear, tolerance_um: float = TOLERANCE_UM) -> Path:
    """The disc as a DXF drawing in mm (R2010): outline, pin circle, tip and root circles, each on its layer.

    Raises ConfigError (E-EXTRA-MISSING) without ezdxf, StoreError E-STUDY-WRITE.
    """
    try:
        import ezdxf
    except ImportError as error:
        raise ConfigError("E-EXTRA-MISSING", str(path), extra="cad", packages="ezdxf") from error
    drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
    limits, space = gear.limits(), drawing.modelspace()
    for layer in ("PROFILE", *CIRCLES):
        drawing.layers.add(layer)
    space.add_lwpolyline(outline(gear, tolerance_um).tolist(), close=True, dxfattribs={"layer": "PROFILE"})
    for layer, name in CIRCLES.items():
        radius = gear.pin_circle if name == "pin_circle" else getattr(limits, name)
        space.add_circle((0.0, 0.0), radius, dxfattribs={"layer": layer})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        drawing.saveas(path)
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=error.strerror or str(error)) from error
    return path
