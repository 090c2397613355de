"""`doctor`, `doctor self-test`, `doctor certificate`: whether the control can be reached, trusted and programmed."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.checks import CertificateView, TrustView, gathered
from drivers.clock import Clock, LoopClock
from drivers.errors import ConfigError, words
from drivers.message import Message, advice
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.probes import LEVELS, Level
from gateway.cli.next_steps import after_doctor, next_command, show_next
from gateway.cli.options import RUN_NEEDS, JsonOption, SiteArgument, TakeOption, load_site, require_control
from gateway.cli.output import echo, echo_folded, language, render_text, show_json
from gateway.cli.signals import run_to_end
from gateway.events import DevicesOpened, received

NOT_OK_EXIT = 5
OUTCOME_WORDS: Mapping[str, str | Message] = {
    "ok": "ok",
    "wrong": "WRONG",
    "unknown": Message.of("S-DOC-UNKNOWN"),
    "skipped": "skipped",
}

LevelOption = Annotated[
    str,
    typer.Option(
        "--level",
        help="read: look, nobody acts; program: also start programs that move nothing; motion: also jog each axis.",
    ),
]
ThumbprintOption = Annotated[
    str,
    typer.Option(
        help="Pin the certificate of this full SHA-256 or SHA-1 thumbprint, typed from the control's own display.",
        show_default=False,
    ),
]


def doctor_command(
    site: SiteArgument, level: LevelOption = "read", take: TakeOption = "", as_json: JsonOption = False
) -> None:
    """Examine the control up to a level, line by line; exit code 0 only if all is well."""
    from gateway.broker import take_from_hung_gateway

    tree, given = load_site(site), parse_level(level)
    if given == "write":
        raise ConfigError("E-DOC-WRITE", "--level", site=site)
    if given != "read":
        require_control(tree)
    with take_from_hung_gateway(take):
        results = examine(tree, site, given, as_json=as_json)
    lines = [line for one in results for line in one.lines]
    well = all(line.outcome in ("ok", "skipped") for line in lines)
    if as_json:
        show_json({**report_record(tree, given, results), "ok": well})
    elif tree.controller.driver != "none":
        after_doctor(lines, str(site))
    else:
        show_next(f"day FOLDER --site {site}")
    if not well:
        raise typer.Exit(NOT_OK_EXIT)


def examine(tree: Any, site: Path, level: Level, *, as_json: bool, above: bool = False) -> Sequence[Any]:
    """Every check of a site up to a level, shown as it ends; ``above``: the higher ones too, as skipped."""
    from gateway.acceptance.checks import SiteDesk, examine_site

    told: set[str] = set()

    def say(code: str, /, **fields: object) -> None:
        """Each check opens the control anew; what it says of it is told once."""
        line = words(code, **fields)
        if not as_json and (not isinstance(received(code, fields), DevicesOpened) or line not in told):
            echo(f"  {line}")
        told.add(line)

    def show(result: Any) -> None:
        for line in () if as_json else gathered(result.lines):
            colour = {"ok": "green", "wrong": "red"}.get(line.outcome, "yellow")
            head = f"{render_text(OUTCOME_WORDS[line.outcome]):<14} {line.check}: "
            echo_folded(f"{head}{render_text(Message(line.code, line.fields))}", 15, colour=colour)
            if line.fix:
                echo_folded(f"{'':<14} -> {advice(line.message, language())}", 18)

    desk = SiteDesk(tree, site, LoopClock(), say)
    return run_to_end(examine_site(desk, level, show, above=above), at=site)


def report_record(tree: Any, level: Level, results: Sequence[Any]) -> dict[str, Any]:
    """An examination as data."""
    return {"site": tree.site.name, "level": level, "lines": [line for one in results for line in one.as_records()]}


def parse_level(text: str) -> Level:
    """A level as it was typed. Raises ConfigError (E-ACCEPT-LEVEL)."""
    for one in LEVELS:
        if text == one:
            return one
    raise ConfigError("E-ACCEPT-LEVEL", "--level", given=text, known=", ".join(LEVELS))


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

    tree = load_site(site)
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


def show_certificates(view: TrustView, *, as_json: bool) -> None:
    """A certificate beside the pinned one."""
    if as_json:
        named = {"shown": view.shown, "pinned": view.pinned, "own": view.own}
        data: dict[str, Any] = {name: certificate_record(one) if one else None for name, one in named.items()}
        data |= {"url": view.url, "file": view.place, "equal": view.equal}
        show_json({**data, "accepted_by": view.accepted_by, "accepted_utc": view.accepted_utc, "reason": view.reason})
        return
    echo(view.url)
    for title, one in (
        (Message.of("S-DOC-SHOWN-CERTIFICATE"), view.shown),
        (Message.of("S-DOC-PINNED-CERTIFICATE"), view.pinned),
        (Message.of("S-DOC-OWN-CERTIFICATE"), view.own),
    ):
        if one is not None:
            valid = {"begin": f"{one.valid_from:%Y-%m-%d}", "end": f"{one.valid_until:%Y-%m-%d}"}
            echo(Message.of("S-DOC-CERTIFICATE", title=title, subject=one.subject, **valid))
            echo(f"  SHA-256 {one.sha256}\n  SHA-1   {one.sha1}")
    code = "W-TRUST-EQUAL" if view.equal else "W-TRUST-CHANGED" if view.pinned else "W-TRUST-NONE"
    who = f"{view.accepted_by}, {view.accepted_utc}" if view.accepted_by else Message.of("W-DOC-BY-NOBODY")
    echo(Message.of(code, file=view.place, who=who))
    if view.reason:
        echo(Message.of("W-TRUST-EXCUSED", who=who, reason=view.reason))
    if not view.equal:
        echo(f"  -> {advice(Message.of(code, file=view.place, who=who), language())}")


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
    from gateway.workflow.run.self_test import self_test_site

    tree, used = load_site(site), clock or LoopClock()
    with progress(quiet=quiet, at=(tree, site), own_operator=own_operator) as say:

        async def main() -> Any:
            return await self_test_site(tree, site, axis=axis, clock=used, say=say)

        with exchange_files_for(PieceOfWork(f"self-test {axis}", "go-on", ends=True)):
            return run_to_end(main(), at=site)
