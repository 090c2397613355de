"""The document's words in each of its languages: one catalogue a language, under drivers/messages/document."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

from drivers.errors import ConfigError

LANGUAGES = ("en", "de", "zh")


@functools.cache
def catalogue_of(language: str) -> Mapping[str, str]:
    """Key -> text of one language. Raises ConfigError (E-REPORT-LANGUAGE)."""
    if language not in LANGUAGES:
        raise ConfigError("E-REPORT-LANGUAGE", "report", language=language, known=", ".join(LANGUAGES))
    file = resources.files("drivers").joinpath("messages", "document", f"{language}.toml")
    return tomllib.loads(file.read_text(encoding="utf-8"))


@dataclass(frozen=True, slots=True)
class Tongue:
    """One language: called with a key and the fields of its text."""

    language: str = "en"

    def __call__(self, key: str, /, **fields: object) -> str:
        """The text as its catalogue has it, µm and all. Raises KeyError for an unknown key: a fault of ours."""
        text = catalogue_of(self.language)[key]
        return text.format(**fields) if fields else text

    def known(self, key: str, otherwise: str) -> str:
        """The text of a key that may be absent; ``otherwise`` where it is."""
        found = catalogue_of(self.language).get(key)
        return otherwise if found is None else found
