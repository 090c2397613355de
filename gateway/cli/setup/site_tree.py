"""From what a control tells and a person answers to the tree of a site file that can be measured; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Any

from drivers.checks import ControlAxis

OVERRUN, ROTARY = 5.0, "ABC"
# Distances of interpolation points that people read easily, mm or deg.
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 50.0, 90.0, 100.0, 200.0, 250.0, 500.0, 1000.0)
TURNING = (15.0, 30.0, 45.0, 90.0)
"""Those for rotary axes alone."""
MOST_POINTS = 101
USUAL_TARGETS, LONG_INTERVAL = 21, 250.0
TURN = 360.0
OPTICS = {"straightness": "XYZ", "angular": "ABC"}
"""What the optics of a linear axis show: displacements across it, or rotations about the two other directions."""
_ROLL = dict(zip("XYZ", "ABC", strict=True))
SAMPLE_GEAR = """# Common literature values of a cycloid disc; no maker's data. Put your own gear here, mm.
name = "RV-40E-like"

[gear]                       # pin circle and pin radius, eccentricity, pins, lobes, face width
rp = 64.0
rrp = 3.0
a = 1.3
zp = 40
zc = 39
b = 10.0

[grinding]
centre_distance_mm = 160.0   # gear axis to wheel axis
"""


@dataclass(frozen=True, slots=True)
class AxisToMeasure:
    """An axis to be measured: travel in mm or deg, ``instrument`` by its name in the site file."""

    name: str
    letter: str
    rotary: bool
    modulo: bool
    travel: tuple[float, float]
    instrument: str
    encoder: int = 0
    points: int | None = None


def plan_axis(axis: ControlAxis, travel: tuple[float, float], instruments: tuple[str, str]) -> AxisToMeasure:
    """An axis as the control tells it; ``instruments`` are those of linear and of rotary axes."""
    rotary = axis.unit == "deg"
    modulo = rotary and (axis.modulo if axis.modulo is not None else travel == (0.0, TURN))
    return AxisToMeasure(
        name=axis.name,
        letter=letter_of(axis.name),
        rotary=rotary,
        modulo=bool(modulo),
        travel=(0.0, TURN) if modulo else travel,
        instrument=instruments[rotary],
        encoder=axis.encoder or 0,
        points=axis.points,
    )


def letter_of(name: str) -> str:
    """The ISO 230-1 letter in an axis' name: the first of X Y Z A B C U V W there, else its first letter."""
    letters = [one for one in name.upper() if one in "XYZABCUVW"]
    return letters[0] if letters else next((one for one in name.upper() if one.isalpha()), "X")


def axis_tree(axis: AxisToMeasure) -> dict[str, Any]:
    """The axis' section: targets, overrun and table fit into its travel and into the control's room for points."""
    low, high, step = grid(axis)
    targets: dict[str, Any] = {"first": low, "last": high, "count": targets_of(high - low), "offset_fraction": 0.2}
    if axis.modulo:
        targets = {"first": 0.0, "last": TURN, "count": 25, "offset_fraction": 0.2}  # 0 and 360 deg: does it close?
    tree: dict[str, Any] = {"name": axis.name, "letter": axis.letter, "kind": "rotary" if axis.rotary else "linear"}
    tree["travel"] = list(axis.travel)
    tree["reference"] = min(max(0.0, low), high)
    tree |= {"modulo": True} if axis.modulo else {}
    tree["encoder"] = axis.encoder
    tree["measure"] = {
        **({"instrument": axis.instrument} if axis.instrument else {}),
        "component": f"E{axis.letter}{axis.letter}",
        "targets": targets,
        "repetitions": 5,
        "overrun": overrun(axis),
        "feed": 900.0 if axis.rotary else 3000.0,
        "stable": 1.5 if axis.rotary else 0.5,
        **({"jog": 0.1} if axis.rotary else {"expansion_ppm_per_k": 11.5, "jog": min(10.0, (high - low) / 4.0)}),
    }
    tree["table"] = {"minimum": low, "maximum": high, "step": step}
    return tree


def targets_of(span: float) -> int:
    """How many targets an axis gets, mm or deg: enough to tell a curve, and no interval above 250 mm on a long one."""
    return max(USUAL_TARGETS, ceil(span / LONG_INTERVAL) + 1)


def overrun(axis: AxisToMeasure) -> float:
    """How far the axis may run beyond its outer targets: 5 mm or deg, less on a short axis."""
    return min(OVERRUN, (axis.travel[1] - axis.travel[0]) / 20.0)


def grid(axis: AxisToMeasure) -> tuple[float, float, float]:
    """First point, last point and distance of the table: whole steps, within the travel less the overrun."""
    most = min(axis.points or MOST_POINTS, MOST_POINTS)
    span = (0.0, TURN) if axis.modulo else (axis.travel[0] + overrun(axis), axis.travel[1] - overrun(axis))
    for step in (one for one in STEPS if axis.rotary or one not in TURNING):
        low, high = ceil(span[0] / step - 1e-9) * step, floor(span[1] / step + 1e-9) * step
        if high > low and round((high - low) / step) + 1 <= most and (not axis.modulo or TURN % step == 0):
            return low, high, step
    return span[0], span[1], span[1] - span[0]


def used_letters(axes: Sequence[AxisToMeasure]) -> tuple[AxisToMeasure, ...]:
    """The axes whose letter is their own: of two with one letter the first is measured."""
    seen: set[str] = set()
    found = []
    for axis in axes:
        if axis.letter not in seen:
            seen.add(axis.letter)
            found.append(axis)
    return tuple(found)


def grinds(axes: Sequence[AxisToMeasure]) -> bool:
    """Whether axes can grind a gear: two linear ones and a rotary one."""
    return sum(not axis.rotary for axis in axes) >= 2 and any(axis.rotary for axis in axes)


def work_tree(
    axes: Sequence[AxisToMeasure], gear: str, height_mm: float, others: Sequence[ControlAxis]
) -> dict[str, Any]:
    """The section of the work; ``height_mm`` in mm; ``others``: the control's axes that are not measured.

    X feeds in, Z strokes and C indexes where the machine has them, else the first axes of their kinds; the first
    linear axis that is not measured carries the dresser. What places the wheel along its axis nobody can guess.
    """
    linear, rotary = ([axis.letter for axis in axes if axis.rotary is kind] for kind in (False, True))
    infeed = _first_of("X", linear)
    roles = {"infeed": infeed, "stroke": _first_of("Z", [one for one in linear if one != infeed])}
    tree: dict[str, Any] = {"gear": gear, "height_mm": height_mm, **roles, "index": _first_of("C", rotary)}
    dresser = next((one for one in others if one.unit == "mm"), None)
    if dresser is None:
        return tree | {"dresser": ""}
    return tree | {"dresser": dresser.name, "dresser_letter": letter_of(dresser.name)}


def _first_of(usual: str, letters: Sequence[str]) -> str:
    return usual if usual in letters else letters[0]


def setup_trees(axes: Sequence[AxisToMeasure], optics: Sequence[str]) -> list[dict[str, Any]]:
    """One set-up for each error that these optics show on a linear axis; no roll, which needs a level."""
    return [
        {"axis": axis.name, "component": f"E{direction}{axis.letter}", "instrument": name}
        for name in optics
        for axis in axes
        if not axis.rotary and axis.letter in _ROLL
        for direction in OPTICS[name]
        if direction not in (axis.letter, _ROLL[axis.letter])
    ]
