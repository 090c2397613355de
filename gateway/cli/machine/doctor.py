"""`doctor`, `doctor self-test`, `doctor certificate`: whether the control can be reached, trusted and programmed."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers import registry
from drivers.checks import CertificateView, CheckLine, TrustView, Wanted, WantedAxis, fine, gathered, unknown, wrong
from drivers.clock import Clock, LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.stale_programs import Sent
from gateway.cli.next_steps import after_doctor, next_command, show_next
from gateway.cli.options import RUN_NEEDS, JsonOption, SiteArgument, TakeOption
from gateway.cli.output import echo, echo_folded, show_json
from gateway.cli.signals import run_to_end

NOT_OK_EXIT = 5
OUTCOME_WORDS = {"ok": "ok", "wrong": "WRONG", "unknown": "could not tell"}

ThumbprintOption = Annotated[
    str,
    typer.Option(
        help="Pin the certificate of this full SHA-256 or SHA-1 thumbprint, typed from the control's own display.",
        show_default=False,
    ),
]


def doctor_command(site: SiteArgument, take: TakeOption = "", as_json: JsonOption = False) -> None:
    """Look at the road to the control, line by line, and change nothing; exit code 0 only if all is well."""
    tree = _load_site(site)
    lines = run_to_end(_examine_borrowed(tree, site, take), at=site)
    well = all(line.outcome == "ok" for line in lines)
    if as_json:
        show_json({"site": tree.site.name, "ok": well, "lines": [line.as_record() for line in lines]})
    else:
        for line in gathered(lines):
            colour = {"ok": "green", "wrong": "red"}.get(line.outcome, "yellow")
            echo_folded(f"{OUTCOME_WORDS[line.outcome]:<14} {line.check}: {line.what}", 15, colour=colour)
            if line.fix:
                echo_folded(f"{'':<14} -> {line.fix}", 18)
        after_doctor(lines, str(site)) if tree.controller.driver != "none" else show_next(f"day FOLDER --site {site}")
    if not well:
        raise typer.Exit(NOT_OK_EXIT)


async def _examine_borrowed(tree: Any, site: Path, take: str) -> tuple[CheckLine, ...]:
    """The lines, with the devices borrowed from a gateway that serves this site, or taken from one that hangs."""
    from gateway.broker import borrow_devices, take_from_hung_gateway
    from gateway.workflow.run.folder import store_of

    clock = LoopClock()
    with take_from_hung_gateway(take):
        async with borrow_devices(store_of(tree, site).root, "doctor", clock):
            return await examine_control(tree, site, clock)


async def examine_control(tree: Any, site: Path, clock: Clock) -> tuple[CheckLine, ...]:
    """Every line: the road to the control, the self-tests kept, pushes that did not end. Writes nothing."""
    from gateway.workflow.run.folder import known_of, store_of

    known = known_of(tree, store_of(tree, site).root)
    sought = wanted_control(tree, sent_programs(tree, site), known.facts)
    lines = await control_port(tree, "doctor", clock).examine(sought, tree.controller.timeout_s)
    excused = [fine("W-DOC-ACCEPTED", "identity", **one.fields) for one in known.accepted]
    return (
        *lines,
        *excused,
        *stored_self_tests(tree, site, lines),
        *unfinished_pushes(tree, site),
        *report_font_line(tree.report.language),
    )


ReasonOption = Annotated[
    str,
    typer.Option(
        help="Reason for accepting a certificate that is not valid now; stored, and shown by doctor and reports.",
        show_default=False,
    ),
]


def certificate_command(
    site: SiteArgument, thumbprint: ThumbprintOption = "", reason: ReasonOption = "", as_json: JsonOption = False
) -> None:
    """What the server shows now, what is pinned, and whether they are equal; with a thumbprint, pin what it shows.

    Exit code 5 where they are not equal.
    """
    from gateway import audit
    from gateway.workflow.run.identity import accept_certificate, shown_certificate

    tree = _load_site(site)
    if thumbprint:
        who = audit.acting_person()
        work = accept_certificate(tree, site, thumbprint, who=who, clock=LoopClock(), reason=reason)
    elif reason:
        raise typer.BadParameter("--reason is for --thumbprint: give both", param_hint="--reason")
    else:
        work = shown_certificate(tree, LoopClock())
    view = run_to_end(work, at=site)
    show_certificates(view, as_json=as_json)
    if not view.equal:
        raise typer.Exit(NOT_OK_EXIT)


def _load_site(site: Path) -> Any:
    """The site file. Raises ConfigError."""
    from gateway.config import load_site

    return load_site(site)


def control_port(tree: Any, role: str, clock: Clock) -> Any:
    """What a role of the site's control is, by its driver's name. Raises ConfigError (E-CFG-DRIVER)."""
    controller = tree.controller
    if controller.driver == "none" and role != "doctor":
        raise ConfigError("E-FILES-ONLY", tree.site.name)
    factory = registry.load(f"{controller.driver}-{role}", role)
    return factory(tree.site.name, controller.url, controller.settings, clock)


def sent_programs(tree: Any, site: Path) -> tuple[Sent, ...]:
    """Every program this store sent to the control; none while a gateway is at work with them."""
    from gateway.push import JOURNALS, SentProgramBook
    from gateway.workflow.run.folder import store_of

    book = SentProgramBook(store_of(tree, site).root / JOURNALS, tree.controller.serial)
    return () if book.at_work() else book.known()


def unfinished_pushes(tree: Any, site: Path) -> tuple[CheckLine, ...]:
    """A line for each push of this store that did not end and that nobody is at work with, the loud ones first."""
    from gateway.push import JOURNALS, held_pushes
    from gateway.workflow.run.folder import store_of

    return tuple(wrong(one.code, "journal", **one.fields) for one in held_pushes(store_of(tree, site).root / JOURNALS))


def stored_self_tests(tree: Any, site: Path, seen: Sequence[CheckLine]) -> tuple[CheckLine, ...]:
    """The last self-test of each axis as this store knows it: that is what a push asks for.

    ``seen`` is what was found of the control just now: a test of another version of it does not count.
    """
    from gateway.store.machine_books import SelfTestBook
    from gateway.workflow.run.folder import store_of

    if f"{tree.controller.driver}-paper" not in registry.known("paper"):
        return ()  # no programs of ours run on this road
    now = next((str(line.fields["version"]) for line in seen if line.code == "W-DOC-SERIAL"), "")
    known = SelfTestBook(store_of(tree, site).root).all(tree.controller.serial)
    last = {(one.axis, one.encoder): one for one in known}
    return tuple(self_test_line(axis.name, last.get((axis.name, axis.encoder)), now) for axis in tree.axes)


def report_font_line(language: str) -> tuple[CheckLine, ...]:
    """Which font of this computer writes Chinese in a report; a fault only where the site's reports need it."""
    try:
        from gateway.report.document.pdf import CJK_FONTS, NEED_CJK, cjk_font
    except ModuleNotFoundError:
        return ()  # the extra that makes reports is not installed here
    found = cjk_font()
    if found:
        return (fine("W-DOC-FONT", "report font", font=found),)
    if language in NEED_CJK:
        return (wrong("E-DOC-FONT", "report font", language=language, fonts=", ".join(CJK_FONTS)),)
    return (fine("W-DOC-FONT-NONE", "report font"),)


