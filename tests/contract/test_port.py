"""Every registered controller, and a control that takes tables from files, keep the one contract of the port."""

from __future__ import annotations

import asyncio
import contextlib
import tempfile
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers import registry
from drivers.clock import LoopClock, run_virtual
from drivers.contract import (
    CHECKS,
    Check,
    ContractBroken,
    OperatorMoment,
    Subject,
    loads_and_acts,
    restores,
    says_what_it_can,
    shows_what_acts,
    switches_as_declared,
)
from drivers.errors import ConfigError
from drivers.files import only
from drivers.ports.controller import Controller
from drivers.types.orders import PushBatch, PushOrder, ReadBack, SignProof
from drivers.types.tables import LiveSet, LiveTable
from tests.contract import linuxcnc_stage, modbus_stage, opcua_stage
from tests.contract.fileroad import CAPABILITIES, FileRoad, Machine, curve
from tests.offline.world import offline_world
from tests.sizes import long


@contextlib.asynccontextmanager
async def on_opcua(folder: Path, **stage: Any) -> AsyncIterator[Subject]:
    """The 840D by its OPC UA server and programs: the operator presses NC START and does what MSG says."""
    async with opcua_stage.on_stage(folder=folder, **stage) as on:
        told: list[str] = []

        def tell(code: str, /, **_fields: object) -> None:
            told.append(code)

        async def person(moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
            if moment == "start":
                on.press()
            return await (on.asked(work, told) if moment == "read" else work)

        yield Subject(on.device, opcua_stage.TABLE_C, "C", True, 0.0, person, tell, allowed=0.002)


def on_opcua_with_gaps(folder: Path) -> contextlib.AbstractAsyncContextManager[Subject]:
    """The same from another server: axis numbers are left out, and an empty name is a null string."""
    spec = opcua_stage.SPEC
    axes = tuple(replace(axis, number=number) for axis, number in zip(spec.axes, (1, 4, 13), strict=True))
    return on_opcua(folder, spec=replace(spec, axes=axes), server={"null_strings": True})


@contextlib.asynccontextmanager
async def on_mailbox(_folder: Path) -> AsyncIterator[Subject]:
    """The 840D behind a PLC mailbox: somebody presses the button at the panel."""
    async with modbus_stage.on_stage() as on:

        async def person(moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
            return await (on.pressed(work) if moment == "release" else work)

        yield Subject(on.device, modbus_stage.table(), "X", False, 0.0, person)


@contextlib.asynccontextmanager
async def on_files(_folder: Path) -> AsyncIterator[Subject]:
    """Tables from files: the control is restarted after a while."""
    machine, clock = Machine(), LoopClock()
    yield files_subject(FileRoad(machine, clock), machine, clock)


def files_subject(device: FileRoad, machine: Machine, clock: LoopClock) -> Subject:
    async def person(moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
        if moment in ("read", "start"):
            return await work
        task = asyncio.ensure_future(work)
        await clock.sleep(3.0)
        machine.restart()
        return await task

    return Subject(device, curve(), "X", False, 0.0, person)


@contextlib.asynccontextmanager
async def on_linuxcnc(_folder: Path) -> AsyncIterator[Subject]:
    """LinuxCNC by the agent on its host: somebody restarts it."""
    with tempfile.TemporaryDirectory() as folder:
        async with linuxcnc_stage.subject(Path(folder)) as found:
            yield found


@contextlib.asynccontextmanager
async def on_stick(_folder: Path) -> AsyncIterator[Subject]:
    """The 840D without a wire: a person carries programs there, runs them, and brings what they wrote."""

    async def person(_moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
        return await work

    with tempfile.TemporaryDirectory() as folder:
        async with offline_world(LoopClock(), Path(folder), old=None) as world:
            world.porter.start()
            device = world.driver()
            await device.open(5.0)
            try:
                yield Subject(device, world.new, "X", False, 0.0, person, allowed=0.002, timeout_s=3600.0)
            finally:
                await device.close()
                await world.porter.stop()


ROADS: dict[str, Callable[[Path], contextlib.AbstractAsyncContextManager[Subject]]] = {
    "sinumerik-opcua": on_opcua,
    "sinumerik-opcua with gaps": on_opcua_with_gaps,
    "sinumerik-modbus": on_mailbox,
    "sinumerik-offline": on_stick,
    "linuxcnc-agent": on_linuxcnc,
    "file-road": on_files,
}


def test_every_registered_controller_is_judged() -> None:
    """But for "none": a site of files only has no device, and making one must fail before the port is used."""
    assert set(registry.known("controller")) - set(ROADS) == {only.NAME}
    with pytest.raises(ConfigError) as caught:
        only.FilesOnly("control", only.ADDRESS, {}, LoopClock())
    assert caught.value.code == "E-FILES-ONLY"


PAIRS = [
    long((road, check)) if "gaps" in road and check is not loads_and_acts else (road, check)
    for road in ROADS
    for check in CHECKS
]


@pytest.mark.parametrize(("road", "check"), PAIRS)
async def test_the_port_is_kept(road: str, check: Check, keys: Path) -> None:
    async with ROADS[road](keys) as subject:
        await check(subject)


# ---- the checks find what they are for -----------------------------------------------------------------


class _Liar(FileRoad):
    """Keeps the port but for one thing, which a subclass spoils."""


class TwoHomes(_Liar):
    @property
    def capabilities(self) -> Any:
        return replace(CAPABILITIES, tables=CAPABILITIES.tables * 2)


class LosesAPoint(_Liar):
    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        (one,) = await super().read_back(batch, timeout_s)
        table = one.found.own.table
        own = LiveTable(replace(table, deviations=(*table.deviations[:-1], 9.0)), False)
        return (replace(one, found=replace(one.found, own=own)),)


class OnAtOnce(_Liar):
    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        (one,) = await super().read_back(batch, timeout_s)
        return (replace(one, found=replace(one.found, own=replace(one.found.own, enabled=True))),)


class OneCurve(_Liar):
    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        (order,) = passed
        await super().activate(batch, (replace(order, table=replace(order.table, reverse=())),))
        self.machine.files["X"] = "\n".join(
            f"{place} {value} {value}" for place, value in zip(order.table.places, order.table.deviations, strict=True)
        )


class FrozenDigest(_Liar):
    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        return replace(await super().saved_tables(axis, proof), digest="0" * 64)


class NoDigest(_Liar):
    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        return replace(await super().saved_tables(axis, proof), digest="")


class KeepsTheNew(_Liar):
    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        if batch[0].purpose == "restore":
            self.machine.files.pop("X.new")
            self._started = self.machine.starts
        else:
            await super().activate(batch, passed)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        if passed[0].purpose != "restore":
            await super().restarted(passed, timeout_s)


class SwitchesAfterAll(_Liar):
    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        del order, enable, timeout_s


@pytest.mark.parametrize(
    ("spoilt", "check", "rule"),
    [
        (TwoHomes, says_what_it_can, "each said once"),
        (LosesAPoint, loads_and_acts, "read back"),
        (OnAtOnce, loads_and_acts, "stays off"),
        (OneCurve, loads_and_acts, "acts as it was ordered"),
        (NoDigest, shows_what_acts, "has a digest"),
        (FrozenDigest, loads_and_acts, "another digest"),
        (KeepsTheNew, restores, "new one does not act"),
        (SwitchesAfterAll, switches_as_declared, "unsupported"),
    ],
)
def test_a_controller_that_breaks_a_rule_is_named(spoilt: type[FileRoad], check: Check, rule: str) -> None:
    async def main() -> None:
        machine, clock = Machine(), LoopClock()
        device: Controller = spoilt(machine, clock)
        assert isinstance(device, FileRoad)
        await check(files_subject(device, machine, clock))

    with pytest.raises(ContractBroken) as caught:
        run_virtual(main)
    assert rule in caught.value.what
