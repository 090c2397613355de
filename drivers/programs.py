"""NC programs as they cross the port: in whose name they are sent, their text, and what a control is without one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

from drivers.types.identity import MachineIdentity
from drivers.types.moves import Movement, SafePlaces
from drivers.types.orders import DisableOrder, PushBatch, TableQuestion
from drivers.types.stops import StopPlan
from drivers.workpiece import GrindPlan


@dataclass(frozen=True, slots=True)
class Origin:
    """Whose programs these are, for the head of each: site, serial number of the machine, our version.

    No run: what is sent has the very bytes that were printed and signed before it.
    """

    site: str = ""
    machine: str = ""
    version: str = ""


NOBODY = Origin()


@dataclass(frozen=True, slots=True)
class ProgramText:
    """A program: its path in the control (/_N_MPF_DIR/_N_TFMEAS_X1_MPF) and its blocks."""

    path: str
    text: str

    @property
    def file_name(self) -> str:
        """What the file is called outside a control: TFMEAS_X1.MPF."""
        name, _, ending = self.path.rpartition("/")[2].removeprefix("_N_").rpartition("_")
        return f"{name}.{ending}"


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Try every word that our programs need, for one compensated axis and its measuring system; nothing moves."""

    axis: str
    encoder: int = 0
    encoder_said: bool = True


@dataclass(frozen=True, slots=True)
class SelfTested:
    """How a self-test ended, word by word: for one axis and measuring system of the very machine that it names.

    ``utc`` is this PC's time, ``control_date`` the day that the control wrote into its report ("": none). ``stopped``
    says why the program did not come to its end ("": it did); ``failed`` then names its trial. ``without`` are words
    that the control does not take and that our programs do without: they are longer there. ``own_points``,
    ``cross_points`` and ``file_kb`` are what the control had reserved (None: not kept): with them programs are written
    again without it.
    """

    machine: MachineIdentity
    axis: str
    encoder: int
    utc: str
    control_date: str
    passed: tuple[str, ...]
    failed: tuple[str, ...]
    stopped: str = ""
    without: tuple[str, ...] = ()
    own_points: int | None = None
    cross_points: tuple[int, ...] = ()
    file_kb: int = 0

    @property
    def ok(self) -> bool:
        """Whether every word passed and the program came to its end."""
        return bool(self.passed) and not self.failed and not self.stopped

    @property
    def missed(self) -> str:
        """What was not passed, in words; "" where all was."""
        return "; ".join(one for one in (", ".join(self.failed), self.stopped) if one)


@dataclass(frozen=True, slots=True)
class DwellPlan:
    """Stops for a capture program that triggers by itself: the axis stands ``dwell_s`` at each; nobody shakes hands."""

    stops: StopPlan
    dwell_s: float


@dataclass(frozen=True, slots=True)
class Visits:
    """Stop plans that are foreseen to follow one another: they go into one program, as far as one holds them."""

    plans: tuple[StopPlan, ...]


Order = Visits | StopPlan | TableQuestion | PushBatch | DisableOrder | GrindPlan | SelfTest | DwellPlan
"""What a program is written for."""


def reading_plan(question: TableQuestion) -> StopPlan:
    """What saves the tables of a question: no stop, so that no axis moves; feed, overrun and dwell are never used."""
    return StopPlan(
        name=f"TFREAD{question.letter}",
        axis=question.axis,
        letter=question.letter,
        unit=question.unit,
        rotary=question.rotary,
        stops=(),
        feed=1.0,
        overrun=0.0,
        dwell_s=1.0,
        encoder=question.encoder,
    )


