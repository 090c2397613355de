"""Proves the optics of an error motion before its first target: kind, unit, light, and a jog they must survive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.errors import BeamObstructed, UnsupportedDevice
from drivers.types.stops import Stop, StopReached
from drivers.units import DeviationUnit
from gateway.capture.errormotion import ErrorReadings, ErrorRig
from gateway.capture.readings import StopReading
from gateway.capture.rig import step_of
from gateway.capture.targets import jog_plan, jog_start, step_plan
from gateway.domain.equipment import SenseProof
from gateway.walk import walk, watched

# What a carriage or table can do over a jog, um or arcsec: 2.5 mrad of lean over 10 mm, a ball 0.3 mm off its axis.
JOG_CHANGE: dict[DeviationUnit, float] = {"um": 25.0, "arcsec": 30.0}
STEP_SHARE = 0.25  # of a step by hand: a shim's thickness, and how straight it is moved
BACK_AGAIN: dict[DeviationUnit, float] = {"um": 2.0, "arcsec": 2.0}


@dataclass(frozen=True, slots=True)
class MountingProof:
    """What the instrument said of its optics and read at start, start + ``jog`` and start again, in ``unit``.

    ``sense`` is the proof by a known step of the optics; None where the site file names no step.
    """

    instrument: str
    axis: str
    component: str
    optics: str
    unit: DeviationUnit
    jog: float
    evidence: tuple[float, ...]
    sense: SenseProof | None = None


async def prove_mounting(rig: ErrorRig) -> MountingProof:
    """Let the operator mount what MSG says, ask the instrument what it has, and jog the axis.

    A jog that does not come back is made once more: one reading out of line is no wrong mounting.
    Raises UnsupportedDevice (E-SETUP-OPTICS: other optics; E-SETUP-LIGHT: no valid reading with them;
    E-SETUP-JOG: it follows the travel or does not come back; E-SETUP-STEP: it does not follow a known step), Unstable.
    """
    told, seen = await _jogged(rig, rig.setup)
    if not _plausible(rig, seen):
        told, seen = await _jogged(rig, "")
    if not _plausible(rig, seen):
        raise _refused(rig, seen)
    component = rig.axis.measure.component
    return MountingProof(
        instrument=rig.instrument.name,
        axis=rig.axis.name,
        component=component,
        optics=told,
        unit=rig.unit,
        jog=rig.jog,
        evidence=tuple(seen),
        sense=await _stepped(rig, seen[-1]) if rig.step else None,
    )


async def _stepped(rig: ErrorRig, before: float) -> SenseProof:
    """A person moves the optics by a known step in the plus direction and back again: the reading must follow.

    Raises UnsupportedDevice (E-SETUP-STEP): another way or by another amount, or it does not come back.
    """
    there_at, back_at = [await _after(rig, moved) for moved in (rig.step, 0.0)]
    there, back = there_at - before, there_at - back_at
    if max(abs(there - rig.step), abs(back - rig.step)) > STEP_SHARE * rig.step + _repeats(rig):
        told: dict[str, Any] = {"step": f"{rig.step:+g} {rig.unit}", "there": f"{there:+.2f} {rig.unit}"}
        told |= {"component": rig.axis.measure.component, "back": f"{-back:+.2f} {rig.unit}"}
        raise UnsupportedDevice("E-SETUP-STEP", rig.instrument.name, **told)
    return SenseProof(
        instrument=rig.instrument.name,
        axis=rig.axis.name,
        sense=1,
        scale=0.5 * (there + back) / rig.step,
        evidence=(before, there_at, back_at),
    )


async def _after(rig: ErrorRig, moved: float) -> float:
    """The reading once a person has moved the optics to ``moved`` from where they were mounted."""
    seen: list[float] = []
    async with ErrorReadings(rig) as readings:

        async def at_stop(_index: int, _stop: Stop, _reached: StopReached) -> None:
            readings.datum()
            reading = await _lit(rig, readings)
            seen.append(float(rig.combine(reading.values[None, :])[0]))

        plan = step_plan(rig.axis, jog_start(rig.axis, rig.jog), step_of(rig.axis, moved))
        looks_on = watched(rig.controller, rig.clock, plan, at_stop)
        await walk(rig.controller, plan, at_stop=looks_on, patience=rig.patience, say=rig.say)
    return seen[-1]


async def _jogged(rig: ErrorRig, setup: str) -> tuple[str, list[float]]:
    """What the instrument says of its optics, and its three readings; ``setup`` is what MSG says ("": nothing)."""
    seen: list[float] = []
    told: list[str] = []
    async with ErrorReadings(rig) as readings:

        async def at_stop(index: int, _stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                told.append(await _optics(rig))
                readings.datum()
            reading = await _lit(rig, readings)
            seen.append(float(rig.combine(reading.values[None, :])[0]))

        plan = jog_plan(rig.axis, jog_start(rig.axis, rig.jog), rig.jog, setup)
        looks_on = watched(rig.controller, rig.clock, plan, at_stop)
        await walk(rig.controller, plan, at_stop=looks_on, patience=rig.patience, say=rig.say)
    return told[0], seen


async def _lit(rig: ErrorRig, readings: ErrorReadings) -> StopReading:
    """A settled reading; without a valid one what is mounted is not what was asked for, or not aligned."""
    try:
        return await readings.settled(rig.window)
    except BeamObstructed as error:
        component = rig.axis.measure.component
        raise UnsupportedDevice("E-SETUP-LIGHT", rig.instrument.name, component=component) from error


async def _optics(rig: ErrorRig) -> str:
    kind = (await rig.instrument.optics()).kind
    if kind not in rig.optics:
        wanted = " or ".join(known for known in rig.optics if known != "unknown")
        component = rig.axis.measure.component
        raise UnsupportedDevice("E-SETUP-OPTICS", rig.instrument.name, found=kind, wanted=wanted, component=component)
    return kind


def _plausible(rig: ErrorRig, seen: list[float]) -> bool:
    return abs(seen[1] - seen[0]) <= JOG_CHANGE[rig.unit] and abs(seen[2] - seen[0]) <= _repeats(rig)


def _repeats(rig: ErrorRig) -> float:
    return max(BACK_AGAIN[rig.unit], 5.0 * rig.axis.measure.stable)


def _refused(rig: ErrorRig, seen: list[float]) -> UnsupportedDevice:
    return UnsupportedDevice(
        "E-SETUP-JOG",
        rig.instrument.name,
        jog=f"{rig.jog:g} {rig.axis.unit}",
        component=rig.axis.measure.component,
        there=f"{seen[1] - seen[0]:+.3f} {rig.unit}",
        limit=f"{JOG_CHANGE[rig.unit]:g} {rig.unit}",
        back=f"{seen[2] - seen[0]:+.3f} {rig.unit}",
        repeats=f"{_repeats(rig):g} {rig.unit}",
    )
