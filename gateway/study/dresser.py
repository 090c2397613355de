"""A builder's dresser as a file says it, and the wheel's corrected profile as files: table, CSV, DXF, proof."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.errors import ConfigError
from drivers.local.textfile import read_toml
from gateway.domain.grinding_process import Separation
from gateway.errors import StoreError
from gateway.process.wheel import COLUMNS, LIMIT_UM, STEP_UM, DresserTable, SenseProof, WheelCorrection
from gateway.study.export import rows_text
from gateway.study.inputs import validate_file

WHEEL_COLUMNS = (
    "theta_deg", "radius_mm", "axial_mm", "normal_radial", "normal_axial", "correction_um", "u_um",
    "centre_radius_mm", "centre_axial_mm",
)  # fmt: skip
EXAGGERATED = 1000.0  # 1 um of the correction is drawn as 1 mm
INK, OLD, NEW, RULE = "#22282e", "#a8453a", "#1f4e79", "#b4babf"


class DresserData(BaseModel):
    """The table that a dresser takes, and its diamond.

    ``sign`` is +1 where a positive correction makes the wheel larger, -1 where smaller; ``axial_sense`` is +1 where its
    axial places count like y of the gear. Both are what the builder's manual says: a known step proves them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=200)

    columns: tuple[
        Literal["radius", "axial", "correction", "normal_radial", "normal_axial", "centre_radius", "centre_axial"], ...
    ] = Field(min_length=1)
    length_unit: Literal["mm", "um"]
    correction_unit: Literal["mm", "um"] = "mm"
    sign: Literal[1, -1]
    axial_sense: Literal[1, -1] = 1
    along: Literal["normal", "radial"] = "normal"
    headings: tuple[str, ...] = ()
    separator: Literal[",", ";", "\t", " "] = ","
    decimal: Literal[".", ","] = "."
    decimals: int = Field(default=6, ge=1, le=9)
    diamond_radius_mm: float = Field(gt=0, le=50)
    limit_um: float = Field(default=LIMIT_UM, gt=0, le=1000)
    step_um: float = Field(default=STEP_UM, ge=0.5, le=10)

    @model_validator(mode="after")
    def _fits(self) -> DresserData:
        if len(set(self.columns)) != len(self.columns):
            raise ValueError("a column is named twice")
        if self.headings and len(self.headings) != len(self.columns):
            raise ValueError(f"{len(self.headings)} headings for {len(self.columns)} columns")
        if self.separator == self.decimal:
            raise ValueError("separator and decimal sign are the same")
        needed = {"correction"} if "correction" in self.columns else {"centre_radius", "centre_axial"}
        if not needed <= set(self.columns) or ("correction" in self.columns and "axial" not in self.columns):
            raise ValueError(
                "the table needs the columns axial and correction, or centre_radius and centre_axial: known are "
                + ", ".join(COLUMNS)
            )
        return self

    @property
    def table(self) -> DresserTable:
        """What turns points into rows."""
        return DresserTable(
            columns=self.columns,
            length_unit=self.length_unit,
            correction_unit=self.correction_unit,
            sign=self.sign,
            axial_sense=self.axial_sense,
            along=self.along,
        )


class DresserFile(BaseModel):
    """A dresser file: one section."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    dresser: DresserData


@dataclass(frozen=True, slots=True)
class Dresser:
    """A dresser file that was read, and where the proof of its sense lies."""

    data: DresserData
    path: Path

    @property
    def digest(self) -> str:
        """Of what the table means: a proof counts for this alone."""
        meant = self.data.model_dump(mode="json", exclude={"limit_um", "step_um", "diamond_radius_mm"})
        return sha256(json.dumps(meant, sort_keys=True).encode()).hexdigest()

    @property
    def proof_path(self) -> Path:
        """Beside the dresser file."""
        return self.path.with_suffix(".proof.json")

    def keep(self, proof: SenseProof) -> Path:
        """Store a proof. Raises StoreError (E-STUDY-WRITE)."""
        return _write(self.proof_path, json.dumps({"dresser": self.digest, **asdict(proof)}, indent=1) + "\n")

    def demand_proved(self) -> None:
        """Raise ConfigError (E-WHEEL-UNPROVED, E-WHEEL-SENSE) unless a step has proved what + means to this dresser."""
        try:
            said = json.loads(self.proof_path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            said = {}
        if not isinstance(said, Mapping) or said.get("dresser") != self.digest:
            raise ConfigError("E-WHEEL-UNPROVED", str(self.path), proof=str(self.proof_path))
        if said.get("verdict") != "proved":
            raise ConfigError("E-WHEEL-SENSE", str(self.proof_path), verdict=str(said.get("verdict")))


def load_dresser(path: Path) -> Dresser:
    """Read a dresser file. Raises ConfigError (E-STUDY-READ, E-STUDY-TOML, E-STUDY-VALUE) with file, key and why."""
    try:
        data = read_toml(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("E-STUDY-READ", str(path), why=str(error)) from error
    except ValueError as error:
        raise ConfigError("E-STUDY-TOML", str(path), why=str(error)) from error
    return Dresser(validate_file(data, DresserFile, str(path)).dresser, path)


def dresser_text(data: DresserData, found: WheelCorrection) -> str:
    """The table as the dresser takes it."""
    out = io.StringIO()
    writer = csv.writer(out, delimiter=data.separator, lineterminator="\n")
    if data.headings:
        writer.writerow(data.headings)
    for row in data.table.rows(found):
        writer.writerow([f"{one:.{data.decimals}f}".replace(".", data.decimal) for one in row])
    return out.getvalue()


def write_dresser(path: Path, data: DresserData, found: WheelCorrection) -> Path:
    """The dresser's table as a file. Raises StoreError (E-STUDY-WRITE)."""
    return _write(path, dresser_text(data, found))


