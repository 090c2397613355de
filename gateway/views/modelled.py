"""A run's error model for people: each error over its travel with its band, what it does to the tooth, what if."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.types.values import FloatArray
from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import THRESHOLD_UM, what_next
from gateway.correct.outlook.prediction import flank_map
from gateway.correct.outlook.ranking import ConstantShape, SizedError, cure_errors, errors_of, rank_errors
from gateway.correct.plan.plan import Plan
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE
from gateway.errors import InvalidRequest, ModelError
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.components import is_periodic, motion_uncertainty, value
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.report.tooth.errors import error_rows
from gateway.sensitivity.outputs import ScaledMotion
from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.run import stages
from gateway.workflow.tooth.proposal import PROFILE, WIDTH, ToothWork, work_of

POINTS = 61
MOST = 2.0
"""An error is looked at between none of it, or its opposite, and this multiple."""


def model_of(folder: RunFolder, site: SiteFile, site_path: Path) -> dict[str, Any]:
    """Every error of a run: range, U (k = 2), its curve with its band; with a gear its effect, cure, and what is next.

    Curves are in um or arcsec over mm or deg. ``tooth`` is None where the site names no gear that can be read or
    the work lies where an error is not known (E-MODEL-RANGE), and ``why`` the reason.
    Raises StoreError (E-STORE-STAGE: no errors in this run).
    """
    model = folder.get(stages.ERRORS, ErrorModel)
    curves = {one.name: _curve(one, model.systematic.get(one.name, 0.0)) for one in model.motions}
    errors = [{**row.as_data(), "curve": curves.get(row.name)} for row in error_rows(model)]
    said = [one.as_data() for one in model.said]
    try:
        tooth = _tooth(folder, site, model, work_of(site, site_path))
    except (ConfigError, ModelError) as error:
        return {
            "errors": errors,
            "said": said,
            "tooth": None,
            "why": error.as_record(),
        }
    return {"errors": errors, "said": said, "tooth": tooth, "why": None}


def flank_at(folder: RunFolder, site: SiteFile, site_path: Path, sizes: Mapping[str, float]) -> dict[str, Any]:
    """The flank of the measured machine with some errors at other sizes, to second order, one rotation removed; um.

    ``sizes`` are multiples by error name: of a measured error what it is, of an unknown one its assumed span; what is
    not named stays as measured, or zero. Deviations (K, T, Z), + surplus. Raises TrueflankError (E-WEB-BODY: an error
    that the model does not have, or a multiple beyond +/- 2), StoreError, and what the gear raises.
    """
    seen = _Seen.of(folder.get(stages.ERRORS, ErrorModel), site, work_of(site, site_path))
    found = flank_map(seen.resized(sizes), seen.grid)
    return {
        "theta_rad": found.theta_rad.tolist(),
        "z_mm": found.z_mm.tolist(),
        "deviation_um": np.round(found.deviation_um, 4).tolist(),
        "rms_um": found.rms_um,
        "largest_um": found.largest_um,
    }


@dataclass(frozen=True)
class _Seen:
    """The measured machine with its gear, as the proposal for the tooth sees it."""

    model: ErrorModel
    grinding: Grinding
    grid: FlankGrid
    plan: Plan

    @classmethod
    def of(cls, model: ErrorModel, site: SiteFile, work: ToothWork) -> _Seen:
        grinding = Grinding(chain_of_errors(model, height_mm=work.height_mm), work.gear, work.centre_distance_mm)
        return cls(
            model, grinding, flank_grid(work.gear, profile=PROFILE, width=WIDTH), Plan(grids(site), zeros=("X",))
        )

    @property
    def errors(self) -> dict[str, SizedError]:
        """Every error by its name."""
        return {one.parameter.name: one for one in errors_of(self.grinding, self.plan, self.model)}

    def resized(self, sizes: Mapping[str, float]) -> Grinding:
        """The same with errors times their multiples. Raises TrueflankError (E-WEB-BODY)."""
        known = self.errors
        for name, size in sizes.items():
            if name not in known or not abs(size) <= MOST:
                raise InvalidRequest("E-WEB-BODY", "web", why=f"sizes: {name}:{size:g}; known, within +/- {MOST:g}")
        changed = {name: _times(known[name], size) for name, size in sizes.items()}
        return replace(self.grinding, chain=self.grinding.chain.with_errors(changed))


def _range(one: SizedError) -> dict[str, float]:
    """What a person may try: a measured error from none to twice, an unknown one within its span."""
    return {"low": one.low, "high": MOST + one.low, "at": 1.0 + one.low}


def _times(one: SizedError, size: float) -> ScaledMotion | float:
    basis = one.parameter.basis
    if basis is None or (isinstance(basis, ConstantShape) and not one.parameter.name.startswith("E")):
        return size * (basis.value if isinstance(basis, ConstantShape) else 1.0)
    return ScaledMotion(basis, size)


def _curve(one: Component, systematic: float) -> dict[str, Any]:
    low, high = (0.0, 360.0) if is_periodic(one) else one.domain
    at = np.linspace(low, high, POINTS)
    U = COVERAGE * np.hypot(motion_uncertainty(one, at), systematic)
    return {"axis": one.axis, "unit": one.axis_unit, "at": _list(at), "value": _list(value(one, at)), "U": _list(U)}


def _list(values: FloatArray) -> list[float]:
    return [float(one) for one in np.round(values, 4)]


def _tooth(folder: RunFolder, site: SiteFile, model: ErrorModel, work: ToothWork) -> dict[str, Any]:
    """Ranking and cures as the run stored them, else worked out as it would; what to measure next is always of now."""
    seen = _Seen.of(model, site, work)
    stored = folder.get(stages.TOOTH, ToothProposal) if folder.has(stages.TOOTH) else None
    machine = (seen.grinding, seen.grid, seen.plan, model)
    return {
        "gear": work.name,
        "ranking": [asdict(one) for one in (stored.ranking if stored else rank_errors(*machine))],
        "cures": [asdict(one) for one in (stored.cures if stored else cure_errors(*machine))],
        "sizes": {name: _range(one) for name, one in seen.errors.items()},
        "next": [asdict(one) for one in what_next(model, work.tooth, grids(site))],
        "threshold_um": THRESHOLD_UM,
    }
