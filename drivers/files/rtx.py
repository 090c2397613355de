"""Dynamic captures, .rtx: a text header and little-endian doubles, mapped and never read twice.

Layout as two independent public readers agree on it: "key: value" lines with CR LF, "Data:" and then exactly
"Sample no" doubles, then "EOF::" with or without a line end before it. The file does not say whether its
numbers are mm or mrad, so `unit` must be confirmed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError, FileFormatError, FileUnreadable
from drivers.files.csvtext import plain, recording_lines
from drivers.files.numbers import decimal
from drivers.files.rtltext import keyed, lookup
from drivers.local.textfile import decode_text
from drivers.message import Message, Quantity, digits
from drivers.recordings import Recording
from drivers.units import ARCSEC_PER_DEG, ARCSEC_PER_RAD, UM_PER_MM, DeviationUnit, typed_unit

UNITS: dict[str, tuple[DeviationUnit, float]] = {
    "mm": ("um", UM_PER_MM),
    "um": ("um", 1.0),
    "mrad": ("arcsec", ARCSEC_PER_RAD / 1e3),
    "urad": ("arcsec", ARCSEC_PER_RAD / 1e6),
    "arcsec": ("arcsec", 1.0),
    "deg": ("arcsec", ARCSEC_PER_DEG),
}
MARK = b"Data:\r\n"
LONGEST_HEADER = 8192
LONGEST_WORD = 400
MOST_SAMPLES = 1 << 40
_BREAK = re.compile(r"\r\n|\n|\r")
DOUBLE = struct.calcsize("<d")
WORDS = ("Machine", "Serial No", "Date", "By", "Axis", "Location")


class RtxFormat:
    """Dynamic file driver "rtx"; `unit` is mm, um, mrad, urad, arcsec or deg, as the capture program was set."""

    def __init__(self, unit: str = "", codepage: str = "cp1252") -> None:
        unit = typed_unit(unit)
        if unit and unit not in UNITS:
            raise ConfigError("E-FILE-UNIT", "rtx", unit=unit, known=", ".join(UNITS))
        self._unit = unit
        self._codepage = codepage

    def read(self, path: Path) -> Recording:
        """Map a file. Raises FileFormatError, ConfigError (E-FILE-RTX-UNIT) where no unit was confirmed.

        A file that ends early gives what is there and says so in the warnings.
        """
        where = str(path)
        data, size = _beginning(path)
        head = read_head(data, size, self._codepage, where)
        if not self._unit:
            raise ConfigError("E-FILE-RTX-UNIT", where)
        raw = np.memmap(path, dtype="<f8", mode="r", offset=head.start, shape=(head.count,))
        _check_finite(raw, where)
        unit, scale = UNITS[self._unit]
        warnings = (*_ending(path, head), *_doubts(head.keys))
        return Recording(
            raw=raw,
            rate_hz=head.rate_hz,
            unit=unit,
            scale=scale,
            trigger=head.trigger,
            header=head.keys,
            warnings=warnings,
        )

    def origin(self, path: Path) -> dict[str, str]:
        """The file's own words (Machine, Serial No, ...), for which no unit is needed yet."""
        return dict(read_head(*_beginning(path), self._codepage, str(path)).keys)

    def lines(self, recording: Recording) -> Iterator[str]:
        """A record as a table of times and values, piece by piece."""
        return recording_lines(recording)

    def write(self, path: Path, recording: Recording) -> None:
        """Write a record as .rtx in the unit of this format; raises ConfigError (E-FILE-RTX-UNIT) without one.

        A record with gaps has no equidistant samples and is refused: FileFormatError (E-FILE-RTX-GAPS).
        """
        if not self._unit or UNITS[self._unit][0] != recording.unit:
            raise ConfigError("E-FILE-RTX-UNIT", str(path))
        if recording.gaps:
            raise FileFormatError("E-FILE-RTX-GAPS", str(path), gaps=len(recording.gaps))
        with path.open("xb") as file:
            write_rtx(file, recording.blocks(), recording, UNITS[self._unit][1])


@dataclass(frozen=True, slots=True)
class RtxHead:
    """What stands before the samples: ``count`` of ``stated`` doubles are there, from byte ``start`` on."""

    keys: Mapping[str, str]
    start: int
    count: int
    stated: int
    rate_hz: float
    trigger: int | None


def _beginning(path: Path) -> tuple[bytes, int]:
    """The first bytes and the size of the file."""
    try:
        with path.open("rb") as file:
            return file.read(LONGEST_HEADER), file.seek(0, 2)
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(path), why=str(error)) from error


