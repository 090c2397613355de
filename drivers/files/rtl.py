"""Vendor results for one axis, .rtl (linear) and .rta (rotary), as measured sets."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.assembly import doubted
from drivers.files.environment import KEYS, environment, environment_words
from drivers.files.numbers import no_readings
from drivers.files.rtltext import RtlText, lookup, parse, render
from drivers.files.text import read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message, digits
from drivers.types.results import MeasuredSet
from drivers.types.values import FloatArray
from drivers.units import AxisUnit, deg_to_arcsec, mm_to_um, rad_to_arcsec, typed_unit

Convert = Callable[[FloatArray], FloatArray]
LENGTH: dict[str, Convert] = {"um": lambda value: value, "mm": mm_to_um}
ANGLE: dict[str, Convert] = {
    "arcsec": lambda value: value,
    "mrad": lambda value: rad_to_arcsec(value / 1e3),
    "urad": lambda value: rad_to_arcsec(value / 1e6),
    "deg": deg_to_arcsec,
}
# Beyond these a unit is doubted: 5 mrad is 1031 arcsec, and no axis is good to a thousandth of one.
LARGEST = {"mm": 5000.0, "deg": 1000.0}
SMALLEST = {"mm": 0.001, "deg": 0.001}
NOT_HEADER = ("TARGET DATA", "RUNS", "DEVIATIONS", "HEADER", "USER-TEXT", "ENVIRONMENT")
ONE_TURN_DEG = 370.0
TITLE = "TITLE"
WORDS = ("Machine", "Serial No", "Date", "By", "Axis", "Location", TITLE)
# Keys that are written from the numbers themselves, or belong to another section.
MADE = ("File type", "Owner", "Version no", "Filetype", "Target-count", "Targets", "Flags", "Run-count", *KEYS)
_SECTION_NAME = re.compile(r"[A-Z][A-Z0-9 -]*")
_BREAK = re.compile(r"[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]+")


class RtlFormat:
    """File driver "rtl": targets mm, deviations um unless `unit` says mm; deviation = measured - target."""

    def __init__(self, unit: str = "", codepage: str = "cp1252", *, confirmed: bool = False) -> None:
        self._confirmed = confirmed
        self._convert = _conversion(typed_unit(unit) or "um", LENGTH, "rtl")
        self._codepage = codepage

    def read(self, path: Path) -> MeasuredSet:
        """Read a file. Raises FileFormatError with line and reason."""
        where = str(path)
        content = parse(decode_text(read_bytes(path), self._codepage, where), where)
        return doubted(measured_set(content, "mm", self._convert, where), where, confirmed=self._confirmed)

    def text(self, measured: MeasuredSet) -> str:
        """A linear set as a file, deviations in um. Raises ConfigError (E-FILE-KIND) for a rotary one."""
        _must_be(measured, "mm", "rtl")
        return text_of(measured, "rtl")


class RtaFormat:
    """File driver "rta": targets deg; the file does not say its deviation unit, so `unit` must be confirmed."""

    def __init__(self, unit: str = "", codepage: str = "cp1252", *, confirmed: bool = False) -> None:
        self._confirmed = confirmed
        unit = "urad" if typed_unit(unit) == "um/m" else typed_unit(unit)
        self._unit = unit
        self._codepage = codepage
        if unit:
            _conversion(unit, ANGLE, "rta")

    def read(self, path: Path) -> MeasuredSet:
        """Read a file. Raises ConfigError (E-FILE-RTA-UNIT) without a unit, FileFormatError."""
        where = str(path)
        content = parse(decode_text(read_bytes(path), self._codepage, where), where)
        if not self._unit:
            largest = max(abs(value) for _run, _target, value in content.rows)
            raise ConfigError("E-FILE-RTA-UNIT", where, largest=digits(largest, 6))
        return doubted(measured_set(content, "deg", ANGLE[self._unit], where), where, confirmed=self._confirmed)

    def origin(self, path: Path) -> dict[str, str]:
        """The file's own words (Machine, Serial No, ...) without its numbers, for which no unit is needed yet."""
        where = str(path)
        return _header(parse(decode_text(read_bytes(path), self._codepage, where), where))

    def text(self, measured: MeasuredSet) -> str:
        """A rotary set as a file in this format's unit (default mrad). Raises ConfigError (E-FILE-KIND)."""
        _must_be(measured, "deg", "rta")
        one = float(ANGLE[self._unit or "mrad"](np.ones(1))[0])
        return text_of(replace(measured, deviations=measured.deviations / one), "rta")


