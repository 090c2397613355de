"""Proves an instrument's sense and unit by a small known move before anything is measured with it."""

from __future__ import annotations

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, UnsupportedDevice
from drivers.ports import Controller, Instrument, RotaryCalibrator
from drivers.types import Approach, FloatArray, Stop, StopReached
from gateway.capture.readings import Reading, Readings, Window
from gateway.capture.targets import jog_plan, jog_start
from gateway.config import AxisSection
from gateway.domain import SenseProof
from gateway.errors import Unstable
from gateway.say import Say, silence
from gateway.walk import Patience, walk

TOLERANCE = 0.01
ROTARY_JOG_DEG = 0.1


async def prove_sense(
    axis: AxisSection,
    controller: Controller,
    instrument: Instrument,
    window: Window,
    clock: Clock,
    patience: Patience,
    say: Say = silence,
) -> SenseProof:
    """Jog the axis and see the instrument follow within 1 %; its sense, +1 or -1, is what was seen.

    Linear: +`jog` mm. Rotary (house rule): +0.1 deg with the calibrator held, then the calibrator alone
    by -0.1 deg; the laser must follow both. Raises UnsupportedDevice (E-CAP-SENSE): wrong optics, wrong
    axis or wrong unit.
    """
    setup = f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"
    if axis.kind == "rotary":
        return await _rotary(axis, controller, instrument, window, clock, patience, setup, say)
    return await _linear(axis, controller, instrument, window, clock, patience, setup, say)


async def _linear(
    axis: AxisSection,
    controller: Controller,
    instrument: Instrument,
    window: Window,
    clock: Clock,
    patience: Patience,
    setup: str,
    say: Say,
) -> SenseProof:
    jog = axis.measure.jog
    plan = jog_plan(axis, jog_start(axis, jog), jog, setup)
    seen: list[float] = []
    async with Readings(instrument, clock, first_channel) as readings:

        async def at_stop(index: int, _stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                readings.datum()
            moved = None if index == 0 else (seen[-1], abs(jog) / 2.0)
            seen.append(float((await _follow(readings, window, moved, axis, jog, seen)).values[0]))

        await walk(controller, plan, at_stop, patience, say)
    there, back = (seen[1] - seen[0]) / jog, (seen[1] - seen[2]) / jog
    return _proof(axis, instrument, (there, back), tuple(seen))


async def _follow(
    readings: Readings,
    window: Window,
    moved: tuple[float, float] | None,
    axis: AxisSection,
    jog: float,
    seen: list[float],
) -> Reading:
    try:
        return await readings.settled(window, moved_from=moved)
    except Unstable as error:
        if moved is None:
            raise
        raise UnsupportedDevice(
            "E-CAP-SENSE",
            axis.name,
            jog=f"{jog:g} {axis.unit}",
            read=f"less than {abs(jog) / 2:g} {axis.unit} (last steady value {seen[-1]:.6f})",
        ) from error


async def _rotary(
    axis: AxisSection,
    controller: Controller,
    instrument: Instrument,
    window: Window,
    clock: Clock,
    patience: Patience,
    setup: str,
    say: Say,
) -> SenseProof:
    if not isinstance(instrument, RotaryCalibrator) or "laser_deg" not in instrument.channels:
        raise ConfigError("E-CAP-CALIBRATOR", instrument.name, axis=axis.name)
    calibrator = instrument
    jog = ROTARY_JOG_DEG
    plan = jog_plan(axis, jog_start(axis, jog), jog, setup)
    laser, device = instrument.channels.index("laser_deg"), instrument.channels.index("device_deg")
    seen: list[FloatArray] = []
    async with Readings(instrument, clock, lambda values: values[:, laser]) as readings:

        async def read(moved: bool) -> None:
            away = (float(seen[-1][laser]), jog / 2.0) if moved else None
            rough = [float(values[laser]) for values in seen]
            seen.append((await _follow(readings, window, away, axis, jog, rough)).values)

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

        await walk(controller, plan, at_stop, patience, say)
    axis_ratio = float(seen[1][laser] - seen[0][laser]) / jog
    turn_ratio = float(seen[2][laser] - seen[1][laser]) / -jog
    device_ratio = float(seen[2][device] - seen[1][device]) / -jog
    if abs(device_ratio - 1.0) > TOLERANCE:
        raise UnsupportedDevice(
            "E-CAP-SENSE", axis.name, jog="-0.1 deg (calibrator alone)", read=f"{-jog * device_ratio:.6f} deg"
        )
    evidence = tuple(float(value) for values in seen for value in values)
    return _proof(axis, instrument, (axis_ratio, turn_ratio), evidence)


def _proof(
    axis: AxisSection, instrument: Instrument, ratios: tuple[float, float], evidence: tuple[float, ...]
) -> SenseProof:
    sense: Approach = 1 if ratios[0] > 0 else -1
    if any(abs(sense * ratio - 1.0) > TOLERANCE for ratio in ratios):
        jog = axis.measure.jog if axis.kind == "linear" else ROTARY_JOG_DEG
        read = " and ".join(f"{ratio * jog:+.6f} {axis.unit}" for ratio in ratios)
        raise UnsupportedDevice("E-CAP-SENSE", axis.name, jog=f"{jog:+g} {axis.unit}", read=read)
    return SenseProof(instrument.name, axis.name, sense, float(np.mean(np.abs(ratios))), evidence)


def first_channel(values: FloatArray) -> FloatArray:
    """The first column, shape (n,): what a one-channel instrument reads."""
    return values[:, 0]
