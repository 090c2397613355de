"""The command `check`: everything a site file alone can tell, then its devices and the control's own limits."""

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
from gateway.cli.options import JsonOption, SiteArgument
from gateway.cli.show import counted, echo, say_line, show_json, show_table
from gateway.cli.stopping import run_to_end

CARRIED = "carried"
WRONG_FILE = ConfigError.exit_code
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


def check_command(
    site: SiteArgument,
    connect: Annotated[
        bool, typer.Option("--connect", help="Also open every device and compare the control's own limits.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say everything that is wrong in a site file; with --connect ask every device it names, and move nothing."""
    from gateway.config import with_positions

    found = checked(site)
    rows: Sequence[tuple[str, ...]] = ()
    if connect and not found.faults:
        # A control that files are carried to answers another day: the command ends and says what to carry. It is the
        # program that a self-test carries first, so the one goes on with the other's files.
        with exchange_files_for(PieceOfWork("self-test ", "go-on", ends=True)):
            rows, limits = run_to_end(asked(found.site, site), at=site)
        found = replace(found, faults=in_order(with_positions(limits, found.text)))
    tell(found, site, rows, as_json=as_json)
    if not as_json:
        lead_on(found, site, connected=connect)
    if found.faults:
        raise typer.Exit(WRONG_FILE)


def lead_on(found: CheckedSite, path: Path, *, connected: bool) -> None:
    """Say what to type after a check: the same again, the devices, the doctor, or the files of who has no wire."""
    from gateway.cli.onward import next_step, repeat
    from gateway.config import by_files

    if found.faults:
        repeat(f"check {path}")
    elif urlsplit(found.site.controller.url).scheme == CARRIED and not connected:
        next_step(f"self-test {path}")
    elif by_files(found.site):
        next_step(f"day FOLDER --site {path}")
    else:
        next_step(f"doctor {path}" if connected else f"check {path} --connect")


def checked(path: Path) -> CheckedSite:
    """The file, and the files it names, judged. Raises ConfigError (E-CFG-READ, E-CFG-ENCODING)."""
    from gateway.cli.begin.ondisk import disk_faults
    from gateway.config import read_site, with_absolute_paths, with_positions

    reading = read_site(path)
    disk = with_positions(disk_faults(reading, path), reading.text)
    found = (*reading.faults, *reading.doubts, *disk)
    faults = tuple(one for one in found if is_fault(one))
    doubts = tuple(one for one in found if not is_fault(one))
    site = with_absolute_paths(reading.site, path.parent) if reading.site is not None else None
    return CheckedSite(site, in_order(faults), in_order(doubts), reading.text)


def is_fault(one: Any) -> bool:
    """Whether it refuses the file: an error's code does, however it was found."""
    return not one.doubt or one.code.startswith("E-")


def in_order(faults: Sequence[Any]) -> tuple[Any, ...]:
    """As they stand in the file."""
    return tuple(sorted(faults, key=lambda one: (one.line, one.column)))


async def asked(site: Any, path: Path) -> tuple[Sequence[tuple[str, ...]], tuple[Any, ...]]:
    """Every device's identity, and what the control says against the file; a service that has the devices lends them.

    Raises DevicesFailed, and what `gateway.broker.borrow_devices` raises.
    """
    from gateway.broker import borrow_devices
    from gateway.cli.begin.surveying import surveyed
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
        facts = await surveyed(control.driver, control.url, control.settings, clock=clock, timeout_s=control.timeout_s)
    rows: list[tuple[str, ...]] = [
        (one.name, one.identity.model, one.identity.serial, one.identity.firmware) for one in seen if one.identity
    ]
    return rows, tuple(against_control(site, facts))


def against_control(site: Any, facts: ControlFacts) -> Iterator[Any]:
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
            reached = {"travel": span, "table": (axis.table.minimum, axis.table.maximum), "targets": reach(axis)}
            for what, (first, last) in reached.items():
                if first < low - 1e-6 or last > high + 1e-6:
                    ends = {"what": what, "first": first, "last": last, "low": low, "high": high}
                    yield Fault(("axes", number, what), "E-CFG-CONTROL-LIMITS", {**fields, **ends})


def reach(axis: Any) -> tuple[float, float]:
    """How far measuring moves an axis: its outer targets and the overrun beyond them."""
    from gateway.capture.targets import positions

    measure = axis.measure
    if measure.targets is None:
        return axis.table.minimum, axis.table.maximum
    at = positions(measure.targets, axis.reference, rotary=axis.kind == "rotary")
    return float(at[0]) - measure.overrun, float(at[-1]) + measure.overrun


def tell(found: CheckedSite, path: Path, rows: Sequence[tuple[str, ...]], *, as_json: bool) -> None:
    """The verdict for people, or as data."""
    if as_json:
        devices = [dict(zip(DEVICE_KEYS, row, strict=True)) for row in rows]
        name = found.site.site.name if found.site is not None else None
        notes = [one.as_record(str(path)) for one in (*found.faults, *found.doubts)]
        told = {"faults": notes, "remarks": list(map(str, found.remarks)), "devices": devices}
        show_json({"site": name, "file": str(path), "valid": not found.faults, **told})
        return
    _lines([fault.error(str(path)) for fault in found.faults], "red")
    _lines([doubt.error(str(path)) for doubt in found.doubts], "yellow")
    for remark in found.remarks:
        say_line(remark, 2, colour="yellow")
    if found.faults:
        echo(Message.of("W-CHECK-FAULTS", file=path, count=len(found.faults)), colour="red", bold=True)
        return
    tree = found.site
    counts = {"axes": counted(len(tree.axes), "axis", "axes")}
    counts["instruments"] = counted(len(tree.instruments), "instrument", "instruments")
    echo(Message.of("W-CHECK-VALID", file=path, site=tree.site.name, **counts), colour="green")
    if rows:
        show_table("devices", DEVICE_KEYS, rows)


def _lines(errors: Sequence[TrueflankError], colour: str) -> None:
    """One line for each; a cure that several in a row share stands once, behind the last of them."""
    for error, following in zip_longest(errors, errors[1:]):
        say_line(f"{error.where}: {error.code}: {error.what}", 2, colour=colour)
        if error.hint and (following is None or error.hint != following.hint):
            say_line(f"  -> {error.hint}", 5)