def _must_be(measured: MeasuredSet, axis_unit: AxisUnit, kind: str) -> None:
    if measured.axis_unit != axis_unit:
        raise ConfigError("E-FILE-KIND", kind, found=measured.axis_unit, wanted=axis_unit)


def _conversion(unit: str, known: dict[str, Convert], kind: str) -> Convert:
    if unit not in known:
        raise ConfigError("E-FILE-UNIT", kind, unit=unit, known=", ".join(known))
    return known[unit]


def measured_set(content: RtlText, axis_unit: AxisUnit, convert: Convert, where: str) -> MeasuredSet:
    """Runs to repetitions: odd runs go up through the target numbers, even runs down, whatever their order.

    Where the targets themselves fall with their number, the set is turned round so that they rise.
    """
    targets = np.array(content.targets, np.float64)
    rising = _rises(targets, where)
    deviations, warnings = _deviations(content, len(targets), where)
    deviations = convert(deviations)
    if not rising:
        targets, deviations = targets[::-1], deviations[::-1, :, ::-1]
        warnings.append(Message.of("S-FILE-FALLING"))
    start, end, expansion, doubts = environment(content.keys("ENVIRONMENT"), where)
    warnings += [*doubts, *_size_doubts(targets, deviations, axis_unit)]
    return MeasuredSet(
        targets=targets,
        deviations=deviations,
        axis_unit=axis_unit,
        ambient_start=start,
        ambient_end=end,
        compensated_for="air+material",
        expansion_ppm_per_k=expansion,
        header=_header(content),
        warnings=(*content.warnings, *warnings),
    )


def _rises(targets: FloatArray, where: str) -> bool:
    steps = np.diff(targets)
    if bool((steps > 0).all()):
        return True
    if bool((steps < 0).all()):
        return False
    raise FileFormatError("E-FILE-TARGETS", where)


