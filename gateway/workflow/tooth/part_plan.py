"""How a site grinds its gear: the plan of a test part, from the site file and the gear file alone."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from drivers.workpiece import GrindAxis, GrindPlan, check_plan
from gateway.config import R_PARAMETER, AxisSection, SiteFile, WorkSection
from gateway.gear.cycloid import CycloidGear
from gateway.study.inputs import GearFile, gear_of, load_gear
from gateway.tooth import SetupValues

DECIMALS = 6
_UNSAID = re.compile(r"[^A-Za-z0-9 ()=.,:_/+-]")


def grind_plan(site: SiteFile, gear_file: GearFile, setup: SetupValues, part: str = "part") -> GrindPlan:
    """How this site grinds a gear with these set-up values.

    Raises ConfigError: E-GRIND-NO-WORK, E-GRIND-AXIS, and what `check_plan` refuses; ModelError E-GEAR-...
    """
    work = work_section(site)
    gear = gear_of(gear_file)
    wheel = _wheel(site, work)
    index = _axis(site, work.index, "index", "rotary")
    plan = GrindPlan(
        name=f"TFGRIND_{index.name}",
        part=_UNSAID.sub("-", f"{gear_file.name} {part}".upper())[:60],
        infeed=_axis(site, work.infeed, "infeed", "linear"),
        stroke=_axis(site, work.stroke, "stroke", "linear"),
        index=index,
        dresser=GrindAxis(work.dresser, work.dresser_letter) if work.dresser else None,
        spaces=gear.zc,
        centre_distance_mm=gear_file.grinding.centre_distance_mm,
        height_mm=work.height_mm,
        face_mm=gear.b,
        root_mm=round(gear.root_radius, DECIMALS),
        tip_mm=round(gear.tip_radius, DECIMALS),
        stock_mm=round(work.stock_mm / _least_slope(gear), DECIMALS),
        x_mm=round(setup.x_mm, DECIMALS),
        c_deg=round(setup.c_deg, DECIMALS),
        dressing_mm=round(setup.dressing_mm, DECIMALS),
        index_sense=work.index_sense,
        overrun_mm=work.overrun_mm,
        retract_mm=work.retract_mm,
        rough_mm=work.rough_mm,
        spark_out=work.spark_out,
        infeed_feed=work.infeed_feed,
        stroke_feed=work.stroke_feed,
        index_feed=work.index_feed,
        positioning_feed=work.positioning_feed,
        air_cut_feed=work.air_cut_feed,
        dwell_s=work.dwell_s,
        wheel_on=work.wheel_on,
        wheel_off=work.wheel_off,
        wheel=wheel if isinstance(wheel, GrindAxis) else None,
        wheel_mm=work.wheel_mm,
        wheel_offset=wheel if isinstance(wheel, int) else None,
    )
    try:
        check_plan(plan)
    except ConfigError as error:
        if error.fields.get("key") != "wheel_offset":
            raise
        # Of a plan's names the only one that [work] has not.
        low, high = (f"R{error.fields[end]}" for end in ("low", "high"))
        told = {"key": "wheel_place", "value": work.wheel_place, "low": low, "high": high}
        raise ConfigError(error.code, site.site.name, retryable=False, **told) from None
    return plan


def work_section(site: SiteFile) -> WorkSection:
    """What the site file says of the work. Raises ConfigError (E-GRIND-NO-WORK)."""
    if site.work is None:
        raise ConfigError("E-GRIND-NO-WORK", site.site.name)
    return site.work


def gear_of_site(site: SiteFile, site_path: Path) -> GearFile:
    """The gear file that [work] names, relative to the site file. Raises ConfigError (E-GRIND-NO-WORK, E-STUDY-...)."""
    return load_gear(site_path.parent / work_section(site).gear)


def _axis(site: SiteFile, wanted: str, role: str, kind: str) -> GrindAxis:
    found = next((axis for axis in site.axes if wanted in (axis.letter, axis.name) and axis.kind == kind), None)
    if found is None:
        known = ", ".join(f"{axis.name} ({axis.kind})" for axis in site.axes)
        raise ConfigError("E-GRIND-AXIS", site.site.name, axis=wanted or "nothing", role=role, known=known)
    return GrindAxis(found.name, found.letter, _travel(found), found.encoder)


def axes_of_work(site: SiteFile) -> tuple[AxisSection, AxisSection, AxisSection]:
    """The axes that grind: infeed, stroke, index. Raises ConfigError (E-GRIND-NO-WORK, E-GRIND-AXIS)."""
    work = work_section(site)
    roles = (work.infeed, "infeed", "linear"), (work.stroke, "stroke", "linear"), (work.index, "index", "rotary")
    named = {axis.name: axis for axis in site.axes}
    infeed, stroke, index = (named[_axis(site, *role).name] for role in roles)
    return infeed, stroke, index


def _travel(axis: AxisSection) -> tuple[float, float] | None:
    return None if axis.modulo else axis.travel


def _wheel(site: SiteFile, work: WorkSection) -> GrindAxis | int | None:
    """The axis that moves the wheel along its own, or the number of the R parameter that the dressing program reads."""
    parameter = R_PARAMETER.fullmatch(work.wheel_place)
    if parameter is not None:
        return int(parameter[1])
    known = next((axis for axis in site.axes if work.wheel_place in (axis.letter, axis.name)), None)
    if known is not None:
        return GrindAxis(known.name, known.letter, _travel(known), known.encoder)
    return GrindAxis(work.wheel_place, work.wheel_letter, work.wheel_travel) if work.wheel_place else None


def _least_slope(gear: CycloidGear) -> float:
    """The least part of a flank's normal along the infeed: the wheel leaves stock s of a flank after s / this of X."""
    theta = np.linspace(0.0, gear.half_pitch, 201)[1:-1]
    return float(np.min(np.abs(gear.section(theta).normal[..., 0])))


# Where a person enters set-up values for the builder's own grinding and dressing programs.


_USUAL = {"x_entry": "S-ENTER-X", "c_entry": "S-ENTER-C", "dressing_entry": "S-ENTER-DRESSING"}
"""Where a person enters a value usually, by the key of the site file that names another place."""


def entry_instructions(work: WorkSection, setup: SetupValues) -> Message:
    """Each value with its place, and how it is seen that this was done; our own programs take theirs by themselves."""
    places = {key: getattr(work, key) or Message.of(code) for key, code in _USUAL.items()}
    values = {"x": setup.x_um, "c": setup.c_arcsec, "dressing": setup.dressing_um}
    told = {key: fixed(value, 1, signed=True) for key, value in values.items()}
    return Message("W-SETUP-ENTER", {**places, **told})