def write_wheel(path: Path, found: WheelCorrection) -> Path:
    """All points as CSV, as `wheel_text`. Raises StoreError (E-STUDY-WRITE)."""
    return _write(path, wheel_text(found))


def wheel_text(found: WheelCorrection) -> str:
    """All points as CSV (`WHEEL_COLUMNS`), + = larger wheel."""
    columns = (
        np.rad2deg(found.theta_rad), found.radius_mm, found.axial_mm, found.normal[:, 0], found.normal[:, 1],
        found.correction_um, found.u_um, found.centre_mm[:, 0], found.centre_mm[:, 1],
    )  # fmt: skip
    return rows_text(WHEEL_COLUMNS, np.stack(columns, axis=-1).tolist())


def write_wheel_dxf(path: Path, found: WheelCorrection) -> Path:
    """The axial section (x axial, y radius, mm) as DXF R2010: wanted, corrected 1000 times enlarged, diamond's centre.

    Raises ConfigError (E-EXTRA-MISSING) without ezdxf, StoreError (E-STUDY-WRITE).
    """
    try:
        import ezdxf  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError("E-EXTRA-MISSING", str(path), extra="cad", packages="ezdxf") from error
    drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
    wanted = np.stack([found.axial_mm, found.radius_mm], axis=1)
    moved = wanted + 1e-3 * EXAGGERATED * found.correction_um[:, None] * found.normal[:, ::-1]
    layers = {"WHEEL": wanted, "CORRECTION_X1000": moved, "DIAMOND_CENTRE": found.centre_mm[:, ::-1]}
    for name, points in layers.items():
        drawing.layers.add(name)
        drawing.modelspace().add_lwpolyline(points.tolist(), dxfattribs={"layer": name})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        drawing.saveas(path)
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=error.strerror or str(error)) from error
    return path


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=error.strerror or str(error)) from error
    return path


def separation_sheet(figure: Any, found: Separation) -> None:
    """Shares as bars with their u, and the wheel's form on both flanks, um; for a matplotlib figure."""
    left, right = figure.subplots(1, 2)
    names = [one.name for one in found.shares]
    at = np.arange(len(names))[::-1]
    left.barh(at, [one.rms_um for one in found.shares], xerr=[one.u_um for one in found.shares], color=NEW, ecolor=OLD)
    left.set_yticks(at, names)
    left.set_xlabel("RMS on the flank  µm")
    form = found.form
    degrees, u = np.rad2deg(form.theta_rad), 2.0 * np.asarray(form.u_um)
    value = np.asarray(form.deviation_um)
    for side in (form.theta_rad < 0.0, form.theta_rad > 0.0):
        right.fill_between(degrees[side], (value - u)[side], (value + u)[side], color=RULE)
        right.plot(degrees[side], value[side], color=NEW)
    right.axhline(0.0, color=INK, linewidth=0.6)
    right.set_xlabel("profile angle  deg (left flank > 0)")
    right.set_ylabel("form of the wheel on the flank  µm (k = 2)")
    figure.suptitle(f"{', '.join(found.parts)}: {found.total_um:.2f} µm RMS", fontsize=10, color=INK)


def separation_data(found: Separation) -> dict[str, Any]:
    """Plain data of a separation, units in the names."""
    form = found.form
    points = {
        "theta_deg": np.rad2deg(form.theta_rad).tolist(),
        "deviation_um": np.asarray(form.deviation_um).tolist(),
        "u_um": np.asarray(form.u_um).tolist(),
    }
    return {
        "parts": list(found.parts),
        "total_um": found.total_um,
        "point_u_um": found.point_u_um,
        "shares": {one.name: {"rms_um": one.rms_um, "u_um": one.u_um} for one in found.shares},
        "details": {one.name: {"rms_um": one.rms_um, "u_um": one.u_um} for one in found.details},
        "diamond_um": {"value": found.diamond.value, "u": found.diamond.u, "named": found.diamond_named},
        **{
            name: {key: {"value": one.value, "u": _finite(one.u), "unit": one.unit} for key, one in values.items()}
            for name, values in (("setup", found.setup), ("clamping", found.clamping), ("wear", found.wear))
        },
        "correlations": [list(one) for one in found.correlations],
        "form": points,
        "said": _texts(found.said),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _texts(said: Sequence[Any]) -> list[str]:
    return [str(one) for one in said]
