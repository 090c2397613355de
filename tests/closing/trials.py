"""Proposals tried on true machines, many of them: what the model of the errors says of a flank, judged by the truth.

A trial has no press, no inspection and no clamping: set-up values are right in it. So it judges what the errors' own
doubts make of u, and of the shop's only how an axis comes to a place, where the axes of the machine scatter.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from math import hypot
from multiprocessing import get_context
from pathlib import Path

from drivers.clock import run_virtual
from drivers.errors import TrueflankError
from gateway.correct.outlook.flank_uncertainty import CLAMPING, DRIFT, INDEX, INFEED, SETUP, SIZE
from simulators.cellfile import CellFile
from tests.closing.families import relative
from tests.closing.honesty import FAMILY, POOLED, Spread
from tests.closing.kept import Kept
from tests.closing.others import other
from tests.closing.proposed import Tried, tried

SHOP = {CLAMPING, DRIFT, INDEX, INFEED, SETUP, SIZE}
OTHER, FEW = "other", "11-lobe disc"
LEAST, SURE = 0.3, 3.0


@dataclass(frozen=True, slots=True)
class Trial:
    """One machine: RMS of the true flank before and with what was proposed, set-up values right, um.

    ``missed_um`` of the prediction, whose standard uncertainty is ``u_um``; ``acting_u_um`` is the part of it that
    could act here. ``axes``: M of the linear axes before and after, um. ``failed``: the error that ended it.
    """

    name: str
    before_um: float = 0.0
    after_um: float = 0.0
    missed_um: float = 0.0
    u_um: float = 0.0
    acting_u_um: float = 0.0
    axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failed: str = ""

    @property
    def ratio(self) -> float:
        """How far the truth lies from what was predicted, in standard uncertainties of what acts."""
        return self.missed_um / self.acting_u_um


def run_trial(file: CellFile, folder: Path) -> Trial:
    """A machine's trial on a virtual loop of its own; an error of ours that ended it is its result."""
    try:
        found = run_virtual(lambda: tried(file, folder, report=False))
    except TrueflankError as error:
        return Trial(file.name, failed=f"{error.code} {error.where}")
    return Trial(
        name=file.name,
        before_um=found.before_um,
        after_um=found.after_um,
        missed_um=found.missed_um,
        u_um=found.u_um,
        acting_u_um=acting_u(found, scatters=any(axis.scatter > 0.0 for axis in file.axes)),
        axes=found.axes,
    )


def try_one(family: str, seed: int, folder: Path) -> Trial:
    """One machine of a family, or of the others, on the disc of few lobes; its folder is removed."""
    file = other(seed) if family == OTHER else relative(family, seed, FEW)
    try:
        return run_trial(file, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def try_all(
    wanted: Sequence[tuple[str, int]], folder: Path, workers: int, kept: Kept[Trial], heard: Callable[[Trial], None]
) -> None:
    """Every machine wanted (family, seed) that is not kept; `heard` is told of each, kept ones first."""
    left = []
    for family, seed in wanted:
        found = kept.get(f"{family}-{seed}")
        if found is None:
            left.append((family, seed))
        else:
            heard(found)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(try_one, family, seed, folder / f"{family}-{seed}") for family, seed in left]
        for future in as_completed(running):
            one = future.result()
            if not one.failed:
                kept.put(one.name, one)
            heard(one)


def acting_u(found: Tried, *, scatters: bool) -> float:
    """What of u the errors make, um, and how the axes come to a place where they scatter."""
    left_out = SHOP - {INDEX, INFEED} if scatters else SHOP
    return hypot(*(part for name, part in found.parts_um.items() if name not in left_out))


def harmed(one: Trial) -> list[str]:
    """What no proposal may do to a machine, or say of it."""
    if one.failed:
        return [f"{one.name}: {one.failed}"]
    said = [f"{one.name}: flank from {one.before_um:.2f} to {one.after_um:.2f} um"] * (one.after_um > one.before_um)
    said += [f"{one.name}: missed {one.missed_um:.2f} um, u {one.u_um:.2f}"] * (one.missed_um > SURE * one.u_um)
    return said + [f"{one.name}: M of {axis} {m:.2f} to {n:.2f}" for axis, (m, n) in one.axes.items() if n > m + LEAST]


def of_trials(families: Mapping[str, Sequence[Trial]]) -> tuple[Spread, ...]:
    """Ratios pooled first, then by family: their mean, and as ``deviation`` their root mean square (1 if honest)."""
    done = {name: [one for one in trials if not one.failed] for name, trials in families.items()}
    whole = [one for trials in done.values() for one in trials]
    return (_spread("all", whole, POOLED), *(_spread(name, trials, FAMILY) for name, trials in done.items()))


def _spread(family: str, trials: Sequence[Trial], limits: tuple[float, float]) -> Spread:
    ratios = [one.ratio for one in trials]
    count = max(len(ratios), 1)
    mean, square = sum(ratios) / count, sum(ratio**2 for ratio in ratios) / count
    return Spread("errors alone", family, len(ratios), mean, square**0.5, limits, by="root mean square")
