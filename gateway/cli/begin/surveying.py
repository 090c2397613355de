"""Asks a control what it knows of itself, by its survey where the road has one, else through the port."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from drivers import registry
from drivers.checks import ControlAxis, ControlFacts
from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.ports.controller import Controller
from drivers.ports.devices import Survey


async def surveyed(
    driver: str, url: str, settings: Mapping[str, Any], *, clock: Clock, timeout_s: float
) -> ControlFacts:
    """Everything the road can tell. Raises what opening it raises, ConfigError (E-CFG-DRIVER)."""
    name = f"{driver}-survey"
    if name in registry.known("survey"):
        survey = cast(Survey, registry.load(name, "survey")("control", url, settings, clock))
        return await survey.survey(timeout_s)
    controller = cast(Controller, registry.load(driver, "controller")("control", url, settings, clock))
    try:
        await controller.open(timeout_s)
        return await _through_port(controller)
    finally:
        await controller.close()


async def _through_port(controller: Controller) -> ControlFacts:
    machine, state = await controller.identify(), await controller.state()
    axes = [
        ControlAxis(name, state.axes[name].unit, points=await _points(controller, name))
        for name in machine.axis_names
        if name in state.axes
    ]
    return ControlFacts(machine.serial, machine.version, machine.unit_system, tuple(axes), identity=machine.facts)


async def _points(controller: Controller, axis: str) -> int | None:
    try:
        return (await controller.table_limits(axis)).reserved_points
    except TrueflankError:
        return None
