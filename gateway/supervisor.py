"""Opens, watches and closes the site's devices; every failure is reported at once, not one after another."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterable
from contextlib import aclosing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceError, TrueflankError, UnsupportedDevice
from drivers.ports.controller import Controller
from drivers.ports.devices import Device
from drivers.ports.instruments import Instrument, TypedInstrument
from drivers.stale_programs import NOTHING, LeavesPrograms, SentPrograms
from drivers.terms import speak
from drivers.types.identity import Identity, Likeness, MachineIdentity, Renamed, likeness
from drivers.types.machine import MachineState
from gateway.config import InstrumentSection, SiteFile
from gateway.live import of_device, onlooker

# What a site's instruments may be; the first is meant where a driver is not known.
_ROLES = ("instrument", "gear-inspector")


@dataclass(frozen=True, slots=True)
class DevicePicture:
    """One device as seen now: ``state`` is "closed", "open", "lost" or "failed"."""

    name: str
    driver: str
    state: str
    since_utc: str
    identity: Identity | None = None
    error: TrueflankError | None = None


def unopened_devices(site: SiteFile, clock: Clock) -> tuple[DevicePicture, ...]:
    """Every device of a site before anything was loaded for it."""
    since = clock.utc().isoformat(timespec="seconds")
    named = ((Supervisor.CONTROLLER, site.controller.driver), *((one.name, one.driver) for one in site.instruments))
    return tuple(DevicePicture(name=name, driver=driver, state="closed", since_utc=since) for name, driver in named)


class DevicesFailed(TrueflankError):
    """One or more devices did not open; ``causes`` holds each device's own error."""

    def __init__(self, causes: tuple[tuple[str, TrueflankError], ...]) -> None:
        lines = "; ".join(f"{name}: {error}" for name, error in causes)
        super().__init__("E-SUP-OPEN", "site", count=len(causes), causes=lines)
        self.causes = causes
        # The first cause that a person can act on decides the shell's exit code.
        self.exit_code = causes[0][1].exit_code  # type: ignore[misc]


Recognise = Callable[[MachineIdentity], None]
"""Who knows what the site's machine is known by: refuses another one, as `refusal_of`."""


def refusal_of(found: Likeness, site: str) -> UnsupportedDevice:
    """What says that a machine is not the one known: E-SUP-IDENTITY where one fact is asked, else E-SUP-MACHINE.

    ``site`` is its site file, for the command that accepts.
    """
    told: dict[str, Any] = {"site": site, "told": found.told}
    if found.is_asked:
        (one,) = found.changed
        told = {"site": site, "fact": one.fact, "was": one.was, "now": one.now, "same": ", ".join(found.same)}
    return UnsupportedDevice("E-SUP-IDENTITY" if found.is_asked else "E-SUP-MACHINE", Supervisor.CONTROLLER, **told)


