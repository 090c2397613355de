"""Angular error motions of a linear axis, pitch, yaw and roll, by ISO 230-1 letters and ISO 230-2 statistics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message
from drivers.units import arcsec_to_rad
from gateway.domain.figures import Evaluation
from gateway.errors import ModelError
from gateway.evaluate.standards import iso230_2
from gateway.evaluate.uncertainty.budget import Budget

Kind = Literal["roll", "pitch", "yaw", "tilt about X", "tilt about Y"]
# A vertical axis has no pitch and yaw but two tilts (ISO 230-1:2012).
COMPONENTS: Mapping[tuple[str, str], str] = {
    ("X", "roll"): "EAX",
    ("X", "pitch"): "EBX",
    ("X", "yaw"): "ECX",
    ("Y", "roll"): "EBY",
    ("Y", "pitch"): "EAY",
    ("Y", "yaw"): "ECY",
    ("Z", "roll"): "ECZ",
    ("Z", "tilt about X"): "EAZ",
    ("Z", "tilt about Y"): "EBZ",
}


@dataclass(frozen=True, slots=True)
class AngularMotion:
    """One angular error motion: its letter name, the evaluation in arcsec, and its range E also in urad."""

    component: str
    evaluation: Evaluation
    E_urad: float | None


def component(axis: str, kind: Kind) -> str:
    """The ISO 230-1 name, e.g. pitch of X is EBX. Raises ModelError (E-EVAL-ANGULAR)."""
    name = COMPONENTS.get((axis, kind))
    if name is None:
        known = ", ".join(word for at, word in COMPONENTS if at == axis) or Message.of("W-EVAL-XYZ-ONLY")
        raise ModelError("E-EVAL-ANGULAR", "angular", axis=axis, kind=kind, known=known)
    return name


def angular_motion(
    axis: str,
    kind: Kind,
    targets_mm: ArrayLike,
    angles_arcsec: ArrayLike,
    *,
    sense: Literal[1, -1] = 1,
    budget: Budget | None = None,
) -> AngularMotion:
    """Evaluate angles (m, n, 2), approach + then -, NaN where missing, read at targets (m,).

    ``sense`` makes the readings right-handed about the component's axis. Angles need no correction for air.
    Raises ModelError as `iso230_2.evaluate` and E-EVAL-ANGULAR.
    """
    name = component(axis, kind)
    readings = sense * np.asarray(angles_arcsec, dtype=np.float64)
    found = iso230_2.evaluate_iso230_2(targets_mm, readings, "arcsec", budget=budget)
    words = "ISO 230-1:2012, statistics of ISO 230-2:2014"
    labelled = replace(found, standard=words, edition="2012")
    return AngularMotion(name, labelled, None if found.E is None else float(arcsec_to_rad(found.E)) * 1e6)
