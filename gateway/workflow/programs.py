"""Every program that a site would send, written without a control: to be read and signed before the first day.

They are the programs of the site's next commands: what only the control knows (its axes, what it has reserved, words
that it does not take) is what its self-test kept. Before a self-test it is taken as small as the work allows: as many
points as the tables ask for, and no tables of others. The number is none that was ever given.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from drivers import registry
from drivers.errors import ConfigError, words
from drivers.message import digits, fixed
from drivers.programs import DayNumbers, DwellPlan, Order, ProgramText, SelfTest, SelfTested, Visits, reading_plan
from drivers.types.abilities import Capabilities
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable, LiveTable
from gateway.axes import AxisRecord
from gateway.capture.targets import measuring_plan, plan_of, plan_s, targets_of
from gateway.config import AxisSection, SiteFile
from gateway.domain.proposals import Proposal, TableChange
from gateway.domain.values import FloatArray
from gateway.moves import Patience, question
from gateway.push import (
    TIMES,
    MovedTable,
    PlanAxes,
    make_effect_plan,
    other_tables_enabled,
    positions_of,
    proof_positions,
    transaction_groups,
)
from gateway.store.machine_books import ProofBook
from gateway.tooth import SetupValues, ToothProposal
from gateway.workflow.axes import verdict
from gateway.workflow.axes.measure import plans_of_axis
from gateway.workflow.axes.short_capture import plans_of_combined_effect as acting_plans
from gateway.workflow.errors21.setup_capture import foreseen_plans
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.run.folder import known_of, store_of
from gateway.workflow.run.paper_control import PAPER_NUMBERS, SENT_KINDS, ProgramKind, example_table, paper_control
from gateway.workflow.tooth.part_plan import gear_of_site, grind_plan

Layer = Literal["axis", "cross"]
LAYERS: tuple[Layer, Layer] = ("axis", "cross")
ON_PAPER = Capabilities(stops=True, tables=(), switched="at-stop", marker=True, consent="start", together=True)
"""What a control can do whose programs are written here: they switch tables at a stop, all of a layer together."""


@dataclass(frozen=True, slots=True)
class PrintedProgram:
    """One program: what it is for, a name of its own among the others, and its text."""

    what: ProgramKind
    name: str
    program: ProgramText


def programs(
    site: SiteFile,
    site_path: Path,
    wanted: tuple[ProgramKind, ...] = SENT_KINDS,
    proposal: Proposal | None = None,
    *,
    tooth: ToothProposal | None = None,
    dwell: DwellOptions | None = None,
    numbers: DayNumbers = PAPER_NUMBERS,
) -> tuple[PrintedProgram, ...]:
    """Programs of these kinds in the order in which a run sends them; ``load`` from ``proposal`` or an example table.

    ``effect`` is what a push of ``proposal`` sends behind each load, nothing without one: the proof of effect at places
    that follow from the new table and the one it replaces, the measuring again of the axes, and for ``tooth`` that of
    axes which cross tables change. All signs are taken as proved by then.
    With what the control's self-test kept of it they are what is sent, byte for byte, ``numbers`` apart: each program
    gets its own when it is sent. Axes are taken to stand in their safe places then, as commands ask for. Of a PLC
    mailbox, which runs no programs, they are what is laid down in it.

    Raises ConfigError (E-CFG-DRIVER, E-PROGRAM-NO-ROAD for a road that sends nothing of these kinds, E-PROGRAM-NOTHING
    for a site that asks for none), and what writing and judging raise.
    """
    tables = _tables_to_load(site, proposal)
    paper = paper_control(site, site_path, wanted, tables, numbers=numbers)
    made_for = _For(site, site_path, tables, proposal, paper.known, paper.names, numbers.order, tooth)
    found = []
    for what in wanted:
        for name, order in _orders(made_for, what) if what != "dwell" else _dwell_programs(site, dwell):
            made = paper.write(order)
            files = [one.file_name for one in made]
            for place, one in enumerate(made):
                again = files[:place].count(one.file_name)
                found.append(
                    PrintedProgram(what, f"{what}-{name}{f'-{again + 1}' if again else ''}-{one.file_name}", one)
                )
    if not found:
        asked = [what for what in wanted if what == "dwell" or next(_orders(made_for, what), None) is not None]
        if asked:
            raise ConfigError("E-PROGRAM-NO-ROAD", site.site.name, driver=site.controller.driver)
        raise ConfigError("E-PROGRAM-NOTHING", site.site.name, what=", ".join(wanted))
    return tuple(found)


def numbers_in(site: SiteFile, sent: Path) -> DayNumbers:
    """The numbers of a program as it was sent or carried, so that the same can be printed and compared.

    Raises ConfigError (E-PROGRAM-LIKE) for a file that shows none.
    """
    driver = f"{site.controller.driver}-numbers"
    try:
        text = sent.read_text(encoding="ascii")
    except (OSError, ValueError) as error:
        raise ConfigError("E-PROGRAM-LIKE", "--like", file=str(sent), why=str(error)) from error
    read = registry.load(driver, "numbers") if driver in registry.known("numbers") else None
    found = None if read is None else read(text, site.controller.settings, str(sent))
    if not isinstance(found, DayNumbers):
        raise ConfigError("E-PROGRAM-LIKE", "--like", file=str(sent), why=words("W-PROGRAM-NO-NUMBER"))
    return found


def write_programs(files: Mapping[str, str], folder: Path, *, force: bool = False) -> None:
    """Write texts by name. Raises ConfigError (E-PROGRAM-THERE), before the first is written, unless ``force``."""
    there = [name for name in files if (folder / name).exists()]
    if there and not force:
        raise ConfigError("E-PROGRAM-THERE", str(folder), name=there[0], count=len(there))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii", newline="\n")
    except OSError as error:
        raise ConfigError("E-PROGRAM-FOLDER", str(folder), why=str(error)) from error


def _tables_to_load(site: SiteFile, proposal: Proposal | None) -> tuple[CompensationTable, ...]:
    """The tables of a proposal; without one an example for each axis, of the size that its own table will have."""
    if proposal is not None:
        return tuple(change.new for change in proposal.changes if not change.skipped)
    return tuple(example_table(axis)[0] for axis in site.axes)


@dataclass(frozen=True, slots=True)
class _For:
    """What programs are written for: a site, the tables to be loaded, and what is known of its control."""

    site: SiteFile
    path: Path
    tables: tuple[CompensationTable, ...]
    proposal: Proposal | None
    known: Mapping[str, SelfTested]
    names: tuple[str, ...]
    number: int
    tooth: ToothProposal | None = None

    @property
    def machine(self) -> MachineIdentity:
        """The control's own fingerprint where a self-test or an earlier command kept it."""
        if self.known:
            return next(iter(self.known.values())).machine
        facts = known_of(self.site, store_of(self.site, self.path).root).facts
        return MachineIdentity(facts.get("serial", self.site.controller.serial), facts.get("version", ""), self.names)


