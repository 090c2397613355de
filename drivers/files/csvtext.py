"""A measured set or a recording as a table for spreadsheets: no cell of text can be taken for a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping

import numpy as np

from drivers.recordings import Recording
from drivers.types.results import MeasuredSet
from drivers.units import deviation_unit

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
LONGEST_CELL = 1000
ROWS = 1 << 14


def plain(text: str) -> str:
    """Text on one line without control characters."""
    return "".join(char if char.isprintable() else " " for char in text)[:LONGEST_CELL].strip()


def guarded(text: str) -> str:
    """A cell of text: one line, and an apostrophe before what a spreadsheet would work out."""
    start = text.startswith(FORMULA)
    clean = plain(text)
    return f"'{clean}" if start or clean.startswith(FORMULA) else clean


def line(cells: list[str]) -> str:
    """One line of a table, quoted where it must be."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\r\n").writerow(cells)
    return buffer.getvalue()


def _words(header: Mapping[str, str]) -> Iterator[str]:
    """What was said about the measurement, as comment lines; a reader of the table skips them."""
    for key, value in header.items():
        yield line([f"# {plain(key).replace(',', ' ').replace(chr(34), ' ')}", guarded(value)])


def table_text(measured: MeasuredSet) -> str:
    """Columns target, direction (up, down), repetition, deviation; what is missing has no row."""
    unit = deviation_unit(measured.axis_unit)
    lines = [line([f"target_{measured.axis_unit}", "direction", "repetition", f"deviation_{unit}"])]
    for repetition in range(measured.deviations.shape[1]):
        for way, word in ((0, "up"), (1, "down")):
            for target, value in zip(measured.targets, measured.deviations[:, repetition, way], strict=True):
                if not np.isnan(value):
                    lines.append(line([number(target), word, str(repetition + 1), number(value)]))
    return "".join([*_words(measured.header), *lines])


def number(value: float) -> str:
    """The shortest decimal that gives the same double back."""
    return repr(float(value) + 0.0)


def recording_lines(recording: Recording) -> Iterator[str]:
    """A dynamic record as text, piece by piece: time_s (lost samples counted) and the value with its unit."""
    yield from _words(recording.header)
    yield line(["time_s", f"value_{recording.unit}"])
    for start in range(0, len(recording), ROWS):
        times, values = recording.times(start, start + ROWS), recording.values(start, start + ROWS)
        yield "".join(f"{t:.9g},{v!r}\r\n" for t, v in zip(times.tolist(), values.tolist(), strict=True))
