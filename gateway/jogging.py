"""Where the road to a controller runs no programs: the operator brings the axis to each stop, the state confirms it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.ports.controller import Controller
from drivers.types.machine import AxisState
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.units import wrap_deg
from gateway.events import StopDone
from gateway.say import Say
from gateway.walk import AtStop, Patience

POLL_S = 0.5
STILL = 1e-3
# A person who types the position in MDI is exact to the control's own resolution; by hand-wheel nearly so.
EXACT = 2e-3
Told = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Jogged:
    """One axis that is moved by hand: its name, whether it turns endlessly, and how long a person may take in s."""

    axis: str
    modulo: bool
    patience_s: float


async def stand_at(
    controller: Controller, clock: Clock, jogged: Jogged, position: float, room: float, ask: Told, *, away: bool = False
) -> AxisState:
    """Wait until the axis stands within ``room`` of a position; ``ask`` is called once if it does not stand there yet.

    ``away``: it must first be seen elsewhere, as a person does who mounts something and then moves the axis.
    Raises DeadlineExceeded after a person's patience, and what the port raises.
    """
    async with clock.deadline(jogged.patience_s, jogged.axis):
        told, gone, before = False, not away, float("nan")
        while True:
            seen = await _seen(controller, jogged.axis)
            there = seen is not None and _is_there(jogged, seen, position, room)
            gone = gone or (seen is not None and not there)
            if seen is not None and there and gone and abs(seen.position - before) <= STILL:
                return seen
            if not told and not (there and gone):
                ask()
                told = True
            before = seen.position if seen is not None else float("nan")
            await clock.sleep(POLL_S)


async def _seen(controller: Controller, axis: str) -> AxisState | None:
    try:
        return (await controller.state()).axes.get(axis)
    except TrueflankError as error:
        if not error.retryable:
            raise
        return None


def _is_there(jogged: Jogged, seen: AxisState, position: float, room: float) -> bool:
    off = seen.position - position
    return seen.in_position and abs(wrap_deg(off) if jogged.modulo else off) <= room


async def jog_through(
    controller: Controller,
    clock: Clock,
    plan: StopPlan,
    at_stop: AtStop,
    patience: Patience,
    say: Say,
) -> None:
    """Be at each stop of a plan as the operator brings the axis there; a set-up is mounted before the first.

    Raises what `stand_at` and ``at_stop`` raise.
    """
    jogged = Jogged(plan.axis, plan.rotary, patience.start_s)

    def ask(stop: Stop, setup: str) -> Told:
        side = "from below" if stop.approach > 0 else "from above"
        fields = {"axis": plan.axis, "position": stop.target, "unit": plan.unit, "side": side, "room": EXACT}
        return lambda: say("P-JOG-SETUP" if setup else "P-JOG-STOP", setup=setup, **fields)

    for index, stop in enumerate(plan.stops):
        setup = plan.setup if index == 0 else ""
        seen = await stand_at(
            controller, clock, jogged=jogged, position=stop.target, room=EXACT, ask=ask(stop, setup), away=bool(setup)
        )
        await at_stop(index, stop, _reached(index, stop, seen))
        StopDone(plan.axis, plan.name, index + 1, len(plan.stops)).tell(say)


def _reached(index: int, stop: Stop, seen: AxisState) -> StopReached:
    return StopReached(
        counter=index + 1,
        repetition=stop.repetition,
        label=stop.label,
        approach=stop.approach,
        target=seen.position,
        encoder_compensation=seen.encoder_compensation,
        cross_compensation=seen.cross_compensation,
    )
