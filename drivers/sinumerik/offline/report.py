"""The report of a carried program: the blocks that write it, its record, and the control as it was seen then.

Each line is a comment to the control, ``;NAME=VALUE`` by the NC's own names. The first line names the step, the last
but one counts the lines, so a file that is cut, older or another's is recognised. Stops of a measurement come first, in
order. `SeenControl` answers the session's reads from such a report and from what a person typed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan
from typing import Any

from drivers.errors import FileFormatError
from drivers.message import Message
from drivers.sinumerik.ncprogram.backup import END_WORD
from drivers.sinumerik.ncprogram.words import COUNT, Phase, SetupWord, Word, Words
from drivers.sinumerik.opcua import machine
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.requests import Reading
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile import axis_settings
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus

# Blocks that write a report, and the reader.

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
class ReportRequest:
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
            out += [*machine.encoder_names(axis), *axis_settings.temperature_names(axis)]
            out += [f"$MA_BACKLASH[{encoder},{axis}]" for encoder in machine.ENCODER_INDICES]
        for table in range(self.tables):
            out += [f"$MN_MM_CEC_MAX_POINTS[{table}]", f"$SN_CEC_TABLE_ENABLE[{table}]"]
        return (*out, self.chain, *(f"R{self.words.first + place}" for place in range(COUNT)))

    @property
    def told(self) -> tuple[str, ...]:
        """The same, and the marker."""
        return (*self.names, f"R{self.marker}") if self.marker >= 0 else self.names


@dataclass(frozen=True, slots=True)
class ReportedStop:
    """One stop: the words as they stood, and where all axes stood, by name."""

    words: dict[Word, float]
    places: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StepReport:
    """What the control said at the end of a step: values by the NC's own names, as they were written."""

    number: int
    values: dict[str, str]
    stops: tuple[ReportedStop, ...] = ()


def begin_blocks(kind: str, number: int) -> list[str]:
    """Blocks that begin the file anew. They need the integers `ERROR` and `LINES`."""
    return [f'DELETE({ERROR},"{PATHS[kind]}")', "STOPRE", f"{LINES}=0", *_line(kind, f'"{first_line(kind, number)}"')]


def first_line(kind: str, number: int) -> str:
    """Whose report it is."""
    return f";TRUEFLANK {kind} {number}"


def stop_blocks(asked: ReportRequest) -> list[str]:
    """Blocks that tell one stop while the axis stands there."""
    told = '" "'.join(f"<<{asked.words.name(word)}<<" for word in SHOWN).removesuffix("<<")
    out = _line(TOLD, f'";STOP "{told}')
    for axis in asked.axes:
        out += _line(TOLD, f'";AT {axis} "<<$AA_IM[{axis}]')
    return out


def end_blocks(kind: str, number: int, asked: ReportRequest) -> list[str]:
    """Blocks that tell everything and end the file."""
    out = [block for name in asked.told for block in _line(kind, f'";{name}="<<{name}')]
    out += _line(kind, f'";TRUEFLANK END {kind} {number} LINES "<<{LINES}')
    return [*out, *_line(kind, f'"{END_WORD}"')]


def _line(kind: str, text: str) -> list[str]:
    write = f'WRITE({ERROR},"{PATHS[kind]}",{text})'
    return [write, f"IF {ERROR}<>0 GOTOF {FAILED}", f"{LINES}={LINES}+1"]