def self_test_line(axis: str, test: Any, now: str) -> CheckLine:
    """A kept self-test (None: never made) as a line: passed, not passed, of another version."""
    if test is None:
        return unknown("W-DOC-UNTESTED", "self-test kept", axis=axis)
    fields = {"axis": axis, "date": test.utc, "version": test.machine.version}
    if now and test.machine.version != now:
        return wrong("E-DOC-TESTED-OTHER", "self-test kept", now=now, **fields)
    if test.ok:
        return fine("W-DOC-TESTED", "self-test kept", passed=len(test.passed), **fields)
    return wrong("E-DOC-TESTED", "self-test kept", missed=test.missed, **fields)


def wanted_control(tree: Any, sent: tuple[Sent, ...] = (), facts: Mapping[str, str] | None = None) -> Wanted:
    """What the site expects of its control; ``sent`` are the programs that were sent there.

    ``facts`` are what its machine is known by; without them the serial number of the site file alone.
    """
    known = facts or {}
    axes = tuple(
        WantedAxis(axis.name, axis.unit, axis.encoder, table_points(axis.table), encoder_said=axis.encoder_said)
        for axis in tree.axes
        if getattr(axis, "table", None) is not None
    )
    serial = known.get("serial", tree.controller.serial)
    return Wanted(serial, axes, sent, access_level=tree.controller.access_level, facts=known)


