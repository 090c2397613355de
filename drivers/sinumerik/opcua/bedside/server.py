"""Questions about the OPC UA server itself: clock, name space, option, methods, rights, files, alarms."""

from __future__ import annotations

from datetime import UTC

from drivers.checks import CheckLine, fine, unknown, wrong
from drivers.sinumerik.ncprogram.words import program_path
from drivers.sinumerik.opcua import rights as table
from drivers.sinumerik.opcua.bedside.bed import Bedside
from drivers.sinumerik.opcua.session import alarms as standing_alarms
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.files import FileNodes

CLOCK_LIMIT_S = 60.0


async def clock(bed: Bedside) -> list[CheckLine]:
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


async def name_space(bed: Bedside) -> list[CheckLine]:
    """Where the control's variables live."""
    return [fine("W-DOC-NAMESPACE", "namespace", uri=nodes.NAMESPACE_URI, index=bed.session.name_space)]


async def option(bed: Bedside) -> list[CheckLine]:
    """The licence itself is no public variable; without it there is no machine data to be served."""
    served = await bed.value(nodes.in_channel("chanStatus", bed.settings.channel))
    if served is not None and bed.session.methods:
        return [fine("W-DOC-OPTION", "option")]
    return [unknown("W-DOC-OPTION-UNKNOWN", "option")]


async def methods(bed: Bedside) -> list[CheckLine]:
    """What can be called: copying files, selecting programs."""
    lines = []
    absent = [name for name in ("CopyFileToServer", "CopyFileFromServer") if name not in bed.session.methods]
    if absent:
        lines.append(fine("W-DOC-FILE-NODES", "methods", absent=", ".join(absent)))
    if "Select" not in bed.session.methods:
        return [*lines, wrong("E-UA-ABSENT", "methods", status="not offered", what="Select")]
    return lines or [fine("W-DOC-METHODS", "methods")]


async def version(bed: Bedside) -> list[CheckLine]:
    """The server's version against the oldest one whose manual prints what is used."""
    told = await bed.session.software_version(bed.timeout_s)
    bed.version = table.version_of(told)
    if bed.version is None:
        return [unknown("W-DOC-SERVER-UNKNOWN", "server version", oldest=table.OLDEST_NAME)]
    if bed.version < table.OLDEST:
        return [wrong("E-DOC-SERVER-OLD", "server version", version=told, oldest=table.OLDEST_NAME)]
    return [fine("W-DOC-SERVER", "server version", version=told, oldest=table.OLDEST_NAME)]


async def rights(bed: Bedside) -> list[CheckLine]:
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


async def reads_alone(session: UaSession, timeout_s: float) -> list[CheckLine]:
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


async def files(bed: Bedside) -> list[CheckLine]:
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


async def alarms(bed: Bedside) -> list[CheckLine]:
    """Whether alarms are told, and which stand."""
    told = await standing_alarms.standing(bed.session, bed.timeout_s)
    if told is None:
        return [unknown("W-DOC-NO-EVENTS", "alarms")]
    return [fine("W-DOC-EVENTS", "alarms", standing=", ".join(str(alarm.number) for alarm in told) or "none")]
