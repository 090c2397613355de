"""Half a day in place of a day: which set-ups of a site to measure in the hours there are, and what the others cost.

The matrices are `gateway.correct.outlook.measuring_hours`, the choice `gateway.sensitivity.planning`. Here stands what
a site has: its set-ups, instruments and times, and what has been measured. Nothing is opened.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from drivers.types.values import FloatArray
from gateway.capture.targets import targets_of
from gateway.config import SiteFile
from gateway.correct.outlook.measuring_hours import HourGoal, SetupReadings, Way, planning_task
from gateway.evaluate.geometry.error_model import error_model
from gateway.model.error_model import ErrorModel
from gateway.sensitivity.planning import WORTH, HourPlan, plan_hours
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.errors21.setups import PlannedSetup, mounted_setups, plan_setups, spans, with_way
from gateway.workflow.forecast import day_of_closing, setup_hours
from gateway.workflow.tooth.proposal import work_of

FEWEST = {"linear": 9, "rotary": 18}
"""Targets of an error motion below which none is proposed: for fewer waves a fit is not worth what it leaves out."""
LEAST_REPETITIONS = 2
UNREAD = 11
GOALS = ("flank", "drive")
ENDED = {"proved": "W-HOURS-PROVED", "nothing left": "W-HOURS-NOTHING", "hours": "W-HOURS-SPENT"}


@dataclass(frozen=True, slots=True)
class HoursRequest:
    """What was asked: hours of measuring at most, a tolerance of the goal (um or arcsec), and the goal by its name."""

    hours: float | None = None
    tolerance: float | None = None
    goal: str = "flank"


@dataclass(frozen=True)
class SiteHours:
    """A plan for a site: its set-ups in order, each with the targets and repetitions chosen."""

    plan: HourPlan
    setups: tuple[PlannedSetup, ...]
    goal: HourGoal
    tolerance: float | None

    @property
    def said(self) -> tuple[Message, ...]:
        """Why it ends, what it reaches, and what was left out with its price."""
        plan, unit = self.plan, self.goal.unit
        figures = {"u": fixed(plan.u), "u_before": fixed(plan.u_before), "u_least": fixed(plan.u_least), "unit": unit}
        hours = {"hours": fixed(plan.hours, 1), "all": fixed(plan.hours_all, 1)}
        share = fixed(100.0 * plan.hours / plan.hours_all if plan.hours_all > 0.0 else 0.0, 0)
        lines = [Message.of("W-HOURS-REACHES", **figures, **hours, share=share, bound=fixed(plan.bound))]
        limit = fixed(self.tolerance) if self.tolerance is not None else ""
        lines.append(
            Message.of(
                ENDED[plan.ended], bound=fixed(plan.bound), tolerance=limit, least=fixed(100.0 * WORTH, 0), unit=unit
            )
        )
        if self.tolerance is not None and plan.ended != "proved":
            lines.append(Message.of("W-HOURS-UNPROVED", bound=fixed(plan.bound), tolerance=limit, unit=unit))
        return tuple(lines)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        plan = self.plan
        by = {one.key: one for one in self.setups}
        return {
            "goal": self.goal.kind if self.goal.kind != "axis" else self.goal.axis,
            "unit": self.goal.unit,
            "tolerance": self.tolerance,
            "ended": plan.ended,
            "hours": round(plan.hours, 3),
            "hours_of_all": round(plan.hours_all, 3),
            "u_before": plan.u_before,
            "u": plan.u,
            "u_with_all": plan.u_least,
            "bound": plan.bound,
            "steps": [
                {
                    "setups": [_way_of(by[key]) for key in step.keys],
                    "hours": round(step.hours, 3),
                    "u": step.u,
                    "gain_per_hour": step.gain_per_h,
                }
                for step in plan.steps
            ],
            "left_out": [
                {"setups": list(one.keys), "hours": round(one.hours, 3), "u_with": one.u_with} for one in plan.left_out
            ],
            "said": list(map(str, self.said)),
        }


def _way_of(one: PlannedSetup) -> dict[str, Any]:
    return {
        "setup": one.key,
        "targets": int(targets_of(one.axis).size),
        "repetitions": one.axis.measure.repetitions,
        "instrument": one.setup.instrument or one.setup.source,
    }


def goal_of_site(site: SiteFile, site_path: Path, name: str) -> HourGoal:
    """The goal by name: flank, drive, or an axis of the site. Raises ConfigError (E-HOURS-GOAL), as `work_of`."""
    axes = {axis.name: axis.letter for axis in site.axes}
    if name in axes:
        return HourGoal("axis", axis=axes[name])
    if name not in GOALS:
        raise ConfigError("E-HOURS-GOAL", "--goal", goal=name, known=", ".join((*GOALS, *axes)))
    work = work_of(site, site_path)
    if name == "drive" and work.goal is None:
        raise ConfigError("E-HOURS-DRIVE", site.site.name, gear=work.name)
    drive = work.goal.drive if name == "drive" and work.goal is not None else None
    return HourGoal("drive" if name == "drive" else "flank", work.tooth, drive)


@dataclass
class SiteHoursPlanner:
    """Plans a site's hours, anew after each set-up with what its readings told; keeps the newest plan."""

    site: SiteFile
    goal: HourGoal
    request: HoursRequest
    newest: SiteHours | None = None

    @property
    def lines(self) -> tuple[Message, ...]:
        """What the newest plan says."""
        return () if self.newest is None else self.newest.said

    @property
    def able(self) -> tuple[PlannedSetup, ...]:
        """Every set-up of the site that may be measured."""
        return tuple(one for one in plan_setups(self.site) if one.measured)

    def plan(self, model: ErrorModel | None = None, measured: Collection[str] = (), spent_h: float = 0.0) -> SiteHours:
        """What is best measured from here. Raises ModelError (E-PLAN-HOURS, E-PLAN-GOAL)."""
        left = [one for one in self.able if one.key not in measured]
        # An axis' positioning hangs by its levers on angles that are measured later: there a measured set-up counts by
        # its design and not by the fit, which would take what the levers leave open for its own.
        tied = self.goal.kind == "axis"
        shown = self.able if tied else left
        mounted = mounted_setups(shown)
        ways = {one.key: ways_of(self.site, one) for one in mounted}
        lead = {one.key: one.key if one.key in ways else one.leader for one in shown}
        readings = [_readings(self.site, one, ways[lead[one.key]], lead[one.key]) for one in shown]
        tolerance, hours = self.request.tolerance, self.request.hours
        known_errors = nothing_known(self.site) if model is None or tied else model
        task = planning_task(known_errors, readings, self.goal, grids(self.site), proof=tolerance is not None)
        known = task.known.after([one.choices[0] for one in task.candidates if one.key in measured])
        required = [one.key for one in left if _needed(one)] if self.goal.kind != "axis" else []
        required = list(dict.fromkeys(lead[key] for key in required))
        if hours is not None:
            # Once the run has begun, the axes' own positioning is measured even where the rest took longer.
            needed_h = sum(ways[key][0].hours for key in required) if measured else 0.0
            hours = max(hours - spent_h, needed_h)
        found = plan_hours(
            known,
            [one for one in task.candidates if one.key not in measured],
            bundles=task.bundles,
            required=required,
            hours=hours,
            tolerance=tolerance,
        )
        by = {one.key: one for one in left}
        chosen = tuple(
            _chosen(one, ways[key][found.choice(key)])
            for key in found.keys
            for one in (by[key], *(other for other in left if other.leader == key and other.key != key))
        )
        self.newest = SiteHours(found, chosen, self.goal, tolerance)
        return self.newest

    def next(self, model: ErrorModel | None, measured: Collection[str], spent_h: float) -> tuple[PlannedSetup, ...]:
        """The set-ups of the next step; none where the plan ends."""
        found = self.plan(model, measured, spent_h)
        keys = set(found.plan.steps[0].keys if found.plan.steps else ())
        return tuple(one for one in found.setups if one.key in keys or one.leader in keys)


