"""What a doctor asks of a control after the login: the server, the machine, settings and remains of our programs.

Every question only reads, and yields lines of a report. One that fails is a line; a lost session ends them. A setting
is judged against what the site's tables ask; data that a control does not show are reported as unknown.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC
from typing import Any, Protocol

from drivers.checks import CheckLine, Wanted, WantedAxis, failed, fine, identity_lines, unknown, wrong
from drivers.clock import Clock
from drivers.errors import TransportError, TrueflankError, UnsupportedDevice
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, required_kilobytes
from drivers.sinumerik.ncprogram.selftest import read_self_test_report
from drivers.sinumerik.ncprogram.words import COUNT, MARKED, file_path, program_path
from drivers.sinumerik.opcua import machine as acting_encoders
from drivers.sinumerik.opcua import rights as table
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.program_dialogue import ProgramDialogue, Transfer
from drivers.sinumerik.opcua.session import client as standing_alarms
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import FileNodes, UaSession
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.stale_programs import find_stale_program as found_left


@dataclass(slots=True)
class ControlCheckContext:
    """What the questions need; ``rights``, ``version`` and ``configuration`` are learnt on the way: None at first."""

    session: UaSession
    reader: MachineReader
    settings: UaSettings
    wanted: Wanted
    clock: Clock
    timeout_s: float
    where: str
    rights: frozenset[str] | None = None
    version: tuple[int, int] | None = None
    configuration: Configuration | None = None
    memories: list[tuple[WantedAxis, ReservedPoints]] = field(default_factory=list)

    async def value(self, path: str) -> Any:
        """A value, None when it cannot be read."""
        (found,) = await self.session.read([path], self.timeout_s)
        return None if found.status else found.value

    async def datum(self, name: str) -> Any:
        """A machine datum by its NC name, None when it cannot be read."""
        names = self.configuration.places if self.configuration else ()
        path = nodes.to_path(name, names, self.settings.channel)
        return None if path is None else await self.value(path)


# Questions about the OPC UA server itself: clock, name space, option, methods, rights, files, alarms.

CLOCK_LIMIT_S = 60.0


async def check_clock(bed: ControlCheckContext) -> list[CheckLine]:
    """How far the control's clock is from this PC's."""
    theirs = await bed.session.server_time(bed.timeout_s)
    if theirs is None:
        return [unknown("W-DOC-NO-CLOCK", "clock")]
    apart_s = (theirs.replace(tzinfo=UTC) - bed.clock.utc()).total_seconds()
    if abs(apart_s) > CLOCK_LIMIT_S:
        if abs(bed.session.ahead_s or 0.0) > CLOCK_LIMIT_S:
            return []  # told before the login already
        return [wrong("E-DOC-CLOCK", "clock", apart_s=round(apart_s), limit_s=CLOCK_LIMIT_S)]
    return [fine("W-DOC-CLOCK", "clock", apart_s=round(apart_s, 1) + 0.0)]  # no "-0.0"


async def check_name_space(bed: ControlCheckContext) -> list[CheckLine]:
    """Where the control's variables live."""
    return [fine("W-DOC-NAMESPACE", "namespace", uri=nodes.NAMESPACE_URI, index=bed.session.name_space)]


async def check_option(bed: ControlCheckContext) -> list[CheckLine]:
    """The licence itself is no public variable; without it there is no machine data to be served."""
    served = await bed.value(nodes.in_channel("chanStatus", bed.settings.channel))
    if served is not None and bed.session.methods:
        return [fine("W-DOC-OPTION", "option")]
    return [unknown("W-DOC-OPTION-UNKNOWN", "option")]


async def check_methods(bed: ControlCheckContext) -> list[CheckLine]:
    """What can be called: copying files, selecting programs."""
    lines = []
    absent = [name for name in ("CopyFileToServer", "CopyFileFromServer") if name not in bed.session.methods]
    if absent:
        lines.append(fine("W-DOC-FILE-NODES", "methods", absent=", ".join(absent)))
    if "Select" not in bed.session.methods:
        return [*lines, wrong("E-UA-ABSENT", "methods", status="not offered", what="Select")]
    return lines or [fine("W-DOC-METHODS", "methods")]


