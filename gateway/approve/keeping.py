"""Approvals in a run's folder: each a file named by its hash; using one leaves a mark that cannot be made twice."""

from __future__ import annotations

import os
from pathlib import Path

from drivers.local.ownfiles import open_own
from gateway.domain.proposals import Approval
from gateway.errors import CorruptRecord, WriteRefused
from gateway.store import records
from gateway.store.disk import checked_name, disk_errors, make_folder, read_whole, sync_folder, write_whole

FOLDER = "approvals"


class Approvals:
    """The approvals of one run. They stand beside `run.json`, so that two people never overwrite each other."""

    def __init__(self, run: Path) -> None:
        self._folder = Path(run) / FOLDER

    def keep(self, approval: Approval) -> str:
        """Keep an approval for good; returns its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(approval)
        digest = records.sha256(data)
        make_folder(self._folder)
        write_whole(self._path(digest), data)
        return digest

    def unused(self, plan_hash: str = "") -> tuple[Approval, ...]:
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
    def digest(approval: Approval) -> str:
        """The hash that names an approval."""
        return records.sha256(records.encode(approval))

    def use(self, approvals: tuple[Approval, ...], used_by: str) -> None:
        """Use them up, durably, before anything is written to a machine; ``used_by`` says for what.

        Raises WriteRefused (E-APPROVE-USED) when one has been used before, also by a push that began at the same
        moment; StoreError (E-STORE-DISK).
        """
        for approval in approvals:
            path = self._path(records.sha256(records.encode(approval)))
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
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="approval")
    return records.decode(data, Approval, str(path))