def _needed(one: PlannedSetup) -> bool:
    """Whether tables for the tooth need a set-up whatever its own gain.

    Axis tables need the positioning of their axis. A lean of C against Z that nobody measured looks like what X over Z
    corrects: the proposal then leaves that table out, with all that is known of it.
    """
    return one.positioning or one.setup.name == "B0C"


def nothing_known(site: SiteFile) -> ErrorModel:
    """Every error within its assumed span."""
    usual = site.assumed
    return error_model((), spans(site), linear_um=usual.linear_um, angular_arcsec=usual.angular_arcsec)


def ways_of(site: SiteFile, one: PlannedSetup) -> tuple[Way, ...]:
    """How a set-up may be read: as the site says; with fewer repetitions; and at every other target as well.

    A positioning stays as it is: its evaluation and its table ask for all of it. So does a file.
    """
    at, repetitions = _places(one), one.axis.measure.repetitions
    found = [(one, at, repetitions)]
    if one.setup.source == "live" and not one.positioning and not one.setup.mount and at.size:
        fewer = min(repetitions, LEAST_REPETITIONS)
        half = _every_other(at, rotary=one.axis.kind == "rotary")
        if fewer < repetitions:
            found.append((with_way(one, at.tolist(), fewer), at, fewer))
        if half.size >= FEWEST[one.axis.kind] and one.setup.name[1] != "0":
            found.append((with_way(one, half.tolist(), fewer), half, fewer))
    return tuple(Way(places, count, setup_hours(site, way)) for way, places, count in found)