@dataclass(frozen=True, slots=True)
class DayNumbers:
    """What a program gets only when it is sent; on paper these stand for it.

    ``order`` numbers the work, ``step`` what is carried there by hand; ``head`` are 64 bits of the audit log that go
    into the control's marker, ``head_after`` those of its end; ``commands`` are those of a PLC mailbox, in their order
    (0 for one that is not named).
    """

    order: int = 999_999
    step: int = 999_999
    head: int = 0
    head_after: int = 0
    commands: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class PaperMachine:
    """What a program must know of a control, where there is none to ask.

    ``axes``: machine axis names; ``modulo``: those that turn endlessly; ``own_points``: points that axis tables have
    reserved, by axis; ``cross_points``: those of cross tables, by number; ``places``: where axes may stand;
    ``without``: words that the control does not take, ``file_kb`` how large a file may become (`SelfTested`);
    ``numbers``: what stands for those that a program gets when it is sent; ``seen``: the control, or who wrote the site
    file, said that these are its axes, all of them in their order.
    """

    axes: tuple[str, ...]
    modulo: frozenset[str] = frozenset()
    own_points: Mapping[str, int] = field(default_factory=dict)
    cross_points: tuple[int, ...] = ()
    places: SafePlaces = field(default_factory=SafePlaces)
    without: tuple[str, ...] = ()
    file_kb: int = 0
    numbers: DayNumbers = field(default_factory=DayNumbers)
    seen: bool = True

    @property
    def number(self) -> int:
        """That of the work."""
        return self.numbers.order


@runtime_checkable
class SendsPrograms(Protocol):
    """A controller that sends programs: in somebody's name, and each is kept before it is sent."""

    def attend(self, origin: Origin, keep: Callable[[ProgramText], None]) -> None:
        """From now on programs carry ``origin`` in their head; ``keep`` is called with each before it is sent."""
        ...


@runtime_checkable
class SelfTests(Protocol):
    """A controller that tries the words of its programs before any of them matters (`Capabilities.self_test`)."""

    async def prepare_self_test(self, order: SelfTest) -> None:
        """Send, read back and select the program; it moves nothing. The person at the machine starts it.

        Raises DeviceRefused (not in reset, a program the control's rules do not allow) with nothing started.
        """
        ...

    async def wait_self_test(self, order: SelfTest, timeout_s: float) -> SelfTested:
        """Wait for its end and read its report; what stopped it is a result, not an error.

        Raises DeadlineExceeded (nobody started it), and what the wire raises.
        """
        ...


@runtime_checkable
class WritesWithout(Protocol):
    """A controller whose programs can do without some words of its language."""

    def do_without(self, words: Collection[str]) -> None:
        """From now on programs are written without these, as a self-test of this control found (`SelfTested`)."""
        ...


@runtime_checkable
class ForeseesPlans(Protocol):
    """A controller that puts stop plans which follow one another into one program, so that one press starts them."""

    @property
    def goes_on(self) -> bool:
        """Whether the plan prepared last goes on in the program that runs already: nobody needs to start it."""
        ...

    async def foresee(self, plans: Sequence[StopPlan]) -> None:
        """These plans will be prepared, in this order, as far as nothing comes between; none: nothing follows.

        A program that waits for its next plan is asked to end by any other plan, order or program, and by this call
        unless it waits for the first of these.
        """
        ...


@runtime_checkable
class SaysMotion(Protocol):
    """A controller that says what moves before the person at the machine acts, and guards axes by their places."""

    @property
    def places(self) -> SafePlaces:
        """Safe places and feeds that it was told; none at first."""
        ...

    def keep_to(self, places: SafePlaces) -> None:
        """From now on a program ends before its first move when a guarded axis has left its place."""
        ...

    async def motion(self) -> Movement:
        """What the selected program will move, and where all axes stand, read afresh. Raises as `Controller.state`."""
        ...


Moment = Literal["restart", "clamp", "unclamp", "self-test"]
"""When a program waits for a person: for a restart, a blank, the part, the self-test's start."""


@runtime_checkable
class ShowsMessages(Protocol):
    """A controller whose programs show a person what they wait for."""

    def message(self, moment: Moment) -> str:
        """What the control shows then, read from the program that was sent last; "" where that does not wait so."""
        ...
