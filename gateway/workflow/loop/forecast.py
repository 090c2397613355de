"""The day of `run` and `close` as a forecast from the site file alone: no device is opened, nothing is stored."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from drivers.errors import ConfigError
from drivers.types.stops import StopPlan
from gateway.capture.rig import setup_of
from gateway.capture.sense import sense_plan
from gateway.capture.targets import measuring_plan, targets_of
from gateway.config import AxisSection, SiteFile, one_start, open_road, plans_together
from gateway.config.reaching import typed_rotary
from gateway.correct.plan.plan import CROSS
from gateway.model.chain import LOCATIONS
from gateway.remaining import RemainingTime
from gateway.tooth import SetupValues
from gateway.workflow.axes.guard import short_check
from gateway.workflow.axes.measure import plans_of_axis
from gateway.workflow.bench import with_axes
from gateway.workflow.errors21.setupcapture import coming, optics_of
from gateway.workflow.errors21.setups import Planned, chosen, planned
from gateway.workflow.loop.asking import proving, pushing, reading_tables, trials_in, trials_out, visiting
from gateway.workflow.loop.dayplan import Asks, DayPlan, Piece, Stage, ToMount
from gateway.workflow.part.inspecting import inspector_name
from gateway.workflow.part.planning import gear_of_site, grind_plan
from gateway.workflow.tooth.proposal import work_of

Told = Iterator[Piece]
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
    applied = day.applied(cross=False, stands=_outlasting(last)) if apply else ()
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
        return DayPlan(site.site.name, command, site.times, every, most_extra_h=most, unprotected=open_road(site))

    def _extra_h(self, pieces: Iterable[Piece]) -> float:
        """At most so many hours for targets that readings ask for, and for the same targets measured again."""
        most = {axis.name: axis.measure.extra_hours for axis in self.site.axes}
        read = [one.mounting for one in pieces if one.mounting is not None and one.stage.startswith("measure")]
        return sum(most[one.axis] for one in read if one.component[:2] not in LOCATIONS)

    def warm_up(self) -> Told:
        """Before the first reading."""
        yield Piece("warm-up", "machine and instruments", Asks(), hand_s=60.0 * self.site.times.warm_up_min)

    def axes_measured(self) -> Told:
        """Axis by axis; those of files have their tables read by a program, which ends the one that waits."""
        for from_file, axes in groupby(self.site.axes, key=lambda axis: axis.measure.file is not None):
            if from_file:
                for axis in axes:
                    yield Piece("measure", f"tables of {axis.name}", reading_tables(axis.name))
            else:
                yield from self.measured("measure", [(axis, plans_of_axis(axis, "before")) for axis in axes])

    def setups_measured(self, wanted: Sequence[str] = ()) -> Told:
        """Every set-up in the order of the plan, files first."""
        todo = chosen(planned(self.site), wanted)
        files = [one.axis.name for one in todo if one.setup.source == "file"]
        for name in dict.fromkeys(files):
            yield Piece("measure", f"tables of {name}", reading_tables(name))
        count = 0
        for one in todo:
            if one.setup.source == "live":
                plans = coming(self.site, [one])
                yield self._setup(one, plans, count)
                count += len(plans)

    def _setup(self, one: Planned, plans: Sequence[StopPlan], before: int) -> Piece:
        asks = self._begun(before, len(plans)).plus(visiting(plans, one.axis))
        hand_s = STEP_S if one.setup.step and not one.positioning else 0.0
        return Piece("measure", one.key, asks, _mounting_of(one), hand_s=hand_s)

    def _begun(self, before: int, count: int) -> Asks:
        """The programs that begin with the next ``count`` plans after ``before`` others."""
        first = -(-before // self.together)
        last = -(-(before + count) // self.together)
        return Asks(("begin measuring",) * (last - first))

    def measured(
        self, stage: Stage, axes: Sequence[tuple[AxisSection, Sequence[StopPlan]]], after: int = 0, stands: str = ""
    ) -> Told:
        """Axes one after the other in one row of programs, ``after`` so many plans; on ``stands`` optics are there."""
        count = after
        for axis, plans in axes:
            asks = self._begun(count, len(plans)).plus(visiting(plans, axis))
            yield Piece(stage, axis.name, asks, _own_mounting(axis) if axis.name != stands else None)
            count += len(plans)

    def part(self, name: str, part_s: float) -> Piece:
        """A part ground, taken off and inspected."""
        asks = Asks((f"grind part {name}",), machine_s=part_s)
        return Piece("part", name, asks, clampings=1, hand_s=60.0 * self.site.times.inspection_min)

    def applied(self, *, cross: bool, stands: str = "") -> Told:
        """Signs, the axes' own tables, the axes again, and the cross tables; ``stands``: on that axis a laser does."""
        own = [axis for axis in self.site.axes if axis.measure.instrument]
        tables = [(out, over) for out, over in self._cross()] if cross else []
        own.sort(key=lambda axis: (axis.name != stands, axis.kind == "linear"))
        yield from self._signed(own, tables, stands)
        stands = _outlasting(own[-1:])
        own.sort(key=lambda axis: (axis.name != stands, self.site.axes.index(axis)))
        if own:
            # What the trial tables left is what was read, where the program that loads holds the control against it.
            asks = pushing(self.site, [(axis, axis) for axis in own], "axis tables", just=one_start(self.site))
            yield Piece("push", "axis tables and reversals", asks)
        again = [(axis, plans_of_axis(axis, "after")) for axis in own]
        yield from self.measured("measure again", again, len(own), stands)
        if tables:
            yield Piece("push", "cross tables", pushing(self.site, tables, "cross tables", just=bool(own)))

    def _cross(self) -> Iterator[tuple[AxisSection, AxisSection]]:
        """Every cross table that may be proposed, as (output, input)."""
        by_letter = {axis.letter: axis for axis in self.site.axes if axis.measure.instrument}
        return ((by_letter[out], by_letter[over]) for out, over in CROSS if {out, over} <= set(by_letter))

    def _signed(
        self, own: Sequence[AxisSection], tables: Sequence[tuple[AxisSection, AxisSection]], stands: str
    ) -> Told:
        """The signs of all axes in one transaction; of cross tables one sign holds for every input axis."""
        if not own:
            return
        yield Piece("sign proofs", "trial tables", trials_in(self.site))
        count = 0
        for axis in own:
            cross = [(over, "cross") for out, over in tables if out == axis][:1]
            kinds = [(axis, "axis"), (axis, "reversal"), *cross]
            sense = visiting([sense_plan(axis, setup_of(axis))], axis)
            asks = self._begun(count, 1 + len(kinds)).plus(sense)
            for over, kind in kinds:
                asks = asks.plus(proving(self.site, axis, over, kind))
            yield Piece("sign proofs", axis.name, asks, _own_mounting(axis) if axis.name != stands else None)
            count += 1 + len(kinds)
        yield Piece("sign proofs", "tables of before", trials_out(self.site))

    def acting(self) -> Told:
        """An axis with a cross table over itself, at few targets, once every table acts.

        It goes on in the program that proved their effect. A calibrator does not outlast the reference run before.
        """
        count = len(list(self._cross()))
        for out, over in self._cross():
            if out == over:
                few = short_check(out, targets_of(out), self.site.guard)
                plans = [sense_plan(out, setup_of(out)), measuring_plan(few, targets_of(few), "")]
                asks = self._begun(count, len(plans)).plus(visiting(plans, out))
                yield Piece("measure again", out.name, asks, _own_mounting(out))
                count += len(plans)


def _mounting_of(one: Planned) -> ToMount:
    setup = one.setup
    return ToMount(
        setup.component,
        one.axis.name,
        setup.instrument,
        optics_of(one),
        park=dict(setup.park),
        offset_mm=setup.offset_mm,
    )


def _outlasting(last: Sequence[AxisSection]) -> str:
    """The axis on which the instrument that was mounted last still stands after a restart; "" for none."""
    return last[0].name if last and last[0].kind == "linear" else ""


def _own_mounting(axis: AxisSection) -> ToMount:
    return ToMount(axis.measure.component, axis.name, axis.measure.instrument, axis.kind)
