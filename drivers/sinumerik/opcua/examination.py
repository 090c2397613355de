"""What a doctor sees of a control after the login: rights, variables, memory, files; every question is a read."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC
from typing import Any

from drivers.checks import CheckLine, Wanted, WantedAxis, failed, fine, unknown, wrong
from drivers.clock import Clock
from drivers.errors import TransportError, TrueflankError, UnsupportedDevice
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.ncprogram.words import COUNT, MARKED, file_path, program_path
from drivers.sinumerik.opcua import conditions, encoders
from drivers.sinumerik.opcua.dialogue import Dialogue
from drivers.sinumerik.opcua.leaving import found as found_left
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.session import alarms, nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.files import FileNodes
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.transfer import Transfer

CLOCK_LIMIT_S = 60.0
READING = ("StateRead", "TeaRead", "SeaRead")
WRITING = ("StateWrite", "FsRead", "FsWrite", "ApWrite")
SURPLUS = ("SinuWriteAll", "TeaWrite", "SeaWrite", "DriveWrite", "PlcWrite", "FrameWrite", "ToolWrite", "RandomWrite")
_AXIS_ITEMS = ("actToolBasePos", "aaRef", "aaStat", "vaEnc1CompVal", "vaEnc2CompVal", "vaCecCompVal")


@dataclass(slots=True)
class Bedside:
    """What the questions need; ``rights`` and ``configuration`` are learnt on the way, None while unknown."""

    session: UaSession
    reader: MachineReader
    settings: UaSettings
    wanted: Wanted
    clock: Clock
    timeout_s: float
    where: str
    rights: frozenset[str] | None = None
    configuration: Configuration | None = None
    memories: list[tuple[WantedAxis, Memory]] = field(default_factory=list)

    async def value(self, path: str) -> Any:
        """A value, None when it cannot be read."""
        (found,) = await self.session.read([path], self.timeout_s)
        return None if found.status else found.value

    async def datum(self, name: str) -> Any:
        """A machine datum by its NC name, None when it cannot be read."""
        names = self.configuration.places if self.configuration else ()
        path = nodes.to_path(name, names, self.settings.channel)
        return None if path is None else await self.value(path)


async def at_the_bed(bed: Bedside) -> list[CheckLine]:
    """All questions in turn; one that fails is a line, and a lost session ends them."""
    lines: list[CheckLine] = []
    for check, question in _QUESTIONS:
        try:
            lines += await question(bed)
        except TransportError as error:
            lines.append(failed(error, check, "wrong" if error.code == "E-UA-STALE" else "unknown"))
        except TrueflankError as error:
            lines.append(failed(error, check))
        if not bed.session.is_open:
            return [*lines, unknown("W-DOC-NOT-REACHED", "rest")]
    return lines


async def _clock(bed: Bedside) -> list[CheckLine]:
    theirs = await bed.session.server_time(bed.timeout_s)
    if theirs is None:
        return [unknown("W-DOC-NO-CLOCK", "clock")]
    apart_s = abs((theirs.replace(tzinfo=UTC) - bed.clock.utc()).total_seconds())
    if apart_s > CLOCK_LIMIT_S:
        return [wrong("E-DOC-CLOCK", "clock", apart_s=round(apart_s), limit_s=CLOCK_LIMIT_S)]
    return [fine("W-DOC-CLOCK", "clock", apart_s=round(apart_s, 1))]


async def _name_space(bed: Bedside) -> list[CheckLine]:
    return [fine("W-DOC-NAMESPACE", "name space", uri=nodes.NAMESPACE_URI, index=bed.session.name_space)]


async def _option(bed: Bedside) -> list[CheckLine]:
    """The licence itself is no public variable; without it there is no machine data to be served."""
    served = await bed.value(nodes.in_channel("chanStatus", bed.settings.channel))
    if served is not None and bed.session.methods:
        return [fine("W-DOC-OPTION", "option")]
    return [unknown("W-DOC-OPTION-UNKNOWN", "option")]


async def _methods(bed: Bedside) -> list[CheckLine]:
    lines = []
    absent = [name for name in ("CopyFileToServer", "CopyFileFromServer") if name not in bed.session.methods]
    if absent:
        lines.append(fine("W-DOC-FILE-NODES", "methods", absent=", ".join(absent)))
    if "Select" not in bed.session.methods:
        return [*lines, wrong("E-UA-ABSENT", "methods", status="not offered", what="Select")]
    return lines or [fine("W-DOC-METHODS", "methods")]


async def _rights(bed: Bedside) -> list[CheckLine]:
    if "GetMyAccessRights" not in bed.session.methods:
        return [unknown("W-DOC-RIGHTS-UNKNOWN", "rights")]
    bed.rights = rights = _listed(await bed.session.call("GetMyAccessRights", [], bed.timeout_s))
    missing = [right for right in READING if "SinuReadAll" not in rights and right not in rights]
    missing += [right for right in WRITING if right not in rights]
    surplus = [right for right in SURPLUS if right in rights]
    if missing:
        return [wrong("E-DOC-RIGHTS", "rights", missing=", ".join(missing))]
    if surplus:
        return [wrong("E-DOC-SURPLUS", "rights", surplus=", ".join(surplus))]
    return [fine("W-DOC-RIGHTS", "rights", rights=", ".join(sorted(rights)))]


def _listed(answer: Any) -> frozenset[str]:
    """Rights as one text or as a list of texts: the manuals show names only."""
    parts = answer if isinstance(answer, list) else [answer or ""]
    return frozenset(name for part in parts for name in re.split(r"[;,\s]+", str(part)) if name)


async def _axes(bed: Bedside) -> list[CheckLine]:
    bed.configuration = configuration = await bed.reader.configuration()
    lines = []
    for axis in bed.wanted.axes:
        if axis.name not in configuration.names:
            lines.append(wrong("E-NC-AXIS", "axes", axis=axis.name, known=", ".join(configuration.names)))
        elif configuration.units[axis.name] != axis.unit:
            unit = configuration.units[axis.name]
            lines.append(wrong("E-DOC-AXIS-UNIT", "axes", axis=axis.name, unit=unit, wanted=axis.unit))
    return lines or [fine("W-DOC-AXES", "axes", names=", ".join(configuration.names))]


async def _identity(bed: Bedside) -> list[CheckLine]:
    machine = await bed.reader.identity(bed.configuration.names if bed.configuration else ())
    if machine.serial != bed.wanted.serial:
        return [wrong("E-DOC-SERIAL", "serial number", found=machine.serial, wanted=bed.wanted.serial)]
    return [fine("W-DOC-SERIAL", "serial number", serial=machine.serial, version=machine.version)]


async def _variables(bed: Bedside) -> list[CheckLine]:
    paths = _paths(bed)
    found = await bed.session.survey(paths, bed.timeout_s)
    lines = []
    for reading in found:
        if reading.status:
            lines.append(wrong("E-DOC-NODE", "variables", path=reading.path, status=reading.status))
        elif reading.kind and reading.kind != nodes.kind_of(reading.path):
            kinds = {"kind": reading.kind, "wanted": nodes.kind_of(reading.path)}
            lines.append(wrong("E-DOC-KIND", "variables", path=reading.path, **kinds))
    return lines or [fine("W-DOC-NODES", "variables", count=len(paths))]


def _paths(bed: Bedside) -> list[str]:
    """Every variable that measuring and pushing read."""
    channel, settings = bed.settings.channel, bed.settings
    names = bed.configuration.places if bed.configuration else ()
    paths = [settings.serial_node, settings.version_node, nodes.BASIC_LENGTH_UNIT, nodes.ACCESS_LEVEL]
    paths += [nodes.OPERATING_MODE, nodes.ALARM_COUNT, nodes.alarm_number(1)]
    paths += [nodes.in_channel("chanStatus", channel), nodes.in_channel("msg", channel, "ProgramInfo")]
    paths += [nodes.in_channel("progName", channel, "ProgramInfo"), nodes.r_block(settings.r_first, COUNT, channel)]
    numbers = [place for place, name in enumerate(names, start=1) if name]
    paths += [nodes.of_axis(item, number, channel) for item in _AXIS_ITEMS for number in numbers]
    data = [f"$MA_MM_ENC_COMP_MAX_POINTS[{axis.encoder},{axis.name}]" for axis in bed.wanted.axes]
    data += [f"$MA_ENC_COMP_ENABLE[{axis.encoder},{axis.name}]" for axis in bed.wanted.axes]
    return paths + [path for name in data if (path := nodes.to_path(name, names, channel)) is not None]


async def _units(bed: Bedside) -> list[CheckLine]:
    basic = await bed.value(nodes.BASIC_LENGTH_UNIT)
    scaling = await bed.datum("$MN_SCALING_SYSTEM_IS_METRIC")
    if basic is None:
        return [unknown("W-DOC-UNITS-UNKNOWN", "units")]
    if int(basic) != 0 or scaling is False:
        return [wrong("E-DOC-INCH", "units", basic=basic, scaling=scaling)]
    return [fine("W-DOC-UNITS", "units")]


async def _encoders(bed: Bedside) -> list[CheckLine]:
    """The measuring system of the site file against the one whose table acts."""
    lines: list[CheckLine] = []
    for axis in bed.wanted.axes:
        if bed.configuration is None or axis.name not in bed.configuration.names:
            continue
        found = await bed.reader.encoders(bed.configuration, axis.name)
        try:
            encoders.check(found, axis.name, axis.encoder, bed.where, said=axis.encoder_said)
        except UnsupportedDevice as error:
            lines.append(failed(error, "measuring system"))
        else:
            line = fine("W-DOC-ENCODER", "measuring system", axis=axis.name, system=axis.encoder + 1)
            lines.append(line)
    return lines or [unknown("W-DOC-ENCODER-UNKNOWN", "measuring system")]


async def _memory(bed: Bedside) -> list[CheckLine]:
    if bed.configuration is None:
        return [unknown("W-DOC-MEMORY-UNKNOWN", "table memory")]
    lines, cross = [], ""
    for axis in (one for one in bed.wanted.axes if one.name in bed.configuration.names):
        memory = await bed.reader.memory(bed.configuration, axis.name, axis.encoder)
        bed.memories.append((axis, memory))
        fields = {"axis": axis.name, "reserved": memory.eec_points, "needed": axis.points}
        enough = memory.eec_points >= axis.points
        lines.append(
            (fine if enough else wrong)("W-DOC-MEMORY" if enough else "E-DOC-MEMORY", "table memory", **fields)
        )
        cross = ", ".join(f"{place}: {points}" for place, points in enumerate(memory.cec_points) if points)
    return [
        *lines,
        fine("W-DOC-CROSS", "cross tables", tables=cross) if cross else fine("W-DOC-NO-CROSS", "cross tables"),
    ]


async def _conditions(bed: Bedside) -> list[CheckLine]:
    """Settings that our programs and tables need; asked once the reserved memory is known."""
    return await conditions.judged(bed, bed.memories)


async def _level(bed: Bedside) -> list[CheckLine]:
    level = await bed.value(nodes.ACCESS_LEVEL)
    if level is None:
        return [unknown("W-DOC-LEVEL-UNKNOWN", "key switch")]
    if int(level) > bed.wanted.access_level:
        return [wrong("E-DOC-LEVEL", "key switch", level=level, needed=bed.wanted.access_level)]
    return [fine("W-DOC-LEVEL", "key switch", level=level)]


async def _files(bed: Bedside) -> list[CheckLine]:
    """By rights and by what a program of ours that is already there says; nothing is written to find out."""
    if bed.rights is not None and "FsWrite" not in bed.rights:
        return [wrong("E-DOC-RIGHTS", "files", missing="FsWrite")]
    said: bool | None = None
    for axis in bed.wanted.axes:
        path = nodes.to_file(program_path("MEAS", axis.name))
        if path is not None and said is None:
            said = await FileNodes(bed.session, bed.where).writable(path, bed.timeout_s)
    if said is False:
        return [wrong("E-UA-LEVEL", "files", status="UserWritable is false", what="part programs")]
    if said is None and bed.rights is None:
        return [unknown("W-DOC-FILES-UNKNOWN", "files")]
    return [fine("W-DOC-FILES", "files") if said else fine("W-DOC-FILES-BY-RIGHTS", "files")]


async def _self_test(bed: Bedside) -> list[CheckLine]:
    """The report that each axis' self-test left in the control; nothing is started here."""
    transfer = Transfer(bed.session, bed.settings.channel, bed.where, bed.timeout_s)
    files = {axis.name: file_path("SELF", axis.name) for axis, _ in bed.memories}
    return conditions.self_tests({name: await transfer.found(path) for name, path in files.items()})


