"""A live set as a machine of a known sign means it."""

from __future__ import annotations

from typing import Any

from drivers.sinumerik.tablefile.tables import tables_by_proof
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.tables import LiveSet


def proof_of(sign: Any, axis: str = "X1") -> SignProof:
    """A proof of cross tables that says this sign, of no machine."""
    return SignProof(MachineIdentity("", "", ()), "cross", axis, -1.0 * sign, 0.01, sign, "")


def signed(live: LiveSet, sign: Any) -> LiveSet:
    """Cross tables as deviations by that sign."""
    return tables_by_proof(live, proof_of(sign))
