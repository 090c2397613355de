"""A driver's own keys of the site file to a frozen record: unknown keys and wrong types are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, fields
from math import isfinite
from typing import Any, TypeVar

from drivers.errors import ConfigError

Record = TypeVar("Record")


def read_settings(record: type[Record], settings: Mapping[str, Any], where: str) -> Record:
    """Build `record` (a dataclass whose fields all have plain defaults) from a mapping.

    Raises ConfigError: E-CFG-SETTING for an unknown key, E-CFG-SETTING-VALUE for a wrong type.
    """
    known: dict[str, Field[Any]] = {item.name: item for item in fields(record)}  # type: ignore[arg-type]
    for key in settings:
        if key not in known:
            raise ConfigError("E-CFG-SETTING", where, key=key, known=", ".join(known))
    values = {key: _checked(key, value, known[key].default, where) for key, value in settings.items()}
    return record(**values)


def _checked(key: str, value: Any, default: Any, where: str) -> Any:
    wanted = type(default)
    if wanted is float and type(value) is int:
        value = float(value)
    if type(value) is not wanted or (wanted is float and not isfinite(value)):
        raise wrong_setting(key, f"needs a {wanted.__name__}, not {value!r}", where)
    return value


def wrong_setting(key: str, why: str, where: str) -> ConfigError:
    """The error for one key's value."""
    return ConfigError("E-CFG-SETTING-VALUE", where, key=key, why=why)
