"""Many machines through their closing runs at once, each in a process's own virtual time.

What a machine gave is kept, where a folder is named for it: a run of hours that was stopped goes on where it was.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from simulators.cellfile import CellFile, load_cell, with_plan
from tests.closing.families import relative
from tests.closing.kept import Kept
from tests.closing.machines import machine
from tests.closing.record import MachineResult


@dataclass(frozen=True, slots=True)
class Job:
    """One machine: a packaged cell by name, or a seeded machine by its number, of a family or of the class.

    ``gear`` is what it grinds, "" for its own; a ``short`` run measures from files, and few targets where it pushes.
    """

    seed: int
    packaged: str = ""
    family: str = ""
    gear: str = ""
    short: bool = False

    @property
    def name(self) -> str:
        """What it is called in the table."""
        return self.packaged or f"{self.family or 'machine'}-{self.seed}"

    @property
    def key(self) -> str:
        """What its result is kept by."""
        return "-".join([self.name, *self.gear.split(), "short" if self.short else "whole"])

    def cell(self) -> CellFile:
        """Its cell file with the whole measuring plan."""
        if self.packaged:
            return with_plan(load_cell(self.packaged))
        return relative(self.family, self.seed, self.gear) if self.family else machine(self.seed, self.gear)


def jobs(count: int) -> list[Job]:
    """The demo cell, the 11-lobe cell, and so many seeded machines."""
    return [Job(0, "demo"), Job(0, "eleven"), *(Job(seed) for seed in range(1, count + 1))]


def prove_one(job: Job, folder: Path) -> MachineResult:
    """One machine in a folder that is removed when its run came to an end."""
    from tests.closing.runs import quick, run_machine

    edit = quick if job.short else None
    result = run_machine(job.cell(), job.seed, folder, short=job.short, edit=edit, least=not job.short)
    if not result.failed:
        shutil.rmtree(folder)
    return result


def prove(
    wanted: Sequence[Job],
    folder: Path,
    workers: int,
    heard: Callable[[MachineResult], None],
    kept: Kept[MachineResult] | None = None,
) -> list[MachineResult]:
    """All machines in their order; `heard` is told each as it ends. What a run raises by mistake is its failure.

    What is ``kept`` is not run again, and what ends well is kept; a run that ended with an error is tried anew.
    """
    found = {job: result for job in wanted if kept is not None and (result := kept.get(job.key)) is not None}
    for result in found.values():
        heard(result)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(prove_one, job, folder / job.name): job for job in wanted if job not in found}
        for future in as_completed(running):
            job = running[future]
            found[job] = _result(job, future)
            if kept is not None and not found[job].failed:
                kept.put(job.key, found[job])
            heard(found[job])
    return [found[job] for job in wanted]


def _result(job: Job, future: Future[MachineResult]) -> MachineResult:
    error = future.exception()
    if error is None:
        return future.result()
    part = job.cell().part
    gear, lobes = (part.name, part.gear.zc) if part is not None else ("", 0)
    failed = f"{type(error).__name__}: {str(error)[:200]}"
    return MachineResult(job.name, job.seed, gear, lobes, short=False, utc="", failed=failed)
