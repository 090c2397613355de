"""Measures all errors of a machine set-up by set-up, resumes between them, and tells what is known and what is open."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import TrueflankError, words
from drivers.message import Message, Quantity, fixed, prose
from drivers.types.doubts import Doubt
from drivers.types.tables import LiveSet
from gateway.capture.revisits import require_complete
from gateway.capture.targets import targets_of
from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import ALSO_SHOWN, THRESHOLD_UM, OpenDoubt, ToothSpec, what_next
from gateway.correct.plan.plan import AxisGrid
from gateway.domain.captures import Capture
from gateway.domain.equipment import Equipment
from gateway.errors import CaptureError, IllegalTransition, Incomplete
from gateway.evaluate.behaviour.doubts import accept_doubts, all_doubts, blocking_doubts, demand_settled
from gateway.evaluate.geometry.error_model import error_model
from gateway.events import RunStarted, SetupStarted
from gateway.interlocks import age_refusals, suspect_refusals
from gateway.model.chain import LETTERS
from gateway.model.error_model import LOCATION_NAMES, ErrorModel
from gateway.report.tooth.errors import ErrorRow, error_rows
from gateway.say import Say
from gateway.store import RunFolder
from gateway.tooth import FlankAgreement
from gateway.workflow.axes.measure import fetch_tables, store_equipment
from gateway.workflow.errors21.setup_capture import foreseen_plans, measure_setup, start_positions
from gateway.workflow.errors21.setups import PlannedSetup, plan_setups, select_setups, spans
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.live_tables import compare_live_tables

MEASURING, PARTIAL, MEASURED, STOPPED = "measuring", "partly-measured", "measured", "stopped"


@dataclass(frozen=True, slots=True)
class PlanOutcome:
    """What is known after the set-ups so far: rows of the 21, what is open, what to measure next in words."""

    state: str
    run_folder: str
    model: ErrorModel
    rows: tuple[ErrorRow, ...]
    machine: tuple[str, ...]
    remaining: tuple[str, ...]
    open: tuple[OpenDoubt, ...]
    advice: tuple[Message, ...]

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        return {
            "state": self.state,
            "run_folder": self.run_folder,
            "errors": [row.as_data() for row in self.rows],
            "remaining": list(self.remaining),
            "open": [
                {"name": one.name, "change_um": one.change_um, "share": one.share, "measured": one.measured}
                for one in self.open
            ],
            "threshold_um": THRESHOLD_UM,
            "advice": prose(self.advice),
            "said": list(map(str, self.model.said)),
        }


class ChoosesSetups(Protocol):
    """Chooses what is measured next from what has been measured: a plan for limited hours."""

    def next(self, model: ErrorModel | None, measured: Collection[str], spent_h: float) -> Sequence[PlannedSetup]:
        """The set-ups of the next step, in order; none where it ends. ``measured`` are keys, ``spent_h`` hours."""

    @property
    def lines(self) -> tuple[Message, ...]:
        """What it says of its end."""


async def measure_site(
    site: SiteFile,
    site_path: Path,
    *,
    clock: Clock,
    say: Say,
    wanted: Sequence[str] = (),
    resume: RunFolder | None = None,
    tooth: ToothSpec | None = None,
    chooses: ChoosesSetups | None = None,
) -> PlanOutcome:
    """Walk through the plan's set-ups (those wanted, by key or component) and tell what is known afterwards.

    With ``chooses`` each step is chosen by what the ones before it told. All instruments are opened before anything
    moves, so that a missing one is told at once; then only the one in use stays open. Each set-up is stored before the
    next; a run that stopped is resumed with its folder, finished set-ups are not repeated, but for those that no table
    could be pushed from. Raises ConfigError (E-SETUP-...), IllegalTransition (E-SETUP-MACHINE, E-SETUP-CHANGED),
    CaptureError (E-SETUP-TABLES: tables changed since an earlier set-up), and what capturing raises; the folder keeps
    the error.
    """
    todo = select_setups(plan_setups(site), wanted)
    folder = resume or new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    left = _setups_to_measure(folder, todo, clock.utc(), say)
    try:
        if left:
            async with open_context(
                site, site_path, folder=folder, clock=clock, say=say, instruments=instruments_of(left)
            ) as at:
                if chooses is None:
                    await _walk(at, left, resumed=resume is not None)
                else:
                    await _walk_by_choice(at, chooses, left, resumed=resume is not None)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state(STOPPED)
        raise
    outcome = fit_error_model(site, folder, tooth)
    return outcome if chooses is None else replace(outcome, advice=chooses.lines)


def _shortened(key: str) -> str:
    """The file that says that a plan for limited hours chose a set-up's targets and repetitions."""
    return f"shortened-{key}.json"