def read_report(text: str, where: str, kind: str, number: int, names: Iterable[str]) -> StepReport:
    """The report of one step.

    Raises FileFormatError: E-OFF-OTHER (of another step), E-OFF-REPORT (not whole, or damaged).
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    check_ends(lines, where, first_line(kind, number), f"{kind} {number}")
    values: dict[str, str] = {}
    stops: list[ReportedStop] = []
    for place, line in enumerate(lines[1:-2], start=2):
        found, stop = _VALUE.fullmatch(line), _STOP.fullmatch(line)
        if stop is not None:
            _take_stop(stops, stop[1], stop[2].split(), where, place)
        elif found is None or found[1] in values:
            raise damaged_error(where, lines, place, Message.of("W-OFFLINE-OWN-VALUE"))
        else:
            values[found[1]] = found[2]
    missing = [name for name in names if name not in values]
    if missing:
        raise damaged_error(where, lines, len(lines), missing[0])
    return StepReport(number, values, tuple(stops))


def check_ends(lines: Sequence[str], where: str, first: str, ends: str) -> None:
    """Begin, end and count of a file of ours. Raises as `read_report`."""
    if not lines or not lines[0].startswith(";TRUEFLANK "):
        raise damaged_error(where, lines, 1, first)
    if lines[0] != first:
        raise other_run_error(where, lines[0], first)
    last = _LAST.fullmatch(lines[-2]) if len(lines) > 2 and lines[-1] == END_WORD else None
    if last is None:
        raise damaged_error(where, lines, len(lines), Message.of("W-OFFLINE-END-WORD", end_word=END_WORD))
    if f"{last[1]} {last[2]}" != ends:
        raise other_run_error(where, lines[-2], f";TRUEFLANK END {ends}")
    if int(last[3]) != len(lines) - 2:
        raise damaged_error(where, lines, len(lines) - 1, f"LINES {len(lines) - 2}")


def other_run_error(where: str, found: str, wanted: str) -> FileFormatError:
    """What says that a line names another step, run or section than the file that is waited for."""
    return FileFormatError("E-OFF-OTHER", where, found=found[1:_TEXT], wanted=wanted[1:])


def damaged_error(where: str, lines: Sequence[str], line: int, wanted: str | Message) -> FileFormatError:
    """What says that a line, counted from 1, is not what must stand there."""
    text = lines[line - 1][:_TEXT] if lines else ""
    return FileFormatError("E-OFF-REPORT", where, line=line, text=text, wanted=wanted)


def _take_stop(stops: list[ReportedStop], kind: str, parts: list[str], where: str, line: int) -> None:
    try:
        if kind == "STOP":
            stops.append(ReportedStop(dict(zip(SHOWN, map(float, parts), strict=True))))
        else:
            name, value = parts
            stops[-1].places[name] = float(value)
    except (ValueError, IndexError) as error:
        text = " ".join(parts)[:_TEXT]
        raise FileFormatError("E-OFF-REPORT", where, line=line, text=text, wanted="a stop") from error


# How the control stood when it was seen last, as the wire's own variables: a report, and what a person typed.

ABSENT = "BadNodeIdUnknown"
_SHOWN = {
    "actToolBasePos": "$AA_IM",
    "aaRef": "$AA_REF",
    "aaStat": "$AA_STAT",
    "vaEnc1CompVal": "$VA_ENC1_COMP_VAL",
    "vaEnc2CompVal": "$VA_ENC2_COMP_VAL",
    "vaCecCompVal": "$VA_CEC_COMP_VAL",
}
_TEXTS = ("$MN_HW_SERIAL_NUMBER[0]", "$MN_VERSION_INFO[0]", "$MC_DIAMETER_AX_DEF")
_IN_POSITION = 4


@dataclass(slots=True)
class SeenControl:
    """One report with what was typed; ``stop`` is the stop that is shown now, None at the end. ``queued`` are R
    parameters that the gateway wrote since: they go along in the next program.
    """

    report: StepReport
    asked: ReportRequest
    alarms: tuple[int, ...] = ()
    access_level: int = 7
    program: str = ""
    stop: int | None = None
    queued: dict[int, float] = field(default_factory=dict)

    @property
    def serial(self) -> str:
        """MD18030 as it stands there."""
        return self.report.values["$MN_HW_SERIAL_NUMBER[0]"]

    @property
    def machine(self) -> MachineIdentity:
        """Who the machine is, as the report tells it."""
        values = self.report.values
        names = tuple(values[f"$MN_AXCONF_MACHAX_NAME_TAB[{place}]"].strip() for place in range(len(self.asked.axes)))
        marker = values.get(f"R{self.asked.marker}", "")
        return MachineIdentity(
            self.serial.strip(),
            values["$MN_VERSION_INFO[0]"].strip(),
            tuple(name.upper() for name in names if name),
            marker=f"{float(marker):g}" if marker else "",
        )

    @property
    def chain(self) -> float:
        """The number of the step that was done last there."""
        return float(self.report.values[self.asked.chain])

    def checked(self, where: str) -> SeenControl:
        """Itself. Raises FileFormatError (E-OFF-REPORT) for a number that is none."""
        for place, (name, value) in enumerate(self.report.values.items(), start=2):
            if name not in _TEXTS and not name.startswith("$MN_AXCONF_MACHAX_NAME_TAB"):
                try:
                    float(value)
                except ValueError as error:
                    raise FileFormatError(
                        "E-OFF-REPORT", where, line=place, text=f"{name}={value}"[:60], wanted="a number"
                    ) from error
        return self

    def echoed(self, counter: float) -> None:
        """The gateway has its reading of a stop: the next one, or the end, is what the control shows now."""
        here = self._here
        if here is None or self.stop is None or counter != here.words[Word.COUNTER]:
            return
        self.stop = self.stop + 1 if self.stop + 1 < len(self.report.stops) else None

    @property
    def _here(self) -> ReportedStop | None:
        return None if self.stop is None else self.report.stops[self.stop]

    def r(self, number: int) -> float:
        """An R parameter as the gateway would read it now."""
        word = number - self.asked.words.first
        here = self._here
        if here is not None and word == Word.PHASE:
            return float(Phase.MEASURING)
        if here is not None and word in here.words:
            return here.words[Word(word)]
        if number in self.queued:
            return self.queued[number]
        return float(self.report.values.get(f"R{number}", "nan"))

    def read(self, paths: Sequence[str], settings: UaSettings) -> list[Reading]:
        """Variables of the wire; what no report tells is absent."""
        known = self._values(settings)
        return [self._reading(path, known) for path in paths]

    def _reading(self, path: str, known: Mapping[str, Any]) -> Reading:
        address = nodes.parse(path)
        if address is not None and address.name == "R" and address.elements:
            values = [self.r(number) for number in address.elements]
            if not any(isnan(value) for value in values):
                return Reading(path, values if address.last is not None else values[0], kind="Double")
            return Reading(path, None, ABSENT)
        if path in known:
            return Reading(path, known[path], kind=nodes.kind_of(path))
        return Reading(path, None, ABSENT)

    def _values(self, settings: UaSettings) -> dict[str, Any]:
        """What the report, and its being there, say by the wire's names."""
        values, channel = self.report.values, settings.channel
        metric = values["$MN_SCALING_SYSTEM_IS_METRIC"] == "1"
        status = ChannelStatus.RESET if self.stop is None else ChannelStatus.ACTIVE
        known: dict[str, Any] = {
            settings.serial_node: self.serial.strip(),
            settings.version_node: values["$MN_VERSION_INFO[0]"].strip(),
            nodes.BASIC_LENGTH_UNIT: 0 if metric else 1,
            nodes.OPERATING_MODE: nodes.MODES.index("AUTO"),
            nodes.ACCESS_LEVEL: self.access_level,
            nodes.ALARM_COUNT: len(self.alarms),
            nodes.in_channel("chanStatus", channel): status.value,
            nodes.in_channel("msg", channel, "ProgramInfo"): "",
            nodes.in_channel("progName", channel, "ProgramInfo"): self.program,
        }
        for place in range(1, 32):
            known[nodes.alarm_number(place)] = self.alarms[place - 1] if place <= len(self.alarms) else 0
        for name, path in self._paths().items():
            if name in values and not name.startswith("R"):
                known[path] = values[name] if name in _TEXTS else _typed(path, values[name])
        return known | self._axes(channel)

    def _axes(self, channel: int) -> dict[str, Any]:
        known: dict[str, Any] = {}
        here = self._here
        for number, axis in enumerate(self.asked.axes, start=1):
            for item, name in _SHOWN.items():
                path = nodes.of_axis(item, number, channel)
                known[path] = _typed(path, self.report.values[f"{name}[{axis}]"])
            if here is not None:
                known[nodes.of_axis("actToolBasePos", number, channel)] = here.places.get(axis, 0.0)
                known[nodes.of_axis("aaStat", number, channel)] = _IN_POSITION
        return known

    def _paths(self) -> dict[str, str]:
        """The wire's name of each datum that is told."""
        named = {name: nodes.to_path(name, self.asked.axes) for name in self.asked.names}
        return {name: path for name, path in named.items() if path is not None}


def _typed(path: str, text: str) -> Any:
    kind = nodes.kind_of(path)
    if kind == "String":
        return text
    value = float(text)
    if kind == "Boolean":
        return bool(value)
    return int(value) if kind.startswith("UInt") else value
