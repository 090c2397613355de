"""Every motion said before the press: what goes from where to where, and where all other axes stand.

Read from the control at that moment. What a program moves, and what it shows, the driver reads from its own blocks.
"""

from __future__ import annotations

import math

from drivers.errors import words
from drivers.ports.controller import Controller
from drivers.programs import Moment, SaysMotion, ShowsMessages
from drivers.types.moves import NEAR, AxisStands, Going, Movement, SafePlaces
from drivers.units import wrap_deg
from gateway.say import Say


def places_of(controller: Controller) -> SafePlaces:
    """The safe places that a controller keeps to; none where it knows of none."""
    return controller.places if isinstance(controller, SaysMotion) else SafePlaces()


async def tell_motion(controller: Controller, say: Say) -> None:
    """Say what the selected program will move and where every other axis stands. Raises as `Controller.state`."""
    if isinstance(controller, SaysMotion):
        say_motion(await controller.motion(), say)


def say_motion(motion: Movement, say: Say) -> None:
    """One event for each axis that goes, one for all that stand; pure but for ``say``."""
    stands = {one.axis: one for one in motion.stands}
    for going in motion.goes:
        _say_going(going, stands.get(going.axis), say)
    if not motion.goes:
        say("P-MOVE-NOTHING")
    goes = {going.axis for going in motion.goes}
    others = [one for one in motion.stands if one.axis not in goes]
    if others:
        say("P-MOVE-OTHERS", others="; ".join(standing_words(one) for one in others))


def shown_there(controller: Controller, moment: Moment) -> str:
    """What the control itself shows while it waits for a person, as a bracket behind our words; "" where nothing."""
    message = controller.message(moment) if isinstance(controller, ShowsMessages) else ""
    return words("W-SHOWN-THERE", message=message) if message else ""


def standing_words(one: AxisStands) -> str:
    """Where an axis stands, and whether that is within its safe place."""
    fields = {"axis": one.axis, "position": shown(one.position), "unit": one.unit}
    if one.place is None:
        return words("W-MOVE-NO-PLACE", **fields)
    if math.isinf(one.place[0]) and math.isinf(one.place[1]):
        return words("W-MOVE-ANY", **fields)
    code = "W-MOVE-SAFE" if one.safe else "W-MOVE-OUTSIDE"
    return words(code, low=shown(one.place[0]), high=shown(one.place[1]), **fields)


def shown(value: float) -> str:
    """A position as people read it: micrometres at most, no trailing zeros."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _say_going(going: Going, now: AxisStands | None, say: Say) -> None:
    start = now.position if now is not None else going.first
    slow, fast = going.feeds
    fields = {"axis": going.axis, "unit": going.unit, "start": shown(start), "feed": _span(slow, fast)}
    if going.turns:
        say("P-MOVE-TURNS", **fields)
    elif going.goes_if_elsewhere and now is not None and _there(going, now.position):
        say("P-MOVE-STANDS", axis=going.axis, unit=going.unit, place=shown(going.last))
    elif going.low == going.high:
        say("P-MOVE-TO", end=shown(going.last), **fields)
    else:
        ends = {"first": shown(going.first), "low": shown(going.low), "high": shown(going.high)}
        say("P-MOVE-BETWEEN", end=shown(going.last), **ends, **fields)
    if going.further:
        say("P-MOVE-FURTHER", axis=going.axis)


def _there(going: Going, position: float) -> bool:
    off = position - going.last
    return abs(wrap_deg(off) if going.unit == "deg" else off) <= NEAR


def _span(slow: float, fast: float) -> str:
    return f"{slow:g}" if slow == fast else f"{slow:g} to {fast:g}"
