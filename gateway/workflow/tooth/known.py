"""What a stored run knows of its machine for a study: errors with their covariance, the control's grids, the shop.

A study of a run, by command or by the library, takes the same model, grids and shop as the run's own proposal for the
tooth, so that its uncertainties are those of the run's report.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from gateway.config import SiteFile, WorkSection, load_site
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.plan.plan import AxisGrid
from gateway.domain.captures import Capture
from gateway.evaluate.behaviour.fine_structure import HiddenStructure
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.study.inputs import SITE_FILE, ErrorFile, GridData, errors_from, is_run, model_of_run, run_folder
from gateway.workflow import stages
from gateway.workflow.errors21.components import grids
from gateway.workflow.tooth.shop import shop_of


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
