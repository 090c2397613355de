"""Transfer of programs and files, and the dialogue with a running program through R parameters.

A program and the gateway share a block of R parameters (`drivers.sinumerik.ncprogram.unpack_text`). The old values
are kept at the first write and given back at the end. The gateway polls status, alarms and words in one request (a
`StatusSnapshot`), echoes the count of a stop, sets the release word, or sets the abort word, which the program obeys at
its next check. Files go by the server's methods, else by file nodes. Only a `LegalProgram` is sent.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from drivers.clock import Clock
from drivers.errors import DeviceRefused, LocalProtocolError, TransportError, TrueflankError, UnsupportedDevice
from drivers.programs import ProgramText
from drivers.sinumerik.ncprogram.checks import LegalProgram
from drivers.sinumerik.ncprogram.words import COUNT, MARKED, Phase, Word
from drivers.sinumerik.opcua.machine import ALARM_PLACES, MachineReader, channel_status
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import FileNodes, UaSession
from drivers.sinumerik.opcua.session.status import is_not_yet
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.stale_programs import Sent, SentPrograms
from drivers.types.machine import ChannelStatus

# Transfer.

COPIED = 16 * 1024 * 1024  # what the copying methods take (manual of 05/2022)
LARGEST = 64 * 1024 * 1024
_SELECTED = 0
_SELECT = {1: "E-NC-CHANNEL", 2: "E-NC-NO-PROGRAM", 3: "E-NC-NOT-RESET"}
# By these the server says that it will not copy, and has not; the file's own node may still serve.
_NOT_COPIED = frozenset({"BadNotSupported", "BadRequestNotAllowed", "BadOutOfRange", "BadRequestTooLarge"})
_NOT_GIVEN = _NOT_COPIED | {"BadResponseTooLarge", "BadEncodingLimitsExceeded"}


class Transfer:
    """Moves text files; ``timeout_s`` bounds each call. ``keep`` is called with each program before it is sent.

    ``text`` is the last one.
    """

    def __init__(self, session: UaSession, channel: int, where: str, timeout_s: float = 5.0) -> None:
        self._session = session
        self._files = FileNodes(session, where)
        self._channel = channel
        self._where = where
        self.timeout_s = timeout_s
        self.text = ""
        self.keep: Callable[[ProgramText], None] = _nowhere

    async def send(self, passed: LegalProgram) -> None:
        """Write a program and read it back. Raises DeviceRefused (E-NC-PROGRAM-CHANGED) when it differs."""
        path, text = passed.program.path, passed.program.text
        content = text.encode("ascii")
        if len(content) > LARGEST:
            raise LocalProtocolError("E-PROGRAM-SIZE", self._where, size=len(content), limit=LARGEST)
        self.keep(passed.program)
        self.text = text
        await self._put(_server_path(path), content)
        if _lines(await self.fetch(path)) != _lines(text):
            raise DeviceRefused("E-NC-PROGRAM-CHANGED", self._where, path=path)

    async def _put(self, path: str, content: bytes) -> None:
        refused: DeviceRefused | None = None
        if "CopyFileToServer" in self._session.methods and len(content) <= COPIED:
            arguments = [(path, "String"), (content, "ByteString"), (True, "Boolean")]
            try:
                await self._session.call("CopyFileToServer", arguments, self.timeout_s)
            except DeviceRefused as error:
                if error.fields.get("status") not in _NOT_COPIED:
                    raise
                refused = error
            else:
                return
        try:
            await self._files.write(path, content, self.timeout_s)
        except UnsupportedDevice as error:
            raise (refused or error) from error

    async def fetch(self, path: str) -> str:
        """A file's text. Raises DeviceRefused (E-UA-FILE, E-UA-BUSY, E-UA-RIGHTS), RemoteProtocolError (E-UA-VALUE)."""
        content = nodes.check_content(await self._get(_server_path(path)), path, self._where)
        return content.decode("latin-1")

    async def found(self, path: str) -> str | None:
        """A file's text, None where there is no such file."""
        try:
            return await self.fetch(path)
        except DeviceRefused as error:
            if error.code != "E-UA-FILE":
                raise
            return None

    async def _get(self, path: str) -> object:
        refused: DeviceRefused | None = None
        if "CopyFileFromServer" in self._session.methods:
            try:
                return await self._session.call("CopyFileFromServer", [(path, "String")], self.timeout_s)
            except DeviceRefused as error:
                if error.fields.get("status") not in _NOT_GIVEN:
                    raise
                refused = error
        try:
            return await self._files.read(path, self.timeout_s)
        except UnsupportedDevice as error:
            raise (refused or error) from error

    async def select(self, path: str) -> None:
        """Select a program for NC START. Raises DeviceRefused (E-NC-CHANNEL, E-NC-NO-PROGRAM, E-NC-NOT-RESET...)."""
        arguments = [(_server_path(path), "String"), (self._channel, "Int32")]
        answer = await self._session.call("Select", arguments, self.timeout_s)
        code = nodes.check_whole(answer, f"Select {path}", self._where)
        if code != _SELECTED:
            refused = _SELECT.get(code, "E-NC-SELECT")
            raise DeviceRefused(refused, self._where, path=path, answer=code, channel=self._channel, status="busy")


