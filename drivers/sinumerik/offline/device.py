"""The 840D without a connection, as a Controller: the driver by OPC UA over a session whose steps a person carries.

Work with a control is the same sequence of questions each time it is restarted. So each step that was carried answers
where it answered before, and the first one without an answer is what a person has to carry now::

    session asks -> step answered?  yes: read its report, go on
                                    no:  lay out program and sheet, wait for the files of that step

Nothing is sent twice: a step that was composed stays as it is, and a program that differs from it is refused.
"""

from __future__ import annotations

import secrets as random_source
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers.checks import CheckLine, Wanted, failed, identity_lines, unknown
from drivers.clock import Clock
from drivers.errors import (
    DeadlineExceeded,
    DeviceRefused,
    FileFormatError,
    LinkBroken,
    TrueflankError,
    UnsupportedDevice,
)
from drivers.message import Message
from drivers.offline_exchange import PieceOfWork, ToCarry, at_work
from drivers.sinumerik.ncprogram.words import Word
from drivers.sinumerik.offline import steps
from drivers.sinumerik.offline.folder import CarriedStep, StepFolder, carried_files, stick_name
from drivers.sinumerik.offline.report import ReportRequest, SeenControl
from drivers.sinumerik.offline.settings import OfflineSettings
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.session import nodes, requests
from drivers.sinumerik.opcua.session.client import Arguments, UaSession
from drivers.sinumerik.opcua.session.connection import Secrets
from drivers.sinumerik.opcua.session.requests import AlarmEvent, Reading
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile.tables import HELD_KINDS
from drivers.stale_programs import NOTHING, StaleProgram
from drivers.types.abilities import Capabilities
from drivers.types.identity import Identity
from drivers.types.orders import PushBatch

# The session.

LOOK = "/_N_MPF_DIR/_N_TFSEE_MPF"
LOOK_S = 1.0
QUIET_S = 30.0
"""How long what was brought back is looked at for what cannot come of it any more."""


