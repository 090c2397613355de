"""The command `trust machine`, and the question of every command whose machine has one fact that is another."""

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
from gateway.cli.control.connecting import NOT_ALL_WELL
from gateway.cli.options import JsonOption, SiteArgument, load_site, with_control
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end

AcceptIdentityOption = Annotated[
    list[str] | None,
    typer.Option(
        "--accept-identity",
        help="FACT=REASON: it is the same machine although this fact changed; stored, and shown by doctor and reports.",
        show_default=False,
    ),
]
AskIdentityOption = Annotated[bool, typer.Option("--ask/--no-ask", help="Ask about one changed fact, or refuse.")]
SELF_TEST = PieceOfWork("self-test ", "go-on", ends=True)
"""Its first program is the one that shows the control, so the one goes on with the other's files."""
HEADS = ("fact", "known", "now")


def machine_command(
    site: SiteArgument,
    accept_identity: AcceptIdentityOption = None,
    ask: AskIdentityOption = True,
    as_json: JsonOption = False,
) -> None:
    """What the machine is known by, what its control says now, and what was accepted; accept one fact that changed."""
    from gateway.supervisor import refusal_of
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    with_control(tree)
    if accept_identity:
        _accept(tree, site, accept_identity, quiet=as_json)
    machine, found, known = _looked(tree, store_of(tree, site).root)
    if found.is_asked and ask and not as_json and not accept_identity:
        _ask(refusal_of(found, str(site)), tree, site)
        machine, found, known = _looked(tree, store_of(tree, site).root)
    if as_json:
        accepted = [one.fields for one in known.accepted]
        show_json({"known": dict(known.facts), "now": dict(machine.facts), "accepted": accepted, "ok": found.is_known})
    else:
        rows = [(fact, known.facts.get(fact, "-"), machine.facts.get(fact, "-")) for fact in FACTS]
        show_table(tree.site.name, HEADS, rows)
        for one in known.accepted:
            echo(Message.of("W-DOC-ACCEPTED", **one.fields))
        if not found.is_known:
            refused = refusal_of(found, str(site))
            echo(f"{refused.what}\n  -> {refused.hint}", colour="red")
    if not found.is_known:
        raise typer.Exit(NOT_ALL_WELL)


def _looked(tree: Any, root: Path) -> Any:
    """Who the machine says it is. With a control that files are carried to it ends, and says what to carry."""
    from gateway.workflow.run.identity import read_identity

    with exchange_files_for(SELF_TEST):
        return run_to_end(read_identity(tree, root, LoopClock()))


def answered(error: TrueflankError, given: Mapping[str, Any]) -> bool:
    """Whether a person said that the machine is the same although one fact is another, so that a command goes on.

    Without anybody at the terminal, or for JSON, the refusal stands: it is raised.
    """
    site = Path(str(error.fields.get("site", "")))
    if error.code != "E-SUP-IDENTITY" or given.get("as_json") or not given.get("ask", True) or site.suffix != ".toml":
        return False
    _ask(error, load_site(site), site)
    return True


def _ask(error: TrueflankError, tree: Any, site: Path) -> None:
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
    _accept(tree, site, [f"{error.fields['fact']}={reason}"])


def _accept(tree: Any, site: Path, texts: list[str], *, quiet: bool = False) -> None:
    from gateway import audit
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.run.identity import accept_identity

    work = accept_identity(tree, site, store_of(tree, site), texts, who=audit.acting_person(), clock=LoopClock())
    with exchange_files_for(SELF_TEST):
        kept = run_to_end(work)
    if not quiet:
        echo(Message.of("W-DOC-ACCEPTED", **kept.fields))