def _setups_to_measure(
    folder: RunFolder, todo: Sequence[PlannedSetup], now_utc: datetime, say: Say
) -> tuple[PlannedSetup, ...]:
    """Set-ups without a capture that can be used; a finished one must still be what the site file says."""
    doubted = _contradicted_errors(folder)
    for one in todo:
        if not folder.has(stages.setup(one.key)) or one.setup.name in doubted:
            continue
        shortened = _shortened(one.key) in folder.facts["files"]
        if not one.was_measured_as(folder.read_text(f"setup-{one.key}.json"), shortened=shortened):
            raise IllegalTransition("E-SETUP-CHANGED", folder.run_id, setup=one.key)
    left = []
    for one in todo:
        if one.setup.name in doubted:
            say("P-SETUP-ANEW", setup=one.key, words=words("S-PART-CONTRADICTS", error=one.setup.name))
        if one.setup.name in doubted or not _is_done(folder, one, now_utc, say):
            left.append(one)
    return tuple(left)


def _contradicted_errors(folder: RunFolder) -> frozenset[str]:
    """Errors whose measuring the run's own part contradicts, as long as nothing was measured or pushed since."""
    if not folder.has(stages.AGREEMENT) or folder.digest(stages.ERRORS) not in folder.parents(stages.AGREEMENT):
        return frozenset()
    found = folder.get(stages.AGREEMENT, FlankAgreement)
    return frozenset(one.error for one in found.explanations if found.outcome == "apart")


def _is_done(folder: RunFolder, one: PlannedSetup, now_utc: datetime, say: Say) -> bool:
    """Whether a set-up is behind us: measured, and with nothing against it that would refuse a push from it later."""
    if not folder.has(stages.setup(one.key)):
        return False
    if one.setup.source != "live" or any(stage.startswith(stages.push("")) for stage in folder.stages):
        return True
    capture = folder.get(stages.setup(one.key), Capture)
    why = _reason_to_repeat(capture, now_utc, positioning=one.positioning)
    why = why or "; ".join(doubt.text for doubt in blocking_doubts(_open_doubts(one, capture)))
    if why:
        say("P-SETUP-ANEW", setup=one.key, words=why)
    return not why


def _reason_to_repeat(capture: Capture, now_utc: datetime, *, positioning: bool) -> str:
    """Why a stored capture is measured anew; "" where it is not."""
    try:
        require_complete(capture)
    except Incomplete as error:
        return error.what
    against = (*suspect_refusals(capture), *age_refusals(capture, now_utc)) if positioning else ()
    return "; ".join(one.words for one in against)


def instruments_of(plan: Sequence[PlannedSetup]) -> set[str]:
    """The instruments these set-ups need at the machine."""
    return {one.setup.instrument for one in plan if one.setup.source == "live"}


async def _walk(at: RunContext, left: Sequence[PlannedSetup], *, resumed: bool) -> None:
    walk = _Walk(at, await _same_machine(at) if resumed else {})
    store_equipment(at)
    at.folder.set_state(MEASURING)
    read = [one for one in left if not at.folder.has(stages.setup_raw(one.leader or one.key)) or not one.leader]
    await at.foresee(foreseen_plans(at.site, read))
    for number, one in enumerate(left):
        await walk.measure(one, number + 1, len(left))
    await at.foresee(())
    at.folder.set_state(PARTIAL)


