"""Questions about the machine behind the server: axes, identity, variables, units, encoders, memory, keys, state."""

from __future__ import annotations

from drivers.checks import CheckLine, failed, fine, identity_lines, unknown, wrong
from drivers.errors import UnsupportedDevice
from drivers.sinumerik.ncprogram.words import COUNT
from drivers.sinumerik.opcua import encoders as acting_encoders
from drivers.sinumerik.opcua.bedside.bed import Bedside
from drivers.sinumerik.opcua.session import nodes

_AXIS_ITEMS = ("actToolBasePos", "aaRef", "aaStat", "vaCecCompVal")


async def axes(bed: Bedside) -> list[CheckLine]:
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


async def identity(bed: Bedside) -> list[CheckLine]:
    """Whether it is the machine that this site knows, fact by fact."""
    machine = await bed.reader.identity(bed.configuration.names if bed.configuration else ())
    return identity_lines(machine, bed.wanted)


async def variables(bed: Bedside) -> list[CheckLine]:
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


def _paths(bed: Bedside) -> list[str]:
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


async def units(bed: Bedside) -> list[CheckLine]:
    """Metric, as all that is written."""
    basic = await bed.value(nodes.BASIC_LENGTH_UNIT)
    scaling = await bed.datum("$MN_SCALING_SYSTEM_IS_METRIC")
    if basic is None:
        return [unknown("W-DOC-UNITS-UNKNOWN", "units")]
    if int(basic) != 0 or scaling is False:
        return [wrong("E-DOC-INCH", "units", basic=basic, scaling=scaling)]
    return [fine("W-DOC-UNITS", "units")]


async def encoders(bed: Bedside) -> list[CheckLine]:
    """The measuring system of the site file against the one whose table acts."""
    lines: list[CheckLine] = []
    for axis in bed.wanted.axes:
        if bed.configuration is None or axis.name not in bed.configuration.names:
            continue
        found = await bed.reader.encoders(bed.configuration, axis.name)
        try:
            acting_encoders.check(found, axis.name, axis.encoder, bed.where, said=axis.encoder_said)
        except UnsupportedDevice as error:
            lines.append(failed(error, "measuring system"))
        else:
            line = fine("W-DOC-ENCODER", "measuring system", axis=axis.name, system=axis.encoder + 1)
            lines.append(line)
    return lines or [unknown("W-DOC-ENCODER-UNKNOWN", "measuring system")]


async def memory(bed: Bedside) -> list[CheckLine]:
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


async def level(bed: Bedside) -> list[CheckLine]:
    """The access level that compensation data need."""
    level = await bed.value(nodes.ACCESS_LEVEL)
    if level is None:
        return [unknown("W-DOC-LEVEL-UNKNOWN", "key switch")]
    if int(level) > bed.wanted.access_level:
        return [wrong("E-DOC-LEVEL", "key switch", level=level, needed=bed.wanted.access_level)]
    return [fine("W-DOC-LEVEL", "key switch", level=level)]


async def state(bed: Bedside) -> list[CheckLine]:
    """Channel, mode and axes that are not referenced."""
    if bed.configuration is None:
        return [unknown("W-DOC-STATE-UNKNOWN", "state")]
    state = await bed.reader.state(bed.configuration)
    open_axes = [name for name, axis in state.axes.items() if not axis.referenced]
    fields = {"channel": state.channel.name, "mode": state.mode, "unreferenced": ", ".join(open_axes) or "none"}
    return [fine("W-DOC-STATE", "state", **fields)]
