"""What a doctor found on the road to a device, line by line, and what a server shows as its certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal

from drivers.errors import TrueflankError
from drivers.message import Form, Message
from drivers.stale_programs import Sent
from drivers.types.identity import MachineIdentity, likeness

Outcome = Literal["ok", "wrong", "unknown", "skipped"]


@dataclass(frozen=True, slots=True)
class CheckLine:
    """One thing looked at: ``check`` names it, ``code`` and ``fields`` say what was found, by the catalogue."""

    check: str
    outcome: Outcome
    code: str
    fields: dict[str, object] = field(default_factory=dict)

    @property
    def message(self) -> Message:
        """What was found, and what to do where it is not in order."""
        return Message(
            self.code, self.fields, Form.ERROR if self.outcome in ("wrong", "unknown") else Form.TEXT, self.check
        )

    @property
    def what(self) -> str:
        """What was found, in words."""
        return self._said.what

    @property
    def fix(self) -> str:
        """What to do about it, in words; "" when nothing is to be done."""
        return self._said.hint if self.outcome in ("wrong", "unknown") else ""

    @property
    def _said(self) -> TrueflankError:
        said = TrueflankError(self.code)
        said.fields = self.fields
        return said

    def as_record(self) -> dict[str, object]:
        """The line as data."""
        fields = {key: str(value) for key, value in self.fields.items()}
        record = {"check": self.check, "outcome": self.outcome, "code": self.code, "fields": fields}
        return {**record, "what": self.what, "fix": self.fix}


def gathered(lines: Sequence[CheckLine]) -> tuple[CheckLine, ...]:
    """The same lines for people: what is found alike of several axes is one line that names them all."""
    found: list[CheckLine] = []
    for line in lines:
        axis = line.fields.get("axis")
        place = next((at for at, one in enumerate(found) if axis is not None and _alike(one, line)), None)
        if place is None:
            found.append(line)
        else:
            axes = f"{found[place].fields['axis']}, {axis}"
            found[place] = replace(found[place], fields={**found[place].fields, "axis": axes})
    return tuple(found)


def _alike(one: CheckLine, other: CheckLine) -> bool:
    same = (one.check, one.outcome, one.code) == (other.check, other.outcome, other.code)
    return same and {**one.fields, "axis": ""} == {**other.fields, "axis": ""}


def fine(code: str, check: str, **fields: object) -> CheckLine:
    """A line that is as it should be."""
    return CheckLine(check, "ok", code, fields)


def wrong(code: str, check: str, **fields: object) -> CheckLine:
    """A line that somebody must put right."""
    return CheckLine(check, "wrong", code, fields)


def unknown(code: str, check: str, **fields: object) -> CheckLine:
    """A line of which nothing could be told from here."""
    return CheckLine(check, "unknown", code, fields)


def skipped(code: str, check: str, **fields: object) -> CheckLine:
    """A line of what was not looked at, and why: it says nothing about the control."""
    return CheckLine(check, "skipped", code, fields)


def failed(error: TrueflankError, check: str, outcome: Outcome = "wrong") -> CheckLine:
    """What an error says, as a line."""
    return CheckLine(check, outcome, error.code, dict(error.fields))


@dataclass(frozen=True, slots=True)
class WantedAxis:
    """An axis the site means to correct: name as in MD10000, unit, measuring system (0 or 1), table points.

    ``encoder_said``: whether a person named the measuring system.
    """

    name: str
    unit: Literal["mm", "deg"]
    encoder: int
    points: int
    encoder_said: bool = True


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a site expects of its control; ``sent`` are the programs it ever sent there, if none is at work now.

    ``access_level`` is the largest at which the switches of the tables may be written. ``facts`` are what else the
    machine is known by, of `drivers.types.identity.FACTS`.
    """

    serial: str
    axes: tuple[WantedAxis, ...] = ()
    sent: tuple[Sent, ...] = ()
    access_level: int = 3
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SerialWords:
    """How lines about a serial number are called: the check, the code of the same number, of another one."""

    check: str
    same: str
    other: str


