"""A map of columns as a person types it: NAME=VALUE words; and what is asked where a table leaves something open."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import ConfigError

# What a table leaves open, and the question that a person answers once for all tables with its heading.
ASKS = {
    "E-FILE-CSV-HEADER": "E-IMPORT-COLUMNS",
    "E-FILE-CSV-WAYS": "E-IMPORT-WAYS",
    "E-FILE-CSV-RUNS": "E-IMPORT-RUNS",
    "E-FILE-CSV-UNIT": "E-IMPORT-READINGS",
    "E-FILE-CSV-TURN": "E-IMPORT-TURN",
}
WORDS: dict[str, str | bool] = {"tab": "\t", "semicolon": ";", "comma": ",", "blank": ""}
WORDS |= {"yes": True, "true": True, "no": False, "false": False}


def columns_of(words: Sequence[str]) -> dict[str, str | int | bool]:
    """A column map from NAME=VALUE words. Raises ConfigError (E-CLI-COLUMN)."""
    found: dict[str, str | int | bool] = {}
    for word in words:
        name, mark, value = word.partition("=")
        if not mark or not name.strip():
            raise ConfigError("E-CLI-COLUMN", "--column", text=word)
        plain = value.strip().lower()
        number = plain.lstrip("+-")
        is_number = number.isascii() and number.isdigit() and len(number) < 9
        found[name.strip()] = int(plain) if is_number else WORDS.get(plain, value.strip())
    return found
