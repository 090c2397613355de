"""Files of Klingelnberg's gear measuring centres: curves (.mka), values (.mew), plane contour scans (.dat).

Layout, signs and abscissa as public readers of many real files have them; the maker prints no description.

- ``.mka``: first line HEADER KS.MK.FILE; lines ``number :label: value : value``; blocks of profile and lead curves,
  each with a head that names tooth, flank and how many numbers follow (um); pitch by tooth in tables of its own.
- Abscissa: a profile runs in even steps of *roll length* L = sqrt(r^2 - r_b^2) between the diameters 41 (da) and 44
  (de), not in even steps of diameter; r_b is the base radius of the transverse section. A lead runs evenly from 61 (ba)
  to 64 (be).
- Sign: the curves hold the probe's sense. Surplus material is positive after a factor of -1 on left profiles, +1 on
  right ones, -1 on leads. Settings of the header change what values mean; others than 178 = 1 (DIN), 179 = 1 (slope of
  a lead over the face width) and 180 = 0 are refused.
- -2147483.648 is no reading; in ``.mew`` -9999 is not measured and 8999 not available.
- ``.dat``: a line ``[A]``, then rows ``index; x; y; z;`` in mm, one height a block.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import FileFormatError
from drivers.files.gear import LARGEST_DEVIATION_UM, LARGEST_MM, wrong_line
from drivers.files.numbers import decimal
from drivers.files.text import read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message, digits
from drivers.types.circles import MakersFigure, MakersFigures
from drivers.types.gearfiles import GearContour, GearCurve, GearCurves
from drivers.types.values import FloatArray

CODEPAGE = "latin-1"
UNDEFINED, NOT_MEASURED = -2147483.648, (-9999.0, 8999.0)
NEAR_UNDEFINED = 1000.0
MOST_VALUES, MOST_ROWS, MOST_CURVES = 100_000, 500_000, 4000
SAME_HEIGHT = 0.05  # mm, within one plane section
SETTINGS = {178: 1.0, 179: 1.0, 180: 0.0}
SIGN = {("profile", 1): -1.0, ("profile", -1): 1.0, ("lead", 1): -1.0, ("lead", -1): -1.0}
PROFILE = ("profil", "profile", "齿形")
LEAD = ("flankenlinie", "lead", "helix", "齿向")
FLANKS = {"links": 1, "left": 1, "左": 1, "rechts": -1, "right": -1, "右": -1}
_SIDES = "|".join(FLANKS)
_NUMBERED = re.compile(r"\s*(\d{1,4})\s*:([^:]*):\s*(.*?)\s*\Z")
_BLOCK = re.compile(rf"\s*({'|'.join((*PROFILE, *LEAD))})\s*:", re.IGNORECASE)
_HEAD = re.compile(
    rf"(?:Zahn-Nr\.?|Tooth[- ]No\.?|齿号)\s*:?\s*(?P<tooth>\d{{1,4}}[a-z]?)\s*(?P<side>{_SIDES})\s*/\s*"
    r"(?P<count>\d{1,6})\s*(?:Werte|values)?\s*/?\s*(?P<axis>[xdz])\s*=\s*(?P<at>[\d.]+)",
    re.IGNORECASE,
)
_TWIST = re.compile(r"\s*(?:Verschränkung|Verschr.nkung|twist)\s*:", re.IGNORECASE)
_PITCH = re.compile(r"\s*(?:(linke|left|左)|(rechte|right|右))\s*(?:Zahnflanke|flank|齿面)", re.IGNORECASE)
_VALUE = re.compile(r"\s*(\d{5})\s*:([^:]*):\s*([+-]?\d[\d.]*)\s*\Z")
_SECTION = re.compile(r"\s*\[([A-Z])\]\s*\Z")
_WORDS_OF = {"1": ("profil", "齿形"), "2": ("flankenlinie", "lead", "helix", "齿向")}


class KlingelnbergCurves:
    """Gear file driver "mka"."""

    def read(self, path: Path) -> GearCurves:
        """The curves of a file. Raises FileFormatError (E-GEARFILE-..., E-FILE-LINE) with the line."""
        return read_mka(decode_text(read_bytes(path), CODEPAGE, str(path)), str(path))


class KlingelnbergValues:
    """Gear file driver "mew"."""

    def read(self, path: Path) -> MakersFigures:
        """The maker's own values. Raises FileFormatError."""
        return read_mew(decode_text(read_bytes(path), CODEPAGE, str(path)), str(path))


