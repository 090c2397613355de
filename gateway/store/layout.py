"""Where a file of a run lies in its folder: the one rule, by its name; runs kept before it lie in one folder. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

KEY, TODAY = "layout", 2
ROOMS: Mapping[str, tuple[str, ...]] = {
    "captures": ("acting-", "capture-", "component-", "evaluation-", "hidden-", "source-"),
    "setups": ("setup-", "stands-"),
    "tables": ("backup-", "live-", "push-", "tables-"),
    "parts": ("grind-", "ground-", "inspected-", "part-"),
    "protocol": ("sent-",),
    "raw": ("raw-",),
}
"""Sub-folders by how names begin; what is none of them (report, results, site, proposal, verdict) lies on top."""


def place(name: str, facts: Mapping[str, Any]) -> str:
    """The path of a file of this name below its run's folder, with "/"; ``facts`` are the run's own."""
    if facts.get(KEY) != TODAY:
        return name
    if name.endswith(".npy"):
        return f"raw/{name}"
    room = next((room for room, starts in ROOMS.items() if name.startswith(starts)), "")
    return f"{room}/{name}" if room else name
