"""Stop plans as programs that know where axes may stand: guards from how these stand now, and what goes where."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from drivers.programs import NOBODY, Moment
from drivers.sinumerik.ncprogram.grinding import GrindSetting, moves, placed
from drivers.sinumerik.ncprogram.guarding import Guard, going, guards_of, left_safe
from drivers.sinumerik.ncprogram.measuring import Parts, Setting, stops_of
from drivers.sinumerik.ncprogram.messages import message
from drivers.sinumerik.ncprogram.selftest import LOOPS
from drivers.sinumerik.opcua import encoders
from drivers.sinumerik.opcua.dialogue import Dialogue
from drivers.sinumerik.opcua.grinding import PartGrinding
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.measuring import Measuring
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.standing import KeepsPlaces
from drivers.types.stops import StopPlan, StopReached
from drivers.units import AxisUnit
from drivers.workpiece import GrindPlan


class GuardsPrograms(KeepsPlaces):
    """The part of the driver that does this; it shares dialogue and transfer with the others."""

    _dialogue: Dialogue
    _transfer: Transfer
    _settings: UaSettings

    async def _guards(self, *moved: str) -> tuple[Guard, ...]:
        """Of every axis that is not ``moved`` and stands in its safe place now. Raises as `state`."""
        if not self.places.ranges:
            return ()
        stands = (await self.motion()).stands
        return guards_of(self.places, self._dialogue.names, {one.axis for one in stands if one.safe} - set(moved))

    async def _guards_along(self, plans: Sequence[StopPlan]) -> list[tuple[Guard, ...]]:
        """As `_guards`, of plans one after the other: an axis stands then where the plan before left it."""
        if not self.places.ranges:
            return [() for _ in plans]
        safe = {one.axis for one in (await self.motion()).stands if one.safe}
        out: list[tuple[Guard, ...]] = []
        for plan in plans:
            out.append(guards_of(self.places, self._dialogue.names, safe - {plan.axis}))
            safe = left_safe(safe, plan, self.places)
        return out

    def message(self, moment: Moment) -> str:
        """What the control shows then, by the program that was sent last."""
        return message(self._transfer.text, moment)

    def _all_guards(self) -> tuple[Guard, ...]:
        """Of every axis that has a safe place."""
        return guards_of(self.places, self._dialogue.names, self.places.ranges)

    def _grinds(self, plan: GrindPlan, units: Mapping[str, AxisUnit]) -> None:
        """As `_goes`, of the program of a plan with its set-up values."""
        axes = {one.letter: (one.name, units.get(one.name, "mm")) for one in plan.axes}
        self.going = going("\n".join(moves(plan, GrindSetting(self._settings.words, {}))), axes, placed(plan))

    def _visits(self, parts: Parts) -> None:
        """As `_goes`, of these parts of the program alone."""
        blocks = [block for plan, setting in parts if plan.stops for block in stops_of(plan, setting)]
        axes = {plan.letter: (plan.axis, plan.unit) for plan, _ in parts}
        more = {plan.axis for plan, _ in parts if plan.further}
        self.going = tuple(replace(one, further=one.axis in more) for one in going("\n".join(blocks), axes))

    def _goes(self, axes: Mapping[str, tuple[str, AxisUnit]], values: Mapping[str, float] | None = None) -> None:
        """What the program that was sent just now moves; arguments as of `going`."""
        self.going = going(self._transfer.text, axes, values)


class RunsPlans(GuardsPrograms):
    """The part of the driver that runs stop plans: those that were foreseen to follow one another in one program."""

    name: str
    goes_on = False
    _reader: MachineReader
    _measuring: Measuring
    _grinding: PartGrinding
    _configuration = Configuration((), (), ())
    _origin = NOBODY
    _without: frozenset[str] = frozenset()

    def do_without(self, words: Collection[str]) -> None:
        """As `drivers.programs.WritesWithout.do_without`."""
        self._without = frozenset(words)

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Send, read back and select a plan's program. Raises UnsupportedDevice (E-NC-ENCODER...), as `Measuring`."""
        further = await self._measuring.takes(plan)
        self.goes_on = further or await self._measuring.goes_on(plan)
        self._grinding.plan = None
        if further:
            await self._measuring.go_further(plan)
            return
        if self.goes_on:
            await self._measuring.go_on()
        else:
            await self._send(self._measuring.following(plan))
        self._visits(self._measuring.stretch())

    async def prepare_reading(self, plans: Sequence[StopPlan]) -> None:
        """As `prepare_stops`, of plans without any stop: one program that saves the tables of each. Moves nothing."""
        self.goes_on = await self._measuring.reads_on(plans)
        if self.goes_on:
            await self._measuring.go_on()
        else:
            await self._send(plans)
        self._grinding.plan = None
        self._visits(())

    async def _send(self, plans: Sequence[StopPlan]) -> None:
        await self._measuring.leave()
        await self._measuring.prepare(await self._parts(plans))

    async def foresee(self, plans: Sequence[StopPlan]) -> None:
        """As `drivers.programs.ForeseesPlans.foresee`."""
        await self._measuring.foresee(plans)

    async def _parts(self, plans: Sequence[StopPlan]) -> Parts:
        """Plans with what their axes need, read afresh. Raises UnsupportedDevice (E-NC-ENCODER...)."""
        known: dict[tuple[object, ...], Setting] = {}
        for plan in plans:
            key = (plan.axis, plan.compensated_axis, plan.encoder)
            if key not in known:
                known[key] = await self._setting(*key, rotary=plan.rotary)
                await self._check_encoder(plan.compensated_axis, plan.encoder, said=plan.encoder_said)
        settings = [known[plan.axis, plan.compensated_axis, plan.encoder] for plan in plans]
        guards = await self._guards_along(plans)
        return [
            (plan, replace(setting, guards=own)) for plan, setting, own in zip(plans, settings, guards, strict=True)
        ]

    async def _setting(self, axis: str, compensated: str, encoder: int, *, rotary: bool) -> Setting:
        """What the programs must know: ``axis`` is the one that moves."""
        configuration = self._configuration
        number = configuration.number(axis, self.name)
        return Setting(
            words=self._settings.words,
            memory=await self._reader.memory(configuration, compensated, encoder),
            modulo=configuration.is_modulo(axis, rotary=rotary),
            axis_number=number,
            approach_feed=self.places.feed(configuration.units[axis]),
            wait_limit_s=self._settings.wait_limit_s,
            origin=self._origin,
            loops=LOOPS not in self._without,
        )

    async def _check_encoder(self, axis: str, encoder: int, *, said: bool) -> None:
        """The site file's measuring system must be the one that acts. Raises UnsupportedDevice (E-NC-ENCODER...)."""
        found = await self._reader.encoders(self._configuration, axis)
        encoders.check(found, axis, encoder, self.name, said=said)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a counter above ``after``; None when the program has ended. Raises as `Measuring.wait`."""
        return await self._measuring.wait(after, timeout_s, self._configuration)

    async def release_stop(self, counter: int) -> None:
        """Echo the counter. Never retried."""
        await self._measuring.release(counter)
