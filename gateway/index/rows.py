"""The rows of the index, and how a run folder becomes them; what cannot be read becomes a row with its problem."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gateway.domain.figures import Evaluation
from gateway.errors import StoreError
from gateway.store import RunFolder, RunSummary
from gateway.store.records import canonical, sha256
from gateway.tooth import ToothVerdict
from gateway.workflow import stages

PARAMETERS = ("E", "R", "B", "A", "M")
FLANK, FLANK_PARAMETERS = "flank", ("rms",)


@dataclass(frozen=True, slots=True)
class IndexedRun:
    """One run of one gateway; ``seal`` changes whenever its run.json does."""

    gateway: str
    run_id: str
    site: str
    serial: str
    created_utc: str
    state: str
    software: str
    problem: str
    seal: str


@dataclass(frozen=True, slots=True)
class IndexedFigure:
    """One figure of one run: of an axis or of the flank, before or after; ``expanded`` is U (k = 2) where known."""

    gateway: str
    run_id: str
    subject: str
    phase: str
    parameter: str
    value: float
    expanded: float | None
    unit: str


def row_of(gateway: str, run: RunSummary, seal: str) -> IndexedRun:
    """A run as its line in the list of runs has it."""
    return IndexedRun(
        gateway=gateway,
        run_id=run.run_id,
        site=run.site,
        serial=run.machine,
        created_utc=run.created_utc,
        state=run.state,
        software=run.software,
        problem=run.problem,
        seal=seal,
    )


def seal_of(run: RunSummary) -> str:
    """What changes whenever a run does; "" where it cannot be read."""
    if run.problem:
        return f"unreadable {run.problem}"[:64]
    try:
        return sha256(canonical(dict(RunFolder(run.path).facts)))
    except (StoreError, TypeError, ValueError):
        return ""


def figures_of(gateway: str, folder: RunFolder) -> Iterator[IndexedFigure]:
    """E, R, B, A, M of every axis before and after with their U, and the flank's. A damaged stage is left out."""
    for stage in folder.stages:
        kind, _, rest = stage.partition("-")
        subject, _, phase = rest.rpartition("-")
        try:
            if kind == "evaluation" and phase in ("before", "after"):
                yield from _axis(gateway, folder, subject, phase)
            elif stage == stages.TOOTH_VERDICT:
                yield from _flank(gateway, folder)
        except StoreError:
            continue  # the run's own pages say what is damaged


def _axis(gateway: str, folder: RunFolder, axis: str, phase: str) -> Iterator[IndexedFigure]:
    found = folder.get(f"evaluation-{axis}-{phase}", Evaluation)
    for name in PARAMETERS:
        value = getattr(found, name)
        if value is not None:
            yield IndexedFigure(
                gateway=gateway,
                run_id=folder.run_id,
                subject=axis,
                phase=phase,
                parameter=name,
                value=float(value),
                expanded=found.U.get(name),
                unit=found.unit,
            )


def _flank(gateway: str, folder: RunFolder) -> Iterator[IndexedFigure]:
    found = folder.get(stages.TOOTH_VERDICT, ToothVerdict)
    for phase, value in (("before", found.before_um), ("after", found.after_um)):
        yield IndexedFigure(
            gateway=gateway,
            run_id=folder.run_id,
            subject=FLANK,
            phase=phase,
            parameter="rms",
            value=value,
            expanded=found.u_um,
            unit="um",
        )
