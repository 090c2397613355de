"""What a capture works with at one axis, and the proof of its instrument's sense and unit by a small known move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, UnsupportedDevice
from drivers.message import Message
from drivers.ports.controller import Controller
from drivers.ports.instruments import Instrument, Recounting, RotaryCalibrator
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.values import Approach, FloatArray
from drivers.units import deviation_scale
from gateway.capture.readings import Readings, StopReading, Window
from gateway.capture.targets import jog_plan, jog_start
from gateway.config import AxisSection
from gateway.domain.equipment import SenseProof
from gateway.errors import Unstable
from gateway.moves import AtStop, Patience, jog_through, leave_when_ended, walk_plan
from gateway.say import Say, silence

# What a capture works with: one axis, the controller that moves it, the instrument that sees it, and patience.

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
            looks_on = leave_when_ended(self.controller, self.clock, plan, at_stop)
            await walk_plan(self.controller, plan, at_stop=looks_on, patience=self.patience, say=self.say)
        else:
            await jog_through(
                self.controller, self.clock, plan=plan, at_stop=at_stop, patience=self.patience, say=self.say
            )


# Proves an instrument's sense and unit by a small known move before anything is measured with it.

TOLERANCE = 0.01
ROTARY_JOG_DEG = 0.1


def sense_plan(axis: AxisSection, setup: str) -> StopPlan:
    """The moves that prove an instrument's sense; ``setup`` is what MSG says before ("": nothing)."""
    jog = ROTARY_JOG_DEG if axis.kind == "rotary" else axis.measure.jog
    return jog_plan(axis, jog_start(axis, jog), jog, setup)


async def prove_sense(rig: Rig, *, stands: bool = False) -> SenseProof:
    """Jog the axis and see the instrument follow within 1 %; its sense, +1 or -1, is what was seen.

    ``stands``: its optics are mounted already, and nobody is asked to; what it counts begins anew.

    Linear: +`jog` mm. Rotary: +0.1 deg with the calibrator held, then the calibrator alone
    by -0.1 deg; the laser must follow both. That is tried once more, for 1 % of it is no more than one reading out of
    line. Raises UnsupportedDevice (E-CAP-SENSE): wrong optics, wrong axis or wrong unit.
    """
    setup = "" if stands else rig.setup
    if rig.axis.kind != "rotary":
        return await _linear(rig, setup)
    try:
        return await _rotary(rig, setup)
    except _Doubtful:
        return await _rotary(rig, "")


class _Doubtful(UnsupportedDevice):
    """What followed did so by other than 1 %: wrong, or one reading out of line."""


async def _linear(rig: Rig, setup: str) -> SenseProof:
    axis, jog = rig.axis, rig.axis.measure.jog
    plan = sense_plan(axis, setup)
    if not setup and isinstance(rig.instrument, Recounting):
        await rig.instrument.set_datum()
    seen: list[float] = []
    async with Readings(rig.instrument, rig.clock, first_channel) as readings:

        async def at_stop(index: int, _stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                readings.datum()
            moved = None if index == 0 else (seen[-1], abs(jog) / 2.0)
            seen.append(float((await _follow_jog(readings, rig.window, moved, axis, jog, seen)).values[0]))

        await rig.visit(plan, at_stop)
    there, back = (seen[1] - seen[0]) / jog, (seen[1] - seen[2]) / jog
    return _proof(axis, rig.instrument, (there, back), tuple(seen))


async def _follow_jog(
    readings: Readings,
    window: Window,
    moved: tuple[float, float] | None,
    axis: AxisSection,
    jog: float,
    seen: list[float],
) -> StopReading:
    try:
        return await readings.settled(window, moved_from=moved)
    except Unstable as error:
        if moved is None:
            raise
        raise UnsupportedDevice(
            "E-CAP-SENSE",
            axis.name,
            jog=f"{jog:g} {axis.unit}",
            read=Message.of("W-CAP-LESS-THAN", limit=abs(jog) / 2, unit=axis.unit, seen=seen[-1]),
        ) from error


def turning_instrument(axis: AxisSection, instrument: Instrument) -> RotaryCalibrator:
    """The opened instrument of a rotary axis as what can hold, track and turn.

    Raises ConfigError (E-CAP-CALIBRATOR): another instrument, typed readings among them.
    """
    if not isinstance(instrument, RotaryCalibrator) or "laser_deg" not in instrument.channels:
        raise ConfigError("E-CAP-CALIBRATOR", instrument.name, axis=axis.name)
    return instrument


async def _rotary(rig: Rig, setup: str) -> SenseProof:
    axis, calibrator, jog = rig.axis, turning_instrument(rig.axis, rig.instrument), ROTARY_JOG_DEG
    plan = sense_plan(axis, setup)
    laser, device = calibrator.channels.index("laser_deg"), calibrator.channels.index("device_deg")
    seen: list[FloatArray] = []
    async with Readings(calibrator, rig.clock, lambda values: values[:, laser]) as readings:

        async def read(moved: bool) -> None:
            away = (float(seen[-1][laser]), jog / 2.0) if moved else None
            rough = [float(values[laser]) for values in seen]
            seen.append((await _follow_jog(readings, rig.window, away, axis, jog, rough)).values)

        async def at_stop(index: int, _stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                await calibrator.hold()
                readings.datum()
                await read(moved=False)
            elif index == 1:
                await read(moved=True)
                await calibrator.turn(-jog)
                await read(moved=True)
                await calibrator.track()

        await rig.visit(plan, at_stop)
    axis_ratio = float(seen[1][laser] - seen[0][laser]) / jog
    turn_ratio = float(seen[2][laser] - seen[1][laser]) / -jog
    device_ratio = float(seen[2][device] - seen[1][device]) / -jog
    if abs(device_ratio - 1.0) > TOLERANCE:
        raise _Doubtful(
            "E-CAP-SENSE", axis.name, jog="-0.1 deg (calibrator alone)", read=f"{-jog * device_ratio:.6f} deg"
        )
    evidence = tuple(float(value) for values in seen for value in values)
    return _proof(axis, calibrator, (axis_ratio, turn_ratio), evidence)


def _proof(
    axis: AxisSection, instrument: Instrument, ratios: tuple[float, float], evidence: tuple[float, ...]
) -> SenseProof:
    sense: Approach = 1 if ratios[0] > 0 else -1
    if any(abs(sense * ratio - 1.0) > TOLERANCE for ratio in ratios):
        jog = axis.measure.jog if axis.kind == "linear" else ROTARY_JOG_DEG
        read = " and ".join(f"{ratio * jog:+.6f} {axis.unit}" for ratio in ratios)
        raise _Doubtful("E-CAP-SENSE", axis.name, jog=f"{jog:+g} {axis.unit}", read=read)
    return SenseProof(
        instrument=instrument.name, axis=axis.name, sense=sense, scale=float(np.mean(np.abs(ratios))), evidence=evidence
    )


def first_channel(values: FloatArray) -> FloatArray:
    """The first column, shape (n,): what a one-channel instrument reads."""
    return values[:, 0]
