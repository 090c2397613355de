"""Every way the outside world can fail, sorted by who must act; one code, its fields, one catalogue."""

from __future__ import annotations

import functools
import os
import re
import tomllib
from collections.abc import Mapping
from typing import ClassVar

from drivers.terms import filled, shown

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


def words(code: str, part: str = "what", /, **fields: object) -> str:
    """A catalogue text that is no error: progress, findings, verdicts; units as people write them.

    Unknown codes show their fields.
    """
    entry = text_of(code)
    if entry is None:
        return f"{code} {fields}"
    return shown(entry.get(part, "").format_map(_Fields(fields)))


class TrueflankError(Exception):
    """Root of all our exceptions: a stable code with fields, rendered from the catalogue.

    ``where`` names the device, file or room; ``fields`` fill the catalogue's text; ``exit_code`` says to a
    shell who must act; ``retryable`` is true only where trying the same *read* again may help.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, code: str, where: str = "", *, retryable: bool = False, **fields: object) -> None:
        super().__init__(code, where, fields)
        self.code = code
        self.where = where
        self.fields = {key: _plain(value) if key == "why" else value for key, value in fields.items()}
        self.retryable = retryable

    @property
    def what(self) -> str:
        """What happened and which limit it broke, in words."""
        return self._render("what")

    @property
    def hint(self) -> str:
        """What to do about it, in words."""
        return self._render("do")

    def _render(self, part: str) -> str:
        return words(self.code, part, **self.fields) if part == "what" or text_of(self.code) is not None else ""

    def __str__(self) -> str:
        place = f" [{self.where}]" if self.where else ""
        hint = self.hint
        return f"{self.code}{place}: {self.what}" + (f" -> {hint}" if hint else "")

    def __reduce__(self) -> tuple[object, ...]:
        """As it is to another process: its fields are named, which an exception's own way would lose."""
        return _again, (type(self), self.args), self.__dict__

    def as_record(self) -> dict[str, object]:
        """The error as data, for logs, run folders and ``--json``."""
        fields = {key: str(value) for key, value in self.fields.items()}
        return {"code": self.code, "where": self.where, "fields": fields, "what": self.what, "do": self.hint}


def _again(kind: type[TrueflankError], args: tuple[object, ...]) -> TrueflankError:
    error = kind.__new__(kind)
    error.args = args
    return error


_NUMBERED = re.compile(r"^\[(?:Errno|WinError) -?\d+\] (.+?)(?:: ['\"].*)?$", re.DOTALL)


def _plain(why: object) -> object:
    """An operating system's reason without its number and the path behind it: the place is said already."""
    found = _NUMBERED.match(why) if isinstance(why, str) else None
    return found[1] if found else why


class _Fields(dict[str, object]):
    def __missing__(self, key: str) -> object:
        return filled(key) or _Absent(key)


class _Absent:
    def __init__(self, key: str) -> None:
        self._key = key

    def __format__(self, _spec: str) -> str:
        return f"<{self._key}>"


class ConfigError(TrueflankError):
    """Who wrote the file must act: file, key and why are in the fields."""

    exit_code = 2


class TransportError(TrueflankError):
    """The wire failed; the supervisor reopens it."""

    exit_code = 3


class DeadlineExceeded(TransportError):
    """The caller's deadline passed; what the peer did meanwhile is unknown."""


class LimitPassed(DeadlineExceeded):
    """A block took longer than `Clock.deadline` gave it: our own limit, not one that a peer told."""


class LinkBroken(TransportError):
    """An exchange was interrupted, so later answers could belong to earlier questions."""


class ProtocolError(TrueflankError):
    """One side broke the rules of the dialect."""

    exit_code = 4


class LocalProtocolError(ProtocolError):
    """We were about to send something illegal."""


class RemoteProtocolError(ProtocolError):
    """The peer sent something illegal; the offending bytes are in the fields."""


class DeviceError(TrueflankError):
    """The operator must act at the device."""

    exit_code = 5


class DeviceRefused(DeviceError):
    """The device understood and said no."""


class PointsDiffer(DeviceRefused):
    """Every point of a table was written, and the control's own comparison found some otherwise."""


class TableActs(DeviceRefused):
    """The control will not write a table because it is on, whatever its switch reads."""


class OtherCertificate(DeviceRefused):
    """A person typed another fingerprint than the peer showed."""


class BeamObstructed(DeviceError):
    """The laser lost its beam; nothing counted after that is valid."""


class NotReferenced(DeviceError):
    """An axis or instrument has no reference."""


class UnsupportedDevice(DeviceError):
    """Something answered, but it is not what the site file names."""


class FileFormatError(TrueflankError):
    """A vendor file is wrong: file, line and reason are in the fields; the operator must give another."""

    exit_code = 2


class FileUnreadable(FileFormatError):
    """The bytes of a file could not be had, so nothing is known of what it says; it may be tried again."""


class TableError(TrueflankError):
    """A compensation table that the controller could not hold or should not get."""

    exit_code = 7


class TooManyPoints(TableError):
    """More interpolation points than the controller reserved."""


class ValueOutOfRange(TableError):
    """A value, slope or change beyond its limit."""


class Gap(TableError):
    """A table with missing or inconsistent points."""
