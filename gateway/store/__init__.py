"""Run folders, the machines' sign proofs, self-tests and set-up values: what is stored stays what it was."""

from __future__ import annotations

from gateway.store.folder import RunFolder, RunSummary
from gateway.store.maps import Maps, Said
from gateway.store.proofs import Proofs
from gateway.store.runs import Store
from gateway.store.selftests import SelfTestBook
from gateway.store.setupbook import SetupBook, SetupEntry

__all__ = ["Maps", "Proofs", "RunFolder", "RunSummary", "Said", "SelfTestBook", "SetupBook", "SetupEntry", "Store"]
