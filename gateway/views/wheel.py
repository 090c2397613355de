"""The wheel as an inspected part of a run shows it: causes, old and new profile, points to take along, as data."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drivers.errors import TrueflankError
from gateway.config import SiteFile
from gateway.domain.grinding_process import CorrectionOrder, Separation, WheelVerdict
from gateway.errors import NotFound
from gateway.process.wheel import WheelCorrection, predicted_form, wheel_correction
from gateway.store import RunFolder
from gateway.study.dresser import load_dresser, separation_data, wheel_text, write_wheel_dxf
from gateway.study.inputs import gear_of
from gateway.workflow.run import stages
from gateway.workflow.tooth.part_plan import gear_of_site, work_section

KINDS = {"csv": "text/csv; charset=utf-8", "dxf": "image/vnd.dxf"}


def wheel_of(folder: RunFolder, site: SiteFile, site_path: Path, part: str) -> dict[str, Any]:
    """A part's separation, the wheel's form now and after a dressing (um on the flank), and the points of its profile.

    ``why`` says why there are no points: no dresser named, or the correction is refused. ``order`` and ``verdict`` are
    those of a closing run. Raises NotFound (E-WEB-WHEEL) for a part that was not separated.
    """
    found = _separated(folder, part)
    form = found.form
    told: dict[str, Any] = {
        "part": part,
        "separation": separation_data(found),
        "theta_deg": np.rad2deg(form.theta_rad).tolist(),
        "old": {"um": np.asarray(form.deviation_um).tolist(), "u_um": np.asarray(form.u_um).tolist()},
        "new": None,
        "points": None,
        "why": None,
        "order": _plain(folder, stages.ORDER, CorrectionOrder),
        "verdict": _plain(folder, stages.WHEEL_VERDICT, WheelVerdict),
    }
    try:
        dressed = correction_of(folder, site, site_path, part)
    except TrueflankError as error:
        return {**told, "why": error.as_record()}
    after = predicted_form(form, dressed)
    points = {
        "radius_mm": dressed.radius_mm.tolist(),
        "axial_mm": dressed.axial_mm.tolist(),
        "correction_um": dressed.correction_um.tolist(),
        "u_um": dressed.u_um.tolist(),
    }
    new = {"um": np.asarray(after.deviation_um).tolist(), "u_um": np.asarray(after.u_um).tolist()}
    return {**told, "new": new, "points": points}


def wheel_file(folder: RunFolder, site: SiteFile, site_path: Path, part: str, kind: str) -> bytes:
    """The points as CSV, or the profile as DXF. Raises as `correction_of`, ConfigError (E-EXTRA-MISSING)."""
    dressed = correction_of(folder, site, site_path, part)
    if kind == "csv":
        return wheel_text(dressed).encode("utf-8")
    with TemporaryDirectory(prefix="trueflank-wheel-") as place:
        return write_wheel_dxf(Path(place) / "wheel.dxf", dressed).read_bytes()


def correction_of(folder: RunFolder, site: SiteFile, site_path: Path, part: str) -> WheelCorrection:
    """What to give the site's dresser by a part; whether its sense is proved is asked when it is given.

    Raises NotFound (E-WEB-WHEEL, E-WEB-NO-DRESSER), ConfigError, ModelError (E-WHEEL-...).
    """
    found, named = _separated(folder, part), work_section(site).dresser_file
    if not named:
        raise NotFound("E-WEB-NO-DRESSER", site.site.name)
    data = load_dresser(site_path.parent / named).data
    file = gear_of_site(site, site_path)
    limits = {"diamond_mm": data.diamond_radius_mm, "limit_um": data.limit_um}
    return wheel_correction(gear_of(file), file.grinding.centre_distance_mm, found, **limits)


def _separated(folder: RunFolder, part: str) -> Separation:
    if not folder.has(stages.separated(part)):
        raise NotFound("E-WEB-WHEEL", "web", part=part)
    return folder.get(stages.separated(part), Separation)


def _plain(folder: RunFolder, stage: str, kind: type[Any]) -> Any:
    """A stored record as plain data; None where it is not there."""
    if not folder.has(stage):
        return None
    folder.get(stage, kind)  # its hash is checked
    return json.loads(json.dumps(folder.envelope(stage)["record"]))
