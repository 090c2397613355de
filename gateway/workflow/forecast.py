"""The day of `run` and `close` as a forecast from the site file alone: no device is opened, nothing is stored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

from drivers.errors import ConfigError
from drivers.message import Message, words
from drivers.types.stops import StopPlan
from gateway.capture.rig import sense_plan, setup_of
from gateway.capture.targets import HANDSHAKE_S, measuring_plan, plan_s, reading_s, targets_of
from gateway.config import (
    AxisSection,
    DayTimes,
    SiteFile,
    one_start,
    plans_together,
    typed_rotary,
    unprotected_connection,
)
from gateway.correct.plan.plan import CROSS
from gateway.model.chain import LOCATIONS
from gateway.push import ROUNDS, TIMES
from gateway.remaining import RemainingTime, Work
from gateway.tooth import SetupValues
from gateway.workflow.axes.measure import plans_of_axis
from gateway.workflow.axes.short_capture import short_check
from gateway.workflow.control.signs import SWITCH_SETTLE_S
from gateway.workflow.errors21.setup_capture import foreseen_plans, optics_of
from gateway.workflow.errors21.setups import PlannedSetup, mounted_setups, plan_setups, select_setups
from gateway.workflow.run.context import with_axes
from gateway.workflow.tooth.inspection import inspector_name
from gateway.workflow.tooth.part_plan import gear_of_site, grind_plan
from gateway.workflow.tooth.proposal import work_of

# A day at the machine before it begins: each piece of work with what it asks of a person, and its hours; pure.

Stage = Literal["warm-up", "measure", "part", "sign proofs", "push", "measure again"]


@dataclass(frozen=True, slots=True)
class ToMount:
    """Optics to be mounted: for which error of which axis, from which instrument, and where other axes stand."""

    component: str
    axis: str
    instrument: str
    optics: str
    park: Mapping[str, float] = field(default_factory=dict)
    offset_mm: tuple[float, float, float] | None = None

    @property
    def words(self) -> str:
        """Optics and place for people: "straightness (laser) on X1, C1 at 90"."""
        parked = "".join(f", {name} at {place:g}" for name, place in sorted(self.park.items()))
        return f"{self.optics} ({self.instrument}) on {self.axis}{parked}"


@dataclass(frozen=True, slots=True)
class OperatorActions:
    """What work asks of a person beyond a mounting and a clamping: starts and restarts, each by its cause.

    ``machine_s`` is what the machine itself takes meanwhile; ``programs`` are those whose stops are read, each with its
    stops and the part of ``machine_s`` that they take.
    """

    presses: tuple[str, ...] = ()
    resets: tuple[str, ...] = ()
    machine_s: float = 0.0
    programs: tuple[tuple[int, float], ...] = ()

    def plus(self, other: OperatorActions) -> OperatorActions:
        """Both, one after the other."""
        both = self.machine_s + other.machine_s
        programs = (*self.programs, *other.programs)
        return OperatorActions((*self.presses, *other.presses), (*self.resets, *other.resets), both, programs)


def manual_seconds(times: DayTimes, mountings: int, blanks: int, presses: int, resets: int) -> float:
    """Seconds that people and restarts take for so many mountings, blanks on and off, starts and restarts."""
    handled = 60.0 * (times.mounting_min * mountings + times.clamping_min * 2 * blanks)
    return handled + presses * times.start_s + resets * times.restart_s


@dataclass(frozen=True, slots=True)
class Piece:
    """One piece of the day. ``clampings`` counts blanks clamped, each of which is taken off again."""

    stage: Stage
    name: str
    asks: OperatorActions
    mounting: ToMount | None = None
    clampings: int = 0
    hand_s: float = 0.0

    def seconds(self, times: DayTimes) -> float:
        """All of it, by the site's figures."""
        counts = int(self.mounting is not None), self.clampings, len(self.asks.presses), len(self.asks.resets)
        return manual_seconds(times, *counts) + self.asks.machine_s + self.hand_s


