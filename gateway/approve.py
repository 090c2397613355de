"""A person's consent to exactly one plan on one machine: ten minutes long, used once, never given by the pusher."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from drivers.local.names import person_key
from drivers.local.ownfiles import open_own, sync_folder
from drivers.types.identity import MachineIdentity
from drivers.types.uptime import Uptime
from gateway.domain.proposals import Approval, TableChange
from gateway.errors import CorruptRecord, WriteRefused
from gateway.interlocks import APPROVED_FOR
from gateway.push import plan_hash
from gateway.store import checked_name, decode, disk_errors, encode, make_folder, read_whole, sha256, write_whole

# What an approval binds and who may give it. `gateway.interlocks` decides how many a push needs.

VALID = APPROVED_FOR


def give_consent(
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
    uptime: Uptime = Uptime(),
) -> Approval:
    """One person's approval of one change on one machine, from now for ten minutes.

    ``run_id`` is the run that proposed it; ``given`` are the approvals of this plan that have not been used;
    ``uptime`` is now by this computer's own count.
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
        age_s = other.age_s(uptime)
        holds = now_utc < datetime.fromisoformat(other.expires_utc) if age_s is None else age_s < VALID.total_seconds()
        if same and holds:
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
        given_at=uptime,
    )


# Each approval is a file named by its hash; using it creates a second file, which cannot be created twice.

FOLDER = "approvals"


class Approvals:
    """The approvals of one run. They stand beside `run.json`, so that two people never overwrite each other."""

    def __init__(self, run: Path) -> None:
        self._folder = Path(run) / FOLDER

    def keep(self, approval: Approval) -> str:
        """Keep an approval for good; returns its hash. Raises StoreError (E-STORE-DISK)."""
        data = encode(approval)
        digest = sha256(data)
        make_folder(self._folder)
        write_whole(self._path(digest), data)
        return digest

    def read_unused(self, plan_hash: str = "") -> tuple[Approval, ...]:
        """Approvals (of one plan) that no push has used, oldest first, expired ones too.

        This goes by the marks; a mark can be deleted, so whether one is used is the audit log's to say.
        Raises CorruptRecord (E-STORE-HASH) when one was altered.
        """
        with disk_errors(self._folder):
            names = os.listdir(self._folder) if self._folder.is_dir() else []
        fresh = [name for name in names if name.endswith(".json") and f"{name}.used" not in names]
        found = [_read(self._folder / name) for name in fresh]
        wanted = [approval for approval in found if plan_hash in ("", approval.plan_hash)]
        return tuple(sorted(wanted, key=lambda approval: (approval.given_utc, approval.actor)))

    @staticmethod
    def signed_form(approval: Approval) -> bytes:
        """What of an approval is signed: all but the signature."""
        return b"trueflank approval 1\n" + encode(replace(approval, signature=""))

    @staticmethod
    def digest(approval: Approval) -> str:
        """The hash that names an approval."""
        return sha256(encode(approval))

    def use(self, approvals: tuple[Approval, ...], used_by: str) -> None:
        """Use them up, durably, before anything is written to a machine; ``used_by`` says for what.

        Raises WriteRefused (E-APPROVE-USED) when one has been used before, also by a push that began at the same
        moment; StoreError (E-STORE-DISK).
        """
        for approval in approvals:
            path = self._path(sha256(encode(approval)))
            self._mark(path.with_name(f"{path.name}.used"), approval, used_by)

    def _mark(self, path: Path, approval: Approval, used_by: str) -> None:
        with disk_errors(path):
            try:
                file = open_own(path, "xb")
            except FileExistsError as error:
                raise WriteRefused("E-APPROVE-USED", path.name, actor=approval.actor) from error
            with file:
                file.write(used_by.encode("utf-8", "replace"))
                file.flush()
                os.fsync(file.fileno())
            sync_folder(self._folder)

    def _path(self, digest: str) -> Path:
        return self._folder / checked_name(f"approval-{digest[:16]}.json")


def _read(path: Path) -> Approval:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="approval")
    return decode(data, Approval, str(path))


# On a connection that is not protected one person alone must type the risk, for one command, word for word.

UNPROTECTED = "unprotected"
"""The word."""
_typed: ContextVar[str] = ContextVar("the risk that was typed", default="")


@contextmanager
def take_risk(typed: str) -> Iterator[None]:
    """In the block ``typed`` is what the person at work wrote of the risk; "": nothing."""
    before = _typed.set(typed)
    try:
        yield
    finally:
        _typed.reset(before)


def is_risk_taken() -> bool:
    """Whether the person at work has typed the risk."""
    return _typed.get().strip() == UNPROTECTED
