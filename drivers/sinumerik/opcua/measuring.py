"""Stop plans through OPC UA: guarded, sent, followed stop by stop, and the tables that their program saved.

Plans that were announced to follow one another go into one program, which waits at the last stop of each plan until the
next one is prepared. Guards are made of how the axes stand now and of where each plan leaves them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused
from drivers.programs import NOBODY, Moment
from drivers.safe_positions import SafePositionMixin
from drivers.sinumerik.ncprogram import measuring as measuring_program
from drivers.sinumerik.ncprogram.backup import BackupFile
from drivers.sinumerik.ncprogram.checks import Guard, axes_left_safe, check_program, make_guards, read_moves
from drivers.sinumerik.ncprogram.grinding import LOAD, UNLOAD, GrindSetting, all_moves, set_up_variables
from drivers.sinumerik.ncprogram.measuring import MachineSetting, Parts, plan_range, saving_plans, stop_blocks
from drivers.sinumerik.ncprogram.pushing import ACTIVATE
from drivers.sinumerik.ncprogram.selftest import LOOPS, PRESS
from drivers.sinumerik.ncprogram.words import Phase, Word, program_path
from drivers.sinumerik.opcua import machine
from drivers.sinumerik.opcua.grinding import PartGrinding
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.program_dialogue import ProgramDialogue, StatusSnapshot, Transfer, file_error
from drivers.sinumerik.opcua.pushing import fetch_live_tables
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.machine import ChannelStatus
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import LiveSet
from drivers.units import AxisUnit, deviation_scale
from drivers.workpiece import GrindPlan

# Messages at an M0, found in the program's own blocks.

_WAITS = re.compile(r'^(?:N\d+ )?MSG\("([^"]*)"\)\n(?:N\d+ )?M0$', re.MULTILINE)
_BEGINS: dict[Moment, str] = {
    "restart": ACTIVATE,
    "clamp": LOAD,
    "unclamp": UNLOAD,
    "self-test": PRESS,
}


def waiting_messages(text: str) -> tuple[str, ...]:
    """Every message that a program shows at an M0, in its order."""
    return tuple(_WAITS.findall(text))


def message_at(text: str, moment: Moment) -> str:
    """The message of one moment; "" where the program does not wait then."""
    return next((one for one in waiting_messages(text) if one.startswith(_BEGINS[moment])), "")


# Stops.

QUIET_PART, QUIET_S = 0.6, 2.0
LEAVES_S, LOOK_S = 5.0, 0.25
_SAVED = (Phase.MEASURING, Phase.FINISHED, Phase.LEFT)
_OVER = (Phase.FINISHED, Phase.LEFT)


class Measuring:
    """The measuring part of the driver; it shares dialogue and transfer with the others.

    A program may hold several plans, ``together`` at most. It waits at the last stop of each, whose echo is `tables`
    back until the next one is prepared. Counters are those of the plan outside, and count on through all plans inside.
    Where a foreseen plan lets further stops follow, the program waits for them too, and ``further`` holds their plan.
    """

    def __init__(
        self, dialogue: ProgramDialogue, transfer: Transfer, clock: Clock, where: str, *, together: int
    ) -> None:
        self._dialogue = dialogue
        self._transfer = transfer
        self._clock = clock
        self._where = where
        self._together = together
        self._parts: Parts = ()
        self._place = self._base = self._token = 0
        self._held: int | None = None
        self._further: StopPlan | None = None
        self._coming: tuple[StopPlan, ...] = ()
        self._saved = self._ended = False
        self._moving_since: float | None = None
        self._move_s = 0.0

    @property
    def _plan(self) -> StopPlan | None:
        return self._parts[self._place][0] if self._parts else None

    def forget(self) -> None:
        """The program is none of a plan, or asked to end: no tables are to be had, and nothing waits any more."""
        self._parts, self._saved, self._held, self._further = (), False, None, None

    def cut(self) -> None:
        """The program is asked to end: no plan follows in it."""
        self._parts = [_closed(one) for one in self._parts[: self._place + 1]]
        self._held = None

    async def leave(self) -> None:
        """Another kind of program is about to be sent: one that waits for its next plan ends first."""
        if self._held is not None:
            self.cut()
            await self._dialogue.check_own()
            await self._dialogue.write({Word.ABORT: 1.0})
            end = self._clock.now() + LEAVES_S
            while (await self._dialogue.look()).channel is not ChannelStatus.RESET and self._clock.now() < end:
                await self._clock.sleep(LOOK_S)

    async def foresee(self, plans: Sequence[StopPlan]) -> None:
        """As `ForeseesPlans.foresee`."""
        coming = tuple(plans)
        left = tuple(plan for plan, _ in self._parts[self._place + 1 :])
        if self._held is None or not left or coming[: len(left)] != left:
            await self.leave()
        self._coming = coming

    def following(self, plan: StopPlan) -> tuple[StopPlan, ...]:
        """The plan and those foreseen to follow it, as many as go into one program."""
        if plan not in self._coming:
            return (replace(plan, further=False),)
        first = self._coming.index(plan)
        return self._coming[first : first + self._together]

    async def goes_on(self, plan: StopPlan) -> bool:
        """Whether the program that runs waits for this plan."""
        following = self._parts[self._place + 1 :]
        return bool(following) and following[0][0] == plan and await self._is_held()

    async def reads_on(self, plans: Sequence[StopPlan]) -> bool:
        """Whether the program that runs waits for these last plans, all without stops."""
        return tuple(plan for plan, _ in self._parts[self._place + 1 :]) == tuple(plans) and await self._is_held()

    async def _is_held(self) -> bool:
        if self._held is None:
            return False
        seen = await self._dialogue.look()
        return seen.channel is ChannelStatus.ACTIVE and seen.word(Word.TRANSACTION) == self._token

    async def takes(self, plan: StopPlan) -> bool:
        """Whether the program waits for further stops, and these are some: of the same axis, within its moves."""
        if self._held is None or not plan.stops or any(stop.switch is not None for stop in plan.stops):
            return False
        base, setting = self._parts[self._place]
        alike = replace(base, name=plan.name, stops=plan.stops, setup="", further=plan.further)
        low, high = plan_range(base, setting)
        within = setting.modulo or all(low <= place <= high for place in plan_range(plan, setting))
        return base.further and alike == plan and within and await self._is_held()

    async def go_further(self, plan: StopPlan) -> None:
        """Send the first of further stops. Never retried."""
        self._base += self._stops
        self._further = plan
        self._moving_since, self._move_s = None, 0.0
        held, self._held = self._held, None
        await self._ask_further(0, held or 0)
        self._dialogue.pace.again()

    async def _ask_further(self, index: int, echo: int) -> None:
        """Where the next further stop is, and only then that the one before is done."""
        plan, setting = self._further or self._parts[self._place][0], self._parts[self._place][1]
        stop = plan.stops[index]
        lead = stop.target - stop.approach * plan.overrun
        places = {Word.LEAD: lead, Word.NEXT: stop.target}
        turned = {word: round(place, 6) % 360.0 if setting.modulo else place for word, place in places.items()}
        told = {Word.REPETITION: float(stop.repetition), Word.LABEL: float(stop.label)}
        await self._dialogue.write(told | turned | {Word.SIDE: float(stop.approach)})
        await self._dialogue.write({Word.ECHO: float(echo)})

    async def go_on(self) -> None:
        """Echo the last stop of the plan before: the program begins with the next one. Never retried."""
        held, self._held = self._held, None
        before = [plan for plan, _ in self._parts]
        self._base += self._stops
        if self._further is not None:
            await self._dialogue.write({Word.SIDE: 0.0})
        self._place, self._further = self._place + 1, None
        self._saved = self._saved and not saving_plans(before)[self._place]
        self._begun(self._parts[self._place])
        self._dialogue.watch(self._parts[self._place][1].axis_number)
        await self._dialogue.write({Word.ECHO: float(held or 0)})
        self._dialogue.pace.again()

    def _begun(self, part: tuple[StopPlan, MachineSetting]) -> None:
        if part[0] in self._coming:
            self._coming = self._coming[self._coming.index(part[0]) + 1 :]
        self._moving_since, self._move_s = None, 0.0

    async def prepare(self, parts: Parts) -> None:
        """Send, read back and select the program of plans.

        Raises DeviceRefused (E-NC-NOT-RESET and other refusals), and as `check_program`, before anything was written.
        """
        plan, setting = parts[0]
        token = self._dialogue.fresh_number()
        path = program_path("MEAS", plan.compensated_axis)
        passed = check_program(path, measuring_program.build_chained_program(parts, token), setting.memory.axes)
        await self._dialogue.begin(setting.axis_number, token, path)
        self._parts, self._token, self._saved, self._ended = tuple(parts), token, False, False
        self._place = self._base = 0
        self._held = self._further = None
        self._begun(parts[0])
        await self._transfer.send(passed)
        await self._transfer.select(path)

    def stretch(self) -> Parts:
        """The plan prepared last and those that follow it before a person is asked again."""
        rest = self._parts[self._place :]
        asked = [place for place, (plan, _) in enumerate(rest) if place and plan.setup]
        return rest[: asked[0]] if asked else rest

    def _waits_for_next(self, counter: int) -> bool:
        """Whether all stops of this plan are done, and another plan or further stops may follow in the same program."""
        more = self._place + 1 < len(self._parts) or (self._plan is not None and self._plan.further)
        return 0 < self._stops == counter - self._base and more

    @property
    def _stops(self) -> int:
        plan = self._further or self._plan
        return len(plan.stops) if plan is not None else 0

    async def wait(self, after: int, timeout_s: float, configuration: Configuration) -> StopReached | None:
        """Wait for a counter above ``after`` with the axis in position; None when the program has ended.

        Raises DeadlineExceeded (E-NC-NO-STOP), DeviceRefused (E-NC-ALARM, E-NC-FILE), and what the wire raises.
        """
        after += self._base
        if self._waits_for_next(after):
            return None
        end = self._clock.now() + timeout_s
        before: StatusSnapshot | None = None
        looks = 0
        if self._moving_since is not None:
            await self._dialogue.wait()
        while not self._ended:
            seen = await self._dialogue.look()
            looks += 1
            await self._dialogue.check_alarms(seen)
            if seen.word(Word.TRANSACTION) == self._token:
                self._note_progress(seen)
                if before is not None and before.words == seen.words and self._is_stop(seen, after):
                    self._time_move(at_once=looks == 2)
                    return self._stop(seen, configuration)
                self._ended = self._is_over(before, seen)
                fresh = self._is_stop(seen, after) and not (before and before.words == seen.words)
                before = seen
                if fresh:
                    continue  # look again at once: the words of a stop must be seen twice alike
            if self._clock.now() >= end and not self._ended:
                raise DeadlineExceeded("E-NC-NO-STOP", self._where, after=after, timeout_s=timeout_s)
            await self._dialogue.wait()
        return None

    def _note_progress(self, seen: StatusSnapshot) -> None:
        self._dialogue.check_places(seen)
        if seen.phase == Phase.FILE_FAILED:
            raise file_error(seen, self._where, self._plan.compensated_axis if self._plan else "")
        begun = not self._place or seen.word(Word.COUNTER) > self._base or seen.phase == Phase.FINISHED
        self._saved = self._saved or (begun and seen.phase in _SAVED)

    @staticmethod
    def _is_stop(seen: StatusSnapshot, after: int) -> bool:
        waiting = seen.channel is ChannelStatus.ACTIVE and seen.word(Word.COUNTER) > after
        return waiting and seen.in_position and seen.phase == Phase.MEASURING

    @staticmethod
    def _is_over(before: StatusSnapshot | None, seen: StatusSnapshot) -> bool:
        """By its own word, or because the channel is in reset at two looks after the program had begun."""
        if seen.channel is not ChannelStatus.RESET:
            return False
        return seen.phase in _OVER or (before is not None and before.channel is ChannelStatus.RESET)

    def _stop(self, seen: StatusSnapshot, configuration: Configuration) -> StopReached:
        compensated = self._plan.compensated_axis if self._plan else ""
        scale = deviation_scale(configuration.units.get(compensated, "mm"))
        counter, target = round(seen.word(Word.COUNTER)) - self._base, seen.word(Word.TARGET)
        if self._further is not None and self._parts[self._place][1].modulo and 0 < counter <= self._stops:
            target += 360.0 * round((self._further.stops[counter - 1].target - target) / 360.0)
        return StopReached(
            counter=counter,
            repetition=round(seen.word(Word.REPETITION)),
            label=round(seen.word(Word.LABEL)),
            approach=1 if seen.word(Word.APPROACH) > 0 else -1,
            target=target,
            encoder_compensation=seen.word(Word.ENCODER_COMPENSATION) * scale,
            cross_compensation=seen.word(Word.CROSS_COMPENSATION) * scale,
        )

    async def release(self, counter: int) -> None:
        """Echo the counter, unless the program shall wait there for its next plan. Never retried."""
        counter += self._base
        if self._waits_for_next(counter):
            self._held = counter
            return
        if self._further is not None and counter - self._base < self._stops:
            await self._ask_further(counter - self._base, counter)
        else:
            await self._dialogue.write({Word.ECHO: float(counter)})
        self._moving_since = self._clock.now()
        self._dialogue.pace.again(min(QUIET_PART * self._move_s, QUIET_S))

    def _time_move(self, *, at_once: bool) -> None:
        """Remember how long the move took: the next stop is not expected much earlier.

        One that stood there at the first look may have stood there for long: the next is looked for earlier.
        """
        if self._moving_since is not None:
            took_s = self._clock.now() - self._moving_since
            self._move_s, self._moving_since = (0.5 * took_s if at_once else took_s), None

    async def saved_tables(self, axis: str, configuration: Configuration) -> LiveSet:
        """The live tables the last program wrote before moving. Raises DeviceRefused (E-NC-NOT-SAVED, E-UA-FILE...)."""
        part = self._saves(axis)
        if part is not None and not self._saved:
            seen = await self._dialogue.look()
            if seen.word(Word.TRANSACTION) == self._token:
                self._note_progress(seen)
        if part is None or not self._saved:
            raise DeviceRefused("E-NC-NOT-SAVED", self._where, axis=axis)
        plan, setting = part
        saving = BackupFile(section="LIVE", number=self._token, axis=axis, encoder=plan.encoder, memory=setting.memory)
        return await fetch_live_tables(self._transfer, saving, configuration)

    def _saves(self, axis: str) -> tuple[StopPlan, MachineSetting] | None:
        """The part under way where it saves what acts on an axis; at a program's end any such part without stops."""
        rest = self._parts[self._place :]
        still = self._ended and not any(plan.stops for plan, _ in rest)
        known = rest if still else rest[:1]
        return next((one for one in known if one[0].compensated_axis == axis and one[0].save_tables), None)