@dataclass(frozen=True, slots=True)
class DayPlan:
    """All pieces in order, and the figures they are counted with.

    It supposes that no reading is taken again and that every table is proposed and none refused. ``unprotected`` says
    why others could read or change what passes to the control; "" where they cannot.
    """

    site: str
    command: str
    times: DayTimes
    pieces: tuple[Piece, ...]
    most_extra_h: float = 0.0
    unprotected: Message | None = None

    @property
    def mountings(self) -> tuple[ToMount, ...]:
        """What is mounted, in order."""
        return tuple(piece.mounting for piece in self.pieces if piece.mounting is not None)

    @property
    def blanks(self) -> int:
        """Parts to be ground."""
        return sum(piece.clampings for piece in self.pieces)

    @property
    def presses(self) -> tuple[str, ...]:
        """Every start of a program by its cause, but those that confirm a mounting or a clamping."""
        return tuple(cause for piece in self.pieces for cause in piece.asks.presses)

    @property
    def resets(self) -> tuple[str, ...]:
        """Every restart of the control by its cause."""
        return tuple(cause for piece in self.pieces for cause in piece.asks.resets)

    @property
    def hours(self) -> float:
        """From the first step to the last."""
        return self.hours_of(self.pieces)

    def hours_of(self, pieces: Iterable[Piece]) -> float:
        """Hours of some of its pieces."""
        return sum(piece.seconds(self.times) for piece in pieces) / 3600.0

    def work(self) -> tuple[Work, ...]:
        """The pieces that something is said of when they begin: all but the warm-up, which is over by then."""
        told = (one for one in self.pieces if one.stage != "warm-up")
        return tuple(Work(one.stage, one.name, one.seconds(self.times), one.asks.programs) for one in told)

    def by_stage(self) -> dict[Stage, float]:
        """Hours of each stage, in the order in which they begin."""
        stages: Sequence[Stage] = tuple(dict.fromkeys(piece.stage for piece in self.pieces))
        return {stage: self.hours_of(piece for piece in self.pieces if piece.stage == stage) for stage in stages}

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        return {
            "site": self.site,
            "command": self.command,
            "unprotected": str(self.unprotected or ""),
            "hours": round(self.hours, 3),
            "most_extra_hours": round(self.most_extra_h, 3),
            "hours_by_stage": {stage: round(hours, 3) for stage, hours in self.by_stage().items()},
            "mountings": len(self.mountings),
            "blanks": self.blanks,
            "presses": len(self.presses),
            "presses_by_cause": dict(Counter(self.presses)),
            "resets": len(self.resets),
            "resets_by_cause": dict(Counter(self.resets)),
            "pieces": [self._piece(piece) for piece in self.pieces],
            "times": self.times.model_dump(),
        }

    def _piece(self, piece: Piece) -> dict[str, Any]:
        mounts = piece.mounting
        told = None
        if mounts is not None:
            told = {name: getattr(mounts, name) for name in ("component", "axis", "instrument", "optics")}
            told |= {"park": dict(mounts.park), "offset_mm": mounts.offset_mm}
        return {
            "stage": piece.stage,
            "name": piece.name,
            "mounting": told,
            "clampings": piece.clampings,
            "presses": list(piece.asks.presses),
            "resets": list(piece.asks.resets),
            "minutes": round(piece.seconds(self.times) / 60.0, 2),
        }


Teller = Iterator[Piece]
STEP_S = 60.0
"""To put a shim in, or move optics by a known step, and back again."""


def day_of_run(site: SiteFile, *, apply: bool, axes: Collection[str] = ()) -> DayPlan:
    """The day of `run` with these axes, all where none is named.

    A rotary axis whose readings would be typed takes no time: no run measures it. Raises ConfigError (E-RUN-AXIS;
    E-DAY-ROAD where no program of ours runs).
    """
    named = with_axes(site, axes)
    left_out = typed_rotary(named)
    day = _Day(named.model_copy(update={"axes": tuple(one for one in named.axes if one.name not in left_out)}))
    live = [axis for axis in day.site.axes if axis.measure.file is None]
    last = live[-1:] if live == list(day.site.axes) else []
    applied = day.applied(cross=False, stands=_axis_still_mounted(last)) if apply else ()
    return day.plan("run", (*day.warm_up(), *day.axes_measured(), *applied))


def day_of_closing(site: SiteFile, site_path: Path, *, apply: bool, wanted: Sequence[str] = ()) -> DayPlan:
    """The day of `close` with these set-ups (none: all).

    Raises as `close_site` does before it opens a device, and ConfigError (E-DAY-ROAD).
    """
    work_of(site, site_path)
    day = _Day(site)
    pieces = [*day.warm_up(), *day.setups_measured(wanted)]
    if apply:
        inspector_name(site)
        part_s = grind_plan(site, gear_of_site(site, site_path), SetupValues()).seconds
        pieces += [day.part("before", part_s), *day.applied(cross=True), *day.acting()]
        pieces += [day.part("trial", part_s), day.part("after", part_s)]
    return day.plan("close", pieces)


