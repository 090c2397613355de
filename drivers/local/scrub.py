"""Secrets out of what is kept or shown: settings, addresses, texts of site files; pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

HIDDEN = "***"
_SECRET = re.compile(r"pass|secret|token|pin$|key$|credential", re.IGNORECASE)
# What is refused must be certain: a "key" may be any key, what is called a password is one.
_CERTAIN = re.compile(r"passw|passphrase|secret|token|credential", re.IGNORECASE)
# Keys that name where a secret lies hold none themselves.
_POINTER = re.compile(r"_(?:file|env)$", re.IGNORECASE)
_USER = re.compile(r"//[^/@\s\"']*@")
_VALUE = r"(?:\"\"\".*?\"\"\"|'''.*?'''|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'|[^\s,}\]#]+)"
_PART = r"(?:[A-Za-z0-9_-]{1,80}|\"(?:\\.|[^\"\\\n]){0,80}\"|'[^'\n]{0,80}')"
_ENTRY = re.compile(
    rf"(?<![\w.-])(?P<key>(?:{_PART}[ \t]*\.[ \t]*){{0,8}}(?P<last>{_PART}))(?P<is>[ \t]*=[ \t]*)(?P<value>{_VALUE})",
    re.DOTALL,
)


def is_secret(key: str) -> bool:
    """Whether a key's value must not be kept: its name sounds secret and it is no pointer to a file or variable."""
    return _SECRET.search(key) is not None and _POINTER.search(key) is None


def without_user(address: str) -> str:
    """An address without user name and password; a text with every address in it so."""
    return _USER.sub("//", address)


def has_user(address: str) -> bool:
    """Whether an address carries a user name or password."""
    return _USER.search(address) is not None


def without_secrets(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with every value hidden whose key sounds secret, however deep, and no user in any address."""
    return {key: HIDDEN if is_secret(key) else _scrubbed(value) for key, value in settings.items()}


def _scrubbed(value: Any) -> Any:
    if isinstance(value, Mapping):
        return without_secrets(value)
    if isinstance(value, list | tuple):
        return type(value)(_scrubbed(item) for item in value)
    return without_user(value) if isinstance(value, str) else value


def without_secrets_text(text: str) -> str:
    """A TOML text, comments too, with the same hidden; everything else letter by letter as it was."""
    return without_user(_ENTRY.sub(_hidden, text))


_JSON = re.compile(
    rb'("[^"\n]{0,60}(?:passw|passphrase|secret|token|credential)[^"\n]{0,60}"\s*:\s*)"(?:\\.|[^"\\\n])*"',
    re.IGNORECASE,
)
_POINTS = re.compile(rb'_(?:file|env)"\s*:\s*$', re.IGNORECASE)
_BEARER = re.compile(rb"(?i)(bearer\s+)[A-Za-z0-9._~+/=-]{8,}")
_PEM = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?-----END [A-Z ]*PRIVATE KEY-----", re.DOTALL)


def masked(data: bytes, values: Iterable[bytes]) -> bytes:
    """Bytes of any file with these values starred out letter by letter, so that lengths stay; private keys too."""
    data = _PEM.sub(lambda found: b"*" * len(found[0]), data)
    for value in sorted(set(values), key=len, reverse=True):
        if len(value) >= 4:
            data = data.replace(value, b"*" * len(value))
    return data


def masked_text(data: bytes) -> bytes:
    """A text with the values hidden that JSON or a header calls secret."""
    hidden = _JSON.sub(lambda found: found[0] if _POINTS.search(found[1]) else found[1] + b'"***"', data)
    return _BEARER.sub(rb"\1***", hidden)


def _hidden(found: re.Match[str]) -> str:
    secret = is_secret(found["last"].strip("\"'"))
    return f'{found["key"]}{found["is"]}"{HIDDEN}"' if secret else found[0]


def secrets_in(settings: Mapping[str, Any], place: str = "") -> Iterator[str]:
    """The keys, with their places, that hold a secret which is not empty."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from secrets_in(value, f"{place}{key}.")
        elif is_secret(key) and _CERTAIN.search(key) and value not in ("", None, False):
            yield f"{place}{key}"
