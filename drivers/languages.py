"""The languages people are spoken to in: every text for people stands in `drivers/messages`, one folder for each."""

from __future__ import annotations

import functools
import tomllib
from importlib import resources

LANGUAGES = {"en": "English", "zh": "中文", "de": "Deutsch"}


@functools.cache
def texts_of(room: str, language: str) -> dict[str, str]:
    """The sentences of a page by their keys, e.g. "push.arm"; ``room`` is page or panel."""
    file = resources.files("drivers").joinpath("messages", room, f"{language}.toml")
    found = tomllib.loads(file.read_text(encoding="utf-8"))
    return {f"{part}.{key}": text for part, texts in found.items() for key, text in texts.items()}


def page_texts(language: str) -> dict[str, str]:
    """The sentences of the operator's page."""
    return texts_of("page", language)
