"""Lines of displays that answer ``?`` with one reading, to messages and back, pure.

As their manuals print them: Mahr Millimar C1208/C1216/1240 (number, unit), Mahr C1202 (``M1?``, a mark < = > after the
number, ERR6 for a feature that is off), TESA TT80/TT90 (a number; ERR23), Sylvac and Trimos (sign next to the digits, a
blank for plus). A question ends with CR, an answer with CR LF or CR. No answer names the question that it answers, so a
display is asked for one thing only, and never while an answer is due.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

LONGEST = 256
UNITS = {"mm": "mm", "in": "inch", "inch": "inch", '"': "inch", "um": "um", "\xb5m": "um"}
_NUMBER = re.compile(
    rb"(?:[A-Z]{0,2}\d?\s*:?\s+)?\s*([+-]? ?\d{0,6}[.,]?\d{1,6})\s*"
    rb"(mm|MM|inch|INCH|in|IN|\"|um|UM|\xb5m)?\s*([<=>])?\s*\Z"
)
_ERROR = re.compile(rb"ERR\s*(\d{1,3})\s*\Z", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class GaugeAsk:
    """A question as it is typed, without its end: ?, M1?, PRI."""

    text: str


@dataclass(frozen=True, slots=True)
class GaugeReading:
    """A number with the unit of the answer ("" for none); ``decimals`` behind its point; ``mark`` its tolerance."""

    value: float
    unit: Literal["", "mm", "inch", "um"]
    decimals: int
    mark: str = ""


@dataclass(frozen=True, slots=True)
class GaugeError:
    """The display's own error number."""

    number: int


@dataclass(frozen=True, slots=True)
class DamagedLine:
    """A line that is neither."""

    raw: bytes


GaugeAnswer = GaugeReading | GaugeError | DamagedLine


class GaugeCodec:
    """One end of the line: ``client`` asks, ``server`` is the display."""

    def __init__(self, role: Literal["client", "server"] = "client") -> None:
        self._client = role == "client"
        self._rest = b""

    def send(self, message: GaugeAsk) -> bytes:
        """A question with its end."""
        return message.text.encode("ascii") + b"\r"

    def receive(self, data: bytes) -> Iterable[GaugeAnswer]:
        """The answers that these bytes complete, empty lines left out; never raises."""
        return [_answer(line) for line in self._lines(data)]

    def questions(self, data: bytes) -> list[GaugeAsk]:
        """For the display: the questions that these bytes complete."""
        return [GaugeAsk(line.decode("ascii", "replace")) for line in self._lines(data)]

    def _lines(self, data: bytes) -> list[bytes]:
        *lines, self._rest = re.split(rb"[\r\n]", self._rest + data)
        found = [line.strip() for line in lines if line.strip()]
        if len(self._rest) > LONGEST:
            found, self._rest = [*found, self._rest[:LONGEST]], b""
        return found


def _answer(line: bytes) -> GaugeAnswer:
    error, number = _ERROR.match(line), _NUMBER.match(line)
    if error:
        return GaugeError(int(error[1]))
    if not number:
        return DamagedLine(line[:80])
    digits = number[1].replace(b" ", b"").replace(b",", b".").decode("ascii")
    unit: Literal["", "mm", "inch", "um"] = UNITS.get((number[2] or b"").decode("latin-1").lower(), "")  # type: ignore[assignment]
    return GaugeReading(float(digits), unit, len(digits.partition(".")[2]), (number[3] or b"").decode("ascii"))
