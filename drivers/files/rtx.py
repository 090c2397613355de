"""Dynamic captures, .rtx: a text header and little-endian doubles, mapped and never read twice.

Layout as two independent public readers agree on it: "key: value" lines with CR LF, "Data:" and then exactly
"Sample no" doubles, then "EOF::" with or without a line end before it. The file does not say whether its
numbers are mm or mrad, so `unit` must be confirmed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError, FileFormatError
from drivers.files.numbers import decimal
from drivers.files.rtltext import keyed, lookup
from drivers.files.text import decode
from drivers.recordings import Recording
from drivers.units import ARCSEC_PER_RAD, UM_PER_MM, DeviationUnit

UNITS: dict[str, tuple[DeviationUnit, float]] = {
    "mm": ("um", UM_PER_MM),
    "um": ("um", 1.0),
    "mrad": ("arcsec", ARCSEC_PER_RAD / 1e3),
    "urad": ("arcsec", ARCSEC_PER_RAD / 1e6),
    "arcsec": ("arcsec", 1.0),
}
MARK = b"Data:\r\n"
LONGEST_HEADER = 8192
DOUBLE = struct.calcsize("<d")
WORDS = ("Machine", "Serial No", "Date", "By", "Axis", "Location")


class RtxFormat:
    """Dynamic file driver "rtx"; `unit` is mm, um, mrad, urad or arcsec, as the capture program was set."""

    def __init__(self, unit: str = "", codepage: str = "cp1252") -> None:
        if unit and unit not in UNITS:
            raise ConfigError("E-FILE-UNIT", "rtx", unit=unit, known=", ".join(UNITS))
        self._unit = unit
        self._codepage = codepage

    def read(self, path: Path) -> Recording:
        """Map a file. Raises FileFormatError, ConfigError (E-FILE-RTX-UNIT) where no unit was confirmed.

        A file that ends early gives what is there and says so in the warnings.
        """
        where = str(path)
        head, start, size = _head(path)
        keys = keyed(decode(head, self._codepage, where).splitlines())
        stated, rate = _number(keys, "Sample no", where), _rate(keys, where)
        if stated != int(stated) or stated < 1:
            raise FileFormatError("E-FILE-RTX-VALUE", where, key="Sample no", value=f"{stated:g}")
        there = min((size - start) // DOUBLE, int(stated))
        if there < 1:
            raise FileFormatError("E-FILE-ROWS", where)
        if not self._unit:
            raise ConfigError("E-FILE-RTX-UNIT", where)
        raw = np.memmap(path, dtype="<f8", mode="r", offset=start, shape=(there,))
        _check_finite(raw, where)
        unit, scale = UNITS[self._unit]
        warnings = (*_ending(path, start + there * DOUBLE, there, int(stated)), *_doubts(keys))
        return Recording(raw, rate, unit, scale, _trigger(keys, there), header=keys, warnings=warnings)

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


def _head(path: Path) -> tuple[bytes, int, int]:
    """Header bytes, place of the first double and size of the file."""
    where = str(path)
    try:
        with path.open("rb") as file:
            head = file.read(LONGEST_HEADER)
            size = file.seek(0, 2)
    except OSError as error:
        raise FileFormatError("E-FILE-READ", where, why=str(error)) from error
    if not head.removeprefix(b"\xef\xbb\xbf").startswith(b"HEADER::"):
        raise FileFormatError("E-FILE-DETECT", where, found=head[:40].decode("latin-1"))
    end = head.find(MARK)
    if end < 0:
        raise FileFormatError("E-FILE-RTX-DATA", where, limit=LONGEST_HEADER)
    return head[:end], end + len(MARK), size


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
        raise FileFormatError("E-FILE-RTX-VALUE", where, key="Actual sample rate", value=f"{rate:g}")
    return rate


def _trigger(keys: Mapping[str, str], count: int) -> int | None:
    value = decimal(lookup(dict(keys), "Trigger point") or "")
    return int(value) if value is not None and 0 <= value < count else None


def _check_finite(raw: NDArray[np.float64], where: str) -> None:
    for start in range(0, len(raw), 1 << 20):
        bad = np.flatnonzero(~np.isfinite(raw[start : start + (1 << 20)]))
        if len(bad):
            raise FileFormatError("E-FILE-RTX-SAMPLE", where, sample=start + int(bad[0]))


def _ending(path: Path, place: int, there: int, stated: int) -> tuple[str, ...]:
    if there < stated:
        return (f"the file was cut: {there} of {stated} samples are there",)
    with path.open("rb") as file:
        file.seek(place)
        rest = file.read(64)
    if rest.strip() == b"EOF::":
        return ()
    return ("no EOF:: at the end" if not rest.strip() else "there is more after the last sample; it was left out",)


def _doubts(keys: Mapping[str, str]) -> tuple[str, ...]:
    stated, actual = (decimal(lookup(dict(keys), key) or "") for key in ("Sample rate", "Actual sample rate"))
    if stated and actual and abs(stated - actual) > 1e-6 * stated:
        return (f"the sample rate asked for was {stated:g} Hz, the actual one {actual:g} Hz is used",)
    return ()


def write_rtx(file: BinaryIO, blocks: Iterable[NDArray[np.float64]], recording: Recording, scale: float) -> None:
    """The whole file; ``blocks`` in the record's unit, divided by ``scale`` on the way."""
    file.write("\r\n".join([*_lines(recording), ""]).encode("utf-8"))
    for block in blocks:
        file.write((block / scale).astype("<f8").tobytes())
    file.write(b"\r\nEOF::\r\n")


def _lines(recording: Recording) -> list[str]:
    found = dict(recording.header)
    rate = f"{recording.rate_hz:.10g}"
    data = {"File Type": found.get("File Type", "rtx"), "Velocity": found.get("Velocity", "0")}
    data |= {"Sample rate": found.get("Sample rate", rate), "Sample no": str(len(recording))}
    data |= {"Trigger point": str(recording.trigger or 0), "Trigger interval": f"{1.0 / recording.rate_hz:.10g}"}
    data |= {"Actual sample rate": rate, "Flags": found.get("Flags", "0 1 2 0 2")}
    head = {"File type": "rtx", "Owner": found.get("Owner", "trueflank"), "Version no": found.get("Version no", "0")}
    lines = ["HEADER::", *_keys(head), "", "TARGET DATA::", *_keys(data), "", "USER-TEXT::"]
    return [*lines, *_keys({word: found.get(word, "") for word in WORDS}), "", "Data:"]


def _keys(values: Mapping[str, str]) -> list[str]:
    return [f"{key}: {value}" for key, value in values.items()]
