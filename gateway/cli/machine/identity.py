"""The command `doctor identity`, and the question that any command asks when one fact of the machine changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.errors import TrueflankError, words
from drivers.local.names import visible
from drivers.message import Message
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.types.identity import FACTS
from gateway.cli.machine.doctor import NOT_OK_EXIT
from gateway.cli.options import JsonOption, SiteArgument, load_site, require_control
from gateway.cli.output import echo, show_json, show_table
from gateway.cli.signals import run_to_end

AcceptIdentityOption = Annotated[
    list[str] | None,
    typer.Option(
        "--accept-identity",
        help="FACT=REASON: it is the same machine although this fact changed; stored, and shown by doctor and reports.",
        show_default=False,
    ),
]
AskIdentityOption = Annotated[bool, typer.Option("--ask/--no-ask", help="Ask about one changed fact, or refuse.")]
SELF_TEST_FILES = PieceOfWork("self-test ", "go-on", ends=True)
"""Its first program is the one that shows the control, so the one goes on with the other's files."""
IDENTITY_HEADINGS = ("fact", "known", "now")


def identity_command(
    site: SiteArgument,
    accept_identity: AcceptIdentityOption = None,
    ask: AskIdentityOption = True,
    as_json: JsonOption = False,
) -> None:
    """What the machine is known by, what its control says now, and what was accepted; accept one fact that changed."""
    from gateway.supervisor import refusal_of
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    require_control(tree)
    if accept_identity:
        _accept_facts(tree, site, accept_identity, quiet=as_json)
    machine, found, known = _read_identity(tree, store_of(tree, site).root)
    if found.is_asked and ask and not as_json and not accept_identity:
        _ask_same_machine(refusal_of(found, str(site)), tree, site)
        machine, found, known = _read_identity(tree, store_of(tree, site).root)
    if as_json:
        accepted = [one.fields for one in known.accepted]
        show_json({"known": dict(known.facts), "now": dict(machine.facts), "accepted": accepted, "ok": found.is_known})
    else:
        rows = [(fact, known.facts.get(fact, "-"), machine.facts.get(fact, "-")) for fact in FACTS]
        show_table(tree.site.name, IDENTITY_HEADINGS, rows)
        for one in known.accepted:
            echo(Message.of("W-DOC-ACCEPTED", **one.fields))
        if not found.is_known:
            refused = refusal_of(found, str(site))
            echo(f"{refused.what}\n  -> {refused.hint}", colour="red")
    if not found.is_known:
        raise typer.Exit(NOT_OK_EXIT)


def _read_identity(tree: Any, root: Path) -> Any:
    """Who the machine says it is. With a control that files are carried to it ends, and says what to carry."""
    from gateway.workflow.run.identity import read_identity

    with exchange_files_for(SELF_TEST_FILES):
        return run_to_end(read_identity(tree, root, LoopClock()))


def accept_changed_fact(error: TrueflankError, given: Mapping[str, Any]) -> bool:
    """Whether a person said that the machine is the same although one fact is another, so that a command goes on.

    Without anybody at the terminal, or for JSON, the refusal stands: it is raised.
    """
    site = Path(str(error.fields.get("site", "")))
    if error.code != "E-SUP-IDENTITY" or given.get("as_json") or not given.get("ask", True) or site.suffix != ".toml":
        return False
    _ask_same_machine(error, load_site(site), site)
    return True


def _ask_same_machine(error: TrueflankError, tree: Any, site: Path) -> None:
    """The question; yes with a reason is kept. Raises the refusal itself for no, and where nobody answers."""
    same, why = words("P-IDENTITY-SAME"), words("P-IDENTITY-WHY")
    echo(error.what)
    try:
        if not typer.confirm(f"  {visible(same)}", default=False, err=True):
            raise error
        reason = typer.prompt(f"  {visible(why)}", err=True, default="", show_default=False)
    except typer.Abort:
        raise error from None
    if not reason.strip():
        raise error
    _accept_facts(tree, site, [f"{error.fields['fact']}={reason}"])


def _accept_facts(tree: Any, site: Path, texts: list[str], *, quiet: bool = False) -> None:
    from gateway import audit
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.run.identity import accept_identity

    work = accept_identity(tree, site, store_of(tree, site), texts, who=audit.acting_person(), clock=LoopClock())
    with exchange_files_for(SELF_TEST_FILES):
        kept = run_to_end(work)
    if not quiet:
        echo(Message.of("W-DOC-ACCEPTED", **kept.fields))
