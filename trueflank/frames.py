"""Rows as a pandas table, where pandas is installed; it is asked for only here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.errors import ConfigError


def frame(columns: Mapping[str, Any]) -> Any:
    """A DataFrame. Raises ConfigError (E-LIBRARY-PANDAS) where pandas is not installed."""
    try:
        import pandas
    except ImportError as error:
        raise ConfigError("E-LIBRARY-PANDAS", "to_pandas") from error
    return pandas.DataFrame(dict(columns))