async def _walk_by_choice(
    at: RunContext, chooses: ChoosesSetups, left: Sequence[PlannedSetup], *, resumed: bool
) -> None:
    """Step after step as they are chosen; what is behind us of a resumed run counts as measured."""
    walk = _Walk(at, await _same_machine(at) if resumed else {})
    store_equipment(at)
    at.folder.set_state(MEASURING)
    began, open_keys = at.clock.now(), {one.key: one for one in left}
    able = [one for one in plan_setups(at.site) if one.measured]
    while open_keys:
        done = [one for one in able if one.key not in open_keys and at.folder.has(stages.setup(one.key))]
        model = _fitted(at.site, at.folder, done)[0] if done else None
        step = chooses.next(model, [one.key for one in able if one.key not in open_keys], _hours_since(at, began))
        if not step:
            break
        await at.foresee(foreseen_plans(at.site, step))
        for one in step:
            if one.setup != open_keys[one.key].setup:
                chosen = {"targets": int(targets_of(one.axis).size), "repetitions": one.axis.measure.repetitions}
                at.folder.write_text(_shortened(one.key), json.dumps(chosen))
            await walk.measure(one, len(able) - len(open_keys) + 1, len(able))
            del open_keys[one.key]
    await at.foresee(())
    at.folder.set_state(PARTIAL)


def _hours_since(at: RunContext, began: float) -> float:
    return (at.clock.now() - began) / 3600.0


@dataclass
class _Walk:
    """Set-ups one after the other; ``known`` are the tables of each axis by what was measured so far."""

    at: RunContext
    known: dict[str, str]
    tables: dict[str, LiveSet] = field(default_factory=dict)

    async def measure(self, one: PlannedSetup, number: int, of: int) -> None:
        SetupStarted(one.key, number, of).tell(self.at.say)
        await self.at.supervisor.hold(instruments_of([one]))
        capture = await measure_setup(self.at, one, self.tables)
        if capture.axis not in self.known:
            await compare_live_tables(self.at, capture.live)
        _same_tables(self.known, capture, one.key)


async def _same_machine(at: RunContext) -> dict[str, str]:
    """Refuse to go on at another machine, or where what compensated a measured axis is not what it was."""
    before = at.folder.get(stages.EQUIPMENT, Equipment).machine
    different = before.differences(at.machine)
    if different:
        raise IllegalTransition("E-SETUP-MACHINE", at.folder.run_id, fields=", ".join(different))
    known: dict[str, str] = {}
    for one in plan_setups(at.site):
        if at.folder.has(stages.setup(one.key)):
            _same_tables(known, at.folder.get(stages.setup(one.key), Capture), one.key)
    for name, digest in known.items():
        if (await fetch_tables(at, at.axis(name))).digest != digest:
            raise CaptureError("E-SETUP-TABLES", name, setup="the resume")
    return known


def _same_tables(known: dict[str, str], capture: Capture, key: str) -> None:
    """All set-ups of an axis must have been measured under the same tables."""
    if capture.live is None:
        return
    if known.setdefault(capture.axis, capture.live.digest) != capture.live.digest:
        raise CaptureError("E-SETUP-TABLES", capture.axis, setup=key)


def fit_error_model(site: SiteFile, folder: RunFolder, tooth: ToothSpec | None) -> PlanOutcome:
    """Fit everything captured so far, store the error model, and say what should be measured next.

    Raises InDoubt (E-DOUBT-OPEN) where readings of a set-up leave a doubt that nobody settled.
    """
    plan = plan_setups(site)
    done = [one for one in plan if one.measured and folder.has(stages.setup(one.key))]
    model, captures = _fitted(site, folder, done)
    model = replace(model, said=(*model.said, *_unproved_setups(done, captures)))
    remaining = tuple(one.key for one in plan if one.measured and one not in done)
    opened = what_next(model, tooth, grids(site)) if tooth is not None else ()
    if remaining and opened:
        model = replace(model, said=(*model.said, _plan_summary(plan, remaining, opened)))
    folder.put(stages.ERRORS, model, tuple(folder.digest(stages.setup(one.key)) for one in done))
    folder.set_state(PARTIAL if remaining else MEASURED)
    advice = advise(plan, remaining, opened, asked=tooth is not None)
    rows = tuple(row for row in error_rows(model) if row.state == "measured" or row.name in machine_errors(site))
    return PlanOutcome(
        state=folder.state,
        run_folder=str(folder.path),
        model=model,
        rows=rows,
        machine=machine_errors(site),
        remaining=remaining,
        open=opened,
        advice=advice,
    )


