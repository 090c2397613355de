"""A JSON object from the peer, read field by field: each value is what it must be, or the field is named."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from drivers.errors import RemoteProtocolError
from drivers.types.values import FloatArray

MOST = 1 << 53


class Fields:
    """A JSON object from the peer, read field by field."""

    def __init__(self, found: Any, where: str) -> None:
        self.where = where
        if not isinstance(found, Mapping):
            raise self.wrong("(all)", "an object", found)
        self._found = found

    def wrong(self, name: str, wanted: str, got: object) -> RemoteProtocolError:
        """The error for one field."""
        shown = repr(got)[:80]
        return RemoteProtocolError("E-BRIDGE-FIELD", self.where, field=name, wanted=wanted, got=shown)

    def get(self, name: str, default: Any = None) -> Any:
        """The raw value."""
        return self._found.get(name, default)

    def text(self, name: str, default: str | None = None) -> str:
        """A string; required where no default is given."""
        value = self.get(name, default)
        if not isinstance(value, str):
            raise self.wrong(name, "text", value)
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number; required where no default is given."""
        value = self.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise self.wrong(name, "a finite number", value)
        return float(value)

    def maybe(self, name: str) -> float | None:
        """A finite number, or None where it is null or absent."""
        return None if self.get(name) is None else self.number(name)

    def integer(self, name: str, default: int | None = None) -> int:
        """An integer from 0 to 2^53, beyond which JSON holds none exactly; required where no default is given."""
        value = self.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST:
            raise self.wrong(name, f"an integer from 0 to {MOST}", value)
        return value

    def flag(self, name: str) -> bool:
        """True or false."""
        value = self.get(name)
        if not isinstance(value, bool):
            raise self.wrong(name, "true or false", value)
        return value

    def array(self, name: str, values: Any) -> FloatArray:
        """A list of finite numbers as shape (n,)."""
        if not isinstance(values, list) or not {type(item) for item in values} <= {int, float}:
            raise self.wrong(name, "a list of numbers", values)
        try:
            result = np.array(values, np.float64)
        except OverflowError:
            raise self.wrong(name, "finite numbers", "an integer beyond all bounds") from None
        if not np.isfinite(result).all():
            raise self.wrong(name, "finite numbers", values)
        return result


def _finite(value: float) -> bool:
    try:
        return isfinite(value)
    except OverflowError:
        return False
