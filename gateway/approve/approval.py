"""What an approval binds and who may give it; pure. How many a push needs is `gateway.interlocks`' to say."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from drivers.local.names import person_key
from drivers.types.identity import MachineIdentity
from gateway.domain.proposals import Approval, TableChange
from gateway.errors import WriteRefused
from gateway.interlocks.limits import APPROVED_FOR
from gateway.push import plan_hash

VALID = APPROVED_FOR


def consent(
    change: TableChange,
    machine: MachineIdentity,
    *,
    actor: str,
    typed_name: str,
    site_name: str,
    now_utc: datetime,
    run_id: str = "",
    given: Iterable[Approval] = (),
    kept_by: tuple[str, ...] = (),
) -> Approval:
    """One person's approval of one change on one machine, from now for ten minutes.

    ``run_id`` is the run that proposed it; ``given`` are the approvals of this plan that have not been used.
    Raises WriteRefused: E-APPROVE-NAME (the machine's name was not typed), E-APPROVE-NOTHING (no table is proposed),
    E-APPROVE-TWICE (this person's approval of this plan still holds).
    """
    if typed_name != site_name:
        raise WriteRefused("E-APPROVE-NAME", change.name, typed=typed_name or "nothing", wanted=site_name)
    if change.skipped:
        raise WriteRefused("E-APPROVE-NOTHING", change.name, why=change.skipped)
    plan = plan_hash(change, machine)
    for other in given:
        same = (person_key(other.actor), other.plan_hash) == (person_key(actor), plan)
        if same and now_utc < datetime.fromisoformat(other.expires_utc):
            raise WriteRefused("E-APPROVE-TWICE", change.name, actor=actor, until=other.expires_utc)
    until = (now_utc + VALID).isoformat(timespec="seconds")
    since = now_utc.isoformat(timespec="seconds")
    return Approval(
        actor=actor,
        plan_hash=plan,
        base_digest=change.base_digest,
        serial=machine.serial,
        given_utc=since,
        expires_utc=until,
        run_id=run_id,
        kept_by=kept_by,
    )
