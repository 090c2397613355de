"""What would be measured at a site, a capture's figures by a chosen standard, and a run's error model, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.types.values import FloatArray
from gateway.capture.targets import targets_of
from gateway.config import AxisSection, SiteFile
from gateway.correct.outlook.flank_uncertainty import THRESHOLD_UM, what_next
from gateway.correct.outlook.prediction import flank_map
from gateway.correct.outlook.ranking import ConstantShape, SizedError, cure_errors, errors_of, rank_errors
from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.domain.captures import Capture
from gateway.domain.figures import Component, Evaluation
from gateway.domain.values import COVERAGE
from gateway.errors import InvalidRequest, ModelError
from gateway.evaluate.behaviour import positioning
from gateway.evaluate.behaviour.doubts import all_doubts, remarks
from gateway.evaluate.standards import conformity
from gateway.evaluate.standards.registry import band_of, standard, standards
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.chain import Axis, Element
from gateway.model.components import is_periodic, motion_uncertainty, value
from gateway.model.error_model import ErrorModel, chain_of_errors, yk7350b
from gateway.report.tooth.errors import error_rows
from gateway.sensitivity.outputs import ScaledMotion
from gateway.store import RunFolder
from gateway.tooth import FlankMap, InspectedFlank, ToothProposal
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.errors21.setups import PlannedSetup, plan_setups, remountings
from gateway.workflow.run import stages
from gateway.workflow.tooth.proposal import PROFILE, WIDTH, ToothWork, work_of

# What would be measured at a site, as data: its axes, and the set-ups in the order with the fewest remountings.


def plan_of(site: SiteFile) -> dict[str, Any]:
    """Axes with their targets, set-ups in their order, positions in the axis' own unit (mm or deg); and the chain.

    ``chain`` names the axes from the bed outward to the work and to the wheel, each with its direction.
    """
    setups = plan_setups(site) if site.setups else ()
    return {
        "axes": [_axis(axis) for axis in site.axes],
        "setups": [_setup(one) for one in setups],
        "remountings": remountings(setups) if setups else 0,
        "chain": _chain(site),
    }


def _chain(site: SiteFile) -> dict[str, Any]:
    """As the site file tells it; else the form grinder's, where every axis is one of its own; else nothing is known."""
    sides = {"work": site.machine.work_side, "tool": site.machine.tool_side}
    if any(sides.values()):
        return {side: [_link(letter) for letter in letters] for side, letters in sides.items()}
    grinder = yk7350b()
    found = {"work": _links(grinder.work), "tool": _links(grinder.tool)}
    known = {one["letter"] for side in found.values() for one in side}
    return found if {axis.letter for axis in site.axes} <= known else {"work": [], "tool": []}


def _link(letter: str) -> dict[str, Any]:
    turning = letter in "ABC"
    direction = [float(letter in pair) for pair in ("XA", "YB", "ZC")]
    return {"letter": letter, "kind": "revolute" if turning else "prismatic", "direction": direction}


def _links(elements: tuple[Element, ...]) -> list[dict[str, Any]]:
    axes = [one for one in elements if isinstance(one, Axis)]
    return [{"letter": one.name, "kind": one.kind, "direction": [float(part) for part in one.vector]} for one in axes]


def _axis(axis: AxisSection) -> dict[str, Any]:
    measure = axis.measure
    return {
        "axis": axis.name,
        "letter": axis.letter,
        "reference": axis.reference if axis.kind == "rotary" else None,
        "unit": axis.unit,
        "component": measure.component,
        "instrument": measure.instrument,
        "targets": targets_of(axis).tolist(),
        "repetitions": measure.repetitions,
        "travel": list(axis.travel),
    }


def _setup(one: PlannedSetup) -> dict[str, Any]:
    setup = one.setup
    return {
        "setup": one.key,
        "component": setup.component,
        "axis": one.axis.name,
        "instrument": setup.instrument,
        "source": setup.source,
        "unit": one.unit,
        "targets": targets_of(one.axis).tolist(),
        "park": dict(setup.park),
    }


# A stored capture's figures by a standard that a person chooses, judged against limits that a person gives.


def known_standards() -> list[dict[str, Any]]:
    """Every standard by name, edition and what sets it apart, the newest ISO 230-2 first."""
    return [
        {"name": one.name, "edition": one.edition, "says": one.says.as_data(), "iso": one.iso} for one in standards()
    ]