def _nowhere(_program: ProgramText) -> None:
    """Nobody keeps what is sent."""


def _server_path(path: str) -> str:
    found = nodes.to_file(path)
    if found is None:
        raise LocalProtocolError("E-PROGRAM-NAME", path, name=path)
    return found


def _lines(text: str) -> list[str]:
    """The blocks of a program without what transfers may change: line ends and blank lines at the end."""
    return [line.rstrip() for line in text.rstrip().splitlines()]


# Dialogue.

# Alarms that report and let the program run on: rights for machine data, memory display, CEC limits.
HARMLESS = frozenset({4070, 4075, 4400, 20124, 20125})
GROWTH = 1.3
LEAVES_S = 1.0  # a program that waits looks at the abort word four times a second
_WRITE_ANSWERS = {10: "E-NC-FILE-FULL", 12: "E-NC-FILE-MEMORY"}


@dataclass(frozen=True, slots=True)
class StatusSnapshot:
    """Everything a waiting gateway needs, from one request. ``words`` are the R parameters of the site."""

    channel: ChannelStatus
    message: str
    words: tuple[float, ...]
    alarms: tuple[int, ...]
    in_position: bool
    referenced: bool

    def word(self, word: Word) -> float:
        """One R parameter."""
        return self.words[word]

    @property
    def phase(self) -> int:
        """How far the program is."""
        return round(self.words[Word.PHASE])


class PollInterval:
    """How long to wait between two looks: short after something happened, longer while nothing does."""

    def __init__(self, fast_s: float, slow_s: float) -> None:
        self._fast_s = fast_s
        self._slow_s = slow_s
        self._next_s = fast_s
        self._quiet_s = 0.0

    def again(self, quiet_s: float = 0.0) -> None:
        """Something happened; nothing more is expected for ``quiet_s``."""
        self._next_s, self._quiet_s = self._fast_s, quiet_s

    def step(self) -> float:
        """Seconds until the next look."""
        if self._quiet_s > self._next_s:
            quiet, self._quiet_s = self._quiet_s, 0.0
            return quiet
        now, self._next_s = self._next_s, min(self._next_s * GROWTH, self._slow_s)
        return now


