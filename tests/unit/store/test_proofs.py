"""A sign proof is found for the very machine it was measured on and for no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from gateway.errors import CorruptRecord
from gateway.store.machine_books import ProofBook

MACHINE = MachineIdentity("SN/1 ö", "V4.8", ("X1", "C1"))
PROOF = SignProof(MACHINE, "axis", "X1", -1.01, 0.02, 1, "2026-11-21T10:00:00+00:00")


def test_found_again_newest_first(tmp_path: Path) -> None:
    proofs = ProofBook(tmp_path)
    assert proofs.find(MACHINE, "axis", "X1") is None
    newer = replace(PROOF, slope=-0.99, date_utc="2026-11-22T10:00:00+00:00")
    proofs.save(newer)
    path = proofs.save(PROOF)
    assert path.is_file()
    assert proofs.find(MACHINE, "axis", "X1") == newer


@pytest.mark.parametrize(
    "machine",
    [
        replace(MACHINE, serial="SN-2"),
        replace(MACHINE, serial="SN_1 o"),
        replace(MACHINE, version="V4.9"),
        replace(MACHINE, axis_names=("C1", "X1")),
        replace(MACHINE, unit_system="inch"),
    ],
)
def test_not_for_another_fingerprint(tmp_path: Path, machine: MachineIdentity) -> None:
    proofs = ProofBook(tmp_path)
    proofs.save(PROOF)
    assert proofs.find(machine, "axis", "X1") is None


def test_not_for_another_function_or_axis(tmp_path: Path) -> None:
    proofs = ProofBook(tmp_path)
    proofs.save(PROOF)
    assert proofs.find(MACHINE, "cross", "X1") is None
    assert proofs.find(MACHINE, "axis", "C1") is None


def test_an_altered_proof_is_refused(tmp_path: Path) -> None:
    proofs = ProofBook(tmp_path)
    path = proofs.save(PROOF)
    path.write_bytes(path.read_bytes().replace(b'"sign":1', b'"sign":-1'))
    with pytest.raises(CorruptRecord):
        proofs.find(MACHINE, "axis", "X1")
