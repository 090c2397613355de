"""A result file as the capture of one set-up: its readings in the error's own unit, its targets in the machine's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drivers.errors import ConfigError
from drivers.types.results import MeasuredSet
from drivers.types.tables import LiveSet
from drivers.units import deg_to_arcsec, rad_to_arcsec
from gateway.capture.corrected import from_file
from gateway.domain.captures import Capture
from gateway.errors import CaptureError
from gateway.store import Maps
from gateway.workflow.errors21.setups import Planned
from gateway.workflow.files.reading import How, driver_of, read_file, result_endings

ANGLES = ("mrad", "urad", "arcsec", "deg")
ARCSEC = {"mrad": rad_to_arcsec(1e-3), "urad": rad_to_arcsec(1e-6), "deg": deg_to_arcsec(1.0)}
# Drivers that bring deviations to um or arcsec themselves, once they are told the file's unit.
CONVERTING = ("rta", "csv")


def read_setup(path: Path, one: Planned, machine: str, maps: Maps | None, how: How | None = None) -> MeasuredSet:
    """The readings of a set-up's file, in um or arcsec as its error needs them, its targets those of its axis.

    ``how`` says more of the file than the site file does. Raises ConfigError (E-RUN-FILE) for a file that holds no
    targets, CaptureError (E-DAY-UNIT) for lengths where the error is an angle and the other way round, and what
    `read_file` raises.
    """
    driver, unit = driver_of(path, How()), one.setup.unit
    how = how or How(machine=machine)
    told = how.unit or (unit if _tells(driver, unit) else "")
    how = replace(how, unit=told, mixed=not one.positioning, motion=one.setup.component)
    content = _set(path, how, maps)
    if driver in CONVERTING:
        return _as_error(content, one, path)
    return replace(content, deviations=_factor(one) * content.deviations)


def _set(path: Path, how: How, maps: Maps | None) -> MeasuredSet:
    content = read_file(path, how, maps).content
    if not isinstance(content, MeasuredSet):
        raise ConfigError("E-RUN-FILE", str(path), known=", ".join(result_endings()))
    return content


def _fits(content: MeasuredSet, one: Planned) -> bool:
    return ("um" if content.axis_unit == "mm" else "arcsec") == one.unit


def _tells(driver: str, unit: str) -> bool:
    return driver == "rta" or (driver == "csv" and unit in ANGLES)


def _as_error(content: MeasuredSet, one: Planned, path: Path) -> MeasuredSet:
    """Deviations that say their own kind: it must be the error's; the targets are those of the axis that moved."""
    if not _fits(content, one):
        found = "um" if content.axis_unit == "mm" else "arcsec"
        raise CaptureError("E-DAY-UNIT", path.name, error=one.setup.component, found=found, wanted=one.unit)
    return replace(content, axis_unit=one.axis.unit)


def _factor(one: Planned) -> float:
    """From the numbers of a file of lengths to um or arcsec; nothing of a positioning is scaled."""
    if one.positioning:
        return 1.0
    return ARCSEC.get(one.setup.unit, 1.0)


def capture_of(one: Planned, measured: MeasuredSet, live: LiveSet | None, source: str) -> Capture:
    """A set-up's readings as its capture, in machine coordinates. Raises what `from_file` raises."""
    if one.positioning:
        return from_file(one.axis, measured, live, source)
    flip = one.setup.sense * one.axis.measure.file_axis_sense
    # Nothing of the air or material acts on it, and a turned axis does not turn what is read across it.
    across = replace(
        measured, deviations=flip * measured.deviations, axis_unit=one.axis.unit, compensated_for="air+material"
    )
    return from_file(one.axis, across, live, source)
