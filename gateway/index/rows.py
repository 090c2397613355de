"""The rows of the index, and how a run folder becomes them; what cannot be read becomes a row with its problem."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gateway.domain.figures import Evaluation
from gateway.errors import StoreError
from gateway.push import table_id, table_states
from gateway.store import RunFolder, RunSummary, canonical, sha256
from gateway.tooth import ToothVerdict
from gateway.workflow.run import stages

PARAMETERS = ("E", "R", "B", "A", "M")
FLANK, FLANK_PARAMETERS = "flank", ("rms",)


def gateway_name(root: Path) -> str:
    """What tells this store's runs from those of other gateways in one database."""
    return f"{platform.node()}:{root.resolve()}"[-200:]


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


@dataclass(frozen=True, slots=True)
class IndexedTable:
    """A table that should act in a machine by what was pushed; ``seal`` changes whenever the machine's journals do.

    ``name`` as in a proposal ("C1", a cross table with its number), ``table_id`` of its points. Where a journal
    cannot be believed nobody knows what should act: one row without a name, with its problem.
    """

    gateway: str
    serial: str
    name: str
    axis: str
    table_id: str
    transaction: int
    utc: str
    enabled: bool
    kind: str
    problem: str
    seal: str


def read_run(gateway: str, run: RunSummary) -> tuple[IndexedRun, list[IndexedFigure]]:
    """A run as its line in the list of runs has it, with its figures; none where it cannot be read."""
    row = IndexedRun(
        gateway=gateway,
        run_id=run.run_id,
        site=run.site,
        serial=run.machine,
        created_utc=run.created_utc,
        state=run.state,
        software=run.software,
        problem=run.problem,
        seal=seal_of(run),
    )
    try:
        return row, list(figures_of(gateway, RunFolder(run.path))) if not run.problem else []
    except StoreError:
        return row, []  # it changed while it was read: the next time finds it


def seal_of(run: RunSummary) -> str:
    """What changes whenever a run does, or what keeps it from being read."""
    return f"unreadable {run.problem}"[:64] if run.problem else run.seal


def tables_of(gateway: str, journals: Path, serial: str, seal: str) -> Iterator[IndexedTable]:
    """What pushes left in one machine."""
    try:
        for one in table_states(journals, serial):
            if one.push is None:
                continue
            yield IndexedTable(
                gateway=gateway,
                serial=serial,
                name=one.table,
                axis=one.axis,
                table_id=one.name.id or table_id(one.push),
                transaction=one.push.transaction,
                utc=one.name.utc or one.push.utc,
                enabled=one.acts == "on",
                kind=one.push.new.table.kind,
                problem=one.held.words if one.held is not None else "",
                seal=seal,
            )
    except StoreError as error:
        nothing = {"name": "", "axis": "", "table_id": "", "transaction": 0, "utc": "", "enabled": False, "kind": ""}
        yield IndexedTable(gateway=gateway, serial=serial, **nothing, problem=str(error), seal=seal)  # type: ignore[arg-type]


def journals_seal(journals: Path) -> str:
    """What changes whenever a journal of a store begins, goes on or ends."""
    found = sorted(path for path in journals.rglob("tx-*.jnl")) if journals.is_dir() else []
    marks = [(str(path.relative_to(journals)), stat.st_size, stat.st_mtime_ns) for path, stat in _stats(found)]
    return sha256(canonical({"journals": marks}))


def _stats(paths: Iterable[Path]) -> Iterator[tuple[Path, os.stat_result]]:
    for path in paths:
        with suppress(OSError):  # it was set aside meanwhile: the next time finds it
            yield path, path.stat()


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
