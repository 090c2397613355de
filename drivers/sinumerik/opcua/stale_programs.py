"""Programs of ours whose gateway is gone or is about to leave: recognised by their number, asked to end.

A program leaves at its next check of the abort word, never in mid-motion and never by a reset from here. The R
parameters are given back once it has ended. A selected one is replaced by a program that ends at once, so that a later
NC START moves nothing.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TransportError, TrueflankError
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.ncprogram.words import MARKED, Phase, Word
from drivers.sinumerik.opcua.machine import MachineReader
from drivers.sinumerik.opcua.program_dialogue import ProgramDialogue, StatusSnapshot, Transfer
from drivers.sinumerik.opcua.session import nodes
from drivers.stale_programs import NOTHING, Kind, Sent, SentPrograms, StaleProgram
from drivers.types.machine import ChannelStatus

INERT_PROGRAM = "M30\n"
# How long a program that stands is watched before it is called standing: between two blocks it may seem to.
STANDS_S = 1.0


def find_stale_program(seen: StatusSnapshot, selected: str, known: Sequence[Sent]) -> tuple[StaleProgram, Sent | None]:
    """What of ours is in the control, and the program it belongs to; ``known`` are all ever sent, oldest first."""
    by_number = _newest(known, lambda sent: sent.number in _numbers(seen))
    by_name = _newest(known, lambda sent: sent.program == selected)
    if seen.channel is not ChannelStatus.RESET and by_name is not None:
        sent = by_number if by_number is not None and by_number.program == selected else by_name
        return _left(_kind(seen), sent, seen), sent
    if by_number is not None:
        begun = seen.word(Word.TRANSACTION) == by_number.number or by_number.program != selected
        return _left("words" if begun else "selected", by_number, seen), by_number
    return _not_begun(seen, selected, known)


def _not_begun(seen: StatusSnapshot, selected: str, known: Sequence[Sent]) -> tuple[StaleProgram, Sent | None]:
    """Words were cleared for a program that shows no number yet."""
    last = known[-1] if known and known[-1].open else None
    if last is None or seen.channel is not ChannelStatus.RESET:
        return NOTHING, None
    if selected == last.program:
        return _left("selected", last, seen), last
    ours = [word for word in Word if word not in (*MARKED, Word.ABORT)]
    differs = any(seen.words[word] != last.before[word] for word in (*ours, Word.ABORT))
    if differs and not any(seen.words[word] for word in ours):
        return _left("words", last, seen), last
    return NOTHING, None


def _numbers(seen: StatusSnapshot) -> set[float]:
    return {seen.word(Word.TRANSACTION), seen.word(Word.RELEASE)} - {0.0}


def _newest(known: Sequence[Sent], wanted: Callable[[Sent], bool]) -> Sent | None:
    return next((sent for sent in reversed(known) if wanted(sent)), None)


def _kind(seen: StatusSnapshot) -> Kind:
    if seen.channel is ChannelStatus.INTERRUPTED:
        return "stopped"
    if seen.phase == Phase.WAITING:  # between the halves of a push it stands until it is released
        return "moving" if seen.word(Word.RELEASE) else "waiting"
    if seen.phase == Phase.SAVED:  # after its back-up too
        return "moving" if seen.word(Word.RELEASE) == -seen.word(Word.TRANSACTION) else "waiting"
    counted = seen.word(Word.COUNTER) != seen.word(Word.ECHO)
    return "waiting" if seen.phase == Phase.MEASURING and counted else "moving"


def _left(kind: Kind, sent: Sent, seen: StatusSnapshot) -> StaleProgram:
    return StaleProgram(kind, sent.number, short_name(sent.program), seen.message)


def short_name(path: str) -> str:
    """A program as the control's screen shows it: TFMEAS_X1."""
    return path.rpartition("/")[2].removeprefix("_N_").removesuffix("_MPF")