async def _left_over(bed: Bedside) -> list[CheckLine]:
    """Programs of ours whose gateway is gone, and their words, by the numbers they were sent with."""
    selected = await bed.value(nodes.in_channel("progName", bed.settings.channel, "ProgramInfo"))
    seen = await Dialogue(
        session=bed.session, reader=bed.reader, settings=bed.settings, clock=bed.clock, where=bed.where
    ).look()
    left, _sent = found_left(seen, str(selected or ""), bed.wanted.sent)
    return [(fine if left.clear else wrong)(left.code, "left over", **left.facts)]


async def _r_parameters(bed: Bedside) -> list[CheckLine]:
    first, channel = bed.settings.r_first, bed.settings.channel
    span = {"first": first, "last": first + COUNT - 1}
    words = await bed.value(nodes.r_block(first, COUNT, channel))
    if not isinstance(words, list) or len(words) != COUNT:
        return [wrong("E-DOC-R-RANGE", "R parameters", **span)]
    may = await bed.session.user_may_write(nodes.r_parameter(first, channel), bed.timeout_s)
    if may is False:
        return [wrong("E-DOC-R-RIGHT", "R parameters", **span)]
    used = [first + place for place, value in enumerate(words) if value and place not in MARKED]
    if used:
        return [unknown("W-DOC-R-USED", "R parameters", used=", ".join(f"R{number}" for number in used), **span)]
    return [fine("W-DOC-R", "R parameters", **span) if may else unknown("W-DOC-R-UNKNOWN", "R parameters", **span)]