async def check_version(bed: ControlCheckContext) -> list[CheckLine]:
    """The server's version against the oldest one whose manual prints what is used."""
    told = await bed.session.software_version(bed.timeout_s)
    bed.version = table.version_of(told)
    if bed.version is None:
        return [unknown("W-DOC-SERVER-UNKNOWN", "server version", oldest=table.OLDEST_NAME)]
    if bed.version < table.OLDEST:
        return [wrong("E-DOC-SERVER-OLD", "server version", version=told, oldest=table.OLDEST_NAME)]
    return [fine("W-DOC-SERVER", "server version", version=told, oldest=table.OLDEST_NAME)]


async def check_rights(bed: ControlCheckContext) -> list[CheckLine]:
    """What this user may do: no less than is needed, and no more."""
    if "GetMyAccessRights" not in bed.session.methods:
        return [unknown("W-DOC-RIGHTS-UNKNOWN", "rights")]
    bed.rights = found = table.held(await bed.session.call("GetMyAccessRights", [], bed.timeout_s))
    lacking, perhaps = table.missing(found, bed.version, "reading", "writing")
    surplus = table.surplus(found)
    if lacking:
        return [wrong("E-DOC-RIGHTS", "rights", missing=", ".join((*lacking, *perhaps)))]
    if surplus:
        return [wrong("E-DOC-SURPLUS", "rights", surplus=", ".join(surplus))]
    if perhaps:
        return [unknown("W-DOC-RIGHTS-LATER", "rights", missing=", ".join(perhaps), oldest=table.OLDEST_NAME)]
    return [fine("W-DOC-RIGHTS", "rights", rights=", ".join(sorted(found)))]


async def check_reading_account(session: UaSession, timeout_s: float) -> list[CheckLine]:
    """Whether the account that reads, where another one writes, can do no more than read. Nothing is tried."""
    if "GetMyAccessRights" not in session.methods:
        return [unknown("W-DOC-RIGHTS-UNKNOWN", "reading user")]
    found = table.held(await session.call("GetMyAccessRights", [], timeout_s))
    lacking, _ = table.missing(found, None, "reading")
    surplus = table.surplus(found, reads_alone=True)
    if lacking:
        return [wrong("E-DOC-RIGHTS", "reading user", missing=", ".join(lacking))]
    if surplus:
        return [wrong("E-DOC-READER-WRITES", "reading user", surplus=", ".join(surplus))]
    return [fine("W-DOC-READER", "reading user", rights=", ".join(sorted(found)))]


async def check_files(bed: ControlCheckContext) -> list[CheckLine]:
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


async def check_alarms(bed: ControlCheckContext) -> list[CheckLine]:
    """Whether alarms are told, and which stand."""
    told = await standing_alarms.read_standing_alarms(bed.session, bed.timeout_s)
    if told is None:
        return [unknown("W-DOC-NO-EVENTS", "alarms")]
    return [fine("W-DOC-EVENTS", "alarms", standing=", ".join(str(alarm.number) for alarm in told) or "none")]


# What a doctor reads of a control's settings, before the first program: file length, limits of CEC, what survives.
#
# Each is judged against what the site's tables ask. Data that a control does not show are said to be unknown.

CEC_SWITCH = 41300
MOST_SAVED_DATA = 10
SUMS = {"mm": 0.2, "deg": 0.05}  # the largest value of a table that we write (docs/architecture.md, section 6)


class MachineDataReader(Protocol):
    """What is asked: a machine datum by its NC name (None when it cannot be read), and the reserved points."""

    async def datum(self, name: str) -> Any:
        """The value, or None."""
        ...


LONGEST_NUMBER = 999_999_999


async def check_conditions(
    bed: MachineDataReader, memories: Sequence[tuple[WantedAxis, ReservedPoints]]
) -> list[CheckLine]:
    """Every setting in turn, for axes whose reserved points are known."""
    if not memories:
        return [unknown("W-DOC-MEMORY-UNKNOWN", "written files")]
    axes = [axis for axis, _ in memories]
    cross = any(any(memory.cec_points) for _, memory in memories)
    lines = [
        *await check_file_length(bed, memories),
        *await check_free_memory(bed),
        *await check_kept_switch(bed, cross=cross),
    ]
    lines += await check_cross_limits(bed, axes, cross=cross)
    return [*lines, *await check_diameter(bed), *await check_temperature(bed, axes)]


