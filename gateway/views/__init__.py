"""Read-only pictures of the gateway for people: what the web page and the command line show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Protocol

from drivers.errors import TrueflankError
from drivers.message import Message, told, words
from drivers.registry import known
from drivers.types.machine import MachineState
from gateway.domain.outcomes import ActingCheck, Verdict
from gateway.report.parameters import ParameterRow, parameter_rows
from gateway.report.sentences import number, percent
from gateway.tooth import AxisOutlook

AT_WORK = ("begun", "writing", "written", "on")
"""What is true of a table while its push works on it (`gateway.push.phases.TableNow`)."""
ANSWERS = {True: "as predicted", False: words("W-VIEW-NOT-PREDICTED"), None: words("W-VIEW-CANNOT-TELL")}


class SeenDevice(Protocol):
    """What a supervisor tells of one device (`gateway.supervisor.DevicePicture` is one)."""

    @property
    def name(self) -> str: ...
    @property
    def driver(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def since_utc(self) -> str: ...
    @property
    def error(self) -> TrueflankError | None: ...


class SeenRun(Protocol):
    """What a store tells of one run (`gateway.store.RunSummary` is one)."""

    @property
    def run_id(self) -> str: ...
    @property
    def created_utc(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def problem(self) -> str: ...


@dataclass(frozen=True, slots=True)
class DeviceView:
    """One device: ``state`` is open, lost, failed, closed or in use (by the run at work).

    ``sees_beam`` is false for an instrument that cannot tell a broken beam.
    """

    name: str
    driver: str
    state: str
    since_utc: str
    error: Mapping[str, object] | None = None
    sees_beam: bool = True


@dataclass(frozen=True, slots=True)
class ControlView:
    """The control at the last look: ``channel`` is reset, active or interrupted; the rest as the control has it."""

    channel: str
    mode: str
    alarms: tuple[int, ...]
    message: str


@dataclass(frozen=True, slots=True)
class RunView:
    """The run at work: ``stage`` is the measuring program or step, ``done`` of ``total`` its stops.

    ``ask`` is what a person must do now, as code, fields and words, and ``moves`` what will move then, each as such;
    ``steps`` are axis and kind of each step of a push, ``tables`` each table with its state by now. ``left_s`` is about
    the time to go of the whole command as it was when this picture was made, ``program_left_s`` that of the program at
    work; None while nothing tells it.
    """

    run_id: str
    stage: str
    axis: str
    done: int
    total: int
    words: Message | None
    started_utc: str
    kind: str = "run"
    who: str = ""
    ask: Mapping[str, object] | None = None
    steps: tuple[tuple[str, str], ...] = ()
    tables: tuple[tuple[str, str], ...] = ()
    moves: tuple[Mapping[str, object], ...] = ()
    left_s: float | None = None
    program_left_s: float | None = None

    @property
    def progress(self) -> float | None:
        """Part of the stage that is done, 0 to 1; None while it cannot be told."""
        return min(self.done / self.total, 1.0) if self.total > 0 else None


@dataclass(frozen=True, slots=True)
class JobView:
    """One command as the daemon knows it: ``state`` is running, ended, failed or stopped.

    ``lines`` are what a terminal would show at its end, ``data`` the same as data, ``exit_code`` that of a terminal.
    ``steps`` are those of a push so far, axis and step of its journal; ``tables`` what is true of each table by now.
    """

    job: int
    kind: str
    who: str
    state: str
    run_id: str
    started_utc: str
    ended_utc: str = ""
    words: Message | None = None
    lines: tuple[Message, ...] = ()
    exit_code: int = 0
    data: Mapping[str, object] | None = None
    error: Mapping[str, object] | None = None
    steps: tuple[tuple[str, str], ...] = ()
    tables: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class PastRun:
    """One stored run; ``report`` says whether a report can be shown."""

    run_id: str
    created_utc: str
    state: str
    problem: str
    report: bool


@dataclass(frozen=True, slots=True)
class ResultRow:
    """One line of the before/after table as text: numbers rounded, a dash where there is none."""

    axis: str
    parameter: str
    before: str
    after: str
    unit: str
    change: str


@dataclass(frozen=True, slots=True)
class HeldView:
    """A push that did not end, by the catalogue; ``loud`` unless a read-back said last that its table is off.

    ``back``: it is a rollback, which a person finishes or undoes.
    """

    words: str
    loud: bool
    code: str = ""
    fields: Mapping[str, object] = field(default_factory=dict)
    back: bool = False


@dataclass(frozen=True, slots=True)
class ActingRow:
    """M of an axis as text: with its own table ``alone``, ``predicted`` and ``seen`` with every table acting.

    ``answer`` says whether a short check found what was predicted, "not checked" where there was none.
    """

    axis: str
    alone: str
    predicted: str
    seen: str
    unit: str
    answer: str


@dataclass(frozen=True, slots=True)
class StatusView:
    """The daemon as it is now.

    ``failure`` is the last run's error, ``result`` the last verdict's table, ``acting`` the axes
    of the same run with every table acting, ``trouble`` what is wrong with
    the devices together when each of them answers. ``alarms`` are live tables that are not as they were pushed,
    ``due`` says which were not compared when they should have been, ``left`` what an earlier gateway left in the
    control, ``held`` the pushes that did not end, the loud ones first. ``simulated``: a cell wrote the site file.
    ``unprotected`` says why others could read or change what passes to the control; "" where they cannot. ``ambient``
    is air and material as they were read last, with ``utc`` of that; None before the first reading. ``positions`` is
    where axes stood last, mm or deg.
    """

    site: str
    software: str
    now_utc: str
    devices: tuple[DeviceView, ...]
    run: RunView | None = None
    last_runs: tuple[PastRun, ...] = ()
    failure: Mapping[str, object] | None = None
    result: tuple[ResultRow, ...] = ()
    trouble: Mapping[str, object] | None = None
    alarms: tuple[Message, ...] = ()
    due: Message | None = None
    left: tuple[Mapping[str, object], ...] = ()
    held: tuple[HeldView, ...] = ()
    acting: tuple[ActingRow, ...] = ()
    simulated: bool = False
    unprotected: Message | None = None
    control: ControlView | None = None
    ambient: Mapping[str, object] | None = None
    positions: Mapping[str, float] = field(default_factory=dict)

    @property
    def left_held(self) -> tuple[HeldView, ...]:
        """Pushes that were left without an end: one that is at work now has not been held."""
        at_work = self.run is not None and any(now in AT_WORK for _table, now in self.run.tables)
        return () if at_work else self.held

    @property
    def state(self) -> str:
        """One word for all.

        Running; still-on, while a push is held without proof that its table is off; attention when a device is not
        open or not the site's, a live table is another, or something is left or held; else ready.
        """
        if self.run is not None:
            return "running"
        if any(one.loud for one in self.left_held):
            return "still-on"
        open_all = all(device.state == "open" for device in self.devices)
        troubles = (self.trouble is not None, self.alarms, self.due, self.left, self.left_held)
        return "ready" if open_all and not any(troubles) else "attention"


def control_view(seen: MachineState | None) -> ControlView | None:
    """The control's state for people; None where it was not seen."""
    if seen is None:
        return None
    return ControlView(seen.channel.name.lower(), seen.mode, seen.alarms, seen.message)


