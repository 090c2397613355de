"""Every program that a site would send, written without a control: to be read and signed before the first day.

They are the programs of the site's next commands: what only the control knows (its axes, what it has reserved, words
that it does not take) is what its self-test kept. Before a self-test it is taken as small as the work allows: as many
points as the tables ask for, and no tables of others. The number is none that was ever given.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from drivers import registry
from drivers.errors import ConfigError, words
from drivers.programs import DayNumbers, Order, ProgramText, SelfTest, SelfTested, Visits, reading_plan
from drivers.types.abilities import Capabilities
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable, LiveTable
from gateway.axes import AxisRecord
from gateway.capture.targets import plan_of
from gateway.config import AxisSection, SiteFile
from gateway.domain.proposals import Proposal, TableChange
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
from gateway.store.proofs import Proofs
from gateway.tooth import SetupValues, ToothProposal
from gateway.walk import Patience, question
from gateway.workflow.axes.acting import plans_of as acting_plans
from gateway.workflow.axes.measure import plans_of_axis
from gateway.workflow.control import judging
from gateway.workflow.dwelling import DwellWish, dwell_plans
from gateway.workflow.errors21.setupcapture import coming
from gateway.workflow.errors21.setups import planned
from gateway.workflow.onpaper import EVERY, PAPER, What, example_table, paper_control
from gateway.workflow.part.planning import gear_of_site, grind_plan
from gateway.workflow.runsite import known_of, store_of

Layer = Literal["axis", "cross"]
LAYERS: tuple[Layer, Layer] = ("axis", "cross")
ON_PAPER = Capabilities(stops=True, tables=(), switched="at-stop", marker=True, consent="start", together=True)
"""What a control can do whose programs are written here: they switch tables at a stop, all of a layer together."""


@dataclass(frozen=True, slots=True)
class Written:
    """One program: what it is for, a name of its own among the others, and its text."""

    what: What
    name: str
    program: ProgramText


def programs(
    site: SiteFile,
    site_path: Path,
    wanted: tuple[What, ...] = EVERY,
    proposal: Proposal | None = None,
    *,
    tooth: ToothProposal | None = None,
    dwell: DwellWish | None = None,
    numbers: DayNumbers = PAPER,
) -> tuple[Written, ...]:
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
    tables = _loaded(site, proposal)
    paper = paper_control(site, site_path, wanted, tables, numbers=numbers)
    made_for = _For(site, site_path, tables, proposal, paper.known, paper.names, numbers.order, tooth)
    found = []
    for what in wanted:
        for name, order in _orders(made_for, what) if what != "dwell" else _dwelling(site, dwell):
            made = paper.write(order)
            files = [one.file_name for one in made]
            for place, one in enumerate(made):
                again = files[:place].count(one.file_name)
                found.append(Written(what, f"{what}-{name}{f'-{again + 1}' if again else ''}-{one.file_name}", one))
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


def kept(files: Mapping[str, str], folder: Path, *, force: bool = False) -> None:
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


def _loaded(site: SiteFile, proposal: Proposal | None) -> tuple[CompensationTable, ...]:
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


def _orders(made: _For, what: What) -> Iterator[tuple[str, Order]]:
    site = made.site
    if what == "grind":
        if site.work is not None:
            yield "part", grind_plan(site, gear_of_site(site, made.path), SetupValues())
    elif what == "load":
        yield from _loads(made)
    elif what == "effect":
        yield from _effects(made)
    elif what == "measure":
        yield from _measured(site)
    else:
        for axis in site.axes:
            yield from _of_axis(made, axis, what)
        if what == "backup":
            yield from _read_together(made)


def _measured(site: SiteFile) -> Iterator[tuple[str, Order]]:
    """What a run of the axes sends, and what measuring the errors sends: plans in one program, as they are foreseen."""
    live = [axis for axis in site.axes if axis.measure.file is None]
    plans = tuple(plan for axis in live for plan in plans_of_axis(axis, "before"))
    if plans:
        yield "axes", Visits(plans)
    for axis in site.axes:
        if axis.measure.file is not None:
            yield f"tables-{axis.letter}", question(axis.facts, Patience(0.0, 0.0))
    coming_plans = coming(site, planned(site)) if site.setups else ()
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
            yield name, tuple(_coupled(made, change, together, on) for change, _ in together)
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
    reads = () if carried else _reads(made, cross)
    again = () if carried else judging.plans_of(made.site, [one for one in changes if one.layer == "axis"])
    acting = acting_plans(made.site, made.tooth, cross) if made.tooth is not None else ()
    for layer, last in zip(LAYERS, ((*again, *reads), acting), strict=True):
        groups = _groups(made, layer)
        if not groups and last and layer == "axis":
            yield "axis-read", Visits(last)
        for number, (name, together) in enumerate(groups, start=1):
            yield from _behind(made, name, together, last if number == len(groups) else ())


def _read_together(made: _For) -> Iterator[tuple[str, Order]]:
    """What saves the tables of several output axes before one load; of a single one the axis' own program does."""
    for name, together in (group for layer in LAYERS for group in _groups(made, layer)):
        plans = _reads(made, [change for change, _ in together])
        if len(plans) > 1:
            yield name, Visits(plans)


def _behind(
    made: _For, name: str, together: Sequence[MovedTable], follows: tuple[StopPlan, ...]
) -> Iterator[tuple[str, Order]]:
    """Behind one load; where reversals alone are to be read after the proofs, what follows is a program of its own."""
    proved = [(change, axis) for change, axis in together if change.new.kind != "reversal"]
    if proved:
        yield name, Visits((*(_proved(made, change, axis, together) for change, axis in proved), *follows))
    seen = {change.axis for change, _ in proved if change.new.kind == "axis"}
    unseen = _reads(made, [one for one, _ in together if one.new.kind == "reversal" and one.axis not in seen])
    if unseen:
        yield f"{name}-read", Visits(unseen)
        if follows:
            yield f"{name}-again", Visits(follows)


def _proved(made: _For, change: TableChange, axis: AxisRecord, together: Sequence[MovedTable]) -> StopPlan:
    old = LiveTable(change.old, change.old_enabled)
    along = PlanAxes(axis, _facts(made, change.axis), made.site.moves.places)
    return make_effect_plan(change.new, proof_positions(change.new, old, axis), along, _place(together, axis))


def _reads(made: _For, changes: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What saves the tables of each output axis of these changes."""
    axes = dict.fromkeys(change.axis for change in changes)
    return tuple(reading_plan(question(_facts(made, axis), Patience(0.0, 0.0))) for axis in axes)


def _coupled(
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


def _dwelling(site: SiteFile, wish: DwellWish | None) -> Iterator[tuple[str, Order]]:
    return ((axis.letter, plan) for axis, plan in dwell_plans(site, wish or DwellWish()))


def _of_axis(made: _For, axis: AxisSection, what: What) -> Iterator[tuple[str, Order]]:
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
    return replace(_moved(made, name).facts, safe=made.site.moves.places.ranges.get(name))


def _moved(made: _For, name: str) -> AxisSection:
    return next(axis for axis in made.site.axes if axis.name == name)


def _order(made: _For, table: CompensationTable, purpose: Literal["table", "sign-proof"]) -> PushOrder:
    moved, output = _moved(made, table.input_axis), _moved(made, table.output_axis)
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
    found = Proofs(store_of(made.site, made.path).root).find(machine, table.kind, axis)
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