def read_head(data: bytes, size: int, codepage: str, where: str) -> RtxHead:
    """The header from a file's first bytes and its size, pure.

    Raises FileFormatError (E-FILE-DETECT, E-FILE-RTX-DATA, E-FILE-RTX-VALUE naming the key, E-FILE-ROWS).
    """
    if not data.removeprefix(b"\xef\xbb\xbf").startswith(b"HEADER::"):
        raise FileFormatError("E-FILE-DETECT", where, found=data[:40].decode("latin-1"))
    end = data.find(MARK)
    if end < 0:
        raise FileFormatError("E-FILE-RTX-DATA", where, limit=LONGEST_HEADER)
    keys = keyed(_BREAK.split(decode_text(data[:end], codepage, where)))
    stated, rate, start = _number(keys, "Sample no", where), _rate(keys, where), end + len(MARK)
    if stated != int(stated) or not 1 <= stated <= MOST_SAMPLES:
        raise FileFormatError("E-FILE-RTX-VALUE", where, key="Sample no", value=digits(stated, 6))
    there = min((size - start) // DOUBLE, int(stated))
    if there < 1:
        raise FileFormatError("E-FILE-ROWS", where)
    return RtxHead(keys=keys, start=start, count=there, stated=int(stated), rate_hz=rate, trigger=_trigger(keys, there))


def _number(keys: Mapping[str, str], key: str, where: str) -> float:
    text = lookup(dict(keys), key)
    value = decimal(text) if text is not None else None
    if value is None:
        raise FileFormatError("E-FILE-RTX-VALUE", where, key=key, value=text)
    return value


def _rate(keys: Mapping[str, str], where: str) -> float:
    actual = lookup(dict(keys), "Actual sample rate")
    rate = _number(keys, "Actual sample rate" if actual is not None else "Sample rate", where)
    if not 0.0 < rate <= 1e9:
        raise FileFormatError("E-FILE-RTX-VALUE", where, key="Actual sample rate", value=digits(rate, 6))
    return rate


def _trigger(keys: Mapping[str, str], count: int) -> int | None:
    value = decimal(lookup(dict(keys), "Trigger point") or "")
    return int(value) if value is not None and 0 <= value < count else None


def _check_finite(raw: NDArray[np.float64], where: str) -> None:
    for start in range(0, len(raw), 1 << 20):
        bad = np.flatnonzero(~np.isfinite(raw[start : start + (1 << 20)]))
        if len(bad):
            raise FileFormatError("E-FILE-RTX-SAMPLE", where, sample=start + int(bad[0]))


def _ending(path: Path, head: RtxHead) -> tuple[Message, ...]:
    if head.count < head.stated:
        return (Message.of("S-FILE-RTX-CUT", count=head.count, stated=head.stated),)
    with path.open("rb") as file:
        file.seek(head.start + head.count * DOUBLE)
        rest = file.read(64)
    if rest.strip() == b"EOF::":
        return ()
    return (Message.of("S-FILE-RTX-MORE" if rest.strip() else "S-FILE-NO-EOF"),)


def _doubts(keys: Mapping[str, str]) -> tuple[Message, ...]:
    stated, actual = (decimal(lookup(dict(keys), key) or "") for key in ("Sample rate", "Actual sample rate"))
    if actual is None:
        return (Message.of("S-FILE-RTX-RATE"),)
    if stated and abs(stated - actual) > 1e-6 * stated:
        return (Message.of("S-FILE-RTX-RATES", stated=Quantity(stated), actual=Quantity(actual)),)
    return ()


def write_rtx(file: BinaryIO, blocks: Iterable[NDArray[np.float64]], recording: Recording, scale: float) -> None:
    """The whole file; ``blocks`` in the record's unit, divided by ``scale`` on the way."""
    file.write("\r\n".join([*_lines(recording), ""]).encode("utf-8"))
    for block in blocks:
        file.write((block / scale).astype("<f8").tobytes())
    file.write(b"\r\nEOF::\r\n")


def _lines(recording: Recording) -> list[str]:
    found = dict(recording.header)
    rate = f"{recording.rate_hz:.17g}"
    data = {"File Type": found.get("File Type", "rtx"), "Velocity": found.get("Velocity", "0")}
    data |= {"Sample rate": found.get("Sample rate", rate), "Sample no": str(len(recording))}
    data |= {"Trigger point": str(recording.trigger or 0), "Trigger interval": f"{1.0 / recording.rate_hz:.10g}"}
    data |= {"Actual sample rate": rate, "Flags": found.get("Flags", "0 1 2 0 2")}
    head = {"File type": "rtx", "Owner": found.get("Owner", "trueflank"), "Version no": found.get("Version no", "0")}
    lines = ["HEADER::", *_keys(head), "", "TARGET DATA::", *_keys(data), "", "USER-TEXT::"]
    return [*lines, *_keys({word: found.get(word, "") for word in WORDS}), "", "Data:"]


def _keys(values: Mapping[str, str]) -> list[str]:
    return [f"{key}: {plain(value)[:LONGEST_WORD]}" for key, value in values.items()]
