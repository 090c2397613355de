"""What a stored run knows of its machine for a study: errors with their covariance, the control's grids, the shop.

A study of a run, by command or by the library, takes the same model, grids and shop as the run's own proposal for the
tooth, so that its uncertainties are those of the run's report.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import hypot
from pathlib import Path

from drivers.message import Message, digits, fixed
from gateway.config import SiteFile, WorkSection, load_site
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.plan.plan import AxisGrid
from gateway.domain.captures import Capture
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour.fine_structure import HiddenStructure
from gateway.evaluate.behaviour.repeatability import approach_of, instrument_noise
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.study.inputs import SITE_FILE, ErrorFile, GridData, errors_from, is_run, model_of_run, run_folder
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.run import stages


@dataclass(frozen=True, slots=True)
class KnownMachine:
    """A machine's errors as a study takes them. Of a run also its model, with ``work`` and ``captures`` by letter."""

    errors: ErrorFile
    model: ErrorModel | None = None
    work: WorkSection | None = None
    captures: Mapping[str, Capture] = field(default_factory=dict)

    def shop(self, grinding: Grinding) -> ProcessUncertainty:
        """Clamping, drift and scatter as the run's own proposal takes them; the usual where a run says nothing."""
        return shop_of(self.work, self.captures, grinding)


def known_machine(path: Path, height_mm: float | None = None) -> KnownMachine:
    """An error file, or what a run (its folder or errors.json) knows of its machine; raises as `errors_from`.

    The tables' grids are those of the site file that the run keeps. Raises ConfigError for a site file that is none.
    """
    errors = errors_from(path, height_mm)
    if not is_run(path):
        return KnownMachine(errors)
    model, folder = model_of_run(path), run_folder(path)
    if folder is None or not (folder.path / SITE_FILE).is_file():
        return KnownMachine(errors, model)
    site = load_site(folder.path / SITE_FILE)
    tables = {one.axis: _data(one) for one in grids(site)}
    captures = {
        axis.letter: folder.get(stages.capture(axis.name, "before"), Capture)
        for axis in site.axes
        if folder.has(stages.capture(axis.name, "before"))
    }
    model = with_between(model, folder, site)
    return KnownMachine(errors.model_copy(update={"tables": tables}), model, site.work, captures)


def with_between(model: ErrorModel, folder: RunFolder, site: SiteFile) -> ErrorModel:
    """The model with what the axes' check stops saw between the targets as structure that no fit follows."""
    seen = {
        axis.measure.component: folder.get(stages.hidden(axis.name), HiddenStructure).u
        for axis in site.axes
        if folder.has(stages.hidden(axis.name))
    }
    motions = (replace(one, residual_rms=max(one.residual_rms, seen.get(one.name, 0.0))) for one in model.motions)
    return replace(model, motions=tuple(motions))


def _data(grid: AxisGrid) -> GridData:
    return GridData(
        minimum=grid.minimum, maximum=grid.maximum, step=grid.step, reference=grid.reference, modulo=grid.modulo
    )


# What the captures and the site file tell of the shop: drift, clamping, scatter; and what is said of it.


def _with_drift(shop: ProcessUncertainty, captures: Mapping[str, Capture], grinding: Grinding) -> ProcessUncertainty:
    """Drift measured is drift believed: the larger of what the site file says and what the captures saw."""
    seen = {letter: abs(capture.drift_per_h) for letter, capture in captures.items()}
    return replace(
        shop,
        drift_um_per_h=max(shop.drift_um_per_h, seen.get(grinding.infeed, 0.0)),
        drift_arcsec_per_h=max(shop.drift_arcsec_per_h, seen.get(grinding.index, 0.0)),
    )


def drift_warning(shop: ProcessUncertainty, work: WorkSection | None) -> tuple[Message, ...]:
    """Where a drift was seen that is larger than the site file's, in words."""
    said = _stated_shop(work)
    pairs = (
        ("infeed", shop.drift_um_per_h, said.drift_um_per_h, "um"),
        ("index", shop.drift_arcsec_per_h, said.drift_arcsec_per_h, "arcsec"),
    )
    return tuple(
        Message.of("S-TOOTH-DRIFT", what=what, seen=fixed(seen, 1), said=digits(told, 6), unit=unit)
        for what, seen, told, unit in pairs
        if seen > told
    )


def noise_warning(measured: Mapping[str, MeasuredAxis]) -> tuple[Message, ...]:
    """Where the instrument at rest scatters more than its readings' own windows show, in words."""
    captures = {name: item.capture for name, item in measured.items() if item.capture.rest_count}
    return tuple(
        Message.of(
            "S-TOOTH-NOISE",
            axis=name,
            noise=digits(one.rest_u),
            axis_own=digits(approach_of(one).scatter),
            unit=one.unit,
        )
        for name, one in captures.items()
        if instrument_noise(one) > one.reading_u
    )


def _stated_shop(work: WorkSection | None) -> ProcessUncertainty:
    """What the site file says of clamping, drift and times; the usual where it says nothing."""
    if work is None:
        return ProcessUncertainty()
    keys = ("clamping_um", "drift_um_per_h", "drift_arcsec_per_h", "part_h")
    return replace(
        ProcessUncertainty(), **{key: getattr(work, key) for key in keys}, size_um=work.inspection_size_um / COVERAGE
    )


def shop_of(work: WorkSection | None, captures: Mapping[str, Capture], grinding: Grinding) -> ProcessUncertainty:
    """What site file and captures (by axis letter) say of clamping, drift and scatter; the usual for the rest."""
    shop = _with_drift(_stated_shop(work), captures, grinding)
    known = {letter: approach_of(capture) for letter, capture in captures.items()}
    if grinding.infeed in known:
        shop = replace(shop, infeed_um=known[grinding.infeed].scatter)
    if grinding.index in known:
        turned = known[grinding.index]
        shop = replace(shop, index_arcsec=hypot(turned.scatter, turned.reversal))
    return shop