SERIAL = SerialWords("serial number", "W-DOC-SERIAL", "E-DOC-SERIAL")
FINGERPRINT = SerialWords("fingerprint", "W-LCNC-SERIAL", "E-LCNC-SERIAL")


def identity_lines(machine: MachineIdentity, wanted: Wanted, of: SerialWords = SERIAL) -> list[CheckLine]:
    """Every fact that the control tells of itself beside what the site knows of its machine."""
    found = likeness({**wanted.facts, "serial": wanted.serial}, machine)
    changed = {one.fact: one for one in found.changed}
    lines = []
    if "serial" not in changed:
        told = {"serial": machine.serial, "found": machine.serial, "version": machine.version}
        lines.append(fine(of.same, of.check, **told))
    read = "; ".join(f"{name} {value}" for name, value in machine.facts.items() if name != "serial") or "-"
    unread = ", ".join(fact for fact in found.unread if fact not in machine.facts) or "-"
    if found.is_known:
        return [*lines, fine("W-DOC-FACTS", "identity", facts=read, unread=unread)]
    if found.is_asked:
        (one,) = found.changed
        same = ", ".join(found.same)
        return [*lines, wrong("E-DOC-IDENTITY", "identity", fact=one.fact, was=one.was, now=one.now, same=same)]
    if list(changed) == ["serial"]:
        return [wrong(of.other, of.check, found=machine.serial, wanted=wanted.serial)]
    return [*lines, wrong("E-DOC-MACHINE", "identity", told=found.told)]


@dataclass(frozen=True, slots=True)
class CertificateView:
    """A certificate in the words of those who compare it: SHA-256 and, as older dialogs show it, SHA-1."""

    subject: str
    sha256: str
    sha1: str
    valid_from: datetime
    valid_until: datetime

    def is_called(self, thumbprint: str) -> bool:
        """Whether a typed thumbprint, in either form, with or without colons and blanks, is this certificate's."""
        typed = "".join(thumbprint.replace(":", " ").split()).upper()
        return typed in (self.sha256.replace(":", ""), self.sha1.replace(":", ""))


@dataclass(frozen=True, slots=True)
class TrustView:
    """What a server shows now beside what is pinned for it. ``accepted_by`` and ``accepted_utc`` of the pinned one.

    ``reason`` is why it was accepted although it was not valid then.
    """

    url: str
    shown: CertificateView
    pinned: CertificateView | None
    place: str
    own: CertificateView | None = None
    accepted_by: str = ""
    accepted_utc: str = ""
    reason: str = ""

    @property
    def equal(self) -> bool:
        """Whether the server is the pinned one."""
        return self.pinned is not None and self.pinned.sha256 == self.shown.sha256


@dataclass(frozen=True, slots=True)
class ControlAxis:
    """An axis as the control tells it for a site file; None where this road cannot tell.

    ``travel`` are the soft limits, mm or deg; ``encoder`` 0 or 1 is the measuring system whose table acts, ``points``
    the room reserved for that table.
    """

    name: str
    unit: Literal["mm", "deg"]
    modulo: bool | None = None
    travel: tuple[float, float] | None = None
    encoder: int | None = None
    points: int | None = None


@dataclass(frozen=True, slots=True)
class ControlFacts:
    """What a control tells of itself: serial number, version, unit system, axes in its own order.

    ``identity`` are the facts that the machine is known by, of `drivers.types.identity.FACTS`.
    """

    serial: str
    version: str
    unit_system: Literal["metric", "inch"]
    axes: tuple[ControlAxis, ...]
    identity: Mapping[str, str] = field(default_factory=dict)

    def axis(self, name: str) -> ControlAxis | None:
        """An axis by its name; None where there is none."""
        return next((axis for axis in self.axes if axis.name == name), None)
