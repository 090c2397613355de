"""What a user declares of a table, key by key, to a frozen record that knows its own limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import Field, fields
from typing import Any, Protocol, TypeVar

from drivers.errors import ConfigError
from drivers.message import Message


class DeclaredFields(Protocol):
    """A dataclass of plain defaults with limits on its values."""

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """(key, whether it is right, what it must be)."""
        ...


D = TypeVar("D", bound=DeclaredFields)


def declared(record: type[D], said: Mapping[str, Any], where: str) -> D:
    """Build ``record``; a whole number will do for a float. Raises ConfigError (E-FILE-MAP) naming key and limit."""
    items: tuple[Field[Any], ...] = fields(record)  # type: ignore[arg-type]
    known = {item.name: type(item.default) for item in items}
    values = {key: _as_float(value) if known.get(key) is float else value for key, value in said.items()}
    for key, value in values.items():
        if key not in known or type(value) is not known[key]:
            kind = known[key].__name__ if key in known else f"one of {', '.join(known)}"
            raise ConfigError("E-FILE-MAP", where, key=key, why=f"needs {kind}")
    found = record(**values)
    for key, good, why in found.limits():
        if not good:
            raise ConfigError("E-FILE-MAP", where, key=key, why=why)
    return found


def _as_float(value: Any) -> Any:
    return float(value) if type(value) is int else value