def figures_by(folder: RunFolder, axis: str, phase: str, *, name: str, limits: Mapping[str, float]) -> dict[str, Any]:
    """Figures with U and verdicts of an axis' capture, in um or arcsec; with name "" those of the stored evaluation.

    A vendor's or national figure is made anew from the same readings, without Monte Carlo. Raises ModelError
    (E-EVAL-STANDARD, E-EVAL-LIMIT, E-EVAL-LIMIT-NAME), StoreError (E-STORE-STAGE).
    """
    capture = folder.get(f"capture-{axis}-{phase}", Capture)
    if not name:
        return _stored_figures(folder.get(f"evaluation-{axis}-{phase}", Evaluation), capture, limits)
    figured = positioning.evaluate_positioning(capture, name, limits=limits, monte_carlo=False)
    found = figured.result
    flags = (*found.flags, *remarks(figured.doubts), *(one.message for one in figured.supposed))
    contained = positioning.describe_contributions(figured.contributions, found.unit)
    return _figures_data(found.standard.name, found.unit, found.values, found.U, figured.verdicts, (*flags, contained))


def _stored_figures(kept: Evaluation, capture: Capture, limits: Mapping[str, float]) -> dict[str, Any]:
    values = {key: getattr(kept, key, None) for key in kept.U}
    doubts = all_doubts(capture)
    verdicts = positioning.withhold_verdicts(
        tuple(
            conformity.decide(key, values.get(key), U=kept.U.get(key), limit=limit)
            for key, limit in limits.items()
            if key in values
        ),
        doubts,
    )
    return _figures_data(
        kept.standard,
        kept.unit,
        values,
        kept.U,
        verdicts,
        (*kept.flags, *remarks(doubts)),
    )


def _figures_data(
    name: str, unit: str, values: Mapping[str, float | None], expanded: Mapping[str, float], verdicts: Any, flags: Any
) -> dict[str, Any]:
    judged = {
        one.parameter: {
            "limit": one.limit,
            "verdict": one.verdict,
            "why": one.why.as_data() if one.why is not None else "",
        }
        for one in verdicts
    }
    rows = [
        {"parameter": key, "value": _finite(value), "U": _finite(expanded.get(key)), **judged.get(key, {})}
        for key, value in values.items()
    ]
    return {
        "standard": name,
        "unit": unit,
        "rows": rows,
        "rule": conformity.RULE.as_data(),
        "flags": [one.as_data() for one in flags],
    }


def bands_by(folder: RunFolder, axis: str, phase: str, names: Sequence[str]) -> dict[str, Any]:
    """What each standard counts at every target of a stored capture: lowest and highest, um or arcsec; None: nothing.

    Raises ModelError (E-EVAL-STANDARD), StoreError (E-STORE-STAGE).
    """
    capture = folder.get(f"capture-{axis}-{phase}", Capture)
    found = [(name, band_of(name, capture.deviations)) for name in names]
    bands = [
        {"standard": standard(name).name, "low": _finites(low), "high": _finites(high)} for name, (low, high) in found
    ]
    return {"unit": capture.unit, "targets": capture.targets.tolist(), "bands": bands}


def environment_of(folder: RunFolder) -> list[dict[str, Any]]:
    """Air and material at the start and the end of each capture that a run stored, with utc, oldest first.

    Raises StoreError (E-STORE-STAGE).
    """
    captures = [folder.get(name, Capture) for name in folder.stages if name.startswith("capture-")]
    ends = [
        (utc, one.axis, air)
        for one in captures
        for utc, air in ((one.started_utc, one.ambient_start), (one.ended_utc, one.ambient_end))
    ]
    return [{"utc": utc, "axis": axis, **asdict(air)} for utc, axis, air in sorted(ends, key=lambda end: end[0]) if utc]


def _finites(values: FloatArray) -> list[float | None]:
    return [_finite(float(one)) for one in values]


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


# A run's error model for people: each error over its travel with its band, what it does to the tooth, what if.

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


