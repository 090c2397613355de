"""What a capture works with: one axis, the controller that moves it, the instrument that sees it, and patience."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.clock import Clock
from drivers.ports.controller import Controller
from drivers.ports.instruments import Instrument
from drivers.types.stops import StopPlan
from drivers.units import deviation_scale
from gateway.capture.readings import Window
from gateway.config import AxisSection
from gateway.jogging import jog_through
from gateway.say import Say, silence
from gateway.walk import AtStop, Patience, walk, watched

SETTLE_TIMEOUT_S = 60.0


def setup_of(axis: AxisSection) -> str:
    """The operator's message for mounting the optics of what is measured of an axis."""
    return f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"


def step_of(axis: AxisSection, step: float) -> str:
    """The operator's message for moving optics by a known step from where they stand; 0: back again."""
    return f"TRUEFLANK STEP {axis.measure.component} {step:g} ON {axis.letter}"


@dataclass(slots=True)
class StandingOptics:
    """Whose optics were mounted last, by the message that asked for them; "" where nobody can vouch for it any more."""

    setup: str = ""

    def note(self, axis: AxisSection | None) -> None:
        """These stand from now on; on None everything is taken off.

        A laser's optics on a linear axis outlast pushes and restarts, a calibrator no reference run of its axis.
        """
        self.setup = setup_of(axis) if axis is not None and axis.kind == "linear" else ""

    def holds(self, axis: AxisSection) -> bool:
        """Whether the optics that measure the axis are still mounted from before."""
        return self.setup == setup_of(axis)


@dataclass(frozen=True, slots=True)
class Rig:
    """One axis set up to be measured."""

    axis: AxisSection
    controller: Controller
    instrument: Instrument
    clock: Clock
    patience: Patience
    say: Say = silence

    @property
    def setup(self) -> str:
        """The operator's message for mounting the optics."""
        return setup_of(self.axis)

    @property
    def window(self) -> Window:
        """The axis' settling window, its sigma in the axis unit."""
        measure = self.axis.measure
        stable = measure.stable / deviation_scale(self.axis.unit)
        turn = 360.0 if self.axis.modulo else 0.0
        return Window(measure.settle_s, measure.average_s, stable, SETTLE_TIMEOUT_S, turn=turn)

    async def visit(self, plan: StopPlan, at_stop: AtStop) -> None:
        """Visit a plan's stops: by a program, or where the road runs none by the operator's hand."""
        if self.controller.capabilities.stops:
            looks_on = watched(self.controller, self.clock, plan, at_stop)
            await walk(self.controller, plan, at_stop=looks_on, patience=self.patience, say=self.say)
        else:
            await jog_through(
                self.controller, self.clock, plan=plan, at_stop=at_stop, patience=self.patience, say=self.say
            )
