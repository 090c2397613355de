"""The catalogue of texts: a folder for each language under `drivers/messages`, read as one; code to "what" and "do"."""

from __future__ import annotations

import functools
import os
import re
import tomllib
from collections.abc import Mapping

_MESSAGES = os.path.join(os.path.dirname(__file__), "messages")
_HEADING = re.compile(r"^\[([A-Z0-9-]+)\][ \t]*\n", re.MULTILINE)


@functools.cache
def catalogue(language: str = "en") -> dict[str, dict[str, str]]:
    """Return the message catalogue: code -> {"what", "do"}, the rooms' own files read as one."""
    merged: dict[str, dict[str, str]] = {}
    for text in _files(language):
        merged.update({code: _with_advice(entry) for code, entry in tomllib.loads(text).items()})
    return merged


def text_of(code: str, language: str = "en") -> dict[str, str] | None:
    """One entry of the catalogue, read alone: a command says ten of two thousand texts. None for an unknown code."""
    block = _blocks(language).get(code)
    return None if block is None else dict(_entry(block))


def _files(language: str) -> list[str]:
    folder = os.path.join(_MESSAGES, language)
    return [_read(os.path.join(folder, name)) for name in sorted(os.listdir(folder)) if name.endswith(".toml")]


def _read(path: str) -> str:
    with open(path, encoding="utf-8") as file:
        return file.read()


@functools.cache
def _blocks(language: str) -> dict[str, str]:
    """What stands below each heading, not yet read as TOML; a text never begins a line with a bare heading."""
    found: dict[str, str] = {}
    for text in _files(language):
        _, *parts = _HEADING.split(text)
        found.update(zip(parts[::2], parts[1::2], strict=True))
    return found


@functools.cache
def _entry(block: str) -> dict[str, str]:
    return _with_advice(tomllib.loads(block))


def _with_advice(entry: Mapping[str, str]) -> dict[str, str]:
    """An entry with its "do": empty where nothing need be done, which the files leave out."""
    return {"what": entry["what"], "do": "", **entry}


@functools.cache
def _explanations(language: str) -> dict[str, dict[str, str]]:
    return tomllib.loads(_read(os.path.join(_MESSAGES, "explained", f"{language}.toml")))


def explained(code: str, language: str = "en") -> dict[str, str]:
    """How a code comes about and how to get out of it, {"how", "out"}; {} for most codes, whose text says enough."""
    return dict(_explanations(language).get(code, {}))