def _orders(made: _For, what: ProgramKind) -> Iterator[tuple[str, Order]]:
    site = made.site
    if what == "grind":
        if site.work is not None:
            yield "part", grind_plan(site, gear_of_site(site, made.path), SetupValues())
    elif what == "load":
        yield from _loads(made)
    elif what == "effect":
        yield from _effects(made)
    elif what == "measure":
        yield from _measuring_programs(site)
    else:
        for axis in site.axes:
            yield from _of_axis(made, axis, what)
        if what == "backup":
            yield from _read_together(made)


def _measuring_programs(site: SiteFile) -> Iterator[tuple[str, Order]]:
    """What a run of the axes sends, and what measuring the errors sends: plans in one program, as they are foreseen."""
    live = [axis for axis in site.axes if axis.measure.file is None]
    plans = tuple(plan for axis in live for plan in plans_of_axis(axis, "before"))
    if plans:
        yield "axes", Visits(plans)
    for axis in site.axes:
        if axis.measure.file is not None:
            yield f"tables-{axis.letter}", question(axis.facts, Patience(0.0, 0.0))
    coming_plans = foreseen_plans(site, plan_setups(site)) if site.setups else ()
    if coming_plans:
        yield "errors", Visits(coming_plans)


def _loads(made: _For) -> Iterator[tuple[str, Order]]:
    """One batch for each layer, as a push sends them; without a proposal the example tables of all axes."""
    if made.proposal is None:
        batch = tuple(_order(made, table, "table") for table in made.tables)
        if batch:
            yield "axis", batch
        return
    on: list[CompensationTable] = []
    for layer in LAYERS:
        for name, together in _groups(made, layer):
            yield name, tuple(_coupled_order(made, change, together, on) for change, _ in together)
            on += [change.new for change, _ in together]


