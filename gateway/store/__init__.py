"""Run folders, the machines' sign proofs, self-tests and set-up values: what is stored stays what it was.

`proofs`, `selftests` and `setupbook` are called by their modules: their records come with half of a controller's, and
whoever only reads a run pays for none of them.
"""

from __future__ import annotations

from gateway.store.folder import RunFolder, RunSummary
from gateway.store.maps import Maps, Said
from gateway.store.runs import Store

__all__ = ["Maps", "RunFolder", "RunSummary", "Said", "Store"]
