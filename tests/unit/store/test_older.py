"""Records of versions that wrote the control's own words: read as today's, and their plans refused as older."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import FutureSchema, WriteRefused
from gateway.push import journal
from gateway.push.history import tables_of
from gateway.store import RunFolder, Store, records
from gateway.store.machine_books import ProofBook
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import require_current_version

MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "C1"))
OWN = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 3.0, 1.0))
CROSS = replace(OWN, kind="cross", input_axis="Z1", index=3)
LIVE = LiveSet("X1", LiveTable(OWN, True), (LiveTable(CROSS, False),), 0.002, "text", "digest")
CHANGE = TableChange("X1", OWN, CROSS, False, "base", np.zeros(0), np.zeros(0), np.zeros(0), base=LIVE)
PROPOSAL = Proposal(MACHINE, (CHANGE,), ("a",), "2026-11-20T10:00:00+00:00")
PROOF = SignProof(MACHINE, "cross", "X1", -1.01, 0.02, -1, "2026-11-20T10:00:00+00:00")
KEYS = {"kind": "function", "own": "eec", "cross": "cec", "version": "nck_version"}
KINDS = {"axis": "EEC", "cross": "CEC"}


def before(data: Any) -> Any:
    """Data as an older version wrote it."""
    if isinstance(data, dict):
        named = {KEYS.get(key, key): before(value) for key, value in data.items()}
        return {key: KINDS.get(value, value) if key == "function" else value for key, value in named.items()}
    return [before(item) for item in data] if isinstance(data, list) else data


def older(data: bytes) -> bytes:
    """A record's bytes as an older version wrote them."""
    envelope = json.loads(data)
    return records.canonical({**envelope, "schema": 1, "record": before(envelope["record"])})


def same(one: object, two: object) -> bool:
    return records.encode(one) == records.encode(two)


def test_what_an_older_version_wrote_is_what_is_tested() -> None:
    text = older(records.encode(PROPOSAL)).decode()
    assert '"function":"EEC"' in text
    assert '"function":"CEC"' in text
    assert '"eec":{' in text
    assert '"cec":[' in text
    assert '"nck_version":"V4.8"' in text
    assert not set(KEYS) & set(json.loads(text)["record"]["changes"][0]["old"])


@pytest.mark.parametrize("record", [PROPOSAL, PROOF, LIVE, MACHINE], ids=lambda one: type(one).__name__)
def test_an_older_record_is_read_with_current_keys(record: Any) -> None:
    assert same(records.decode(older(records.encode(record)), type(record)), record)


def test_todays_record_with_an_older_word_is_not_believed() -> None:
    envelope = json.loads(records.encode(PROOF))
    with pytest.raises(FutureSchema):
        records.decode(records.canonical({**envelope, "record": before(envelope["record"])}), SignProof)


def test_an_older_proof_still_counts_for_its_machine(tmp_path: Path) -> None:
    proofs = ProofBook(tmp_path)
    kept = proofs.save(PROOF)
    data = older(kept.read_bytes())
    kept.unlink()
    (kept.parent / f"CEC-X1-{records.sha256(data)[:16]}.json").write_bytes(data)
    assert proofs.find(MACHINE, "cross", "X1") == PROOF
    assert proofs.find(MACHINE, "axis", "X1") is None


def test_an_older_journal_that_did_not_end_names_its_tables(tmp_path: Path) -> None:
    folder = journal.machine_folder(tmp_path, "SN-1")
    folder.mkdir(parents=True)
    kept = journal.Journal.create(folder, 7)
    facts = {"old": before(_facts(OWN)), "new": before(_facts(CROSS)), "old_enabled": True}
    kept.append("LEASED", purpose="table", axis="X1", machine=before({"version": "V4.8"}), **facts)
    kept.close()
    (found,) = journal.unfinished_journals(folder)
    assert tables_of(found) == (LiveTable(OWN, True), CROSS)
    assert found.entries[0].facts["machine"] == {"version": "V4.8"}


def _facts(table: CompensationTable) -> dict[str, Any]:
    return json.loads(records.encode(table))["record"] | {"deviations": list(table.deviations)}


def test_an_older_proposal_is_refused_by_its_version_and_not_as_tampered(tmp_path: Path) -> None:
    folder = Store(tmp_path).create("mill")
    folder.put(stages.PROPOSAL, PROPOSAL)
    require_current_version(folder)
    path = tmp_path / folder.run_id / _file(folder)
    data = older(path.read_bytes())
    path.write_bytes(data)
    facts = dict(folder.facts)
    facts["stages"][stages.PROPOSAL]["sha256"] = records.sha256(data)
    facts |= {"software": "0.0.9", "schema": 1, "machine": {"serial": "SN-1", "nck_version": "V4.8"}}
    body = {**facts, "sha256": records.sha256(records.canonical(facts))}
    (folder.path / "run.json").write_text(json.dumps(body))
    assert same(folder.get(stages.PROPOSAL, Proposal), PROPOSAL)
    assert folder.facts["machine"] == {"serial": "SN-1", "version": "V4.8"}
    with pytest.raises(WriteRefused) as caught:
        require_current_version(RunFolder(folder.path))
    assert caught.value.code == "E-PROPOSAL-OLDER"
    assert "made with version 0.0.9" in caught.value.what
    assert "make the proposal again" in caught.value.hint


def _file(folder: RunFolder) -> str:
    entries: Any = folder.facts["stages"]
    return str(entries[stages.PROPOSAL]["file"])
