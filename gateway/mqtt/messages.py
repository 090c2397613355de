"""What stands in a message: its version, and of what happens the part that other systems get; no names of people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

VERSION = 1
KINDS: Mapping[str, tuple[str, ...]] = {
    "status": ("state", "software", "devices", "run", "alarms", "due", "left", "held", "result", "failure", "trouble"),
    "said": ("event", "code", "fields", "words"),
    "taken": ("axis", "target", "repetition", "approach", "deviation"),
    "ended": ("job", "kind", "run_id", "state", "exit_code", "words"),
    "figures": ("run_id", "serial", "figures"),
    "failure": ("code", "where", "fields", "what", "do"),
}
"""The topics below ``PREFIX/v1/SITE/`` and the members of ``data`` in each. A new member is no new version."""
STAYS = frozenset({"status"})
PEOPLE = frozenset({"who", "by", "actor"})


def kept_of(kind: str) -> bool:
    """Whether the server keeps the newest one for who comes later."""
    return kind in STAYS


def pared(kind: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """The members of a kind; names of people are left out, at every depth."""
    return {key: _without_people(data[key]) for key in KINDS[kind] if key in data}


def _without_people(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _without_people(one) for key, one in value.items() if key not in PEOPLE}
    if isinstance(value, (list, tuple)):
        return [_without_people(one) for one in value]
    return value