class KlingelnbergContour:
    """Gear file driver "gear-contour"."""

    def read(self, path: Path) -> GearContour:
        """The sections of a file. Raises FileFormatError."""
        return read_contour(decode_text(read_bytes(path), CODEPAGE, str(path)), str(path))


def is_contour(text: str) -> bool:
    """Whether a text begins as a contour scan does."""
    return re.match(r"\s*\[[A-Z]\]\s*\r?\n\s*\d+\s*;[^;\n]*;[^;\n]*;", text) is not None


# ---- curves


@dataclass(slots=True)
class _Raw:
    """What the lines held: header values by number, heads with their numbers, pitch rows by flank."""

    header: dict[int, str] = field(default_factory=dict)
    curves: list[tuple[str, re.Match[str], int, list[float]]] = field(default_factory=list)
    pitch: dict[int, list[list[float]]] = field(default_factory=dict)
    twists: int = 0


def read_mka(text: str, where: str) -> GearCurves:
    """The curves of a text, pure. Raises what `KlingelnbergCurves.read` raises."""
    lines = text.lstrip("\ufeff").splitlines()
    if not lines or not re.match(r"\s*HEADER\s+KS\.MK\.FILE", lines[0]):
        raise FileFormatError(
            "E-GEARFILE-HEAD", where, found=lines[0][:60] if lines else "", wanted="HEADER KS.MK.FILE"
        )
    raw = _Raw()
    _read_lines(lines, raw, where)
    if not raw.curves:
        raise FileFormatError("E-FILE-ROWS", where)
    _check_settings(raw.header, where)
    facts = _Facts(raw.header, where)
    curves = tuple(_curve(*one, facts=facts, where=where) for one in raw.curves)
    warnings = [Message.of("S-GEARFILE-TWIST", count=raw.twists)] if raw.twists else []
    lost = sum(int(np.count_nonzero(np.isnan(one.deviation_um))) for one in curves)
    warnings += [Message.of("S-GEARFILE-UNDEFINED", count=lost)] if lost else []
    stated = {str(number): value for number, value in sorted(raw.header.items())}
    missing = [str(number) for number in SETTINGS if number not in raw.header]
    warnings += [Message.of("S-GEARFILE-SETTINGS", numbers=", ".join(missing))] if missing else []
    width = facts.number(26) if raw.header.get(179) is not None else 0.0
    pitch = {flank: np.asarray(rows, dtype=np.float64) for flank, rows in raw.pitch.items()}
    return GearCurves(
        curves=curves,
        pitch_um=pitch,
        width_mm=width,
        source=where,
        header=stated,
        warnings=tuple(warnings),
    )


def _read_lines(lines: list[str], raw: _Raw, where: str) -> None:
    feature, side, at = "", 0, 1
    while at < len(lines):
        line = lines[at]
        at += 1
        block, pitch = _BLOCK.match(line), _PITCH.match(line)
        if _TWIST.match(line):
            raw.twists += 1
            feature, side = "", 0  # its curve is passed over below
        elif block:
            feature, side = ("profile" if block[1].lower() in PROFILE else "lead"), 0
        elif pitch:
            feature, side = "", 1 if pitch[1] else -1
        head = _HEAD.search(line)
        if head is not None:
            count = int(head["count"])
            if count > MOST_VALUES or len(raw.curves) >= MOST_CURVES:
                raise FileFormatError("E-FILE-SIZE", where, targets=count, repetitions=1, limit=MOST_VALUES)
            begun, (at, values) = at, _values(lines, at, count, where)
            if feature:
                raw.curves.append((feature, head, begun, values))
        elif side:
            _pitch_row(line, side, raw)
        elif not block and (numbered := _NUMBERED.match(line)):
            raw.header.setdefault(int(numbered[1]), numbered[3])


