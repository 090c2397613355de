"""Commands given to a desk: what each is, how it stands, and how it ended; the newest are kept."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import PurePath

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message
from gateway.events import DevicesOpened, PushPhaseChanged, RunStarted, TableStateChanged, received
from gateway.say import Say
from gateway.stopping import TERMINATED, StopAsked, Stopped
from gateway.views import JobView

RunStarter = Callable[[Say], Awaitable[object]]
MOST_KEPT = 50
MOST_STEPS = 200


@dataclass(slots=True)
class Job:
    """One command: its work, in whose name, its stop, and how it stands. ``begun`` gets its run id, "" for none.

    ``stop_at`` passes a stop on to where the work is really done: a command at a terminal.
    """

    work: RunStarter
    view: JobView
    stop: StopAsked
    begun: asyncio.Future[str] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    stop_at: Callable[[str], None] | None = None

    def ask_to_stop(self, by: str) -> bool:
        """Ask for its end in order; false where that was asked before."""
        if self.stop_at is None:
            return self.stop.ask(by, TERMINATED)
        self.stop_at(by)
        return True

    def begin(self, run_id: str) -> None:
        """It has a run folder, or will have none."""
        if run_id:
            self.view = replace(self.view, run_id=run_id)
        if not self.begun.done():
            self.begun.set_result(run_id)

    def refuse(self, error: TrueflankError) -> None:
        """It did not begin, or ended before it had a run folder."""
        if not self.begun.done():
            self.begun.set_exception(error)
            self.begun.exception()  # the caller may have gone away; then nobody asks for it

    def heard(self, code: str, fields: dict[str, object]) -> None:
        """One more word of it."""
        event = received(code, fields)
        if isinstance(event, RunStarted):
            self.begin(event.run_id)
        elif isinstance(event, DevicesOpened) and event.run and not self.view.run_id:
            self.begin(event.run)
        elif isinstance(event, PushPhaseChanged):
            step = (event.axis, str(event.step))
            self.view = replace(self.view, steps=(*self.view.steps, step)[-MOST_STEPS:])
        elif isinstance(event, TableStateChanged):
            self.view = replace(self.view, tables=tuple({**dict(self.view.tables), event.axis: event.state}.items()))
        self.view = replace(self.view, words=Message(code, fields))

    def done(self, outcome: object, clock: Clock) -> None:
        """It came to its end; what a workflow handed back is shown as a terminal would."""
        data: object = outcome.as_data() if hasattr(outcome, "as_data") else {}
        folder = PurePath(str(getattr(outcome, "run_folder", ""))).name
        self.view = replace(
            self.view,
            state="ended",
            ended_utc=_now(clock),
            lines=tuple(getattr(outcome, "lines", ())),
            exit_code=int(getattr(outcome, "exit_code", 0)),
            data=data if isinstance(data, dict) else {"items": data},
        )
        self.begin(folder)
        self.ended.set()

    def failed(self, error: TrueflankError, clock: Clock) -> None:
        """It ended by an error, or was stopped."""
        state = "stopped" if isinstance(error, Stopped) else "failed"
        record = error.as_record()
        self.view = replace(
            self.view, state=state, ended_utc=_now(clock), exit_code=error.exit_code, error=record, words=error.message
        )
        self.refuse(error)
        self.ended.set()


def _now(clock: Clock) -> str:
    return clock.utc().isoformat(timespec="seconds")


class Jobs:
    """The newest jobs of a desk by their numbers."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._kept: dict[int, Job] = {}
        self._count = 0

    def new(self, kind: str, work: RunStarter, who: str, within: StopAsked) -> Job:
        """A job that begins now."""
        self._count += 1
        view = JobView(self._count, kind=kind, who=who, state="running", run_id="", started_utc=_now(self._clock))
        job = Job(work, view, StopAsked(within))
        self._kept[self._count] = job
        while len(self._kept) > MOST_KEPT:
            del self._kept[min(self._kept)]
        return job

    def find(self, number: int) -> Job | None:
        """A job by its number."""
        return self._kept.get(number)

    @property
    def views(self) -> tuple[JobView, ...]:
        """Every kept job, the newest first."""
        return tuple(job.view for _number, job in sorted(self._kept.items(), reverse=True))