def device_views(seen: Iterable[SeenDevice], *, lent: bool) -> tuple[DeviceView, ...]:
    """Devices as a supervisor tells them; while a run has them, those closed here are "in use"."""
    return tuple(
        DeviceView(
            name=item.name,
            driver=item.driver,
            state="in use" if lent and item.state == "closed" else item.state,
            since_utc=item.since_utc,
            error=None if item.error is None else item.error.as_record(),
            sees_beam=_sees_beam(item.driver),
        )
        for item in seen
    )


def _sees_beam(driver: str) -> bool:
    spec = known("instrument").get(driver)
    return spec is None or spec.sees_beam


def past_run(seen: SeenRun, *, report: bool) -> PastRun:
    """A stored run as one line of the page."""
    return PastRun(
        run_id=seen.run_id, created_utc=seen.created_utc, state=seen.state, problem=seen.problem, report=report
    )


def axis_table(verdict: Verdict) -> tuple[ResultRow, ...]:
    """E, R, B, A, M of every axis of a verdict, before and after, as text."""
    rows: Sequence[ParameterRow] = [
        row for axis in verdict.axes for row in parameter_rows(axis.axis, axis.before, axis.after)
    ]
    return tuple(
        ResultRow(
            axis=row.axis,
            parameter=row.parameter,
            before=number(row.before),
            after=number(row.after),
            unit=row.unit,
            change=percent(row.change_pct),
        )
        for row in rows
    )


def acting_rows(axes: Iterable[AxisOutlook], checks: Mapping[str, ActingCheck]) -> tuple[ActingRow, ...]:
    """Every axis with all tables of a run acting, and what its short check said; as text."""
    return tuple(_acting_row(one, checks.get(one.axis)) for one in axes)


def _acting_row(one: AxisOutlook, check: ActingCheck | None) -> ActingRow:
    seen, answer = number(None), "not checked"
    if check is not None:
        seen = f"{number(check.M)} ± {number(check.M_U)}"
        answer = ANSWERS[check.held]
    predicted = f"{number(one.M)} ± {number(one.M_U)}"
    return ActingRow(one.axis, number(one.M_alone), predicted, seen, unit=one.unit, answer=answer)


def job_data(job: JobView) -> dict[str, object]:
    """A command as JSON data; what is said as code and fields, with its English text."""
    data = {one.name: getattr(job, one.name) for one in fields(job)}
    return {**data, "words": told(job.words) if job.words is not None else None, "lines": list(map(told, job.lines))}


def as_data(status: StatusView) -> dict[str, object]:
    """The picture as JSON data, with the state in one word and the progress as a number."""
    data = asdict(replace(status, run=None, alarms=(), due=None, unprotected=None))
    if status.run is not None:
        run = asdict(replace(status.run, words=None))
        data["run"] = {**run, "words": _told(status.run.words), "progress": status.run.progress}
    data |= {"alarms": list(map(told, status.alarms)), "due": _told(status.due)}
    return {"state": status.state, **data, "unprotected": _told(status.unprotected)}


def _told(said: Message | str | None) -> dict[str, object] | None:
    return told(said) if isinstance(said, Message) else None
