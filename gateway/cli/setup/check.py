"""`check`, `check programs`, `doctor devices`: faults of a site file, its devices, and every NC program it sends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import typer

from drivers.checks import ControlFacts
from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from gateway.cli.options import JsonOption, SiteArgument, StoreOption, open_run
from gateway.cli.output import count_words, echo, echo_folded, show_json, show_table
from gateway.cli.signals import run_to_end

CARRIED = "carried"
INVALID_FILE_EXIT = ConfigError.exit_code
DEVICE_KEYS = ("device", "model", "serial", "firmware")


@dataclass(frozen=True, slots=True)
class CheckedSite:
    """What was found: ``faults`` refuse the file, ``doubts`` do not; ``site`` is None where it cannot be used."""

    site: Any
    faults: tuple[Any, ...]
    doubts: tuple[Any, ...]
    text: str = ""

    @property
    def remarks(self) -> tuple[Message, ...]:
        """What the file asks for that will do for no push, or only just."""
        from gateway.workflow.axes.site_remarks import remarks

        return remarks(self.site) if self.site is not None and not self.faults else ()


def check_command(site: SiteArgument, as_json: JsonOption = False) -> None:
    """Say everything that is wrong in a site file; nothing is opened."""
    _end_check(check_site(site), site, as_json=as_json)


def devices_command(site: SiteArgument, as_json: JsonOption = False) -> None:
    """Say everything that is wrong in a site file, then ask every device it names, and move nothing."""
    from gateway.config import with_positions

    found = check_site(site)
    if found.faults:
        _end_check(found, site, as_json=as_json)
    # A control that files are carried to answers another day: the command ends and says what to carry. It is the
    # program that a self-test carries first, so the one goes on with the other's files.
    with exchange_files_for(PieceOfWork("self-test ", "go-on", ends=True)):
        rows, limits = run_to_end(ask_devices(found.site, site), at=site)
    found = replace(found, faults=sort_faults(with_positions(limits, found.text)))
    _end_check(found, site, rows, connected=True, as_json=as_json)


def _end_check(
    found: CheckedSite, site: Path, rows: Sequence[tuple[str, ...]] = (), *, connected: bool = False, as_json: bool
) -> None:
    """Show a check and what to type next. Raises typer.Exit where the file has faults."""
    show_check(found, site, rows, as_json=as_json)
    if not as_json:
        show_next_check(found, site, connected=connected)
    if found.faults:
        raise typer.Exit(INVALID_FILE_EXIT)


def show_next_check(found: CheckedSite, path: Path, *, connected: bool) -> None:
    """Say what to type after a check: the same again, the devices, the doctor, or the files of who has no wire."""
    from gateway.cli.next_steps import repeat_after_faults, show_next
    from gateway.config import by_files

    if found.faults:
        repeat_after_faults(f"{'doctor devices' if connected else 'check'} {path}")
    elif urlsplit(found.site.controller.url).scheme == CARRIED and not connected:
        show_next(f"doctor self-test {path}")
    elif by_files(found.site):
        show_next(f"day FOLDER --site {path}")
    else:
        show_next(f"doctor {path}" if connected else f"doctor devices {path}")


def check_site(path: Path) -> CheckedSite:
    """The file, and the files it names, judged. Raises ConfigError (E-CFG-READ, E-CFG-ENCODING)."""
    from gateway.cli.setup.named_files import named_file_faults
    from gateway.config import read_site, with_absolute_paths, with_positions

    reading = read_site(path)
    disk = with_positions(named_file_faults(reading, path), reading.text)
    found = (*reading.faults, *reading.doubts, *disk)
    faults = tuple(one for one in found if is_fault(one))
    doubts = tuple(one for one in found if not is_fault(one))
    site = with_absolute_paths(reading.site, path.parent) if reading.site is not None else None
    return CheckedSite(site, sort_faults(faults), sort_faults(doubts), reading.text)


def is_fault(one: Any) -> bool:
    """Whether it refuses the file: an error's code does, however it was found."""
    return not one.doubt or one.code.startswith("E-")


def sort_faults(faults: Sequence[Any]) -> tuple[Any, ...]:
    """As they stand in the file."""
    return tuple(sorted(faults, key=lambda one: (one.line, one.column)))


