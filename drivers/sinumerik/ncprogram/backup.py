"""NC blocks that write live tables, switches and backlash of an axis to a file, loadable as a program.

WRITE appends one block to a file, DELETE removes the old one (Job Planning manual; signatures as in the
editor completion lists); STOPRE before, because system variables are read ahead of the axes else. What such a
file must hold, line by line, stands here once: `written` believes a file only when it holds it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from drivers.errors import DeviceRefused
from drivers.sinumerik.ncprogram import reversing
from drivers.sinumerik.ncprogram.words import file_path

Section = Literal["LIVE", "BACK", "READ"]
END_WORD = "M17"
_LONGEST_VALUE = 16  # equals sign, line end, and a number of 14 signs
_CEC_PARAMETERS = ("STEP", "MIN", "MAX", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO", "TYPE")
ERROR, POINT, _COUNTER, _CEC = "UERR", "UPOINT", "ULINES", "UCEC"
VARIABLES = f"{ERROR}, {POINT}, {_COUNTER}, {_CEC}"


@dataclass(frozen=True, slots=True)
class Memory:
    """What the control reserved: EEC points of the axis' encoder (MD38000), CEC points by table (MD18342).

    ``axes`` are the machine axis names: a program can compare values of type AXIS, but not write them down.
    ``file_kb`` is how large a written file may become (MD11420), 0 where that is not known.
    """

    eec_points: int
    cec_points: tuple[int, ...] = ()
    axes: tuple[str, ...] = ()
    file_kb: int = 0


@dataclass(frozen=True, slots=True)
class Saving:
    """One file of ours: which run wrote it, and of what. ``number`` is the program's transaction number or token.

    ``factor``: MD32452 stands in it; a road that cannot read that factor writes no line for it.
    """

    section: Section
    number: int
    axis: str
    encoder: int
    memory: Memory
    factor: bool = True

    @property
    def path(self) -> str:
        """Where the program writes it."""
        return file_path(self.section, self.axis)

    @property
    def first_line(self) -> str:
        """A comment to the control: whose file this is."""
        return f";TRUEFLANK {self.section} {self.number} {self.axis} ENCODER {self.encoder}"

    @property
    def last_mark(self) -> str:
        """The comment before the end word, up to the count of the lines before it."""
        return f";TRUEFLANK END {self.section} {self.number} LINES "


@dataclass(frozen=True, slots=True)
class Points:
    """The reserved points of one table: names ``left`` number ``right``, numbers from 0."""

    left: str
    right: str
    count: int

    @property
    def places(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(f"{self.left}{number}{self.right}" for number in range(self.count))


def own_points(saving: Saving) -> Points:
    """Points of the axis' EEC table."""
    return Points(f"$AA_ENC_COMP[{saving.encoder},", f",{saving.axis}]", saving.memory.eec_points)


def own_parameters(saving: Saving) -> tuple[str, ...]:
    """Parameters of the axis' EEC table; none where nothing is reserved."""
    names = ("STEP", "MIN", "MAX", "IS_MODULO") if saving.memory.eec_points else ()
    return tuple(f"$AA_ENC_COMP_{name}[{saving.encoder},{saving.axis}]" for name in names)


def cross_points(table: int, saving: Saving) -> Points:
    """Points of a CEC table."""
    return Points(f"$AN_CEC[{table},", "]", saving.memory.cec_points[table])


def cross_axes(table: int | str) -> tuple[str, ...]:
    """Input and output axis of a CEC table."""
    return f"$AN_CEC_INPUT_AXIS[{table}]", f"$AN_CEC_OUTPUT_AXIS[{table}]"


def cross_parameters(table: int | str) -> tuple[str, ...]:
    """The other parameters of a CEC table."""
    return tuple(f"$AN_CEC_{name}[{table}]" for name in _CEC_PARAMETERS)


def cross_step(table: int | str) -> str:
    """What alone is written of a CEC table that was never loaded: its STEP, which is 0."""
    return f"$AN_CEC_STEP[{table}]"


def cross_switches(table: int | str) -> tuple[str, ...]:
    """SD41300 and SD41310 of a CEC table, loaded or not."""
    return f"$SN_CEC_TABLE_ENABLE[{table}]", f"$SN_CEC_TABLE_WEIGHT[{table}]"


def axis_settings(saving: Saving) -> tuple[str, ...]:
    """Backlash with its factor, EEC and CEC switch of the axis, the CEC switch of every other: tables may act there."""
    own = f"[{saving.encoder},{saving.axis}]"
    switches = (f"$MA_CEC_ENABLE[{axis}]" for axis in switched_axes(saving))
    factor = (reversing.factor(saving.axis),) if saving.factor else ()
    return f"$MA_BACKLASH{own}", *factor, f"$MA_ENC_COMP_ENABLE{own}", *switches


