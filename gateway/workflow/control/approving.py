"""A person's approval of a stored plan: shown as a push would show it, bound to what was shown, kept and recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.message import Message
from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.domain.proposals import Approval, Proposal, TableChange
from gateway.errors import NotSignedIn, WriteRefused
from gateway.say import Say
from gateway.store import RunFolder
from gateway.store.records import encode, sha256
from gateway.users import KeyRing, Signer, UserAccounts
from gateway.workflow import stages
from gateway.workflow.consents import demand_todays
from gateway.workflow.control.pushing import push_run
from gateway.workflow.outcome import Outcome
from gateway.workflow.runsite import site_of, store_of


async def show_plan(folder: RunFolder, *, table: str = "", clock: Clock, say: Say) -> Outcome:
    """The plan against the live machine, with every warning and refusal; writes nothing. Raises as `push_run`.

    ``table`` is the one to be approved ("": all). Raises as `approve_plan`, before a device is opened.
    """
    _wanted(folder.get(stages.PROPOSAL, Proposal), table, folder)
    return await push_run(folder, apply=False, machine_name="", clock=clock, say=say)


async def approve_plan(
    folder: RunFolder,
    *,
    table: str,
    typed_name: str,
    clock: Clock,
    actor: str = "",
    kept_by: tuple[str, ...] = (),
    signer: Signer | None = None,
) -> tuple[Approval, ...]:
    """Approve the proposed tables of a run, or the one named by its name, as ``actor`` (who acts).

    ``kept_by`` are those who may know that person's secret (`Approval.kept_by`), ``signer`` that person's key: where
    people of the store have keys nobody approves without one. Who has an account approves in its name, also at a
    keyboard.

    Each approval holds ten minutes, for this plan on this machine, for one push. Raises WriteRefused (E-APPROVE-...)
    with nothing approved, ConfigError (E-RUN-AXIS), CorruptRecord (E-AUDIT-BROKEN), StoreError.
    """
    site, path = site_of(folder)
    root = store_of(site, path).root
    ring = KeyRing(root)
    person = ring.person_named(actor or audit.acting_person())
    if signer is None and ring.signs:
        raise WriteRefused("E-APPROVE-KEY", person, actor=person)
    proposal = folder.get(stages.PROPOSAL, Proposal)
    demand_todays(folder)
    kept = Approvals(folder.path)
    audit.require_sound(root)
    made = [
        give_consent(
            change,
            proposal.machine,
            actor=person,
            typed_name=typed_name,
            site_name=site.site.name,
            now_utc=clock.utc(),
            run_id=folder.run_id,
            given=kept.read_unused(),
            kept_by=kept_by,
        )
        for change in _wanted(proposal, table, folder)
    ]
    for approval in (_signed(one, signer) for one in made):
        # The record comes first: an approval nobody can look up later must not exist.
        audit.record(
            root,
            "approve",
            clock=clock,
            actor=person,
            role="approver",
            serial=approval.serial,
            plan_hash=approval.plan_hash,
            base_hash=approval.base_digest,
            details={"run": folder.run_id, "approval": sha256(encode(approval)), "until": approval.expires_utc},
        )
        kept.keep(approval)
    return tuple(made)


def _signed(approval: Approval, signer: Signer | None) -> Approval:
    if signer is None:
        return approval
    named = replace(approval, key=signer.public)
    return replace(named, signature=signer.signature_of(Approvals.signed_form(named)))


def signer_at_keyboard(
    folder: RunFolder, utc: datetime, ask: Callable[[Message], str]
) -> tuple[Signer | None, tuple[str, ...]]:
    """The key of who approves at a keyboard, where the people of its store sign, and who may know that secret.

    It is that of the account of this computer's person. ``ask`` is given a question and answers
    with the secret, or with the second factor's code. None where nobody at this store has a key.
    Raises SignInRefused (E-USER-...), WriteRefused (E-APPROVE-KEY), StoreError.
    """
    site, path = site_of(folder)
    ring = KeyRing(store_of(site, path).root)
    if not ring.signs:
        return None, ()
    accounts, name = UserAccounts(ring.accounts_root), ring.person_named(audit.acting_person())
    account = accounts.find(name)
    if account is None or account.key is None:
        raise WriteRefused("E-APPROVE-KEY", name, actor=name)
    secret = ask(Message.of("P-APPROVE-SECRET", name=name))
    try:
        signer = accounts.by_secret(name, pin=secret).signer if account.pin else None
    except NotSignedIn:
        signer = None
    signer = signer or accounts.by_secret(name, password=secret).signer
    if account.factor:
        accounts.take_code(name, ask(Message.of("P-APPROVE-CODE", name=name)), utc)
    return signer, account.kept_by(utc)


def _wanted(proposal: Proposal, table: str, folder: RunFolder) -> list[TableChange]:
    known = [change.name for change in proposal.changes]
    if table and table not in known:
        raise ConfigError("E-RUN-AXIS", str(folder.path), axis=table, known=", ".join(known))
    named = [change for change in proposal.changes if change.name == table]
    found = named or [change for change in proposal.changes if not change.skipped]
    if not found:
        why = tuple(one.skipped for one in proposal.changes if one.skipped)
        raise WriteRefused("E-APPROVE-NOTHING", folder.run_id, why=why)
    return found
