"""The line that an axis' figures hold for: a lever is taken off where a set-up says how far off the reflector stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.message import Message
from drivers.types.values import FloatArray
from gateway.config import AxisSection, SiteFile
from gateway.domain.captures import Capture
from gateway.evaluate.geometry.measurement import Lever
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.workflow import stages

DIRECTIONS = "XYZ"


def on_its_line(capture: Capture, axis: AxisSection, site: SiteFile, folder: RunFolder) -> Capture:
    """A positioning capture on the line its component is meant for, by the angles that the run's error model knows.

    As it is for a rotary axis, and where no set-up of the site says where the reflector stood. Angles nobody measured
    leave their share in ``lever_u``. Raises what the store raises.
    """
    offset = offset_of(axis, site)
    if axis.kind != "linear" or offset is None:
        return capture
    lever = _lever(axis, offset, site, folder)
    between = capture.between
    if between is not None:
        seen = between.deviations - _from_datum(lever, between.targets, capture)[:, None, None]
        between = replace(between, deviations=seen)
    return replace(
        capture,
        deviations=capture.deviations - _from_datum(lever, capture.targets, capture)[:, None, None],
        between=between,
        unsteady_u=float(np.hypot(capture.unsteady_u, np.max(lever.u(capture.targets), initial=0.0))),
        line_mm=offset,
        lever_u=lever.open_u,
        notes=(*capture.notes, *lever.estimated(capture.targets)),
    )


def offset_of(axis: AxisSection, site: SiteFile) -> tuple[float, float, float] | None:
    """Where the reflector of an axis' positioning stands beside the line that counts, mm; None: nobody said."""
    fitting = (one for one in site.setups if (one.component, one.axis) == (axis.measure.component, axis.name))
    return next((one.offset_mm for one in fitting), None)


def line_remark(capture: Capture) -> Message:
    """Which line the figures of a linear axis hold for."""
    if capture.line_mm is None:
        return Message.of("S-LINE-MEASURED")
    where = ", ".join(f"{way} {part:+g}" for way, part in zip(DIRECTIONS, capture.line_mm, strict=True) if part)
    if capture.lever_u:
        return Message.of("S-LINE-PART", component=capture.component, where=where, u=f"{capture.lever_u:.2f}")
    return Message.of("S-LINE-COUNTS", component=capture.component, where=where or "0")


def _lever(axis: AxisSection, offset: tuple[float, float, float], site: SiteFile, folder: RunFolder) -> Lever:
    model = folder.get(stages.ERRORS, ErrorModel) if folder.has(stages.ERRORS) else ErrorModel()
    return Lever.of(
        axis.measure.component,
        axis.letter,
        offset,
        angles={one.name: one for one in model.motions},
        spans={one.name: one.assumed for one in site.setups if one.assumed is not None},
        usual_arcsec=site.assumed.angular_arcsec,
    )


def _from_datum(lever: Lever, at: FloatArray, capture: Capture) -> FloatArray:
    """What the lever adds from the first target on, which stays the zero."""
    return np.asarray(lever.um(at) - lever.um(capture.targets[:1])[0])