async def ask_devices(site: Any, path: Path) -> tuple[Sequence[tuple[str, ...]], tuple[Any, ...]]:
    """Every device's identity, and what the control says against the file; a service that has the devices lends them.

    Raises DevicesFailed, and what `gateway.broker.borrow_devices` raises.
    """
    from gateway.broker import borrow_devices
    from gateway.cli.setup.wizard import survey_control
    from gateway.supervisor import Supervisor
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.run.identity import IdentityCheck

    clock, control, root = LoopClock(), site.controller, store_of(site, path).root
    async with borrow_devices(root, "check", clock):
        supervisor = Supervisor(site, clock, recognise=IdentityCheck(site, path, root, clock, keeps=False))
        try:
            await supervisor.open_all()
            seen = [one for one in supervisor.picture() if one.identity is not None]
        finally:
            await supervisor.close_all()
        facts = await survey_control(
            control.driver, control.url, control.settings, clock=clock, timeout_s=control.timeout_s
        )
    rows: list[tuple[str, ...]] = [
        (one.name, one.identity.model, one.identity.serial, one.identity.firmware) for one in seen if one.identity
    ]
    return rows, tuple(compare_with_control(site, facts))


def compare_with_control(site: Any, facts: ControlFacts) -> Iterator[Any]:
    """What the file says otherwise than the control: axes, units, endless turning, soft limits, encoder, room."""
    from gateway.config import Fault, bounds

    known = ", ".join(axis.name for axis in facts.axes)
    for number, axis in enumerate(site.axes):
        own, fields = facts.axis(axis.name), {"axis": axis.name}
        if own is None:
            yield Fault(("axes", number, "name"), "E-CFG-CONTROL-AXIS", {**fields, "known": known})
            continue
        if own.unit != axis.unit:
            yield Fault(("axes", number, "kind"), "E-CFG-CONTROL-KIND", {**fields, "unit": own.unit})
        if own.modulo is not None and own.modulo != axis.modulo:
            said = str(own.modulo).lower()
            yield Fault(("axes", number, "modulo"), "E-CFG-CONTROL-MODULO", {**fields, "modulo": said})
        if own.encoder is not None and own.encoder != axis.encoder:
            yield Fault(("axes", number, "encoder"), "E-CFG-CONTROL-ENCODER", {**fields, "encoder": own.encoder})
        points = round((axis.table.maximum - axis.table.minimum) / axis.table.step) + 1
        if own.points is not None and points > own.points:
            room = {"points": points, "reserved": own.points}
            yield Fault(("axes", number, "table"), "E-CFG-CONTROL-ROOM", {**fields, **room})
        if own.travel is not None and not axis.modulo:
            low, high = own.travel
            span = bounds(axis)
            reached = {
                "travel": span,
                "table": (axis.table.minimum, axis.table.maximum),
                "targets": measured_range(axis),
            }
            for what, (first, last) in reached.items():
                if first < low - 1e-6 or last > high + 1e-6:
                    ends = {"what": what, "first": first, "last": last, "low": low, "high": high}
                    yield Fault(("axes", number, what), "E-CFG-CONTROL-LIMITS", {**fields, **ends})


def measured_range(axis: Any) -> tuple[float, float]:
    """How far measuring moves an axis: its outer targets and the overrun beyond them."""
    from gateway.capture.targets import positions

    measure = axis.measure
    if measure.targets is None:
        return axis.table.minimum, axis.table.maximum
    at = positions(measure.targets, axis.reference, rotary=axis.kind == "rotary")
    return float(at[0]) - measure.overrun, float(at[-1]) + measure.overrun


def show_check(found: CheckedSite, path: Path, rows: Sequence[tuple[str, ...]], *, as_json: bool) -> None:
    """The verdict for people, or as data."""
    if as_json:
        devices = [dict(zip(DEVICE_KEYS, row, strict=True)) for row in rows]
        name = found.site.site.name if found.site is not None else None
        notes = [one.as_record(str(path)) for one in (*found.faults, *found.doubts)]
        told = {"faults": notes, "remarks": list(map(str, found.remarks)), "devices": devices}
        show_json({"site": name, "file": str(path), "valid": not found.faults, **told})
        return
    _show_errors([fault.error(str(path)) for fault in found.faults], "red")
    _show_errors([doubt.error(str(path)) for doubt in found.doubts], "yellow")
    for remark in found.remarks:
        echo_folded(remark, 2, colour="yellow")
    if found.faults:
        echo(Message.of("W-CHECK-FAULTS", file=path, count=len(found.faults)), colour="red", bold=True)
        return
    tree = found.site
    counts = {"axes": count_words(len(tree.axes), "axis", "axes")}
    counts["instruments"] = count_words(len(tree.instruments), "instrument", "instruments")
    echo(Message.of("W-CHECK-VALID", file=path, site=tree.site.name, **counts), colour="green")
    if rows:
        show_table("devices", DEVICE_KEYS, rows)