async def _alarms(bed: Bedside) -> list[CheckLine]:
    told = await alarms.standing(bed.session, bed.timeout_s)
    if told is None:
        return [unknown("W-DOC-NO-EVENTS", "alarms")]
    return [fine("W-DOC-EVENTS", "alarms", standing=", ".join(str(alarm.number) for alarm in told) or "none")]


async def _state(bed: Bedside) -> list[CheckLine]:
    if bed.configuration is None:
        return [unknown("W-DOC-STATE-UNKNOWN", "state")]
    state = await bed.reader.state(bed.configuration)
    open_axes = [name for name, axis in state.axes.items() if not axis.referenced]
    fields = {"channel": state.channel.name, "mode": state.mode, "unreferenced": ", ".join(open_axes) or "none"}
    return [fine("W-DOC-STATE", "state", **fields)]


_QUESTIONS: tuple[tuple[str, Callable[[Bedside], Awaitable[list[CheckLine]]]], ...] = (
    ("clock", _clock),
    ("name space", _name_space),
    ("option", _option),
    ("methods", _methods),
    ("rights", _rights),
    ("axes", _axes),
    ("serial number", _identity),
    ("variables", _variables),
    ("units", _units),
    ("measuring system", _encoders),
    ("table memory", _memory),
    ("written files", _conditions),
    ("key switch", _level),
    ("files", _files),
    ("self-test", _self_test),
    ("left over", _left_over),
    ("R parameters", _r_parameters),
    ("alarms", _alarms),
    ("state", _state),
)