async def check_file_length(
    bed: MachineDataReader, memories: Iterable[tuple[WantedAxis, ReservedPoints]]
) -> list[CheckLine]:
    """MD11420 against the largest file that a program of ours writes, and MD11422 (a power cut)."""
    given = [(axis, memory) for axis, memory in memories]
    needed = required_kilobytes(
        BackupFile("LIVE", LONGEST_NUMBER, axis=axis.name, encoder=axis.encoder, memory=memory)
        for axis, memory in given
    )
    limit = await bed.datum("$MN_LEN_PROTOCOL_FILE")
    if limit is None:
        return [unknown("W-DOC-FILE-LIMIT-UNKNOWN", "written files", needed_kb=needed)]
    fields = {"needed_kb": needed, "limit_kb": int(limit)}
    if int(limit) < needed:
        return [wrong("E-DOC-FILE-LIMIT", "written files", **fields)]
    mode = await bed.datum("$MN_PROTOCOL_FILE_MODE")
    if mode is not None and int(mode) & 1:
        return [wrong("E-DOC-FILE-LATE", "written files", mode=int(mode))]
    return [fine("W-DOC-FILE-LIMIT", "written files", **fields)]


async def check_free_memory(bed: MachineDataReader) -> list[CheckLine]:
    """MD18060: what is left for programs and for memory that somebody reserves.

    Its unit differs between controls and versions, so nothing is compared but whether there is any.
    """
    left = await bed.datum("$MN_INFO_FREE_MEM_STATIC")
    if left is None:
        return [unknown("W-DOC-FREE-UNKNOWN", "free memory")]
    enough = float(left) > 0.0
    return [(fine if enough else wrong)("W-DOC-FREE" if enough else "E-DOC-FREE", "free memory", left=int(left))]


async def check_kept_switch(bed: MachineDataReader, *, cross: bool) -> list[CheckLine]:
    """Whether SD41300, written by a program, outlives a reset (MD10710); of no matter without cross tables."""
    if not cross:
        return []
    listed = [await bed.datum(f"$MN_PROG_SD_RESET_SAVE_TAB[{place}]") for place in range(MOST_SAVED_DATA)]
    if all(number is None for number in listed):
        return [unknown("W-DOC-KEPT-UNKNOWN", "SD41300")]
    if CEC_SWITCH not in [int(number) for number in listed if number is not None]:
        return [wrong("E-DOC-NOT-KEPT", "SD41300")]
    return [fine("W-DOC-KEPT", "SD41300")]


async def check_cross_limits(bed: MachineDataReader, axes: Iterable[WantedAxis], *, cross: bool) -> list[CheckLine]:
    """MD32720 and MD32730 of each axis, where the control has cross tables."""
    lines = []
    for axis in axes if cross else ():
        largest = await bed.datum(f"$MA_CEC_MAX_SUM[{axis.name}]")
        fastest = await bed.datum(f"$MA_CEC_MAX_VELO[{axis.name}]")
        if largest is None or fastest is None:
            lines.append(unknown("W-DOC-CEC-UNKNOWN", "CEC limits", axis=axis.name))
            continue
        fields = {"axis": axis.name, "largest": largest, "fastest": fastest, "unit": axis.unit, "ask": SUMS[axis.unit]}
        enough = float(largest) >= SUMS[axis.unit] and float(fastest) > 0.0
        lines.append((fine if enough else wrong)("W-DOC-CEC" if enough else "E-DOC-CEC", "CEC limits", **fields))
    return lines


def check_self_test_reports(reports: Mapping[str, str | None]) -> list[CheckLine]:
    """What the last self-test of each axis said; ``reports`` are texts of its file by axis, None where none is."""
    lines = []
    for axis, text in reports.items():
        report = None if text is None else read_self_test_report(text, axis)
        if report is None:
            lines.append(unknown("W-DOC-NO-SELF-TEST", "self-test", axis=axis))
            continue
        fields = {"axis": axis, "date": report.date, "passed": len(report.passed)}
        if report.failed or not report.whole:
            missed = ", ".join(report.failed) or "its end"
            lines.append(wrong("E-DOC-SELF-TEST", "self-test", missed=missed, **fields))
        else:
            lines.append(fine("W-DOC-SELF-TEST", "self-test", **fields))
    return lines


async def check_diameter(bed: MachineDataReader) -> list[CheckLine]:
    """MD20100: which axis is programmed in diameters; our programs say DIAMOF."""
    name = await bed.datum("$MC_DIAMETER_AX_DEF")
    if name is None:
        return [unknown("W-DOC-DIAMETER-UNKNOWN", "diameters")]
    return [fine("W-DOC-DIAMETER", "diameters", axis=str(name).strip() or "no axis")]