def _groups(made: _For, layer: Layer) -> list[tuple[str, Sequence[MovedTable]]]:
    """The transactions of a layer, each with a name of its own."""
    changes = [one for one in made.proposal.changes if one.layer == layer] if made.proposal is not None else []
    moved = [(one, _facts(made, one.new.input_axis)) for one in changes if not one.skipped]
    groups = transaction_groups(moved, ON_PAPER)
    names = [layer if len(groups) == 1 else f"{layer}-{number}" for number, _ in enumerate(groups, start=1)]
    return [(name, [moved[place] for place in group]) for name, group in zip(names, groups, strict=True)]


def _place(together: Sequence[MovedTable], axis: AxisRecord) -> float:
    """Where the input axis stands while its tables are switched."""
    found = positions_of(together, ON_PAPER)[axis.name]
    return axis.reference if found is None else found


def _effects(made: _For) -> Iterator[tuple[str, Order]]:
    """What follows each load: the proofs of effect, and behind the last one of a layer what is measured then."""
    if made.proposal is None:
        return
    changes = [one for one in made.proposal.changes if not one.skipped]
    carried = made.site.controller.driver.endswith("-offline")  # files bring no readings of an instrument
    cross = [one for one in changes if one.layer == "cross"]
    reads = () if carried else _reading_plans(made, cross)
    again = () if carried else verdict.plans_of_verification(made.site, [one for one in changes if one.layer == "axis"])
    acting = acting_plans(made.site, made.tooth, cross) if made.tooth is not None else ()
    for layer, last in zip(LAYERS, ((*again, *reads), acting), strict=True):
        groups = _groups(made, layer)
        if not groups and last and layer == "axis":
            yield "axis-read", Visits(last)
        for number, (name, together) in enumerate(groups, start=1):
            yield from _follow_up_plans(made, name, together, last if number == len(groups) else ())


def _read_together(made: _For) -> Iterator[tuple[str, Order]]:
    """What saves the tables of several output axes before one load; of a single one the axis' own program does."""
    for name, together in (group for layer in LAYERS for group in _groups(made, layer)):
        plans = _reading_plans(made, [change for change, _ in together])
        if len(plans) > 1:
            yield name, Visits(plans)


def _follow_up_plans(
    made: _For, name: str, together: Sequence[MovedTable], follows: tuple[StopPlan, ...]
) -> Iterator[tuple[str, Order]]:
    """Behind one load; where reversals alone are to be read after the proofs, what follows is a program of its own."""
    proved = [(change, axis) for change, axis in together if change.new.kind != "reversal"]
    if proved:
        yield name, Visits((*(_proof_text(made, change, axis, together) for change, axis in proved), *follows))
    seen = {change.axis for change, _ in proved if change.new.kind == "axis"}
    unseen = _reading_plans(made, [one for one, _ in together if one.new.kind == "reversal" and one.axis not in seen])
    if unseen:
        yield f"{name}-read", Visits(unseen)
        if follows:
            yield f"{name}-again", Visits(follows)