def _places(one: PlannedSetup) -> FloatArray:
    """Its targets; of a file, whose targets nobody has looked at, some over the axis' table."""
    at = targets_of(one.axis)
    return at if at.size else np.linspace(one.axis.table.minimum, one.axis.table.maximum, UNREAD)


def _every_other(at: FloatArray, *, rotary: bool) -> FloatArray:
    """Every other target, of a linear axis with both ends."""
    if rotary or at.size % 2:
        return at[::2]
    return at[np.round(np.linspace(0, at.size - 1, at.size // 2)).astype(int)]


def _chosen(one: PlannedSetup, way: Way) -> PlannedSetup:
    same = way.targets.size == _places(one).size and way.repetitions == one.axis.measure.repetitions
    return one if same else with_way(one, way.targets.tolist(), way.repetitions)


def _readings(site: SiteFile, one: PlannedSetup, ways: Sequence[Way], mount: str) -> SetupReadings:
    letters: Mapping[str, str] = {axis.name: axis.letter for axis in site.axes}
    return SetupReadings(
        key=one.key,
        component=one.setup.component,
        letter=one.axis.letter,
        rotary=one.axis.kind == "rotary",
        ways=tuple(ways),
        offset_mm=one.setup.offset_mm,
        systematic=one.systematic,
        stands={letters[name]: place for name, place in one.setup.park.items() if name in letters},
        own_angle=one.setup.own_angle_arcsec is not None,
        mount=mount,
    )


def closing_hours(site: SiteFile, site_path: Path, request: HoursRequest, *, apply: bool) -> HoursRequest:
    """The hours that the rest of a closing leaves for measuring.

    Raises ConfigError (E-HOURS-REST) where they leave none, and as `day_of_closing`.
    """
    if request.hours is None:
        return request
    day = day_of_closing(site, site_path, apply=apply)
    rest = sum(hours for stage, hours in day.by_stage().items() if stage != "measure")
    if rest >= request.hours:
        raise ConfigError("E-HOURS-REST", "--hours", hours=f"{request.hours:g}", rest=fixed(rest, 1))
    return HoursRequest(request.hours - rest, request.tolerance, request.goal)