def _values(lines: list[str], at: int, count: int, where: str) -> tuple[int, list[float]]:
    """The next ``count`` numbers and the line after them. Raises FileFormatError (E-GEARFILE-COUNT, E-FILE-LINE)."""
    found: list[float] = []
    begun = at
    while len(found) < count:
        words = lines[at].split() if at < len(lines) else []
        if not words and at >= len(lines):
            raise FileFormatError("E-GEARFILE-COUNT", where, line=begun, stated=count, found=len(found))
        for word in words:
            value = decimal(word)
            if value is None:
                if _HEAD.search(lines[at]) or ":" in word:
                    raise FileFormatError("E-GEARFILE-COUNT", where, line=begun, stated=count, found=len(found))
                raise wrong_line(where, at + 1, Message.of("W-FILE-NO-NUMBER", bad=word[:40]))
            found.append(value)
        at += 1
    if len(found) > count:
        raise FileFormatError("E-GEARFILE-COUNT", where, line=begun, stated=count, found=len(found))
    return at, found


def _pitch_row(line: str, side: int, raw: _Raw) -> None:
    """A row tooth, f_p, F_p, F_r; any other line ends nothing and holds nothing."""
    words = line.split()
    numbers = [decimal(word) for word in words]
    if len(numbers) == 4 and None not in numbers:
        raw.pitch.setdefault(side, []).append([float(one) for one in numbers[1:] if one is not None])


def _check_settings(header: Mapping[int, str], where: str) -> None:
    for number, wanted in SETTINGS.items():
        stated = header.get(number)
        if stated is not None and decimal(stated.split(":")[0].strip()) != wanted:
            raise FileFormatError(
                "E-GEARFILE-SETTING", where, number=number, found=stated[:20], wanted=digits(wanted, 6)
            )


@dataclass(frozen=True, slots=True)
class _Facts:
    """Numbers of the header that the abscissa needs."""

    header: Mapping[int, str]
    where: str

    def number(self, key: int) -> float:
        """Raises FileFormatError (E-GEARFILE-FACT)."""
        value = decimal(self.header.get(key, "").split(":")[0].split("!")[0].strip())
        if value is None:
            raise FileFormatError("E-GEARFILE-FACT", self.where, number=key)
        return value

    @property
    def base_radius(self) -> float:
        """Of the transverse section, mm: r_b = z m / (2 cos beta) cos alpha_t, tan alpha_t = tan alpha / cos beta."""
        module, teeth, helix, pressure = (self.number(key) for key in (21, 22, 23, 24))
        if not (
            0.0 < abs(module) < 1000.0 and 0.0 < abs(teeth) < 10_000 and abs(helix) < 80.0 and 0.0 < pressure < 60.0
        ):
            raise FileFormatError("E-GEARFILE-FACT", self.where, number=21)
        beta, alpha = np.deg2rad(helix), np.deg2rad(pressure)
        transverse = np.arctan(np.tan(alpha) / np.cos(beta))
        return float(abs(teeth * module) / (2.0 * np.cos(beta)) * np.cos(transverse))

    def roll(self, key: int) -> float:
        """Roll length at a diameter of the header, mm. Raises FileFormatError (E-GEARFILE-FACT)."""
        square = (self.number(key) / 2.0) ** 2 - self.base_radius**2
        if square < 0.0:
            raise FileFormatError("E-GEARFILE-FACT", self.where, number=key)
        return float(np.sqrt(square))


def _curve(
    feature: str, head: re.Match[str], line: int, values: list[float], *, facts: _Facts, where: str
) -> GearCurve:
    flank = FLANKS[head["side"].lower()]
    raw = np.asarray(values, dtype=np.float64)
    raw = np.where(raw < UNDEFINED + NEAR_UNDEFINED, np.nan, raw)
    if np.nanmax(np.abs(raw), initial=0.0) > LARGEST_DEVIATION_UM:
        worst = f"{np.nanmax(np.abs(raw)):.4g}"
        raise FileFormatError("E-FILE-GEAR-SIZE", where, place=f"line {line}", deviation=worst)
    profile = feature == "profile"
    first, low, high, last = (
        facts.roll(key) if profile else facts.number(key) for key in ((41, 42, 43, 44) if profile else (61, 62, 63, 64))
    )
    if not first <= low < high <= last:
        raise FileFormatError("E-GEARFILE-RANGE", where, feature=feature, low=digits(low, 4), high=digits(high, 4))
    return GearCurve(
        feature="profile" if profile else "lead",
        tooth=head["tooth"],
        flank=flank,
        along_mm=np.linspace(first, last, raw.size),
        deviation_um=raw * SIGN[feature, flank],
        judged_mm=(low, high),
    )


