"""What would be measured at a site, as data: its axes, and the set-ups in the order with the fewest remountings."""

from __future__ import annotations

from typing import Any

from gateway.capture.targets import targets_of
from gateway.config import AxisSection, SiteFile
from gateway.model.chain import Axis, Element
from gateway.model.error_model import yk7350b
from gateway.workflow.errors21.setups import PlannedSetup, plan_setups, remountings


def plan_of(site: SiteFile) -> dict[str, Any]:
    """Axes with their targets, set-ups in their order, positions in the axis' own unit (mm or deg); and the chain.

    ``chain`` names the axes from the bed outward to the work and to the wheel, each with its direction.
    """
    setups = plan_setups(site) if site.setups else ()
    return {
        "axes": [_axis(axis) for axis in site.axes],
        "setups": [_setup(one) for one in setups],
        "remountings": remountings(setups) if setups else 0,
        "chain": _chain(site),
    }


def _chain(site: SiteFile) -> dict[str, Any]:
    """As the site file tells it; else the form grinder's, where every axis is one of its own; else nothing is known."""
    sides = {"work": site.machine.work_side, "tool": site.machine.tool_side}
    if any(sides.values()):
        return {side: [_link(letter) for letter in letters] for side, letters in sides.items()}
    grinder = yk7350b()
    found = {"work": _links(grinder.work), "tool": _links(grinder.tool)}
    known = {one["letter"] for side in found.values() for one in side}
    return found if {axis.letter for axis in site.axes} <= known else {"work": [], "tool": []}


def _link(letter: str) -> dict[str, Any]:
    turning = letter in "ABC"
    direction = [float(letter in pair) for pair in ("XA", "YB", "ZC")]
    return {"letter": letter, "kind": "revolute" if turning else "prismatic", "direction": direction}


def _links(elements: tuple[Element, ...]) -> list[dict[str, Any]]:
    axes = [one for one in elements if isinstance(one, Axis)]
    return [{"letter": one.name, "kind": one.kind, "direction": [float(part) for part in one.vector]} for one in axes]


def _axis(axis: AxisSection) -> dict[str, Any]:
    measure = axis.measure
    return {
        "axis": axis.name,
        "letter": axis.letter,
        "unit": axis.unit,
        "component": measure.component,
        "instrument": measure.instrument,
        "targets": targets_of(axis).tolist(),
        "repetitions": measure.repetitions,
        "travel": list(axis.travel),
    }


def _setup(one: PlannedSetup) -> dict[str, Any]:
    setup = one.setup
    return {
        "setup": one.key,
        "component": setup.component,
        "axis": one.axis.name,
        "instrument": setup.instrument,
        "source": setup.source,
        "unit": one.unit,
        "targets": targets_of(one.axis).tolist(),
        "park": dict(setup.park),
    }
