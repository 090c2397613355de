"""Errors of a machine as numbers at positions: those of a run for files of others, those of a file as an error model.

A file of errors (Etalon exchange, ISG, our own table) holds neither uncertainty nor live tables, and one of another
program not even its sign: U and sign are asked, and nothing that comes of it can be pushed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers import registry
from drivers.errors import ConfigError
from drivers.local.textfile import decode_text
from drivers.message import Message, digits, fixed
from drivers.types.exchange import ErrorCurve, ErrorSet
from gateway.config import SiteFile
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE
from gateway.errors import ModelError
from gateway.model.components import at_datum, value
from gateway.model.error_model import TWENTY_ONE, ErrorModel, LocationError, unmeasured_errors
from gateway.store import RunFolder, read_whole
from gateway.workflow.errors21.setups import spans
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


# ---- The other way: a file of errors as the model that a forecast for the tooth takes.

FULL_TURN = 360.0
MOST_U = 1000.0
SAME = 1e-6  # um or arcsec, between the ends of a turn
OWN_SIGN = "errors = actual - nominal"
"""Our own files say so in a comment; a file of somebody else does not tell its sign."""
SENSES = {"error": 1.0, "correction": -1.0}
FORMATS = ("etalon-exchange", "isg-volumetric", "error-csv")


@dataclass(frozen=True, slots=True)
class StatedErrors:
    """What a file of errors does not hold: U (k = 2) of its lengths and of its angles."""

    U_um: float
    U_arcsec: float


def stated_errors(words: str) -> StatedErrors:
    """U of lengths and of angles from "um,arcsec". Raises ModelError (E-ERRORS-U)."""
    try:
        lengths, angles = (float(word) for word in words.split(","))
    except ValueError:
        raise ModelError("E-ERRORS-U", "--error-u") from None
    return StatedErrors(lengths, angles)


def read_errors(path: Path, sense: str = "") -> ErrorSet:
    """Errors of a machine from a file of any format that holds them, as actual - nominal.

    Raises ConfigError (E-ERRORS-FORMAT, E-ERRORS-SENSE: whose sign is not stated), FileFormatError, FileUnreadable.
    """
    text = decode_text(read_whole(path), "cp1252", str(path))
    found = registry.load("other-controls", "recogniser")(text)
    own = OWN_SIGN in text or "error = actual - nominal" in text
    name = found.format if found is not None else "error-csv" if own else ""
    if name not in FORMATS:
        raise ConfigError("E-ERRORS-FORMAT", str(path), known=", ".join(FORMATS))
    if sense not in ("", *SENSES) or not (sense or own):
        raise ConfigError("E-ERRORS-SENSE", str(path), sense=sense or "-")
    errors: ErrorSet = registry.load(name, "error-exchange")().read(text, str(path))
    sign = SENSES[sense or "error"]
    curves = tuple(replace(one, values=one.values * sign) for one in errors.curves)
    return replace(errors, curves=curves, locations={key: value * sign for key, value in errors.locations.items()})


def model_of_errors(errors: ErrorSet, stated: StatedErrors, site: SiteFile) -> ErrorModel:
    """The 21 errors of a file as an error model: straight between its points, a full turn of a rotary axis closed.

    The positioning of an axis is zero at its reference; everything else is taken as the file has it, in its frame. U is
    one for all, for the file holds none: it counts as what repetition does not show. Raises ModelError: E-ERRORS-FIELD
    (an error over several axes), E-ERRORS-TURN (a turn whose ends differ), E-ERRORS-NONE (none of the 21), E-ERRORS-U.
    """
    if errors.fields:
        one = errors.fields[0]
        raise ModelError("E-ERRORS-FIELD", "errors", name=one.name, arguments=", ".join(one.arguments))
    if not (0.0 < stated.U_um < MOST_U and 0.0 < stated.U_arcsec < MOST_U):
        raise ModelError("E-ERRORS-U", "errors")
    references = {axis.letter: axis.reference for axis in site.axes}
    kept = [one for one in errors.curves if one.name in TWENTY_ONE]
    motions = tuple(_component(one, references.get(one.name[2])) for one in kept)
    u = {"um": stated.U_um / COVERAGE, "arcsec": stated.U_arcsec / COVERAGE}
    places = tuple(
        LocationError(name, value, u[ErrorSet.location_unit(name)], ErrorSet.location_unit(name))
        for name, value in errors.locations.items()
        if name in TWENTY_ONE
    )
    names = (*(one.name for one in motions), *(one.name for one in places))
    if not names:
        raise ModelError("E-ERRORS-NONE", "errors", known=", ".join(TWENTY_ONE))
    usual = site.assumed
    left = [one.name for one in errors.curves if one.name not in TWENTY_ONE]
    left += [name for name in errors.locations if name not in TWENTY_ONE]
    said = [Message.of("S-ERRORS-STATED", um=fixed(stated.U_um), arcsec=fixed(stated.U_arcsec))]
    said += [Message.of("S-ERRORS-LEFT", names=", ".join(left))] if left else []
    return ErrorModel(
        motions=motions,
        locations=places,
        unknown=unmeasured_errors(names, spans(site), linear_um=usual.linear_um, angular_arcsec=usual.angular_arcsec),
        systematic={one.name: u[one.unit] for one in motions},
        said=tuple(said),
    )


def _component(curve: ErrorCurve, reference: float | None) -> Component:
    at, values = curve.positions, curve.values
    turns = curve.axis_unit == "deg" and abs(float(at[-1] - at[0]) - FULL_TURN) < SAME
    if turns:
        if abs(float(values[-1] - values[0])) > SAME:
            raise ModelError("E-ERRORS-TURN", "errors", name=curve.name, apart=digits(abs(values[-1] - values[0]), 3))
        at, values = at[:-1], values[:-1]
    found = Component(
        name=curve.name,
        axis=curve.argument,
        axis_unit=curve.axis_unit,
        basis="piecewise",
        domain=(float(at[0]), float(curve.positions[-1])),
        coefficients=values,
        covariance=np.zeros((at.size, at.size)),
        parameters={"nodes": at.tolist(), **({"period": FULL_TURN} if turns else {})},
    )
    own = curve.name[1] == curve.argument
    return at_datum(found, reference) if own and reference is not None else found