class Supervisor:
    """All devices of one site, by name. The controller is called "controller"."""

    CONTROLLER = "controller"
    WATCH_S = 2.0
    REOPEN_MAX_S = 60.0

    def __init__(
        self,
        site: SiteFile,
        clock: Clock,
        say: Callable[[str], None] = lambda _text: None,
        *,
        only: Collection[str] | None = None,
        book: SentPrograms | None = None,
        recognise: Recognise | None = None,
    ) -> None:
        """``only`` names the instruments that are wanted; all of the site's without it.

        ``book`` keeps which programs were sent to the controller, so that what is left of them is known later.
        ``recognise`` knows what was accepted of the machine's identity; without it the site file alone counts.
        """
        self._recognise = recognise or self._by_site_file
        self._site = site
        self._book = book
        self.left = NOTHING
        self.seen: MachineState | None = None
        self._only = only
        self._clock = clock
        self._say = say
        self._devices: dict[str, Device] = {}
        self._pictures: dict[str, DevicePicture] = {}
        self._traces: dict[str, Any] = {}
        self._build()

    def _build(self) -> None:
        section = self._site.controller
        self._add(self.CONTROLLER, section.driver, "controller", section.url, section.settings)
        words = registry.terms_of(section.driver)
        if words is not None:
            speak(words)
        for instrument in self._wanted:
            role = next((role for role in _ROLES if instrument.driver in registry.known(role)), _ROLES[0])
            self._add(instrument.name, instrument.driver, role, instrument.url, instrument.settings)
        if isinstance(self.controller, LeavesPrograms):
            self.controller.book = self._book

    @property
    def _wanted(self) -> tuple[InstrumentSection, ...]:
        return tuple(one for one in self._site.instruments if self._only is None or one.name in self._only)

    def _add(self, name: str, driver: str, role: str, url: str, settings: dict[str, Any]) -> None:
        factory = registry.load(driver, role)
        self._devices[name] = cast(Device, factory(name, url, settings, self._clock))
        self._picture(name, driver, "closed")

    def trace_into(self, folder: Path) -> None:
        """Keep what passes on every instrument's wire from the next opening on, if the site file wants it."""
        if not self._site.site.trace:
            return
        recorder = registry.load("wire-trace", "trace")
        for section in self._wanted:
            device = self._devices[section.name]
            if hasattr(device, "trace"):
                about = {"driver": section.driver, "url": section.url, "settings": section.settings}
                self._traces[section.name] = recorder(folder, section.name, self._clock, about)
                device.trace = self._traces[section.name]

    def _picture(
        self,
        name: str,
        driver: str,
        state: str,
        identity: Identity | None = None,
        error: TrueflankError | None = None,
    ) -> None:
        since = self._clock.utc().isoformat(timespec="seconds")
        self._pictures[name] = DevicePicture(
            name=name, driver=driver, state=state, since_utc=since, identity=identity, error=error
        )

    @property
    def controller(self) -> Controller:
        """The machine's controller."""
        return cast(Controller, self._devices[self.CONTROLLER])

    def instrument(self, name: str) -> Instrument:
        """An instrument of the site by its name."""
        return cast(Instrument, self._devices[name])

    def picture(self) -> tuple[DevicePicture, ...]:
        """All devices as they are now, for pages and logs."""
        return tuple(self._pictures.values())

    async def open_all(self) -> MachineIdentity:
        """Open and identify every device together. Raises DevicesFailed naming each one that did not."""
        await self._open_these(self._devices)
        machine = await self._known_machine()
        await self._look_around()
        return machine

    async def hold(self, names: Collection[str]) -> None:
        """Keep of all instruments only these open: what is not in use streams to nobody and may be carried about.

        One that was let go is opened and identified anew when it is named again. Raises DevicesFailed.
        """
        for name, seen in self._pictures.items():
            if name != self.CONTROLLER and name not in names and seen.state == "open":
                await self._devices[name].close()
                self._picture(name, seen.driver, "closed", seen.identity)
        await self._open_these([name for name in self._devices if name in names and not self._is_open(name)])

    def _is_open(self, name: str) -> bool:
        return self._pictures[name].state == "open"

    async def _open_these(self, names: Iterable[str]) -> None:
        results = await asyncio.gather(*(self._open(name) for name in names))
        failures = tuple((name, error) for name, error in results if error is not None)
        if failures:
            raise DevicesFailed(failures)

    async def _open(self, name: str) -> tuple[str, TrueflankError | None]:
        of_device(name)
        driver = self._pictures[name].driver
        if name in self._traces:
            self._traces[name].session()
        try:
            identity = await self._devices[name].open(self._timeout(name))
            self._check_serial(name, identity)
        except TrueflankError as error:
            self._picture(name, driver, "failed", error=error)
            await self._devices[name].close()
            return name, error
        self._picture(name, driver, "open", identity)
        return name, None

    def _timeout(self, name: str) -> float:
        if name == self.CONTROLLER:
            return self._site.controller.timeout_s
        return next(section.timeout_s for section in self._site.instruments if section.name == name)

    def _check_serial(self, name: str, identity: Identity) -> None:
        wanted = {section.name: section.serial for section in self._site.instruments}.get(name, "")
        if wanted and identity.serial != wanted:
            raise UnsupportedDevice("E-SUP-SERIAL", name, found=identity.serial, wanted=wanted)

    async def identified(self) -> MachineIdentity:
        """Open the controller alone and read who it says it is, whoever that may be. Raises DevicesFailed."""
        await self._open_these([self.CONTROLLER])
        return await self.controller.identify()

    def _by_site_file(self, machine: MachineIdentity) -> None:
        section = self._site.controller
        found = likeness({"serial": section.serial, **section.identity.facts}, machine)
        if not found.is_known:
            raise refusal_of(found, "SITE")

    async def _known_machine(self) -> MachineIdentity:
        machine = await self._called()
        missing = [axis.name for axis in self._site.axes if axis.name not in machine.axis_names]
        if missing:
            names = ", ".join(machine.axis_names)
            raise ConfigError("E-SUP-AXIS", "axes", missing=", ".join(missing), known=names)
        return machine

    async def _called(self) -> MachineIdentity:
        """The machine by the site's serial number, whatever its control gives. Raises as `refusal_of`."""
        controller, name = self.controller, self._site.controller.serial
        if isinstance(controller, Renamed):
            controller.known_as = {}
        machine = await self.controller.identify()
        self._recognise(machine)
        if machine.serial == name:
            return machine
        if not isinstance(controller, Renamed):
            told = f"serial: {name} -> {machine.serial}"
            raise UnsupportedDevice("E-SUP-MACHINE", self.CONTROLLER, told=told)
        controller.known_as = {machine.serial: name}
        return await self.controller.identify()

    async def watch(self, stop: asyncio.Event) -> None:
        """Until `stop`: ask the controller for a sign of life and reopen what was lost, ever more slowly.

        An instrument that is away, as most are between two measurements, holds up nobody's look at the controller.
        What the others send is told to whoever looks on.
        """
        following = [asyncio.create_task(self._follow(one.name)) for one in self._wanted]
        try:
            await self._look_after(stop)
        finally:
            for task in following:
                task.cancel()
            await asyncio.gather(*following, return_exceptions=True)

    async def _look_after(self, stop: asyncio.Event) -> None:
        pause, again_at = self.WATCH_S, 0.0
        while not stop.is_set():
            await self._wait(stop, self.WATCH_S)
            if self._is_open(self.CONTROLLER) and not stop.is_set():
                await self._sign_of_life()
            lost = [name for name, seen in self._pictures.items() if seen.state != "open"]
            if not lost:
                pause = self.WATCH_S
            elif self._clock.now() >= again_at:
                results = await asyncio.gather(*(self._open(name) for name in lost))
                failed = any(error is not None for _name, error in results)
                pause = min(pause * 1.8, self.REOPEN_MAX_S) if failed else self.WATCH_S
                again_at = self._clock.now() + pause - self.WATCH_S

    async def _follow(self, name: str) -> None:
        """What an idle instrument sends, for ever. One whose wire breaks is lost; one without a beam is asked again."""
        of_device(name)
        device = self._devices[name]
        # Who asks a person for each reading sends nothing by himself.
        while isinstance(device, Instrument) and not isinstance(device, TypedInstrument):
            if self._is_open(name):
                try:
                    async with aclosing(device.blocks()) as blocks:  # type: ignore[type-var]
                        async for block in blocks:
                            onlooker().samples(name, block)
                except DeviceError:
                    pass
                except TrueflankError as error:
                    await device.close()
                    self._pictures[name] = replace(self._pictures[name], state="lost", error=error)
            await self._clock.sleep(self.WATCH_S)

    async def _sign_of_life(self) -> None:
        try:
            self.seen = await self.controller.state()
            await self._look_around()
        except TrueflankError as error:
            seen, self.seen = self._pictures[self.CONTROLLER], None
            self._pictures[self.CONTROLLER] = replace(seen, state="lost", error=error)
            self._say(str(error))
            await self.controller.close()

    async def _look_around(self) -> None:
        """What of ours stands in the control without a gateway at work with it: kept in ``left``."""
        if isinstance(self.controller, LeavesPrograms):
            self.left = await self.controller.left_over()

    async def _wait(self, stop: asyncio.Event, seconds: float) -> None:
        waiter = asyncio.ensure_future(stop.wait())
        sleeper = asyncio.ensure_future(self._clock.sleep(seconds))
        try:
            await asyncio.wait((waiter, sleeper), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (waiter, sleeper):
                task.cancel()
            await asyncio.gather(waiter, sleeper, return_exceptions=True)

    async def close_all(self) -> None:
        """Close every device; never raises."""
        for name, device in self._devices.items():
            await device.close()
            seen = self._pictures[name]
            if seen.state == "open":
                self._picture(name, seen.driver, "closed", seen.identity)
        for trace in self._traces.values():
            trace.close()
        if self._book is not None:
            self._book.close()
