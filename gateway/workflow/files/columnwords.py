"""A map of columns as a person types it: NAME=VALUE words; and what is asked where a table leaves something open."""

from __future__ import annotations

import re
from collections.abc import Sequence

from drivers.errors import ConfigError
from gateway.store.maps import Value

# What a table leaves open, and the question that a person answers once for all tables with its heading.
ASKS = {
    "E-FILE-CSV-HEADER": "E-IMPORT-COLUMNS",
    "E-FILE-CSV-WAYS": "E-IMPORT-WAYS",
    "E-FILE-CSV-RUNS": "E-IMPORT-RUNS",
    "E-FILE-CSV-UNIT": "E-IMPORT-READINGS",
    "E-FILE-CSV-SEVERAL": "E-IMPORT-CHOOSE",
    "E-FILE-SHEET": "E-IMPORT-SHEET",
}
_WHOLE, _NUMBER = re.compile(r"[+-]?\d{1,8}\Z", re.ASCII), re.compile(r"[+-]?\d{1,8}\.\d{0,9}\Z", re.ASCII)
WORDS: dict[str, str | bool] = {"tab": "\t", "semicolon": ";", "comma": ",", "blank": ""}
WORDS |= {"yes": True, "true": True, "no": False, "false": False}


def columns_of(words: Sequence[str]) -> dict[str, Value]:
    """A column map from NAME=VALUE words. Raises ConfigError (E-CLI-COLUMN)."""
    found: dict[str, Value] = {}
    for word in words:
        name, mark, value = word.partition("=")
        if not mark or not name.strip():
            raise ConfigError("E-CLI-COLUMN", "--column", text=word)
        found[name.strip()] = _value(value.strip())
    return found


def _value(text: str) -> Value:
    plain = text.lower()
    if _WHOLE.match(plain):
        return int(plain)
    return float(plain) if _NUMBER.match(plain) else WORDS.get(plain, text)
