"""What of ours stands in a control: the programs sent there, and what a look or a stop found of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

from drivers.errors import TrueflankError

Kind = Literal[
    "nothing",
    "ended",
    "waiting",
    "stopped",
    "moving",
    "selected",
    "words",
    "asked",
    "finishing",
    "unknown",
    "closed",
    "session",
]

# The catalogue entry of each kind: "waiting" to "words" were found, "asked" and "finishing" have been asked to end.
CODES: dict[Kind, str] = {
    "nothing": "W-LEFT-NOTHING",
    "ended": "W-LEFT-ENDED",
    "waiting": "W-LEFT-WAITING",
    "stopped": "W-LEFT-STOPPED",
    "moving": "W-LEFT-MOVING",
    "selected": "W-LEFT-SELECTED",
    "words": "W-LEFT-WORDS",
    "asked": "W-LEFT-ASKED",
    "finishing": "W-LEFT-FINISHING",
    "unknown": "W-LEFT-UNKNOWN",
    "closed": "W-LEFT-CLOSED",
    "session": "W-LEFT-SESSION",
}


@dataclass(frozen=True, slots=True)
class Sent:
    """A program of ours in a control: its number and name there, and what stood in the R parameters before.

    ``before`` are the values from R parameter ``first`` on, ``others`` those of further ones by number. ``open``:
    nobody has given them back since.
    """

    number: int
    program: str
    first: int
    before: tuple[float, ...]
    others: dict[int, float] = field(default_factory=dict)
    open: bool = True


@dataclass(frozen=True, slots=True)
class StaleProgram:
    """What of ours is in the control, by its number.

    ``kind``: "waiting" in its hand-shake, "stopped" at M0 or NC STOP, "moving", "selected" and not begun, "words" only;
    after it was asked to end: "ended", "asked" (a person must press), "finishing" (it still moves); "unknown" where
    the control could not be asked; on the road with a mailbox "closed", and "session" where that could not be ended.
    ``message`` is the MSG that the control shows, ``why`` what hindered asking.
    """

    kind: Kind
    number: int = 0
    program: str = ""
    message: str = ""
    why: str = ""

    @property
    def clear(self) -> bool:
        """Whether nothing of ours is left."""
        return self.kind in ("nothing", "ended", "closed")

    @property
    def code(self) -> str:
        """Its catalogue entry."""
        return CODES[self.kind]

    @property
    def facts(self) -> dict[str, object]:
        """Its fields for the catalogue and for records."""
        shown = self.message or "nothing"
        return {"number": self.number, "program": self.program, "message": shown, "why": self.why}

    @property
    def said(self) -> TrueflankError:
        """The finding with words: what is left, and what to press."""
        said = TrueflankError(self.code, "controller")
        said.fields = self.facts
        return said

    @property
    def words(self) -> str:
        """Code, what is left and what to press, in one line."""
        return f"{self.code}: {self.sentence}"

    @property
    def sentence(self) -> str:
        """What is left and what to press, as part of another message, which has a code of its own."""
        return self.said.what + (f"; {self.said.hint}" if self.said.hint else "")

    def as_data(self) -> dict[str, object]:
        """The finding as JSON data."""
        told = {key: str(value) for key, value in self.facts.items() if key != "number"}
        said = {"what": self.said.what, "do": self.said.hint}
        return {"kind": self.kind, "code": self.code, "number": self.number, **told, **said}


NOTHING = StaleProgram("nothing")


class SentPrograms(Protocol):
    """Where it is kept, durable, which programs were sent to one control, and what stood there before."""

    def note(self, sent: Sent) -> None:
        """Keep a program before it is sent; from now on it is at work. Raises our errors when it cannot be kept."""
        ...

    def given_back(self) -> None:
        """What this gateway noted has ended, and its words are as they were before."""
        ...

    def known(self) -> tuple[Sent, ...]:
        """Every program ever noted, oldest first."""
        ...

    def at_work(self) -> bool:
        """Whether a living gateway, this one included, holds programs in the control now."""
        ...

    def close(self) -> None:
        """What is still noted as open is nobody's work from now on; never raises."""
        ...


@runtime_checkable
class LeavesPrograms(Protocol):
    """A controller in which something of ours may be left when a gateway stops or dies."""

    book: SentPrograms | None

    async def left_over(self) -> StaleProgram:
        """What of ours stands there and is nobody's work now; reads only. Raises what the wire raises."""
        ...

    async def withdraw(self, timeout_s: float) -> StaleProgram:
        """Ask what this gateway sent to end, give back its words, say what is left; never raises our errors.

        A program that moves or grinds goes on to its own next wait; one at M0 is left to a person.
        """
        ...

    async def clear_left_over(self, timeout_s: float) -> StaleProgram:
        """The same for what an earlier gateway left; waits ``timeout_s`` for a person. Raises what looking raises."""
        ...
