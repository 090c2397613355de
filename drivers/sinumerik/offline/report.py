"""What a carried program says of the control at its end: the blocks that write it, and the record that is read.

Each line is a comment to the control, ``;NAME=VALUE`` by the NC's own names; the first names the step, the last but one
counts the lines, so that a file that is cut, older or another's is told. Stops of a measurement come before, in order.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from drivers.errors import FileFormatError
from drivers.sinumerik.ncprogram.backup import END_WORD
from drivers.sinumerik.ncprogram.words import COUNT, SetupWord, Word, Words
from drivers.sinumerik.opcua import encoders
from drivers.sinumerik.tablefile import temperature

TOLD, SEEN = "TOLD", "SEEN"
PATHS = {TOLD: "/_N_SPF_DIR/_N_TFTOLD_SPF", SEEN: "/_N_SPF_DIR/_N_TFSEEN_SPF"}
ERROR, LINES, FAILED = "UTERR", "UTLINES", "TF_UNTOLD"
SHOWN = (
    Word.COUNTER,
    Word.REPETITION,
    Word.LABEL,
    Word.APPROACH,
    Word.TARGET,
    Word.ENCODER_COMPENSATION,
    Word.CROSS_COMPENSATION,
)
"""The words of a stop, in the order of its line."""
_OF_AXIS = ("$AA_IM", "$AA_REF", "$AA_STAT", "$VA_ENC1_COMP_VAL", "$VA_ENC2_COMP_VAL", "$VA_CEC_COMP_VAL")
_LAST = re.compile(r";TRUEFLANK END (\w+) (\d+) LINES (\d{1,9})", re.ASCII)
_VALUE = re.compile(r";([$\w]+(?:\[[^\]=]*\])?)=(.*)", re.ASCII)
_STOP = re.compile(r";(STOP|AT) (.+)", re.ASCII)
_TEXT = 60


@dataclass(frozen=True, slots=True)
class ReportAsked:
    """What a report tells: axes in the control's order, how many CEC tables, the R parameters of the site.

    ``marker`` is the R parameter of the machine's own number, -1: none; a report of before it was named lacks it.
    """

    axes: tuple[str, ...]
    tables: int
    words: Words
    marker: int = -1

    @property
    def chain(self) -> str:
        """The R parameter that holds the number of the step that was done last."""
        return f"R{self.words.setup_number(SetupWord.X)}"

    @property
    def names(self) -> tuple[str, ...]:
        """The control's names of all that a report must tell, in order."""
        out = ["$MN_HW_SERIAL_NUMBER[0]", "$MN_VERSION_INFO[0]", "$MN_SCALING_SYSTEM_IS_METRIC"]
        out += ["$MN_LEN_PROTOCOL_FILE", "$MC_DIAMETER_AX_DEF"]
        out += [f"$MN_AXCONF_MACHAX_NAME_TAB[{place}]" for place in range(len(self.axes))]
        for axis in self.axes:
            out += [f"{name}[{axis}]" for name in (*_OF_AXIS, "$MA_IS_ROT_AX", "$MA_ROT_IS_MODULO")]
            out += [f"{name}[{axis}]" for name in ("$MA_CEC_ENABLE", "$MA_CEC_MAX_SUM")]
            out += [*encoders.names_of(axis), *temperature.names_of(axis)]
            out += [f"$MA_BACKLASH[{encoder},{axis}]" for encoder in encoders.INDICES]
        for table in range(self.tables):
            out += [f"$MN_MM_CEC_MAX_POINTS[{table}]", f"$SN_CEC_TABLE_ENABLE[{table}]"]
        return (*out, self.chain, *(f"R{self.words.first + place}" for place in range(COUNT)))

    @property
    def told(self) -> tuple[str, ...]:
        """The same, and the marker."""
        return (*self.names, f"R{self.marker}") if self.marker >= 0 else self.names


@dataclass(frozen=True, slots=True)
class ToldStop:
    """One stop: the words as they stood, and where all axes stood, by name."""

    words: dict[Word, float]
    places: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ToldReport:
    """What the control said at the end of a step: values by the NC's own names, as they were written."""

    number: int
    values: dict[str, str]
    stops: tuple[ToldStop, ...] = ()