class ProgramDialogue:
    """R words of one site. Their old values are kept at the first write and given back at the end."""

    def __init__(
        self, session: UaSession, reader: MachineReader, settings: UaSettings, clock: Clock, where: str
    ) -> None:
        self._session = session
        self._reader = reader
        self._settings = settings
        self._clock = clock
        self._where = where
        self._axes: tuple[int, ...] = (1,)
        self._before: frozenset[int] = frozenset()
        self._original: tuple[float, ...] | None = None
        self._others: dict[int, float] = {}
        self._mine: set[float] = set()
        self.newest = 0  # number of the program whose words were cleared last
        self.book: SentPrograms | None = None
        self.sent: Sent | None = None
        self.names: tuple[str, ...] = ()
        self.reopen: Callable[[], Awaitable[None]] | None = None
        self.pace = PollInterval(settings.fast_poll_s, settings.poll_s)

    async def begin(self, axis_number: int, number: int, program: str, others: tuple[int, ...] = ()) -> None:
        """Clear all words for a new program, noted by its number first; remember the alarms that were there before it.

        ``others`` are axes that it moves too: a glance calls the axis referenced when all are. Raises DeviceRefused
        (E-NC-NOT-RESET) when the channel is not in reset, and what the book raises; nothing is written then.
        """
        self._axes = (axis_number, *others)
        seen = await self.look()
        if seen.channel is not ChannelStatus.RESET:
            raise DeviceRefused("E-NC-NOT-RESET", self._where, status=seen.channel.name)
        self._before = frozenset(seen.alarms)
        self._note(
            Sent(
                number=number,
                program=program,
                first=self._settings.r_first,
                before=self._kept(seen.words),
                others=dict(self._others),
            )
        )
        self.newest = 0
        await self.write({word: 0.0 for word in Word if word not in MARKED})
        self.newest = number
        self._mine.add(float(number))
        self.pace.again()

    def watch(self, axis_number: int) -> None:
        """The program goes on with another axis."""
        self._axes = (axis_number,)

    def another(self, seen: StatusSnapshot) -> bool:
        """Whether a program that is not of this conversation stands in the words; never before our own first one."""
        return bool(self._mine) and seen.word(Word.TRANSACTION) not in (0.0, *self._mine)

    async def check_own(self) -> None:
        """Raise DeviceRefused (E-NC-ANOTHER) when the words are another gateway's: then nothing may be written."""
        seen = await self.look()
        if self.another(seen):
            raise DeviceRefused("E-NC-ANOTHER", self._where, number=round(seen.word(Word.TRANSACTION)))

    def _note(self, sent: Sent) -> None:
        if self.book is not None:
            self.book.note(sent)
        self.sent = sent

    def _kept(self, words: tuple[float, ...]) -> tuple[float, ...]:
        """What the words were before this session; what an earlier gateway left there of its own does not count."""
        if self._original is None:
            numbers = (words[Word.TRANSACTION], words[Word.RELEASE])
            known = self.book.known() if self.book is not None else ()
            left = next((one for one in reversed(known) if one.open and one.number in numbers), None)
            self._original = words if left is None else left.before
            self._others = {} if left is None else dict(left.others)
        return self._original

    def follow(self, program: str) -> None:
        """The conversation goes on with another program under the same number."""
        if self.sent is not None:
            self._note(replace(self.sent, program=program))

    def take_over(self, sent: Sent) -> None:
        """What an earlier gateway sent is ours to end; what stood in the words before it is what is given back."""
        self._note(sent)
        self._mine.add(float(sent.number))
        self._original, self._others = sent.before, dict(sent.others)

    async def look(self) -> StatusSnapshot:
        """One look. Raises TransportError (E-UA-NCK-DOWN) while the NCK restarts, and what the session raises."""
        settings = self._settings
        channel = settings.channel
        paths = [
            nodes.in_channel("chanStatus", channel),
            nodes.r_block(settings.r_first, COUNT, channel),
            nodes.in_channel("msg", channel, "ProgramInfo"),
            nodes.of_axis("aaStat", self._axes[0], channel),
            nodes.ALARM_COUNT,
            *(nodes.of_axis("aaRef", number, channel) for number in self._axes),
        ]
        status, words, message, exact_stop, alarms, *referenced = await self._reader.values(paths)
        return StatusSnapshot(
            channel=channel_status(status, self._where),
            message=message,
            words=tuple(words),
            alarms=await self._alarm_numbers(alarms) if alarms else (),
            in_position=exact_stop == 4,
            referenced=all(referenced),
        )

    async def look_through_restart(self) -> StatusSnapshot | None:
        """One look; None while the NCK restarts: any status but a missing right, an absent node and a lost session."""
        try:
            return await self.look()
        except TrueflankError as error:
            if not is_not_yet(error) or not self._session.is_open:
                raise
            return None

    async def look_after_activation(self) -> StatusSnapshot | None:
        """As `look_through_restart`; a session that the restart ended is opened again, until the server lets us in.

        Raises the server's refusal of rights or of an absent node, and what `reopen` raises for another machine.
        """
        try:
            return await self.look()
        except TrueflankError as error:
            if not self._passes(error):
                raise
        try:
            if not self._session.is_open and self.reopen is not None:
                await self.reopen()
        except TrueflankError as error:
            if not self._passes(error):
                raise
        return None

    def _passes(self, error: TrueflankError) -> bool:
        lost = isinstance(error, TransportError) and not self._session.is_open
        return is_not_yet(error) or (lost and self.reopen is not None)

    async def _alarm_numbers(self, count: int) -> tuple[int, ...]:
        places = range(1, min(count, ALARM_PLACES) + 1)
        found = await self._reader.values([nodes.alarm_number(place) for place in places])
        return tuple(number for number in found if number)

    async def wait(self, longest_s: float | None = None) -> None:
        """Let time pass until the next look, ``longest_s`` at most."""
        pause = self.pace.step()
        await self._session.rest(pause if longest_s is None else min(pause, longest_s))

    def fresh_number(self) -> int:
        """As `UaSession.fresh_number`."""
        return self._session.fresh_number()

    def fresh_alarms(self, seen: StatusSnapshot) -> frozenset[int]:
        """Alarms that came up since `begin`, those that stop no program among them."""
        return frozenset(seen.alarms) - self._before

    async def check_alarms(self, seen: StatusSnapshot) -> None:
        """Raise DeviceRefused (E-NC-ALARM) for an alarm that came up since `begin` and stops programs."""
        new = [number for number in seen.alarms if number in self.fresh_alarms(seen) - HARMLESS]
        if new:
            try:
                text = await self._reader.alarm_texts(len(seen.alarms))
            except TrueflankError:
                text = ""
            raise DeviceRefused("E-NC-ALARM", self._where, number=new[0], text=text or "no text", phase=seen.phase)

    def check_places(self, seen: StatusSnapshot) -> None:
        """Raise DeviceRefused (E-NC-AWAY) when a program ended because an axis had left its safe place."""
        if seen.phase == Phase.AWAY:
            raise DeviceRefused("E-NC-AWAY", self._where, axis=self._name(round(seen.word(Word.MISMATCHES))))

    def _name(self, number: int) -> str:
        return self.names[number - 1] if 0 < number <= len(self.names) else f"number {number}"

    async def write(self, words: dict[Word, float]) -> None:
        """Write words, typed, by one request, never retried; their old values are kept first."""
        if self._original is None:
            self._kept((await self.look()).words)
        await self._session.write(
            [(self._path(word), float(value)) for word, value in words.items()], self._reader.timeout_s
        )

    async def place(self, values: Mapping[int, float]) -> None:
        """Write other R parameters by number and read them back, never retried; given back as the words are.

        Raises DeviceRefused (E-GRIND-NOT-HELD) for one that is not held as written.
        """
        before = await self.numbered(values)
        self._others = {**before, **self._others}
        if self.sent is not None:
            self._note(replace(self.sent, others=dict(self._others)))
        await self._session.write(
            [(nodes.r_parameter(number, self._settings.channel), value) for number, value in values.items()],
            self._reader.timeout_s,
        )
        for number, held in (await self.numbered(values)).items():
            if held != values[number]:
                raise DeviceRefused("E-GRIND-NOT-HELD", self._where, number=number, value=values[number], held=held)

    async def numbered(self, numbers: Iterable[int]) -> dict[int, float]:
        """R parameters by number."""
        wanted = tuple(numbers)
        found = await self._reader.values([nodes.r_parameter(number, self._settings.channel) for number in wanted])
        return dict(zip(wanted, found, strict=True))

    def _path(self, word: Word) -> str:
        return nodes.r_parameter(self._settings.words.number(word), self._settings.channel)

    async def give_back(self) -> bool:
        """Restore the R parameters if no program of ours needs them any more; false when one still does.

        A program that waits is asked to leave first: given-back words must not look like an answer to it. The
        marker of a push stays as it is: it is there for whoever comes next. Words that another gateway uses by now
        are left alone.
        """
        if self._original is None:
            return True
        seen = await self.look()
        if self.another(seen):
            return False
        if not _is_ended(seen) and self.sent is not None:
            await self.write({Word.ABORT: 1.0})
            seen = await self._after_abort(seen)
        if not _is_ended(seen):
            return False
        first = self._settings.r_first
        old = {first + place: value for place, value in enumerate(self._original) if place not in MARKED}
        old |= self._others
        channel = self._settings.channel
        await self._session.write(
            [(nodes.r_parameter(number, channel), value) for number, value in old.items()], self._reader.timeout_s
        )
        self._original, self._others, self.sent = None, {}, None
        if self.book is not None:
            self.book.given_back()
        return True

    async def _after_abort(self, seen: StatusSnapshot) -> StatusSnapshot:
        """Look until the program has left: it takes until it looks at the abort word itself."""
        self.pace.again()
        end = self._clock.now() + LEAVES_S
        while not _is_ended(seen) and self._clock.now() < end:
            await self.wait()
            seen = await self.look()
        return seen


def _is_ended(seen: StatusSnapshot) -> bool:
    return seen.channel is ChannelStatus.RESET or seen.phase == Phase.ENABLED


def file_error(seen: StatusSnapshot, where: str, axis: str) -> DeviceRefused:
    """Why a program could not write its file, by what WRITE answered it."""
    answer = round(seen.word(Word.MISMATCHES))
    return DeviceRefused(_WRITE_ANSWERS.get(answer, "E-NC-FILE"), where, axis=axis, answer=answer)
