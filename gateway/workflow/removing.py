"""A run's folder is taken away, unless something rests on it; the audit log keeps that it was."""

from __future__ import annotations

import shutil

from drivers.clock import Clock
from gateway import audit
from gateway.errors import StoreError
from gateway.store import RunFolder
from gateway.store.disk import disk_errors
from gateway.workflow import stages


def remove_run(folder: RunFolder, *, clock: Clock) -> None:
    """Remove a run whose folder nothing rests on.

    A run that pushed stays: rolling back and verifying start from it. Raises StoreError (E-STORE-RESTS,
    E-STORE-DISK), CorruptRecord (E-AUDIT-BROKEN).
    """
    pushed = [stage for stage in folder.stages if stage.startswith(stages.push(""))]
    if pushed:
        raise StoreError("E-STORE-RESTS", str(folder.path), run=folder.run_id, pushes=", ".join(pushed))
    root = folder.path.parent
    audit.require_sound(root)
    told = {"run": folder.run_id, "state": folder.state, "head": folder.anchor}
    audit.record(root, "remove-run", clock=clock, role="operator", details=told)
    with disk_errors(folder.path):
        shutil.rmtree(folder.path)