def _fitted(site: SiteFile, folder: RunFolder, done: Sequence[PlannedSetup]) -> tuple[ErrorModel, tuple[Capture, ...]]:
    """The errors as these set-ups tell them, and their captures. Raises InDoubt (E-DOUBT-OPEN)."""
    captures = tuple(folder.get(stages.setup(one.key), Capture) for one in done)
    for one, capture in zip(done, captures, strict=True):
        demand_settled(_open_doubts(one, capture), one.key)
    rotary = [axis.name for axis in site.axes if axis.kind == "rotary"]
    measurements = [
        one.measurement(capture.targets, capture.deviations, rotary, start_positions(site, folder, one))
        for one, capture in zip(done, captures, strict=True)
    ]
    usual = site.assumed
    model = error_model(measurements, spans(site), linear_um=usual.linear_um, angular_arcsec=usual.angular_arcsec)
    return model, captures


def _open_doubts(one: PlannedSetup, capture: Capture) -> tuple[Doubt, ...]:
    """The doubts of a set-up's capture, with what the site file accepts of them now."""
    return accept_doubts(all_doubts(capture, modulo=one.axis.modulo), one.axis.measure.accept_doubts)


def _unproved_setups(done: Sequence[PlannedSetup], captures: Sequence[Capture]) -> tuple[Message, ...]:
    """The set-ups whose sense rests on what the site file says."""
    names = ", ".join(one.key for one, capture in zip(done, captures, strict=True) if capture.sense is None)
    return (Message.of("S-MODEL-SENSE", names=names),) if names else ()


def _plan_summary(plan: Sequence[PlannedSetup], remaining: Sequence[str], opened: Sequence[OpenDoubt]) -> Message:
    """How much of the plan was measured, and what the rest is still worth."""
    able = [one for one in plan if one.measured]
    names = {one.setup.name for one in able if one.key in remaining}
    rest_um = sum(one.change_um**2 for one in opened if one.name in names and not one.measured) ** 0.5
    return Message.of("S-MODEL-PART", count=len(able) - len(remaining), of=len(able), rest=fixed(rest_um))


def machine_errors(site: SiteFile) -> tuple[str, ...]:
    """The errors that this machine has: six motions of each of its axes, and the tilts between those of a grinder."""
    letters = [axis.letter for axis in site.axes]
    motions = [f"E{letter}{axis}" for axis in letters for letter in LETTERS]
    return (*motions, *(name for name in LOCATION_NAMES if name[2] in letters))


def grids(site: SiteFile) -> tuple[AxisGrid, ...]:
    """The controller's grids by axis letter."""
    return tuple(
        AxisGrid(
            axis=axis.letter,
            minimum=axis.table.minimum,
            maximum=axis.table.maximum,
            step=axis.table.step,
            reference=axis.reference,
            modulo=axis.modulo,
        )
        for axis in site.axes
    )


def advise(
    plan: Sequence[PlannedSetup], remaining: Sequence[str], opened: Sequence[OpenDoubt], *, asked: bool
) -> tuple[Message, ...]:
    """Which remaining set-up would change the proposal most, or that none would by the threshold."""
    if not asked:
        return (Message.of("W-SETUP-NO-WORK" if remaining else "W-SETUP-NONE-LEFT", count=len(remaining)),)
    able = {one.setup.name: one.key for one in reversed(plan) if one.key in remaining}
    best = next((one for one in opened if one.name in able and not one.measured), None)
    limit = Quantity(THRESHOLD_UM)
    rest = next((one for one in opened if one.name not in able and not one.measured), None)
    more: tuple[Message, ...] = ()
    if rest is not None and rest.change_um > THRESHOLD_UM:
        more = (Message.of("W-SETUP-UNPLANNED", name=rest.name, change=fixed(rest.change_um)),)
    if best is None or best.change_um <= THRESHOLD_UM:
        none = "W-SETUP-NONE-MATTERS" if remaining else "W-SETUP-NONE-LEFT"
        return Message.of(none, count=len(remaining), limit=limit), *more
    said = {"setup": able[best.name], "name": best.name, "share": fixed(100.0 * best.share, 0)}
    return Message.of("W-SETUP-NEXT", **said, change=fixed(best.change_um), limit=limit), *more


