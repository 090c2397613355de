"""How the control stood when it was seen last, as the wire's own variables: a report, and what a person typed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan
from typing import Any

from drivers.errors import FileFormatError
from drivers.sinumerik.ncprogram.words import Phase, Word
from drivers.sinumerik.offline.report import ReportAsked, ToldReport, ToldStop
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.requests import Reading
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus

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

    report: ToldReport
    asked: ReportAsked
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
    def _here(self) -> ToldStop | None:
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
