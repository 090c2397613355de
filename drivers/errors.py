"""Every way the outside world can fail, sorted by who must act; one code, its fields, one catalogue."""

from __future__ import annotations

import re
from typing import ClassVar

from drivers.catalogue import catalogue, explained, text_of
from drivers.message import Form, Message, Moment, Quantity, fields_as_data, render, words

__all__ = ["catalogue", "explained", "render", "text_of", "words"]


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
    def message(self) -> Message:
        """The error as a message: what a record, an event or another error contains of it."""
        return Message(self.code, self.fields, Form.ERROR, self.where)

    @property
    def what(self) -> str:
        """What happened and which limit it broke, in words."""
        return words(self.code, **self.fields)

    @property
    def hint(self) -> str:
        """What to do about it, in words."""
        return words(self.code, "do", **self.fields) if text_of(self.code) is not None else ""

    def __str__(self) -> str:
        place = f" [{self.where}]" if self.where else ""
        hint = self.hint
        return f"{self.code}{place}: {self.what}" + (f" -> {hint}" if hint else "")

    def __reduce__(self) -> tuple[object, ...]:
        """As it is to another process: its fields are named, which an exception's own way would lose."""
        return _again, (type(self), self.args), self.__dict__

    def as_record(self) -> dict[str, object]:
        """The error as data, for logs, run folders and ``--json``."""
        fields = {key: _recorded(value) for key, value in self.fields.items()}
        return {"code": self.code, "where": self.where, "fields": fields, "what": self.what, "do": self.hint}


_PARTS = (Message, Quantity, Moment)


def _recorded(value: object) -> object:
    if isinstance(value, (tuple, list)) and any(isinstance(one, (TrueflankError, *_PARTS)) for one in value):
        return [_recorded(one) for one in value]
    said = value.message if isinstance(value, TrueflankError) else value
    return fields_as_data({"field": said})["field"] if isinstance(said, _PARTS) else str(value)


def _again(kind: type[TrueflankError], args: tuple[object, ...]) -> TrueflankError:
    error = kind.__new__(kind)
    error.args = args
    return error


_NUMBERED = re.compile(r"^\[(?:Errno|WinError) -?\d+\] (.+?)(?:: ['\"].*)?$", re.DOTALL)


def _plain(why: object) -> object:
    """An operating system's reason without its number and the path behind it: the place is said already."""
    found = _NUMBERED.match(why) if isinstance(why, str) else None
    return found[1] if found else why


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