# Which set-ups of a plan pay: those that answer most of what the proposal for the tooth may be wrong by; pure.

ENOUGH = 0.99
"""Of the mean square by which a proposal may be wrong before anything was measured."""


@dataclass(frozen=True, slots=True)
class WorthwhileSetups:
    """Set-ups of a plan by key, in its order, and what they are worth before anything is measured.

    ``of`` is how many the plan has, ``share`` (0 to 1) what part of the doubt about the proposal they answer,
    ``rest_um`` what the others could still change in it, RMS of the flank in um, at one standard uncertainty.
    """

    keys: tuple[str, ...]
    of: int
    share: float
    rest_um: float

    @property
    def told(self) -> dict[str, str]:
        """The figures for a text."""
        share = f"{100.0 * self.share:.1f}"
        return {"count": str(len(self.keys)), "of": str(self.of), "share": share, "rest": f"{self.rest_um:.1f}"}


def worthwhile_setups(site: SiteFile, tooth: ToothSpec, share: float = ENOUGH) -> WorthwhileSetups:
    """The fewest set-ups of a site's plan that answer ``share`` of what is open, beside each axis' own positioning.

    The ranking is that of `what_next` with nothing measured: every error unknown within its assumed span. An axis' own
    positioning belongs to it whatever it is worth, for its table is judged on the axis. Raises what `what_next` raises.
    """
    plan = [one for one in plan_setups(site) if one.measured]
    usual = site.assumed
    nothing = error_model((), spans(site), linear_um=usual.linear_um, angular_arcsec=usual.angular_arcsec)
    return choose_worthwhile(plan, what_next(nothing, tooth, grids(site)), share)


def choose_worthwhile(
    plan: Sequence[PlannedSetup], opened: Sequence[OpenDoubt], share: float = ENOUGH
) -> WorthwhileSetups:
    """The same of a plan whose doubts are known: the error that answers most for each set-up comes first."""
    square = {one.name: one.change_um**2 for one in opened}
    total = sum(square.values())
    setups: dict[str, list[str]] = {}
    for one in plan:
        setups.setdefault(one.setup.name, []).append(one.key)
    taken = {one.setup.name for one in plan if one.positioning}
    while (left := _remaining_square(square, taken)) > (1.0 - share) * total:
        gains = {name: _gain_of_each(name, setups, left, square, taken) for name in setups if name not in taken}
        best = max(gains, key=lambda name: gains[name], default="")
        if not best or gains[best] <= 0.0:
            break
        taken.add(best)
    keys = tuple(one.key for one in plan if one.setup.name in taken)
    left = _remaining_square(square, taken)
    return WorthwhileSetups(keys, len(plan), share=1.0 - left / total if total > 0.0 else 1.0, rest_um=float(left**0.5))


def _gain_of_each(
    name: str, setups: Mapping[str, Sequence[str]], left: float, square: Mapping[str, float], taken: Collection[str]
) -> float:
    """What one more error takes from what is left, um squared for each of its set-ups."""
    return (left - _remaining_square(square, {*taken, name})) / len(setups[name])


def _remaining_square(square: Mapping[str, float], taken: Collection[str]) -> float:
    """The mean square (um squared) that is still open once these errors are measured."""
    shown = {*taken, *(other for name in taken for other in ALSO_SHOWN.get(name, ()))}
    return sum(size for name, size in square.items() if name not in shown)
