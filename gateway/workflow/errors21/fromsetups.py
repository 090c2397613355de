"""The axes' own positioning out of a measured plan: as `run` would have stored it, so that a push finds it."""

from __future__ import annotations

from drivers.errors import ConfigError
from gateway.capture.corrected import doubted
from gateway.config import SiteFile
from gateway.domain.captures import Capture
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.axes.conditions import with_conditions
from gateway.workflow.axes.line import on_its_line
from gateway.workflow.axes.measure import MeasuredAxis, evaluated
from gateway.workflow.errors21.setupcapture import stood
from gateway.workflow.errors21.setups import planned


def axes_measured(folder: RunFolder, site: SiteFile) -> dict[str, MeasuredAxis]:
    """Capture and evaluation of each axis whose positioning the plan measured, by name, in the order of the site.

    Each is brought to the line it is meant for, and stored as the axis' capture and evaluation "before". Raises
    ConfigError (E-CLOSE-AXES) when no axis was.
    """
    found: dict[str, MeasuredAxis] = {}
    for one in planned(site):
        if one.positioning and folder.has(stages.setup(one.key)):
            capture = doubted(folder.get(stages.setup(one.key), Capture), one.axis)
            capture = on_its_line(capture, one.axis, site, folder)
            capture = with_conditions(capture, one.axis, site, stood(site, folder, one))
            parents = (folder.digest(stages.setup(one.key)),)
            found[one.axis.name] = evaluated(folder, one.axis, phase="before", capture=capture, parents=parents)
    if not found:
        raise ConfigError("E-CLOSE-AXES", folder.run_id)
    return {axis.name: found[axis.name] for axis in site.axes if axis.name in found}