def _deviations(content: RtlText, count: int, where: str) -> tuple[FloatArray, list[Message]]:
    deviations = no_readings(count, (content.run_count + 1) // 2, where)
    for run, target, value in content.rows:
        deviations[target - 1, (run - 1) // 2, (run - 1) % 2] = value
    warnings = [Message.of("S-FILE-RUN-UP", run=run) for run in _odd_ones(content)]
    missing = content.run_count * count - len(content.rows)
    if missing:
        warnings.append(Message.of("S-FILE-MISSING", count=missing))
    if np.isnan(deviations[:, :, 1]).all():
        warnings.append(Message.of("S-FILE-ONE-WAY"))
    elif not np.nan_to_num(deviations[:, :, 1]).any():
        deviations, doubt = _without_second_way(content, deviations)
        warnings.append(doubt)
    return deviations, warnings


def _odd_ones(content: RtlText) -> list[int]:
    """Even runs whose rows stand in rising target order."""
    order: dict[int, list[int]] = {}
    for run, target, _value in content.rows:
        order.setdefault(run, []).append(target)
    return [run for run, seen in order.items() if run % 2 == 0 and len(seen) > 1 and seen == sorted(seen)]


def _without_second_way(content: RtlText, deviations: FloatArray) -> tuple[FloatArray, Message]:
    flags = (lookup(content.keys("TARGET DATA"), "Flags") or "").split()
    if len(flags) > 1 and flags[1] == "1":
        deviations = deviations.copy()
        deviations[:, :, 1] = np.nan
        return deviations, Message.of("S-FILE-FLAGS")
    return deviations, Message.of("S-FILE-ZEROS")


def _size_doubts(targets: FloatArray, deviations: FloatArray, axis_unit: AxisUnit) -> list[Message]:
    doubts: list[Message] = []
    largest = float(np.nanmax(np.abs(deviations)))
    unit = "um" if axis_unit == "mm" else "arcsec"
    if largest > LARGEST[axis_unit] or 0 < largest < SMALLEST[axis_unit]:
        doubts.append(Message.of("S-FILE-LARGEST", value=digits(largest, 4), unit=unit))
    if axis_unit == "deg" and float(np.ptp(targets)) > ONE_TURN_DEG:
        doubts.append(Message.of("S-FILE-TURNS"))
    return doubts


def _header(content: RtlText) -> dict[str, str]:
    """All keys of the known sections by their names, every other section verbatim under its own."""
    header: dict[str, str] = {}
    for name in ("HEADER", "USER-TEXT", "ENVIRONMENT", "TARGET DATA"):
        for key, value in content.keys(name).items():
            header.setdefault(key if key == TITLE or not _SECTION_NAME.fullmatch(key) else key.capitalize(), value)
    for name, lines in content.sections:
        if name not in NOT_HEADER:
            header[name] = "\n".join(lines)
    return header


def text_of(measured: MeasuredSet, kind: Literal["rtl", "rta"]) -> str:
    """A measured set as a file: um in .rtl, the numbers as they are in .rta; header words and sections are kept."""
    count, repetitions = measured.deviations.shape[:2]
    runs = [(run, _order(count, run)) for run in range(1, 2 * repetitions + 1)]
    rows = [
        (run, target, float(measured.deviations[target - 1, (run - 1) // 2, (run - 1) % 2]))
        for run, order in runs
        for target in order
    ]
    kept = tuple(row for row in rows if not np.isnan(row[2]))
    targets = tuple(float(target) for target in measured.targets)
    return render(RtlText(targets, 2 * repetitions, kept, _sections_of(measured, kind, 2 * repetitions)))


def _order(count: int, run: int) -> range:
    return range(1, count + 1) if run % 2 else range(count, 0, -1)


def _sections_of(measured: MeasuredSet, kind: str, runs: int) -> tuple[tuple[str, tuple[str, ...]], ...]:
    found = {_one_line(key): value for key, value in measured.header.items()}
    heads = {"File type": kind, "Owner": found.get("Owner", "trueflank"), "Version no": found.get("Version no", "0")}
    count = ("Filetype  : ISO", f"Target-count: {len(measured.targets)}", "Flags: 0 0 2 0")
    sections = [name for name in found if _SECTION_NAME.fullmatch(name) and name not in (*WORDS, *NOT_HEADER, "EOF")]
    made = {key.lower() for key in (*MADE, *WORDS)}
    others = [key for key in found if key not in sections and key.lower() not in made and ":" not in key and key]
    air = environment_words(measured.ambient_start, measured.ambient_end, measured.expansion_ppm_per_k)
    air |= {key: _one_line(found[key]) for key in KEYS if key in found}
    return (
        ("HEADER", tuple(f"{key:<11}: {_one_line(value)}" for key, value in heads.items())),
        ("TARGET DATA", count),
        ("USER-TEXT", tuple(f"{word}: {_one_line(found.get(word, ''))}" for word in (*WORDS, *others))),
        ("RUNS", (f"Run-count:{runs}",)),
        ("DEVIATIONS", ("Run Target Data:",)),
        *((name, _section_lines(found[name])) for name in sections),
        *((("ENVIRONMENT", tuple(f"{key:<11}: {value}" for key, value in air.items())),) if air else ()),
    )


def _one_line(text: str) -> str:
    return _BREAK.sub(" ", text).strip()


def _section_lines(text: str) -> tuple[str, ...]:
    """Lines of a section that nobody here understands; none of them may open another one."""
    return tuple(line for line in _BREAK.split(text) if line.strip() and not line.rstrip().endswith("::"))