class CarriedSession(UaSession):
    """Settings as the road's; ``folder`` keeps the steps of `drivers.offline_exchange.at_work`."""

    def __init__(
        self, folder: StepFolder, asked: ReportRequest, settings: UaSettings, clock: Clock, where: str
    ) -> None:
        super().__init__("carried://", clock, where)
        self._folder, self._asked_for, self._settings = folder, asked, settings
        self._open = self.suspended = False
        self._steps: list[CarriedStep] = []
        self._at = 0
        self._image: SeenControl | None = None
        self._programs: dict[str, str] = {}
        self._files: dict[str, str] = {}
        self._pending: CarriedStep | None = None
        self._quiet_s = 0.0
        self._drawn: list[int] = []

    # ---- opening and closing ------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        """Whether requests can be made; no more once a person has to carry something."""
        return self._open and not self.suspended

    @property
    def methods(self) -> frozenset[str]:
        """What stands for the wire's methods."""
        return frozenset({"CopyFileToServer", "CopyFileFromServer", "Select"})

    async def open(self, secrets: Secrets, timeout_s: float, writing: Secrets | None = None) -> None:
        """From the beginning of the work under way; nobody logs in.

        Raises ToCarry where the control was never seen, DeviceRefused (E-OFF-BEGUN, E-OFF-NOTHING) for other work than
        waits for its files, ConfigError (E-OFF-NONE, E-OFF-FOLDER), FileFormatError.
        """
        del secrets, timeout_s, writing
        self._folder.prepare()
        unseen = self._begin(at_work())
        self._steps, self._at, self._pending = self._folder.steps(), 0, None
        self._programs, self._files, self._drawn, self.suspended = {}, {}, [], False
        last = self._folder.last()
        self._image = steps.seen_control(last, self._asked_for, self._where) if last is not None else None
        if self._image is not None and last is not None:
            self._image.queued = {int(number): value for number, value in last.given.items()}
        self._open = True
        if self._image is None or unseen:
            await self.looked("introduction")

    def _begin(self, work: PieceOfWork) -> bool:
        """Whether a program that was carried for other work may have run since the control was seen."""
        waits, unseen = self._folder.work(), False
        if work.start == "instead" or (waits is not None and not waits and not work.ends):
            unseen = any(not step.answered for step in self._folder.steps())
            self._folder.conclude(self._folder.newest())
        elif code := work.refused(waits):
            raise DeviceRefused(code, self._where, what=work.name if waits is None else waits or "another command")
        self._folder.call(work.name)
        return unseen

    async def close(self) -> None:
        """What the control is still to be told goes along in the next program; nothing else to let go of."""
        if self._open and not self.suspended and not self._steps:
            last = self._folder.last()
            if last is not None and self._image is not None:
                self._folder.keep_last(self._with_queue(last))
        self._open = False

    async def beside(self, timeout_s: float) -> UaSession:
        """No second one. Raises UnsupportedDevice (E-UA-ABSENT)."""
        raise UnsupportedDevice("E-UA-ABSENT", self._where, status="no wire", what=f"a second session in {timeout_s} s")

    async def looked(self, why: str, *, restart: bool = False, also: tuple[str, ...] = ()) -> None:
        """A step of the looking program alone, after a ``restart`` of the control or not. Raises as `rest`.

        ``also`` are files that come back beside it where the control has them.
        """
        asked = self._asked_for
        self._pending = self._next(LOOK, why, lambda one: steps.looking_program(one, asked), restart=restart, also=also)
        while self._pending is not None:
            await self.rest(LOOK_S)

    # ---- requests -----------------------------------------------------------------------------------

    @property
    def image(self) -> SeenControl:
        """How the control stood when it was seen last."""
        if self._image is None:
            raise LinkBroken("E-UA-BROKEN", self._where, why=Message.of("W-OFFLINE-NEVER"))
        return self._image

    async def read(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `UaSession.read`."""
        return requests.checked_readings(await self.survey(paths, timeout_s), self._where)

    async def survey(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `UaSession.survey`."""
        del timeout_s
        return self.image.read(paths, self._settings)

    async def read_aged(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `read`: the control was seen when its last program ended."""
        return await self.read(paths, timeout_s)

    async def server_time(self, timeout_s: float) -> datetime | None:
        """None: nobody tells."""
        del timeout_s
        return None

    async def user_may_write(self, path: str, timeout_s: float) -> bool | None:
        """None: only the programs themselves find out."""
        del path, timeout_s
        return None

    async def alarm_events(self, timeout_s: float) -> list[AlarmEvent] | None:
        """None: a person types them."""
        del timeout_s
        return None

    async def write(self, values: Sequence[tuple[str, Any]], timeout_s: float) -> None:
        """R parameters: they go along in the next program. Raises DeviceRefused (E-OFF-WRITE) for anything else."""
        del timeout_s
        echo = self._settings.words.number(Word.ECHO)
        for path, value in values:
            address = nodes.parse(path)
            if address is None or address.name != "R" or not address.elements:
                raise DeviceRefused("E-OFF-WRITE", self._where, what=path)
            number = address.elements[0]
            self.image.queued[number] = float(value)
            if number == echo:
                self.image.echoed(float(value))
        self._quiet_s = 0.0

    async def call(self, method: str, arguments: Arguments, timeout_s: float) -> Any:
        """Files there and back, and which program runs next. Raises as `UaSession.call`."""
        del timeout_s
        path = nodes.from_file(str(arguments[0][0])) or str(arguments[0][0])
        if method == "CopyFileToServer":
            self._programs[path] = bytes(arguments[1][0]).decode("ascii")
            return None
        if method == "CopyFileFromServer":
            text = self._programs.get(path, self._files.get(path))
            if text is None and at_work().start == "instead":  # what other work never brought may still be there
                await self.looked(path, also=(path,))
                text = self._files.get(path)
            if text is None:
                raise DeviceRefused("E-UA-FILE", self._where, status="BadNotFound", what=path)
            return text.encode("latin-1")
        if method == "Select":
            self._select(path)
            return 0
        raise UnsupportedDevice("E-UA-ABSENT", self._where, status="no wire", what=method)

    def fresh_number(self) -> int:
        """A number for a program; the same for the same step each time the work is begun again."""
        known = self._steps[self._at].drawn if self._at < len(self._steps) else []
        if len(self._drawn) >= len(known):
            self._drawn.append(_any_number())
        else:
            self._drawn.append(known[len(self._drawn)])
        return self._drawn[-1]

    # ---- steps --------------------------------------------------------------------------------------

    def _select(self, path: str) -> None:
        text = self._programs.get(path)
        if text is None:
            raise DeviceRefused("E-NC-NO-PROGRAM", self._where, path=path)
        image, given = self.image, dict(self.image.queued)
        told = (self._asked_for, image.serial.strip(), image.chain, given)
        self._pending = self._next(path, text, lambda number: steps.compose_program(text, number, *told), given)
        image.program = path
        self._quiet_s = 0.0

    def _next(
        self,
        path: str,
        sent: str,
        compose: Callable[[int], str],
        given: dict[int, float] | None = None,
        *,
        restart: bool = False,
        also: tuple[str, ...] = (),
    ) -> CarriedStep:
        """The step at this place of the work: as it was composed before, or composed, kept and laid out now."""
        digest = steps.program_digest(sent)
        place, self._at = self._at, self._at + 1
        drawn, self._drawn = self._drawn, []
        if place < len(self._steps):
            if ((step := self._steps[place]).path, step.sent) != (path, digest):
                raise DeviceRefused("E-OFF-DIVERGED", self._where, step=place + 1, was=step.path, now=path)
            return step
        number = _any_number()
        look = number if path == LOOK else _any_number()
        text = compose(number)
        steps.check_carried_program(path, text, self._asked_for.axes)
        kept = {str(name): value for name, value in (given or {}).items()}
        files = (*steps.first_lines_of(text), *also)
        step = CarriedStep(number, path, digest, files=files, look=look, given=kept, drawn=drawn)
        step.restart = restart or steps.needs_restart([*self._steps, step])
        self._steps.append(step)
        self._folder.keep(place + 1, step, text)
        self._folder.lay_out(carried_files(place + 1, step, text, steps.looking_program(step.look, self._asked_for)))
        return step

    async def rest(self, seconds: float) -> None:
        """A wait of the road: for the files of the step that is out, or for what they show.

        Raises ToCarry while a step is out and the work ends here, DeadlineExceeded (E-OFF-NOT-RUN) when nothing that
        was brought back can show what is waited for.
        """
        step = self._pending
        if step is None:
            self._quiet_s += seconds
            if self._quiet_s > QUIET_S:
                raise DeadlineExceeded("E-OFF-NOT-RUN", self._where, program=stick_name(self.image.program))
            await self._clock.sleep(seconds)
            return
        why = self._answer(step)
        if self._pending is None:
            return
        if at_work().ends:
            self.suspended = True
            raise ToCarry(self._folder.carry, self._folder.back, stick_name(step.path), self._folder.sheet, why=why)
        self._folder.complain(why)
        await self._clock.sleep(max(seconds, LOOK_S))

    def _answer(self, step: CarriedStep) -> str:
        """Take what was brought back for a step, if it is whole; else why not ("" for nothing at all)."""
        try:
            if not step.answered:
                begins, back = steps.first_lines_of(self._folder.program(self._at, step)), str(self._folder.back)
                taken = steps.find_answer(step, self._folder.brought(), self._asked_for, back, begins=begins)
                if taken is None:
                    return ""
                self._folder.keep(self._at, taken)
                self._steps[self._at - 1] = step = taken
            image = steps.seen_control(step, self._asked_for, self._where)
        except FileFormatError as error:
            return str(error)
        image.stop = 0 if image.report.stops else None
        self._files.update(step.answers)
        self._image, self._pending, self._quiet_s = image, None, 0.0
        return ""

    def conclude(self) -> None:
        """The work under way has ended. What is still queued goes along in the next program."""
        if not self._open:
            return  # this session has taken up nothing
        last = self._folder.newest()
        self._folder.conclude(self._with_queue(last) if last is not None and self._image is not None else last)
        self._steps, self._at, self._pending = [], 0, None

    def _with_queue(self, step: CarriedStep) -> CarriedStep:
        given = {str(number): value for number, value in self.image.queued.items()}
        return replace(step, given=given)

    @property
    def under_way(self) -> bool:
        """Whether a step of work is on the disk."""
        return bool(self._folder.steps())


def _any_number() -> int:
    """Six digits that name a step or a program: an older one is not taken for it."""
    return random_source.randbelow(899_999) + 100_000


# The controller.


class SinumerikOffline(SinumerikOpcUa):
    """Driver "sinumerik-offline": settings in `drivers.sinumerik.offline.settings.OfflineSettings`."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        own = OfflineSettings.read(settings, name)
        road = UaSettings.read(own.road, name)
        asked = ReportRequest(own.names, own.cross_tables, road.words, own.r_marker)
        self._stick = Path(own.folder)
        self._carried = CarriedSession(StepFolder(self._stick, name), asked, road, clock=clock, where=name)
        super().__init__(name, url, own.road, clock, session=self._carried)

    @property
    def stick(self) -> Path:
        """As of `drivers.offline_exchange.OfflineExchange`."""
        return self._stick

    def is_waited_for(self) -> bool:
        """Whether an earlier piece of work waits for its files here."""
        return self._carried.under_way

    def conclude(self) -> None:
        """The piece of work has come to its end. Raises ConfigError (E-OFF-FOLDER)."""
        self._carried.conclude()

    async def open(self, timeout_s: float) -> Identity:
        """Read who the machine is from what was brought back last. Raises ToCarry where it was never seen."""
        found = await super().open(timeout_s)
        return replace(found, driver="sinumerik-offline")

    @property
    def capabilities(self) -> Capabilities:
        """As by OPC UA; no test part is ground, and nobody on a network can change what passes.

        No reversal: the proof of its sign comes from both sides, with an instrument that is read as the axis stands.
        """
        return replace(super().capabilities, tables=HELD_KINDS, grinding=False, unprotected=None)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """The next program is run after the restart; where none proves what acts, one that only looks.

        Raises as `SinumerikOpcUa.restarted`, and ToCarry.
        """
        if not any(order.enable for order in passed):
            await self._carried.looked(f"restart {passed[0].transaction}", restart=True)
        await super().restarted(tuple(replace(order, enable=True) for order in passed), timeout_s)

    async def left_over(self) -> StaleProgram:
        """Nothing that could be told: what waits for its files is no work of nobody."""
        return NOTHING if self.is_waited_for() else await super().left_over()


# The doctor: it reads the folder alone.


class OfflineDoctor:
    """Settings as the controller's; it reads the folder alone."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        del url, clock
        own = OfflineSettings.read(settings, name)
        self._where = name
        self._folder = StepFolder(Path(own.folder), name)
        self._asked = ReportRequest(own.names, own.cross_tables, UaSettings.read(own.road, name).words, own.r_marker)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """The folder, and the last report against what the site expects. Never raises our errors."""
        del timeout_s
        try:
            self._folder.prepare()
            last = self._folder.newest()
            if last is None:
                return (unknown("W-OFF-UNSEEN", "road"),)
            image = steps.seen_control(last, self._asked, self._where)
        except TrueflankError as error:
            return (failed(error, "road"),)
        return (*identity_lines(image.machine, wanted), unknown("W-OFF-ROAD", "road"))