async def check_temperature(bed: MachineDataReader, axes: Iterable[WantedAxis]) -> list[CheckLine]:
    """MD32750 and SD43900 to 43920: what else moves the axes by a table of its own."""
    lines = []
    for axis in axes:
        kind = await bed.datum(f"$MA_TEMP_COMP_TYPE[{axis.name}]")
        if kind is None:
            lines.append(unknown("W-DOC-WARMTH-UNKNOWN", "temperature", axis=axis.name))
            continue
        names = ("ABS_VALUE", "SLOPE", "REF_POSITION")
        read = [await bed.datum(f"$SA_TEMP_COMP_{name}[{axis.name}]") for name in names]
        shown = ", ".join("unknown" if value is None else f"{value:g}" for value in read)
        code = "W-DOC-WARMTH" if int(kind) else "W-DOC-NO-WARMTH"
        lines.append(fine(code, "temperature", axis=axis.name, kind=int(kind), values=shown))
    return lines


# Questions about the machine behind the server: axes, identity, variables, units, encoders, memory, keys, state.

_AXIS_ITEMS = ("actToolBasePos", "aaRef", "aaStat", "vaCecCompVal")


async def check_axes(bed: ControlCheckContext) -> list[CheckLine]:
    """The site's axes among the control's, in the same units."""
    bed.configuration = configuration = await bed.reader.configuration()
    lines = []
    for axis in bed.wanted.axes:
        if axis.name not in configuration.names:
            lines.append(wrong("E-NC-AXIS", "axes", axis=axis.name, known=", ".join(configuration.names)))
        elif configuration.units[axis.name] != axis.unit:
            unit = configuration.units[axis.name]
            lines.append(wrong("E-DOC-AXIS-UNIT", "axes", axis=axis.name, unit=unit, wanted=axis.unit))
    return lines or [fine("W-DOC-AXES", "axes", names=", ".join(configuration.names))]


async def check_identity(bed: ControlCheckContext) -> list[CheckLine]:
    """Whether it is the machine that this site knows, fact by fact."""
    machine = await bed.reader.identity(bed.configuration.names if bed.configuration else ())
    return identity_lines(machine, bed.wanted)


async def check_variables(bed: ControlCheckContext) -> list[CheckLine]:
    """Whether every variable that is read is there, with the type it must have."""
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


def _paths(bed: ControlCheckContext) -> list[str]:
    """Every variable that measuring and pushing read."""
    channel, settings = bed.settings.channel, bed.settings
    names = bed.configuration.places if bed.configuration else ()
    paths = [settings.serial_node, settings.version_node, nodes.BASIC_LENGTH_UNIT, nodes.ACCESS_LEVEL]
    paths += [nodes.OPERATING_MODE, nodes.ALARM_COUNT, nodes.alarm_number(1)]
    paths += [nodes.in_channel("chanStatus", channel), nodes.in_channel("msg", channel, "ProgramInfo")]
    paths += [nodes.in_channel("progName", channel, "ProgramInfo"), nodes.r_block(settings.r_first, COUNT, channel)]
    numbers = [place for place, name in enumerate(names, start=1) if name]
    items = [
        *_AXIS_ITEMS,
        *(f"vaEnc{encoder + 1}CompVal" for encoder in sorted({one.encoder for one in bed.wanted.axes})),
    ]
    paths += [nodes.of_axis(item, number, channel) for item in items for number in numbers]
    data = [f"$MA_MM_ENC_COMP_MAX_POINTS[{axis.encoder},{axis.name}]" for axis in bed.wanted.axes]
    data += [f"$MA_ENC_COMP_ENABLE[{axis.encoder},{axis.name}]" for axis in bed.wanted.axes]
    return paths + [path for name in data if (path := nodes.to_path(name, names, channel)) is not None]


async def check_units(bed: ControlCheckContext) -> list[CheckLine]:
    """Metric, as all that is written."""
    basic = await bed.value(nodes.BASIC_LENGTH_UNIT)
    scaling = await bed.datum("$MN_SCALING_SYSTEM_IS_METRIC")
    if basic is None:
        return [unknown("W-DOC-UNITS-UNKNOWN", "units")]
    if int(basic) != 0 or scaling is False:
        return [wrong("E-DOC-INCH", "units", basic=basic, scaling=scaling)]
    return [fine("W-DOC-UNITS", "units")]