def _closed(part: tuple[StopPlan, MachineSetting]) -> tuple[StopPlan, MachineSetting]:
    return replace(part[0], further=False), part[1]


# Guards, and plans in one program.


class GuardMixin(SafePositionMixin):
    """The part of the driver that does this; it shares dialogue and transfer with the others."""

    _dialogue: ProgramDialogue
    _transfer: Transfer
    _settings: UaSettings

    async def _guards(self, *moved: str) -> tuple[Guard, ...]:
        """Of every axis that is not ``moved`` and stands in its safe place now. Raises as `check_state`."""
        if not self.places.ranges:
            return ()
        stands = (await self.motion()).stands
        return make_guards(self.places, self._dialogue.names, {one.axis for one in stands if one.safe} - set(moved))

    async def _guards_along(self, plans: Sequence[StopPlan]) -> list[tuple[Guard, ...]]:
        """As `_guards`, of plans one after the other: an axis stands then where the plan before left it."""
        if not self.places.ranges:
            return [() for _ in plans]
        safe = {one.axis for one in (await self.motion()).stands if one.safe}
        out: list[tuple[Guard, ...]] = []
        for plan in plans:
            out.append(make_guards(self.places, self._dialogue.names, safe - {plan.axis}))
            safe = axes_left_safe(safe, plan, self.places)
        return out

    def message(self, moment: Moment) -> str:
        """What the control shows then, by the program that was sent last."""
        return message_at(self._transfer.text, moment)

    def _all_guards(self) -> tuple[Guard, ...]:
        """Of every axis that has a safe place."""
        return make_guards(self.places, self._dialogue.names, self.places.ranges)

    def _grinds(self, plan: GrindPlan, units: Mapping[str, AxisUnit]) -> None:
        """As `_goes`, of the program of a plan with its set-up values."""
        axes = {one.letter: (one.name, units.get(one.name, "mm")) for one in plan.axes}
        self.going = read_moves(
            "\n".join(all_moves(plan, GrindSetting(self._settings.words, {}))), axes, set_up_variables(plan)
        )

    def _visits(self, parts: Parts) -> None:
        """As `_goes`, of these parts of the program alone."""
        blocks = [block for plan, setting in parts if plan.stops for block in stop_blocks(plan, setting)]
        axes = {plan.letter: (plan.axis, plan.unit) for plan, _ in parts}
        more = {plan.axis for plan, _ in parts if plan.further}
        self.going = tuple(replace(one, further=one.axis in more) for one in read_moves("\n".join(blocks), axes))

    def _goes(self, axes: Mapping[str, tuple[str, AxisUnit]], values: Mapping[str, float] | None = None) -> None:
        """What the program that was sent just now moves; arguments as of `read_moves`."""
        self.going = read_moves(self._transfer.text, axes, values)


class StopPlanMixin(GuardMixin):
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
        known: dict[tuple[object, ...], MachineSetting] = {}
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

    async def _setting(self, axis: str, compensated: str, encoder: int, *, rotary: bool) -> MachineSetting:
        """What the programs must know: ``axis`` is the one that moves."""
        configuration = self._configuration
        number = configuration.number(axis, self.name)
        return MachineSetting(
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
        machine.check_encoder(found, axis, encoder, self.name, said=said)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a counter above ``after``; None when the program has ended. Raises as `Measuring.wait`."""
        return await self._measuring.wait(after, timeout_s, self._configuration)

    async def release_stop(self, counter: int) -> None:
        """Echo the counter. Never retried."""
        await self._measuring.release(counter)