def begun(kind: str, number: int) -> list[str]:
    """Blocks that begin the file anew. They need the integers `ERROR` and `LINES`."""
    return [f'DELETE({ERROR},"{PATHS[kind]}")', "STOPRE", f"{LINES}=0", *_line(kind, f'"{first_line(kind, number)}"')]


def first_line(kind: str, number: int) -> str:
    """Whose report it is."""
    return f";TRUEFLANK {kind} {number}"


def at_stop(asked: ReportAsked) -> list[str]:
    """Blocks that tell one stop while the axis stands there."""
    told = '" "'.join(f"<<{asked.words.name(word)}<<" for word in SHOWN).removesuffix("<<")
    out = _line(TOLD, f'";STOP "{told}')
    for axis in asked.axes:
        out += _line(TOLD, f'";AT {axis} "<<$AA_IM[{axis}]')
    return out


def ended(kind: str, number: int, asked: ReportAsked) -> list[str]:
    """Blocks that tell everything and end the file."""
    out = [block for name in asked.told for block in _line(kind, f'";{name}="<<{name}')]
    out += _line(kind, f'";TRUEFLANK END {kind} {number} LINES "<<{LINES}')
    return [*out, *_line(kind, f'"{END_WORD}"')]


def _line(kind: str, text: str) -> list[str]:
    write = f'WRITE({ERROR},"{PATHS[kind]}",{text})'
    return [write, f"IF {ERROR}<>0 GOTOF {FAILED}", f"{LINES}={LINES}+1"]


def read(text: str, where: str, kind: str, number: int, names: Iterable[str]) -> ToldReport:
    """The report of one step.

    Raises FileFormatError: E-OFF-OTHER (of another step), E-OFF-REPORT (not whole, or damaged).
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    check_ends(lines, where, first_line(kind, number), f"{kind} {number}")
    values: dict[str, str] = {}
    stops: list[ToldStop] = []
    for place, line in enumerate(lines[1:-2], start=2):
        found, stop = _VALUE.fullmatch(line), _STOP.fullmatch(line)
        if stop is not None:
            _take_stop(stops, stop[1], stop[2].split(), where, place)
        elif found is None or found[1] in values:
            raise damaged(where, lines, place, "a value of its own")
        else:
            values[found[1]] = found[2]
    missing = [name for name in names if name not in values]
    if missing:
        raise damaged(where, lines, len(lines), missing[0])
    return ToldReport(number, values, tuple(stops))


def check_ends(lines: Sequence[str], where: str, first: str, ends: str) -> None:
    """Begin, end and count of a file of ours. Raises as `read`."""
    if not lines or not lines[0].startswith(";TRUEFLANK "):
        raise damaged(where, lines, 1, first)
    if lines[0] != first:
        raise of_another(where, lines[0], first)
    last = _LAST.fullmatch(lines[-2]) if len(lines) > 2 and lines[-1] == END_WORD else None
    if last is None:
        raise damaged(where, lines, len(lines), f"{END_WORD} at its end")
    if f"{last[1]} {last[2]}" != ends:
        raise of_another(where, lines[-2], f";TRUEFLANK END {ends}")
    if int(last[3]) != len(lines) - 2:
        raise damaged(where, lines, len(lines) - 1, f"LINES {len(lines) - 2}")


def of_another(where: str, found: str, wanted: str) -> FileFormatError:
    """What says that a line names another step, run or section than the file that is waited for."""
    return FileFormatError("E-OFF-OTHER", where, found=found[1:_TEXT], wanted=wanted[1:])


def damaged(where: str, lines: Sequence[str], line: int, wanted: str) -> FileFormatError:
    """What says that a line, counted from 1, is not what must stand there."""
    text = lines[line - 1][:_TEXT] if lines else ""
    return FileFormatError("E-OFF-REPORT", where, line=line, text=text, wanted=wanted)


def _take_stop(stops: list[ToldStop], kind: str, parts: list[str], where: str, line: int) -> None:
    try:
        if kind == "STOP":
            stops.append(ToldStop(dict(zip(SHOWN, map(float, parts), strict=True))))
        else:
            name, value = parts
            stops[-1].places[name] = float(value)
    except (ValueError, IndexError) as error:
        text = " ".join(parts)[:_TEXT]
        raise FileFormatError("E-OFF-REPORT", where, line=line, text=text, wanted="a stop") from error