def flank_at(
    folder: RunFolder,
    site: SiteFile,
    site_path: Path,
    sizes: Mapping[str, float],
    steps: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The flank of the measured machine with some errors at other sizes, to second order, one rotation removed; um.

    ``sizes`` are multiples by error name: of a measured error what it is, of an unknown one its assumed span; what is
    not named stays as measured, or zero. Deviations (K, T, Z), + surplus. Raises TrueflankError (E-WEB-BODY: an error
    that the model does not have, or a multiple beyond +/- 2), StoreError, and what the gear raises.

    With ``steps`` also ``tables``: the flank that axis tables, cross tables and set-up values at their best for that
    machine leave, ``steps`` (mm or deg by axis letter) in place of the site's spacing; and their points. Raises
    TrueflankError (E-WEB-BODY: a spacing that is none of `model_of`), Gap (E-COMP-REACH), ModelError (E-CORRECT-...).
    """
    seen = _MachineForProposal.of(folder.get(stages.ERRORS, ErrorModel), site, work_of(site, site_path))
    machine = seen.resized(sizes)
    found = _flank_data(flank_map(machine, seen.grid))
    if steps is None:
        return found
    plan = seen.spaced(steps)
    corrected = correct(machine, seen.grid, plan=plan)
    points = {one.axis: round((one.maximum - one.minimum) / one.step) + 1 for one in plan.grids}
    return {**found, "tables": {**_flank_data(flank_map(corrected.unmoved, seen.grid)), "points": points}}


def _flank_data(found: FlankMap) -> dict[str, Any]:
    return {
        "theta_rad": found.theta_rad.tolist(),
        "z_mm": found.z_mm.tolist(),
        "deviation_um": np.round(found.deviation_um, 4).tolist(),
        "rms_um": found.rms_um,
        "largest_um": found.largest_um,
    }


def form_of(folder: RunFolder, site: SiteFile, site_path: Path, stage: str) -> dict[str, Any]:
    """Where the points of a run's flank map are on one space of the nominal gear, for a picture of it.

    ``stage`` is "tooth" or an inspection. Profile points (x, y) in mm in the frame of space 0 and their outward unit
    normals, (T, 2) each, along which surplus counts as +; profile angles in deg, heights in mm, and the spaces.
    Raises StoreError (E-STORE-STAGE), InvalidRequest (E-WEB-BODY), and what the gear raises.
    """
    if stage == stages.TOOTH:
        shown = folder.get(stages.TOOTH, ToothProposal).prediction.after
    elif stage.startswith("inspected-"):
        shown = folder.get(stage, InspectedFlank).fitted
    else:
        raise InvalidRequest("E-WEB-BODY", "web", why="stage: tooth, inspected-before, inspected-after")
    section = work_of(site, site_path).gear.section(shown.theta_rad)
    return {
        "points_mm": np.round(section.xy, 5).tolist(),
        "normals": np.round(np.stack([section.nx, section.ny], axis=-1), 6).tolist(),
        "angle_deg": np.round(np.degrees(shown.theta_rad), 4).tolist(),
        "z_mm": shown.z_mm.tolist(),
        "spaces": shown.deviation_um.shape[0],
    }


@dataclass(frozen=True)
class _MachineForProposal:
    """The measured machine with its gear, as the proposal for the tooth sees it."""

    model: ErrorModel
    grinding: Grinding
    grid: FlankGrid
    plan: Plan

    @classmethod
    def of(cls, model: ErrorModel, site: SiteFile, work: ToothWork) -> _MachineForProposal:
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

    def spaced(self, steps: Mapping[str, float]) -> Plan:
        """The plan with other distances between the points of tables. Raises TrueflankError (E-WEB-BODY)."""
        known = {one.axis: spacings_of(one) for one in self.plan.grids}
        for axis, step in steps.items():
            if not any(abs(step - one) < SAME_STEP for one in known.get(axis, ())):
                raise InvalidRequest("E-WEB-BODY", "web", why=f"steps: {axis}:{step:g}")
        grids_ = tuple(replace(one, step=_exact_step(one, steps.get(one.axis, one.step))) for one in self.plan.grids)
        return replace(self.plan, grids=grids_)


SAME_STEP = 1e-6
FINEST, MOST_INTERVALS, FEWEST_INTERVALS = 0.001, 360, 2
"""Spacings to choose from: whole thousandths of mm or deg."""


def spacings_of(grid: AxisGrid) -> list[float]:
    """Distances between points (mm or deg) that divide a table's range exactly, ascending; the site's is among them.

    A harmonic of a turn needs three points at least.
    """
    span, least = grid.maximum - grid.minimum, FEWEST_INTERVALS + int(grid.modulo)
    found = {round(grid.step, 9)}
    for count in range(least, MOST_INTERVALS + 1):
        step = span / count
        if abs(step / FINEST - round(step / FINEST)) < SAME_STEP / FINEST:
            found.add(round(step, 9))
    return sorted(found)


def _exact_step(grid: AxisGrid, step: float) -> float:
    """A chosen step without what its digits lost."""
    span = grid.maximum - grid.minimum
    return span / round(span / step)


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
    seen = _MachineForProposal.of(model, site, work)
    stored = folder.get(stages.TOOTH, ToothProposal) if folder.has(stages.TOOTH) else None
    machine = (seen.grinding, seen.grid, seen.plan, model)
    units = {one.letter: one.unit for one in site.axes}
    used = {*seen.plan.own, *(over for _out, over in seen.plan.cross)}
    return {
        "gear": work.name,
        "ranking": [asdict(one) for one in (stored.ranking if stored else rank_errors(*machine))],
        "cures": [asdict(one) for one in (stored.cures if stored else cure_errors(*machine))],
        "sizes": {name: _range(one) for name, one in seen.errors.items()},
        "spacings": [
            {"axis": one.axis, "unit": units[one.axis], "step": one.step, "steps": spacings_of(one)}
            for one in seen.plan.grids
            if one.axis in used
        ],
        "next": [asdict(one) for one in what_next(model, work.tooth, grids(site))],
        "threshold_um": THRESHOLD_UM,
        "setup": asdict(stored.setup) if stored else None,
    }