def day_of_measuring(site: SiteFile, wanted: Sequence[str] = ()) -> DayPlan:
    """The day of `measure` with these set-ups (none: all). Raises as `day_of_run`."""
    day = _Day(site)
    return day.plan("measure", day.setups_measured(wanted))


def setup_hours(site: SiteFile, one: PlannedSetup) -> float:
    """Hours of one set-up alone: mounted, started, proved and read; a file is read in no time of the machine.

    Raises ConfigError (E-DAY-ROAD).
    """
    if one.setup.source != "live":
        return PROGRAM_S / 3600.0
    day = _Day(site)
    return sum(piece.seconds(site.times) for piece in day.setup_alone(one)) / 3600.0


def remaining_of(day: Callable[[], DayPlan]) -> RemainingTime:
    """The time to go of a command by its day; without a forecast it is that of the program at work alone.

    What is wrong with the site is said by the command itself, where it matters to it.
    """
    try:
        return RemainingTime(day().work())
    except ConfigError:
        return RemainingTime()


@dataclass(frozen=True)
class _Day:
    """What the pieces of a site's day are made from."""

    site: SiteFile

    @property
    def together(self) -> int:
        """Raises ConfigError (E-DAY-ROAD)."""
        found = plans_together(self.site)
        if not found:
            raise ConfigError("E-DAY-ROAD", self.site.site.name, driver=self.site.controller.driver)
        return found

    def plan(self, command: str, pieces: Iterable[Piece]) -> DayPlan:
        """All of it."""
        every, site = tuple(pieces), self.site
        most = self._extra_h(every)
        return DayPlan(
            site.site.name, command, site.times, every, most_extra_h=most, unprotected=unprotected_connection(site)
        )

    def _extra_h(self, pieces: Iterable[Piece]) -> float:
        """At most so many hours for targets that readings ask for, and for the same targets measured again."""
        most = {axis.name: axis.measure.extra_hours for axis in self.site.axes}
        read = [one.mounting for one in pieces if one.mounting is not None and one.stage.startswith("measure")]
        return sum(most[one.axis] for one in read if one.component[:2] not in LOCATIONS)

    def warm_up(self) -> Teller:
        """Before the first reading."""
        yield Piece("warm-up", words("S-WORK-MACHINE"), OperatorActions(), hand_s=60.0 * self.site.times.warm_up_min)

    def axes_measured(self) -> Teller:
        """Axis by axis; those of files have their tables read by a program, which ends the one that waits."""
        for from_file, axes in groupby(self.site.axes, key=lambda axis: axis.measure.file is not None):
            if from_file:
                for axis in axes:
                    yield Piece("measure", f"tables of {axis.name}", table_reading_actions(axis.name))
            else:
                yield from self.measured("measure", [(axis, plans_of_axis(axis, "before")) for axis in axes])

    def setups_measured(self, wanted: Sequence[str] = ()) -> Teller:
        """Every set-up in the order of the plan, files first."""
        todo = select_setups(plan_setups(self.site), wanted)
        files = [one.axis.name for one in todo if one.setup.source == "file"]
        for name in dict.fromkeys(files):
            yield Piece("measure", f"tables of {name}", table_reading_actions(name))
        count = 0
        for one in mounted_setups(todo):
            if one.setup.source == "live":
                plans = foreseen_plans(self.site, [one])
                yield self._setup(one, plans, count)
                count += len(plans)

    def setup_alone(self, one: PlannedSetup) -> Teller:
        """One set-up that nothing comes before."""
        yield self._setup(one, foreseen_plans(self.site, [one]), 0)

    def _setup(self, one: PlannedSetup, plans: Sequence[StopPlan], before: int) -> Piece:
        asks = self._begun(before, len(plans)).plus(visit_seconds(plans, one.axis))
        hand_s = STEP_S if one.setup.step and not one.positioning else 0.0
        return Piece("measure", one.key, asks, _mounting_of(one), hand_s=hand_s)

    def _begun(self, before: int, count: int) -> OperatorActions:
        """The programs that begin with the next ``count`` plans after ``before`` others."""
        first = -(-before // self.together)
        last = -(-(before + count) // self.together)
        return OperatorActions(("begin measuring",) * (last - first))

    def measured(
        self, stage: Stage, axes: Sequence[tuple[AxisSection, Sequence[StopPlan]]], after: int = 0, stands: str = ""
    ) -> Teller:
        """Axes one after the other in one row of programs, ``after`` so many plans; on ``stands`` optics are there."""
        count = after
        for axis, plans in axes:
            asks = self._begun(count, len(plans)).plus(visit_seconds(plans, axis))
            yield Piece(stage, axis.name, asks, _own_mounting(axis) if axis.name != stands else None)
            count += len(plans)

    def part(self, name: str, part_s: float) -> Piece:
        """A part ground, taken off and inspected."""
        asks = OperatorActions((f"grind part {name}",), machine_s=part_s)
        return Piece("part", name, asks, clampings=1, hand_s=60.0 * self.site.times.inspection_min)

    def applied(self, *, cross: bool, stands: str = "") -> Teller:
        """Signs, the axes' own tables, the axes again, and the cross tables; ``stands``: on that axis a laser does."""
        own = [axis for axis in self.site.axes if axis.measure.instrument]
        tables = [(out, over) for out, over in self._cross()] if cross else []
        own.sort(key=lambda axis: (axis.name != stands, axis.kind == "linear"))
        yield from self._sign_proofs(own, tables, stands)
        stands = _axis_still_mounted(own[-1:])
        own.sort(key=lambda axis: (axis.name != stands, self.site.axes.index(axis)))
        if own:
            # What the trial tables left is what was read, where the program that loads holds the control against it.
            asks = push_actions(self.site, [(axis, axis) for axis in own], "axis tables", just=one_start(self.site))
            yield Piece("push", words("S-WORK-TABLES"), asks)
        again = [(axis, plans_of_axis(axis, "after")) for axis in own]
        yield from self.measured("measure again", again, len(own), stands)
        if tables:
            yield Piece("push", "cross tables", push_actions(self.site, tables, "cross tables", just=bool(own)))

    def _cross(self) -> Iterator[tuple[AxisSection, AxisSection]]:
        """Every cross table that may be proposed, as (output, input)."""
        by_letter = {axis.letter: axis for axis in self.site.axes if axis.measure.instrument}
        return ((by_letter[out], by_letter[over]) for out, over in CROSS if {out, over} <= set(by_letter))

    def _sign_proofs(
        self, own: Sequence[AxisSection], tables: Sequence[tuple[AxisSection, AxisSection]], stands: str
    ) -> Teller:
        """The signs of all axes in one transaction; of cross tables one sign holds for every input axis."""
        if not own:
            return
        yield Piece("sign proofs", "trial tables", trial_loading_actions(self.site))
        count = 0
        for axis in own:
            cross = [(over, "cross") for out, over in tables if out == axis][:1]
            kinds = [(axis, "axis"), (axis, "reversal"), *cross]
            sense = visit_seconds([sense_plan(axis, setup_of(axis))], axis)
            asks = self._begun(count, 1 + len(kinds)).plus(sense)
            for over, kind in kinds:
                asks = asks.plus(proof_actions(self.site, axis, over, kind))
            yield Piece("sign proofs", axis.name, asks, _own_mounting(axis) if axis.name != stands else None)
            count += 1 + len(kinds)
        yield Piece("sign proofs", words("S-WORK-TABLES-BEFORE"), trial_removal_actions(self.site))

    def acting(self) -> Teller:
        """An axis with a cross table over itself, at few targets, once every table acts.

        It goes on in the program that proved their effect. A calibrator does not outlast the reference run before.
        """
        count = len(list(self._cross()))
        for out, over in self._cross():
            if out == over:
                few = short_check(out, targets_of(out), self.site.guard)
                plans = [sense_plan(out, setup_of(out)), measuring_plan(few, targets_of(few), "")]
                asks = self._begun(count, len(plans)).plus(visit_seconds(plans, out))
                yield Piece("measure again", out.name, asks, _own_mounting(out))
                count += len(plans)


def _mounting_of(one: PlannedSetup) -> ToMount:
    setup = one.setup
    return ToMount(
        setup.component,
        one.axis.name,
        setup.instrument,
        optics_of(one),
        park=dict(setup.park),
        offset_mm=setup.offset_mm,
    )


def _axis_still_mounted(last: Sequence[AxisSection]) -> str:
    """The axis on which the instrument that was mounted last still stands after a restart; "" for none."""
    return last[0].name if last and last[0].kind == "linear" else ""


def _own_mounting(axis: AxisSection) -> ToMount:
    return ToMount(axis.measure.component, axis.name, axis.measure.instrument, axis.kind)


# What measuring, proving and pushing ask of a person, by the programs that each sends; pure.
#
# The one place that counts them beforehand. `tests/closing` compares it with what a run asked.

PROGRAM_S = 5.0
"""To send a program, write and compare its tables, and bring its files back."""
EVERY = "all axes"
STREAM_S = 0.4
"""What the blocks of a stream add to each reading, which begins and ends with a whole one."""
TOUCHED = 5
"""About so many places prove the effect of a table."""


def visit_seconds(plans: Sequence[StopPlan], axis: AxisSection) -> OperatorActions:
    """The stops of an axis' plans, each of them read."""
    standing = reading_s(axis.measure) + STREAM_S
    programs = tuple((len(plan.stops), plan_s(plan, standing)) for plan in plans)
    return OperatorActions(machine_s=sum(seconds for _, seconds in programs), programs=programs)


def table_reading_actions(what: str) -> OperatorActions:
    """What acts on an axis, or on all axes of a transaction, saved by a program that moves nothing."""
    return OperatorActions((words("S-WORK-READ", what=what),), (), PROGRAM_S)


def push_actions(
    site: SiteFile, tables: Sequence[tuple[AxisSection, AxisSection]], name: str, *, just: bool = False
) -> OperatorActions:
    """One transaction of tables, each as (output, input), and of what reversals go with them.

    One load, one release where it is a start of its own, one restart, one proof of effect; one read of all their axes
    before them, unless ``just``: a program before has just read them, and the one that loads compares.
    """
    inputs = {over.name: over for _, over in tables}
    moved = sum(0.5 * _across_s(site, axis) for axis in inputs.values())
    shown = sum(_across_s(site, over) + TOUCHED * (over.measure.dwell_s + HANDSHAKE_S) for _, over in tables)
    presses = (*_load_actions(site, f"load {name}", f"switch on {name}"), f"effect of {name}")
    read = OperatorActions() if just else table_reading_actions(name)
    return read.plus(OperatorActions(presses, (f"switch on {name}",), 3 * PROGRAM_S + moved + shown))


def trial_loading_actions(site: SiteFile) -> OperatorActions:
    """The trial tables of all signs: read what is live, loaded, left off, and one restart lets them act when on."""
    presses = _load_actions(site, "load trial tables", "end trial tables")
    return table_reading_actions(EVERY).plus(OperatorActions(presses, ("trial tables",), 2 * PROGRAM_S))


def trial_removal_actions(site: SiteFile) -> OperatorActions:
    """What was live before, back by one program; no restart, and no read of its own, where none of it was on."""
    return OperatorActions(
        _load_actions(site, words("S-WORK-LOAD-BEFORE"), words("S-WORK-END-BEFORE")), (), 2 * PROGRAM_S
    )


def _load_actions(site: SiteFile, load: str, release: str) -> tuple[str, ...]:
    return (load,) if one_start(site) else (load, release)


def proof_actions(site: SiteFile, out: AxisSection, over: AxisSection, kind: str) -> OperatorActions:
    """One trial table switched at its peak: it goes on in the program that proved the instrument."""
    stops = 6 * ROUNDS if kind == "reversal" else 2 * TIMES
    read = 4 * ROUNDS if kind == "reversal" else stops
    turned = (stops - read) * 2.0 * over.measure.overrun / _feed(site, over) * 60.0
    stood = read * (SWITCH_SETTLE_S + out.measure.average_s + over.measure.dwell_s + HANDSHAKE_S + STREAM_S)
    return OperatorActions(machine_s=0.5 * _across_s(site, over) + stood + turned)


def _feed(site: SiteFile, axis: AxisSection) -> float:
    return min(axis.measure.feed, site.moves.places.feed(axis.unit))


def _across_s(site: SiteFile, axis: AxisSection) -> float:
    """Seconds across an axis' table at the feed of a push."""
    return (axis.table.maximum - axis.table.minimum) / _feed(site, axis) * 60.0
