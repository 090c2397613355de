"""The errors of a measured run as numbers at positions, for files that other programs and controls read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.errors import ConfigError
from drivers.types.exchange import ErrorCurve, ErrorSet
from gateway.domain.figures import Component
from gateway.model.components import value
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.workflow.run import stages
from gateway.workflow.run.folder import simulated_run
from gateway.workflow.run.stages import SAID

POINTS = 51


def errors_of_run(folder: RunFolder, points: int = POINTS) -> ErrorSet:
    """All errors that a run of `measure` or `close` knows. Raises ConfigError (E-EXCHANGE-NO-ERRORS)."""
    if stages.ERRORS not in folder.stages:
        raise ConfigError("E-EXCHANGE-NO-ERRORS", str(folder.path))
    found = error_set(folder.get(stages.ERRORS, ErrorModel), points)
    told = (SAID,) if simulated_run(folder) else ()
    return replace(found, notes=(*told, f"run {folder.run_id}", *found.notes))


def error_set(model: ErrorModel, points: int = POINTS) -> ErrorSet:
    """Each fitted motion at equally spaced positions over its domain, and the location errors."""
    notes = tuple(map(str, model.said))
    if model.unknown:
        notes = (*notes, "not measured: " + ", ".join(one.name for one in model.unknown))
    return ErrorSet(
        tuple(_curve(one, points) for one in model.motions), {one.name: one.value for one in model.locations}, notes
    )


def _curve(component: Component, points: int) -> ErrorCurve:
    at = np.round(np.linspace(*component.domain, points), 6)
    return ErrorCurve(component.name, component.axis_unit, at, np.asarray(value(component, at), dtype=np.float64))
