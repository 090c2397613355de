"""How far the error motions that a run identified lie from the machine's own, at the targets it visited."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.domain.captures import Capture
from gateway.model.components import value
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.workflow.run import stages
from simulators.truth import Truth

FloatArray = NDArray[np.float64]
Curve = Callable[[FloatArray], FloatArray]
LEAST = 0.3
SHARE = 0.05
PAIRS = {"EXC": "EYC", "EYC": "EXC", "EAC": "EBC", "EBC": "EAC"}


@dataclass(frozen=True, slots=True)
class Identified:
    """One error motion: the largest deviation of the curve from the truth, and what is allowed, um or arcsec."""

    name: str
    off: float
    limit: float


def identified(folder: RunFolder, truth: Truth, acted: Mapping[str, Curve]) -> tuple[Identified, ...]:
    """Every motion that the run measured, each with its mean deviation (the datum, nobody's concern) taken off.

    ``acted`` is what the control's own tables added (um or arcsec) by motion, while it was measured.
    """
    model = folder.get(stages.ERRORS, ErrorModel)
    found = []
    for one in model.motions:
        at = _targets(folder, one.name)
        if at is not None:
            true = told(truth, one.name, at) + (acted[one.name](at) if one.name in acted else 0.0)
            off = value(one, at) - true
            limit = max(LEAST, SHARE * float(np.ptp(true)))
            found.append(Identified(one.name, float(np.max(np.abs(off - off.mean()))), limit))
    return tuple(found)


def _targets(folder: RunFolder, name: str) -> FloatArray | None:
    """Where that motion was measured; None if it was not."""
    stage = stages.setup(f"{name}-{name[2]}1")
    return np.asarray(folder.get(stage, Capture).targets) if folder.has(stage) else None


def told(truth: Truth, name: str, at: FloatArray) -> FloatArray:
    """The true motion as anybody can measure it: what the mounting hides or the datum decides is taken out.

    Straightness without its least-squares line over the targets (that is squareness), motions of C without their
    mean, and the pairs of C without the wave that turns with it (that is the eccentricity of ball or bar).
    """
    true = truth.motion(name, at)
    if name[2] == "C" and name != "ECC":
        return true - _turning(truth, name, at)
    if name[1] in "XYZ" and name[1] != name[2]:
        return np.asarray(true - np.polyval(np.polyfit(at, true, 1), at))
    return true


def _turning(truth: Truth, name: str, at: FloatArray) -> FloatArray:
    dense = np.arange(720) / 2.0
    mean = float(np.mean(truth.motion(name, dense)))
    if name not in PAIRS:
        return np.full_like(at, mean)
    # first = u cos - v sin, second = u sin + v cos: u + iv is the part of first + i second that turns with the axis.
    first, second = (truth.motion(one, dense) for one in sorted((name, PAIRS[name])))
    turned = np.mean((first + 1j * second) * np.exp(-1j * np.deg2rad(dense))) * np.exp(1j * np.deg2rad(at))
    return np.asarray(mean + (turned.real if name < PAIRS[name] else turned.imag))


def worst(all_of_them: tuple[Identified, ...]) -> Mapping[str, float]:
    """Deviation over its limit by motion, the largest first."""
    ranked = sorted(all_of_them, key=lambda one: one.limit and -one.off / one.limit)
    return {one.name: one.off / one.limit for one in ranked}
