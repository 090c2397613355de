"""A cell file that says only how its machine differs from another cell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NAMED = ("axes", "instruments")


def changed(base: Mapping[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with what ``tree`` says: tables part by part, axes and instruments by their names, all else replaced."""
    return {**base, **{key: _joined(key, base.get(key), value) for key, value in tree.items()}}


def _joined(key: str, old: Any, new: Any) -> Any:
    if isinstance(old, dict) and isinstance(new, dict):
        return changed(old, new)
    if key not in NAMED or not isinstance(old, list) or not isinstance(new, list):
        return new
    by_name = {one.get("name"): one for one in new}
    kept = [changed(one, by_name.pop(one.get("name"), {})) for one in old]
    return [*kept, *by_name.values()]