def switched_axes(saving: Saving) -> tuple[str, ...]:
    """The axes whose CEC switch is written, the file's own first."""
    return tuple(dict.fromkeys((saving.axis, *saving.memory.axes)))


def reserved_tables(memory: Memory) -> tuple[int, ...]:
    """Numbers of the CEC tables that have memory."""
    return tuple(table for table, points in enumerate(memory.cec_points) if points)


def blocks(saving: Saving, failed: str) -> list[str]:
    """Blocks that write everything which moves the axis to its file; they jump to ``failed`` if they cannot.

    They use the integers `VARIABLES`, which the program must define. All reserved points are written, so that
    leftovers beyond the end of a table are on record too. The lines are counted as they are written.
    Raises DeviceRefused (E-NC-FILE-LIMIT) where the file would outgrow what the control lets a file become.
    """
    _check_size(saving)
    write = _Writer(saving.path, failed)
    out = [f'DELETE({ERROR},"{saving.path}")', "STOPRE", f"{_COUNTER}=0", *write.text(f'"{saving.first_line}"')]
    if saving.memory.eec_points:
        out += [*write.points(own_points(saving)), *write.values(own_parameters(saving))]
    for tables in _alike(saving.memory):
        points = cross_points(tables[0], saving).count
        if len(tables) == 1:
            out += _cross(write, tables[0], points, saving)
        else:
            out += [f"FOR {_CEC}={tables[0]} TO {tables[-1]}", *_cross(write, _CEC, points, saving), "ENDFOR"]
    out += write.values(axis_settings(saving))
    return [*out, *write.text(f'"{saving.last_mark}"<<{_COUNTER}'), *write.text(f'"{END_WORD}"')]


def _alike(memory: Memory) -> Iterator[tuple[int, ...]]:
    """Numbers of CEC tables in a row that have equally many points: one loop writes them all."""
    for _, group in groupby(reserved_tables(memory), key=lambda table: memory.cec_points[table]):
        numbers = tuple(group)
        rows = groupby(enumerate(numbers), key=lambda item: item[1] - item[0])
        yield from (tuple(number for _, number in row) for _, row in rows)


def size_of(saving: Saving) -> int:
    """Bytes that the file has at most, all tables loaded and every number as long as numbers are."""
    places = [*own_points(saving).places, *own_parameters(saving), *axis_settings(saving)]
    for table in reserved_tables(saving.memory):
        places += [*cross_points(table, saving).places, *cross_parameters(table), *cross_switches(table)]
        places += cross_axes(table)
    marks = len(saving.first_line) + len(saving.last_mark) + len(END_WORD)
    return marks + sum(len(place) + _LONGEST_VALUE for place in places)


def kilobytes(savings: Iterable[Saving]) -> int:
    """What MD11420 must be for the largest of these files."""
    return max((-(-size_of(saving) // 1024) for saving in savings), default=1)


def _check_size(saving: Saving) -> None:
    needed, limit = kilobytes([saving]), saving.memory.file_kb
    if 0 < limit < needed:
        raise DeviceRefused("E-NC-FILE-LIMIT", saving.path, needed_kb=needed, limit_kb=limit, axis=saving.axis)


def _cross(write: _Writer, table: int | str, points: int, saving: Saving) -> list[str]:
    """A CEC table, or the one whose number a variable holds; never loaded (STEP 0) it has no axes: its STEP says so."""
    inner = write.points(Points(f"$AN_CEC[{table},", "]", points))
    for name in cross_axes(table):
        for axis in saving.memory.axes:
            inner += [f"IF {name}==({axis})", *write.text(f'"{_named(name)}=({axis})"'), "ENDIF"]
    inner += write.values(cross_parameters(table))
    never = write.values((cross_step(table),))
    switches = write.values(cross_switches(table))
    return [f"IF {cross_step(table)}<>0", *inner, "ELSE", *never, "ENDIF", *switches]


def _named(name: str) -> str:
    """A name inside a text: the number of a table that a variable holds is put in when the program runs."""
    return name.replace(f"[{_CEC}", f'["<<{_CEC}<<"')


@dataclass(frozen=True, slots=True)
class _Writer:
    path: str
    failed: str

    def text(self, *texts: str) -> list[str]:
        """A line for each text, counted once all of them are written."""
        out = [
            block
            for text in texts
            for block in (f'WRITE({ERROR},"{self.path}",{text})', f"IF {ERROR}<>0 GOTOF {self.failed}")
        ]
        return [*out, f"{_COUNTER}={_COUNTER}+{len(texts)}"]

    def values(self, names: Iterable[str]) -> list[str]:
        return self.text(*(f'"{_named(name)}="<<{name}' for name in names))

    def points(self, points: Points) -> list[str]:
        left, right = points.left, points.right
        text = f'"{_named(left)}"<<{POINT}<<"{right}="<<{left}{POINT}{right}'
        return [f"FOR {POINT}=0 TO {points.count - 1}", *self.text(text), "ENDFOR"]