def table_points(table: Any) -> int:
    """Interpolation points of a site's table."""
    return round((table.maximum - table.minimum) / table.step) + 1


def show_certificates(view: TrustView, *, as_json: bool) -> None:
    """A certificate beside the pinned one."""
    if as_json:
        named = {"shown": view.shown, "pinned": view.pinned, "own": view.own}
        data: dict[str, Any] = {name: certificate_record(one) if one else None for name, one in named.items()}
        data |= {"url": view.url, "file": view.place, "equal": view.equal}
        show_json({**data, "accepted_by": view.accepted_by, "accepted_utc": view.accepted_utc, "reason": view.reason})
        return
    echo(view.url)
    for title, one in (("shown now", view.shown), ("pinned", view.pinned), ("this gateway's own", view.own)):
        if one is not None:
            echo(f"{title}: {one.subject}, valid {one.valid_from:%Y-%m-%d} to {one.valid_until:%Y-%m-%d}")
            echo(f"  SHA-256 {one.sha256}\n  SHA-1   {one.sha1}")
    code = "W-TRUST-EQUAL" if view.equal else "W-TRUST-CHANGED" if view.pinned else "W-TRUST-NONE"
    who = f"{view.accepted_by}, {view.accepted_utc}" if view.accepted_by else "a person not recorded"
    echo(Message.of(code, file=view.place, who=who))
    if view.reason:
        echo(Message.of("W-TRUST-EXCUSED", who=who, reason=view.reason))
    if not view.equal:
        echo(f"  -> {TrueflankError(code, file=view.place, who=who).hint}")


def certificate_record(view: CertificateView) -> dict[str, str]:
    """A certificate as data."""
    dates = {"valid_from": view.valid_from.isoformat(), "valid_until": view.valid_until.isoformat()}
    return {"subject": view.subject, "sha256": view.sha256, "sha1": view.sha1, **dates}


def self_test_command(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="This machine axis only.", show_default=False)] = "",
    as_json: JsonOption = False,
) -> None:
    """Let the control try every word of our programs: you start it, nothing moves, the outcome is kept."""
    from gateway.cli.next_steps import show_outcome

    show_outcome(run_self_test(site, axis, quiet=as_json), as_json=as_json, onward=_after_self_test(site))


def _after_self_test(site: Path) -> str:
    """What to type after a self-test: the push that asked for it, where its run is the latest; else a run."""
    from gateway.config import load_site
    from gateway.errors import StoreError
    from gateway.store import LATEST, Needs
    from gateway.workflow.run.folder import store_of

    with contextlib.suppress(StoreError):
        latest = store_of(load_site(site), site).open(LATEST, Needs(*RUN_NEEDS["proposal"][:2])).summary()
        if latest.state == "proposed":
            return next_command("proposed", run=latest.path)
    return next_command("outdated", site=site)


def run_self_test(
    site: Path, axis: str = "", *, quiet: bool, clock: Clock | None = None, own_operator: bool = False
) -> Any:
    """Test a site's control, and what came of it; the demo does this first, as anybody must."""
    from gateway.cli.progress import progress
    from gateway.cli.signals import run_to_end
    from gateway.config import load_site
    from gateway.workflow.run.self_test import self_test_site

    tree, used = load_site(site), clock or LoopClock()
    with progress(quiet=quiet, at=(tree, site), own_operator=own_operator) as say:

        async def main() -> Any:
            return await self_test_site(tree, site, axis=axis, clock=used, say=say)

        with exchange_files_for(PieceOfWork(f"self-test {axis}", "go-on", ends=True)):
            return run_to_end(main(), at=site)