# ---- values


def read_mew(text: str, where: str) -> MakersFigures:
    """The maker's values by their five digits and label, pure; unit "": the file states none by value.

    Raises FileFormatError (E-GEARFILE-HEAD, E-GEARFILE-CODE: a code whose label tells of the other feature).
    """
    lines = text.lstrip("\ufeff").splitlines()
    if not lines or not re.match(r"\s*HEADER\s+KS\.MW\.FILE", lines[0]):
        raise FileFormatError(
            "E-GEARFILE-HEAD", where, found=lines[0][:60] if lines else "", wanted="HEADER KS.MW.FILE"
        )
    found: list[MakersFigure] = []
    header: dict[str, str] = {}
    for line, told in enumerate(lines, 1):
        value, numbered = _VALUE.match(told), _NUMBERED.match(told)
        if value is not None:
            number = decimal(value[3])
            label = " ".join(value[2].strip(" .").split())
            if any(word in label.lower() for word in _WORDS_OF.get(value[1][0], ())):
                raise FileFormatError("E-GEARFILE-CODE", where, line=line, number=value[1], label=label[:40])
            if number is None:
                raise wrong_line(where, line, Message.of("W-FILE-NO-NUMBER", bad=value[3][:40]))
            if number not in NOT_MEASURED:
                found.append(MakersFigure(f"{value[1]} {label}".strip(), value[1], number, ""))
        elif numbered is not None:
            header.setdefault(numbered[2].strip(" ."), numbered[3])
    if not found:
        raise FileFormatError("E-FILE-ROWS", where)
    return MakersFigures(tuple(found), header=header)


# ---- contour scans


def read_contour(text: str, where: str) -> GearContour:
    """The sections of a scan, pure. Raises FileFormatError (E-GEARFILE-HEAD, E-GEARFILE-INDEX, -PLANE, E-FILE-LINE)."""
    rows: list[tuple[float, float, float]] = []
    section: list[int] = []
    count, index = -1, 0
    for line, told in _lines(text):
        begun = _SECTION.match(told)
        if begun:
            count, index = count + 1, 0
            continue
        if count < 0:
            raise FileFormatError("E-GEARFILE-HEAD", where, found=told[:60], wanted="[A]")
        words = [word.strip() for word in told.strip().rstrip(";").split(";")]
        numbers = [decimal(word) for word in words]
        if len(numbers) != 4 or None in numbers:
            raise wrong_line(where, line, Message.of("W-FILE-ROW-FOUR"))
        number, x, y, z = (float(one) for one in numbers if one is not None)
        index += 1
        if number != index:
            raise FileFormatError("E-GEARFILE-INDEX", where, line=line, found=digits(number, 6), wanted=index)
        rows.append((x, y, z))
        section.append(count)
        if len(rows) > MOST_ROWS:
            raise FileFormatError("E-FILE-SIZE", where, targets=len(rows), repetitions=1, limit=MOST_ROWS)
    if not rows:
        raise FileFormatError("E-FILE-ROWS", where)
    points, of = np.asarray(rows), np.asarray(section, dtype=np.int64)
    _check_sections(points, of, where)
    return GearContour(points, of, where)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for line, told in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        if told.strip(" \t\0\x1a"):
            yield line, told


def _check_sections(points: FloatArray, section: NDArray[np.int64], where: str) -> None:
    if float(np.abs(points).max()) > LARGEST_MM:
        raise FileFormatError("E-FILE-GEAR-SIZE", where, place=digits(np.abs(points).max(), 4), deviation="-")
    for one in range(int(section.max()) + 1):
        z = points[section == one, 2]
        if z.size and float(np.ptp(z)) > SAME_HEIGHT:
            raise FileFormatError(
                "E-GEARFILE-PLANE", where, section=one + 1, low=digits(z.min(), 6), high=digits(z.max(), 6)
            )
