"""Under which conditions an axis is captured, by site file and live tables, and what certificates state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import date

from drivers.types.tables import LiveSet
from gateway import audit
from gateway.config import AxisSection, SiteFile
from gateway.domain.captures import Capture, Conditions
from gateway.errors import CaptureError
from gateway.say import Say
from gateway.workflow.bench import Bench

STATED = ("um_per_m", "arcsec", "kelvin")


async def stands(at: Bench) -> dict[str, float]:
    """Where the site's axes stand now, by letter. Raises what the wire raises."""
    axes = (await at.supervisor.controller.state()).axes
    return {axis.letter: axes[axis.name].position for axis in at.site.axes if axis.name in axes}


def with_conditions(capture: Capture, axis: AxisSection, site: SiteFile, stood: Mapping[str, float]) -> Capture:
    """The capture with what acted on it and on its uncertainty, and where the axes ``stood`` by letter.

    One from a file has no feed and no dwell, and nobody knows where the other axes stood.
    """
    own = axis.measure.file is None
    # A file's set-up names no instrument: what made it is the one that the site has for this axis.
    usual = (one.measure.instrument for one in site.axes if one.name == axis.name)
    return replace(
        capture,
        conditions=Conditions(
            feed=axis.measure.feed if own else None,
            overrun=axis.measure.overrun if own else None,
            dwell_s=axis.measure.dwell_s if own else None,
            warm_up=site.report.warm_up,
            operator=site.report.operator or (audit.signed_in() if own else ""),
            compensation=_acting(capture.live),
            stated=stated(site, axis.measure.instrument or next(usual, "")),
            stands=stood,
        ),
    )


def stated(site: SiteFile, instrument: str) -> dict[str, float]:
    """Uncertainties (k = 2) that the register states for an instrument, or for equipment of no single one."""
    found: dict[str, float] = {}
    for one in site.equipment:
        if one.instrument in ("", instrument):
            found |= {key: value for key in STATED if (value := getattr(one, key)) is not None}
    return found


def stated_of(site: SiteFile, axis: str) -> dict[str, float]:
    """`stated` for what measures an axis, by its name or letter; for an axis that is unknown, of no instrument."""
    meant = site.meant(axis)
    return stated(site, (meant.measure.instrument or "") if meant is not None else "")


def _acting(live: LiveSet | None) -> str:
    """Names of the tables that were on: "X1, X1(C1)"; "-" for none, "" where nobody knows."""
    if live is None:
        return ""
    acting = [one.table.output_axis for one in (live.own,) if one.enabled]
    acting += [f"{one.table.output_axis}({one.table.input_axis})" for one in live.cross if one.enabled]
    return ", ".join(acting) or "-"


def overdue(site: SiteFile, today: date) -> tuple[str, ...]:
    """Equipment whose next calibration was due before today, by name and day."""
    return tuple(f"{one.name} ({one.due})" for one in site.equipment if one.due is not None and one.due < today)


def tell_overdue(site: SiteFile, today: date, say: Say) -> None:
    """A warning for each overdue calibration. Raises CaptureError (E-CAP-OVERDUE) where the site file refuses."""
    late = overdue(site, today)
    if late and site.report.refuse_overdue:
        raise CaptureError("E-CAP-OVERDUE", site.site.name, names=", ".join(late))
    for name in late:
        say("P-CAP-OVERDUE", name=name)