class ProgramWithdrawal:
    """The part of the driver that ends what was sent; ``reopen`` makes a fresh session where the old one broke."""

    def __init__(
        self,
        dialogue: ProgramDialogue,
        reader: MachineReader,
        transfer: Transfer,
        channel: int,
        clock: Clock,
        where: str,
        reopen: Callable[[], Awaitable[Any]],
    ) -> None:
        self._dialogue = dialogue
        self._reader = reader
        self._transfer = transfer
        self._channel = channel
        self._clock = clock
        self._where = where
        self._reopen = reopen

    async def look(self) -> StaleProgram:
        """What of ours stands in the control and is nobody's work now; reads only. Raises what the wire raises."""
        left, _sent = await self._found()
        return left

    async def _found(self) -> tuple[StaleProgram, Sent | None]:
        book: SentPrograms | None = self._dialogue.book
        known = book.known() if book is not None and not book.at_work() else ()
        if not known:
            return NOTHING, None
        return find_stale_program(await self._dialogue.look(), await self._selected(), known)

    async def _selected(self) -> str:
        (name,) = await self._reader.values([nodes.in_channel("progName", self._channel, "ProgramInfo")])
        return str(name or "")

    async def withdraw(self, timeout_s: float) -> StaleProgram:
        """Ask what this session sent to end, give its words back, and say what is left. Never raises ours.

        A program that stands at M0 is not waited for: there a person must press.
        """
        sent = self._dialogue.sent
        return NOTHING if sent is None else await self._bounded(sent, timeout_s, for_person=False)

    async def clear(self, timeout_s: float) -> StaleProgram:
        """The same for what an earlier gateway left; ``timeout_s`` is the time for a person to press what was said.

        Raises what the wire raises while looking; nothing is written where nothing of ours is found.
        """
        left, sent = await self._found()
        if sent is None:
            return left
        self._dialogue.take_over(sent)
        return await self._bounded(sent, timeout_s, for_person=True)

    async def _bounded(self, sent: Sent, timeout_s: float, *, for_person: bool) -> StaleProgram:
        end = self._clock.now() + 0.8 * timeout_s
        try:
            async with self._clock.deadline(timeout_s, self._where):
                return await self._end(sent, end, for_person=for_person)
        except TrueflankError as error:
            return StaleProgram("unknown", sent.number, short_name(sent.program), why=f"{error.code}: {error.what}")

    async def _end(self, sent: Sent, end: float, *, for_person: bool) -> StaleProgram:
        await self._connected(end)
        await self._dialogue.write({Word.ABORT: 1.0, Word.RELEASE: 0.0})
        seen = await self._at_rest(end, for_person=for_person)
        if seen.channel is ChannelStatus.RESET and not await self._disarmed(sent):
            return _left("selected", sent, seen)
        if seen.channel is ChannelStatus.RESET:
            seen = await self._seen(end)
        if seen.channel is ChannelStatus.RESET and await self._dialogue.give_back():
            return _left("ended", sent, seen)
        return _left("asked" if seen.channel is ChannelStatus.INTERRUPTED else "finishing", sent, seen)

    async def _connected(self, end: float) -> None:
        """What became of the last request of a broken session is unknown: only a fresh one can tell.

        While the NCK restarts nothing can be read or written.
        """
        while not await self._answers(end) and self._clock.now() < end:
            await self._dialogue.wait()

    async def _answers(self, end: float) -> bool:
        try:
            return await self._dialogue.look_through_restart() is not None
        except TransportError:
            pass
        try:
            await self._reopen()
        except TransportError as error:
            if not error.retryable or self._clock.now() >= end:
                raise
        return False

    async def _at_rest(self, end: float, *, for_person: bool) -> StatusSnapshot:
        """The channel in reset, or standing where only a person goes on, or whatever it does at ``end``."""
        stands_since: float | None = None
        self._dialogue.pace.again()
        while True:
            seen, now = await self._seen(end), self._clock.now()
            stands = seen.channel is ChannelStatus.INTERRUPTED and not for_person
            stands_since = (now if stands_since is None else stands_since) if stands else None
            stood = stands_since is not None and now - stands_since >= STANDS_S
            if seen.channel is ChannelStatus.RESET or stood or now >= end:
                return seen
            await self._dialogue.wait()

    async def _seen(self, end: float) -> StatusSnapshot:
        """One look, as soon as the NCK answers; raises what looking raises at ``end``."""
        while self._clock.now() < end:
            seen = await self._dialogue.look_through_restart()
            if seen is not None:
                return seen
            await self._dialogue.wait()
        return await self._dialogue.look()

    async def _disarmed(self, sent: Sent) -> bool:
        """A selected program of ours ends at once from now on; false when the control refused that."""
        if await self._selected() != sent.program:
            return True
        try:
            await self._transfer.send(check_program(sent.program, INERT_PROGRAM, ()))
        except DeviceRefused:
            return False
        return True


class CleanupMixin:
    """What a controller device says of `drivers.stale_programs.LeavesPrograms`, by its parts."""

    _dialogue: ProgramDialogue
    _leaving: ProgramWithdrawal

    @property
    def book(self) -> SentPrograms | None:
        """Where sent programs are kept; without one nothing is recognised later."""
        return self._dialogue.book

    @book.setter
    def book(self, book: SentPrograms | None) -> None:
        self._dialogue.book = book

    async def left_over(self) -> StaleProgram:
        """What of ours stands in the control and is nobody's work now. Raises as `Leaving.look`."""
        return await self._leaving.look()

    async def withdraw(self, timeout_s: float) -> StaleProgram:
        """Ask what was sent to end, give back its words, say what is left; in a fresh session if need be."""
        return await self._leaving.withdraw(timeout_s)

    async def clear_left_over(self, timeout_s: float) -> StaleProgram:
        """The same for what an earlier gateway left. Raises as `Leaving.clear`."""
        return await self._leaving.clear(timeout_s)