def _show_errors(errors: Sequence[TrueflankError], colour: str) -> None:
    """One line for each; a cure that several in a row share stands once, behind the last of them."""
    for error, following in zip_longest(errors, errors[1:]):
        echo_folded(f"{error.where}: {error.code}: {error.what}", 2, colour=colour)
        if error.hint and (following is None or error.hint != following.hint):
            echo_folded(f"  -> {error.hint}", 5)


# ---- check programs


def program_command(
    site: SiteArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the programs.", show_default=False)],
    what: Annotated[
        str,
        typer.Option(
            help="self-test, measure, load, effect (with --run), proof, backup, grind, off or all; dwell for other "
            "capture programs."
        ),
    ] = "all",
    run: Annotated[
        str, typer.Option(help="Load the tables of this run's proposal and prove their effect.", show_default=False)
    ] = "",
    store: StoreOption = Path("runs"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    dwell: Annotated[float, typer.Option(min=0.1, max=600, help="Dwell: standstill at each target, s.")] = 6.0,
    settling: Annotated[
        float, typer.Option(min=0, max=600, help="Dwell: settling time of the capture program, s.")
    ] = 2.0,
    calibrator_feed: Annotated[float, typer.Option(min=1, help="Dwell: fastest feed of a rotary calibrator.")] = 720.0,
    number: Annotated[
        int,
        typer.Option(min=1, max=999_999_999, help="Program number to insert: that of a sent program, for comparison."),
    ] = 999_999,
    like: Annotated[
        Path | None,
        typer.Option(
            help="A program as it was sent or carried: its numbers are put in, to compare.", show_default=False
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write every program that this site would send, without a control; each is judged by the language's rules."""
    from drivers import registry
    from drivers.errors import ConfigError
    from drivers.programs import DayNumbers
    from gateway.config import load_site
    from gateway.workflow.programs import (
        DwellOptions,
        describe_dwell,
        dwell_plans,
        numbers_in,
        programs,
        target_lists,
        write_programs,
    )
    from gateway.workflow.run.paper_control import ALL_KINDS, SENT_KINDS, known_control

    chosen = tuple(one for one in ALL_KINDS if what == one or (what == "all" and one in SENT_KINDS))
    if not chosen:
        raise ConfigError("E-PROGRAM-WHAT", "--what", given=what, known=", ".join((*ALL_KINDS, "all")))
    tree, wish = load_site(site), DwellOptions(dwell, settling, calibrator_feed)
    numbers = numbers_in(tree, like) if like is not None else DayNumbers(order=number)
    proposal, tooth = _read_proposals(run, store) if run else (None, None)
    written = programs(tree, site, chosen, proposal, tooth=tooth, dwell=wish, numbers=numbers)
    lists: dict[str, str] = {}
    told: list[str] = []
    for axis, plan in dwell_plans(tree, wish) if what == "dwell" else ():
        lists |= target_lists(axis, plan)
        told.append(describe_dwell(axis, plan))
    write_programs({one.name: one.program.text for one in written} | lists, output, force=force)
    if as_json:
        show_json({"folder": str(output), "programs": [one.name for one in written], "lists": list(lists)})
        return
    rows = [(one.what, one.name) for one in written] + [("list", name) for name in lists]
    show_table("programs", ("what", "file"), rows)
    for line in told:
        echo(line)
    echo(Message.of("S-CHECK-PROGRAMS", count=len(written), output=output))
    runs_programs = f"{tree.controller.driver}-paper" in registry.known("paper")
    if what != "dwell" and runs_programs and not known_control(tree, site):
        echo(Message.of("W-PROGRAM-UNKNOWN"))


def _read_proposals(run: str, store: Path) -> tuple[Any, Any]:
    """A run's proposal, and that for its tooth where there is one."""
    from gateway.domain.proposals import Proposal
    from gateway.store import Store
    from gateway.tooth import ToothProposal
    from gateway.workflow.run import stages

    folder = open_run(Store(store), run, "proposal")
    tooth = folder.get(stages.TOOTH, ToothProposal) if folder.has(stages.TOOTH) else None
    return folder.get(stages.PROPOSAL, Proposal), tooth
