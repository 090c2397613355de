"""What exactly is to be written, as one hash: table, base and machine. People approve this and nothing else."""

from __future__ import annotations

import hashlib
import json

from drivers.types.identity import MachineIdentity
from gateway.domain.proposals import TableChange
from gateway.push.compare import table_facts

PLAN = 2
"""The form of what is hashed: another form is another plan, whatever stands in it."""


def plan_hash(change: TableChange, machine: MachineIdentity) -> str:
    """sha256 (hex) of the canonical form of a change on a machine; pure.

    Canonical: JSON with sorted keys and no blanks; floats by `repr` (the shortest text of the same double).
    Enters: the form of the plan itself, every field of the new table, the digest of the live tables it was made on,
    the machine's fingerprint. What was predicted and found does not: it is not written.
    """
    plan = {
        "plan": PLAN,
        "table": table_facts(change.new),
        "base_digest": change.base_digest,
        "machine": [machine.serial, machine.version, list(machine.axis_names), machine.unit_system],
    }
    text = json.dumps(plan, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()