async def check_encoders(bed: ControlCheckContext) -> list[CheckLine]:
    """The measuring system of the site file against the one whose table acts."""
    lines: list[CheckLine] = []
    for axis in bed.wanted.axes:
        if bed.configuration is None or axis.name not in bed.configuration.names:
            continue
        found = await bed.reader.encoders(bed.configuration, axis.name)
        try:
            acting_encoders.check_encoder(found, axis.name, axis.encoder, bed.where, said=axis.encoder_said)
        except UnsupportedDevice as error:
            lines.append(failed(error, "measuring system"))
        else:
            line = fine("W-DOC-ENCODER", "measuring system", axis=axis.name, system=axis.encoder + 1)
            lines.append(line)
    return lines or [unknown("W-DOC-ENCODER-UNKNOWN", "measuring system")]


async def check_memory(bed: ControlCheckContext) -> list[CheckLine]:
    """Reserved points against those that the site's tables need."""
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


async def check_access_level(bed: ControlCheckContext) -> list[CheckLine]:
    """The access level that compensation data need."""
    level = await bed.value(nodes.ACCESS_LEVEL)
    if level is None:
        return [unknown("W-DOC-LEVEL-UNKNOWN", "key switch")]
    if int(level) > bed.wanted.access_level:
        return [wrong("E-DOC-LEVEL", "key switch", level=level, needed=bed.wanted.access_level)]
    return [fine("W-DOC-LEVEL", "key switch", level=level)]


async def check_state(bed: ControlCheckContext) -> list[CheckLine]:
    """Channel, mode and axes that are not referenced."""
    if bed.configuration is None:
        return [unknown("W-DOC-STATE-UNKNOWN", "state")]
    state = await bed.reader.state(bed.configuration)
    open_axes = [name for name, axis in state.axes.items() if not axis.referenced]
    fields = {"channel": state.channel.name, "mode": state.mode, "unreferenced": ", ".join(open_axes) or "none"}
    return [fine("W-DOC-STATE", "state", **fields)]


# Questions about our own programs: settings they need, their self-test, what is left of them, their R parameters.


async def check_settings(bed: ControlCheckContext) -> list[CheckLine]:
    """Settings that our programs and tables need; asked once the reserved memory is known."""
    return await check_conditions(bed, bed.memories)


async def check_self_test(bed: ControlCheckContext) -> list[CheckLine]:
    """The report that each axis' self-test left in the control; nothing is started here."""
    transfer = Transfer(bed.session, bed.settings.channel, bed.where, bed.timeout_s)
    files = {axis.name: file_path("SELF", axis.name) for axis, _ in bed.memories}
    return check_self_test_reports({name: await transfer.found(path) for name, path in files.items()})


async def check_left_over(bed: ControlCheckContext) -> list[CheckLine]:
    """Programs of ours whose gateway is gone, and their words, by the numbers they were sent with."""
    selected = await bed.value(nodes.in_channel("progName", bed.settings.channel, "ProgramInfo"))
    seen = await ProgramDialogue(
        session=bed.session, reader=bed.reader, settings=bed.settings, clock=bed.clock, where=bed.where
    ).look()
    left, _sent = found_left(seen, str(selected or ""), bed.wanted.sent)
    return [(fine if left.clear else wrong)(left.code, "left over", **left.facts)]


async def check_r_parameters(bed: ControlCheckContext) -> list[CheckLine]:
    """Whether our R parameters are there, writable and unused."""
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


# Every question that is put to a control after the login, in the order of the road; each one only reads.


async def examine_control(bed: ControlCheckContext) -> list[CheckLine]:
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


_QUESTIONS: tuple[tuple[str, Callable[[ControlCheckContext], Awaitable[list[CheckLine]]]], ...] = (
    ("clock", check_clock),
    ("namespace", check_name_space),
    ("option", check_option),
    ("methods", check_methods),
    ("server version", check_version),
    ("rights", check_rights),
    ("axes", check_axes),
    ("serial number", check_identity),
    ("variables", check_variables),
    ("units", check_units),
    ("measuring system", check_encoders),
    ("table memory", check_memory),
    ("written files", check_settings),
    ("key switch", check_access_level),
    ("files", check_files),
    ("self-test", check_self_test),
    ("left over", check_left_over),
    ("R parameters", check_r_parameters),
    ("alarms", check_alarms),
    ("state", check_state),
)
