"""Run folders, their index and the machines' sign proofs: what is stored stays what it was."""

from __future__ import annotations

from gateway.store.folder import RunFolder, RunSummary, Store
from gateway.store.index import Index
from gateway.store.maps import Maps, Said
from gateway.store.proofs import Proofs

__all__ = ["Index", "Maps", "Proofs", "RunFolder", "RunSummary", "Said", "Store"]
