"""A tree as far as it is right: every section as attributes, None where a key is wrong or left out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import SimpleNamespace
from typing import Any

from pydantic import BaseModel

from gateway.config.keyfaults import is_list, section_of
from gateway.config.places import Path


def seen(model: type[BaseModel], raw: Any, wrong: Collection[Path], path: Path = ()) -> Any:
    """The section at ``path``, which stands in it as ``place`` so that a rule can say where it broke.

    A value is as it stands in the file: lists are lists. What is left out has its default.
    """
    given = raw if isinstance(raw, Mapping) else {}
    found = SimpleNamespace(place=path)
    for name, field in model.model_fields.items():
        place = (*path, name)
        inner = section_of(field.annotation)
        value = given.get(name)
        if inner is not None and is_list(field.annotation):
            value = [seen(inner, one, wrong, (*place, number)) for number, one in _listed(value)]
        elif name not in given:
            value = None if field.is_required() else field.get_default(call_default_factory=True)
        elif inner is not None and value is not None:
            value = seen(inner, value, wrong, place) if isinstance(value, Mapping) else None
        elif any(one[: len(place)] == place for one in wrong):
            value = None
        setattr(found, name, value)
    return found


def _listed(value: Any) -> list[tuple[int, Any]]:
    """The sections of a list, with their numbers."""
    found = value if isinstance(value, list) else []
    return [(number, one) for number, one in enumerate(found) if isinstance(one, Mapping)]