def _proof_text(made: _For, change: TableChange, axis: AxisRecord, together: Sequence[MovedTable]) -> StopPlan:
    old = LiveTable(change.old, change.old_enabled)
    along = PlanAxes(axis, _facts(made, change.axis), made.site.moves.places)
    return make_effect_plan(change.new, proof_positions(change.new, old, axis), along, _place(together, axis))


def _reading_plans(made: _For, changes: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What saves the tables of each output axis of these changes."""
    axes = dict.fromkeys(change.axis for change in changes)
    return tuple(reading_plan(question(_facts(made, axis), Patience(0.0, 0.0))) for axis in axes)


def _coupled_order(
    made: _For, change: TableChange, together: Sequence[MovedTable], on: Sequence[CompensationTable]
) -> PushOrder:
    """The order of a change; tables of other transactions that act on its output are on again at its end.

    Those are what was live before, and what the transactions before this one have put ``on``.
    """
    beside = [one.new for one, _ in together if one is not change and one.axis == change.axis]
    at = _place(together, _facts(made, change.new.input_axis))
    order = replace(_order(made, change.new, "table"), agreeing_position=at)
    if change.new.kind != "cross":
        return order
    pushed = any(one.kind == "cross" and one.output_axis == change.axis and one not in beside for one in on)
    stood = change.base is not None and other_tables_enabled(change.base, change.new, beside)
    return replace(order, coupled=pushed or stood)


def _dwell_programs(site: SiteFile, wish: DwellOptions | None) -> Iterator[tuple[str, Order]]:
    return ((axis.letter, plan) for axis, plan in dwell_plans(site, wish or DwellOptions()))


def _of_axis(made: _For, axis: AxisSection, what: ProgramKind) -> Iterator[tuple[str, Order]]:
    if what == "backup":
        yield axis.letter, question(axis.facts, Patience(0.0, 0.0))
    elif what == "self-test":
        yield axis.letter, SelfTest(axis.name, axis.encoder, axis.encoder_said)
    elif what == "proof":
        yield from _proof(made, axis)
    else:
        yield axis.letter, DisableOrder(made.number, "axis", axis.name, axis.encoder)


def _facts(made: _For, name: str) -> AxisRecord:
    """As a push knows an axis: with its safe place."""
    return replace(_moved_axis(made, name).facts, safe=made.site.moves.places.ranges.get(name))


def _moved_axis(made: _For, name: str) -> AxisSection:
    return next(axis for axis in made.site.axes if axis.name == name)


def _order(made: _For, table: CompensationTable, purpose: Literal["table", "sign-proof"]) -> PushOrder:
    moved, output = _moved_axis(made, table.input_axis), _moved_axis(made, table.output_axis)
    return PushOrder(
        made.number,
        table,
        letter=moved.letter,
        rotary=moved.kind == "rotary",
        enable=purpose == "table",
        agreeing_position=moved.reference,
        purpose=purpose,
        proof=_proof_of(made, table) if purpose == "table" else None,
        encoder=output.encoder,
        encoder_said=output.encoder_said,
    )


def _proof_of(made: _For, table: CompensationTable) -> SignProof:
    """The machine's own; where none is kept yet, one of the usual sense."""
    machine, axis = made.machine, table.output_axis
    found = ProofBook(store_of(made.site, made.path).root).find(machine, table.kind, axis)
    return found or SignProof(machine, table.kind, output_axis=axis, slope=1.0, slope_u=0.01, sign=1, date_utc="")


def _proof(made: _For, axis: AxisSection) -> Iterator[tuple[str, Order]]:
    """The triangle table, the stops that switch it, and the old table back."""
    table, peak = example_table(axis)
    order = _order(made, table, "sign-proof")
    yield f"{axis.letter}-triangle", (order,)
    stops = tuple(
        Stop(peak, 1, repetition=turn // 2, label=turn, switch=bool(turn % 2)) for turn in range(2 * TIMES + 1)
    )
    setup = f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"
    switching: StopPlan = plan_of(axis, stops, setup, name=f"TFSIGN{axis.letter}", dwell_s=axis.measure.dwell_s)
    yield f"{axis.letter}-switching", switching
    nothing = replace(table, deviations=tuple(0.0 for _ in table.deviations))
    yield f"{axis.letter}-restore", (replace(order, table=nothing, enable=False, purpose="restore"),)


# What a capture program of somebody else needs: a program that stands still at each target, and the list of targets.
#
# Such programs trigger when the reading stands still, so the axis must stand longer than they settle.

MARGIN_S = 1.0  # beyond the settling: the person's clock and the control's are two
LARGEST_STEP_DEG = 10.0
CALIBRATOR_FEED = 720.0  # deg/min; what a rotary calibrator's own drive follows over larger steps, as remembered


@dataclass(frozen=True, slots=True)
class DwellOptions:
    """Seconds at each target, seconds that the capture program settles, and the calibrator's fastest feed, deg/min."""

    dwell_s: float = 6.0
    settling_s: float = 2.0
    calibrator_feed: float = CALIBRATOR_FEED


def dwell_plans(site: SiteFile, wish: DwellOptions) -> tuple[tuple[AxisSection, DwellPlan], ...]:
    """One plan for each axis that has targets.

    Raises ConfigError (E-DWELL-SHORT, E-DWELL-TARGETS).
    """
    if wish.dwell_s < wish.settling_s + MARGIN_S:
        least = wish.settling_s + MARGIN_S
        raise ConfigError("E-DWELL-SHORT", "--dwell", dwell=digits(wish.dwell_s, 6), least=digits(least, 6))
    axes = [(axis, targets_of(axis)) for axis in site.axes]
    found = tuple((axis, _plan(axis, at, wish)) for axis, at in axes if at.size)
    if not found:
        raise ConfigError("E-DWELL-TARGETS", site.site.name)
    return found


def _plan(axis: AxisSection, at: FloatArray, wish: DwellOptions) -> DwellPlan:
    plan = measuring_plan(axis, at, "", name=f"TFDWEL{axis.letter}")
    return DwellPlan(replace(plan, feed=feed_of(axis, at, wish)), wish.dwell_s)


def feed_of(axis: AxisSection, at: FloatArray, wish: DwellOptions) -> float:
    """The site's feed, lowered where a rotary calibrator would not follow; mm/min or deg/min."""
    widest = float(np.max(np.diff(at), initial=0.0))
    slow = axis.kind == "rotary" and widest >= LARGEST_STEP_DEG
    return min(axis.measure.feed, wish.calibrator_feed) if slow else axis.measure.feed


def describe_dwell(axis: AxisSection, plan: DwellPlan) -> str:
    """What a person should know of this program: stops, hours, and a feed that is not the site's."""
    count = len(plan.stops.stops)
    hours = plan_s(replace(plan.stops, dwell_s=plan.dwell_s), 0.0) / 3600.0
    text = words("P-DWELL-PLAN", axis=axis.name, stops=count, dwell=digits(plan.dwell_s, 6), hours=fixed(hours, 1))
    if plan.stops.feed < axis.measure.feed:
        feed, own = f"{plan.stops.feed:g}", f"{axis.measure.feed:g}"
        text += words("P-DWELL-FEED", feed=feed, own=own)
    return text


def target_lists(axis: AxisSection, plan: DwellPlan) -> dict[str, str]:
    """The targets as text (one a line) and as CSV in the order of the stops, by file name."""
    at = sorted({stop.target for stop in plan.stops.stops})
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["stop", f"target_{axis.unit}", "direction", "repetition"])
    for place, stop in enumerate(plan.stops.stops, 1):
        writer.writerow([place, f"{stop.target:.6f}", "+" if stop.approach > 0 else "-", stop.repetition + 1])
    lines = "".join(f"{target:.6f}\n" for target in at)
    return {f"dwell-{axis.letter}-targets.txt": lines, f"dwell-{axis.letter}-stops.csv": table.getvalue()}
