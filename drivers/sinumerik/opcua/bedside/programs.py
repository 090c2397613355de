"""Questions about our own programs: settings they need, their self-test, what is left of them, their R parameters."""

from __future__ import annotations

from drivers.checks import CheckLine, fine, unknown, wrong
from drivers.sinumerik.ncprogram.words import COUNT, MARKED, file_path
from drivers.sinumerik.opcua.bedside import conditions
from drivers.sinumerik.opcua.bedside.bed import Bedside
from drivers.sinumerik.opcua.dialogue import Dialogue
from drivers.sinumerik.opcua.leaving import found as found_left
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.transfer import Transfer


async def settings(bed: Bedside) -> list[CheckLine]:
    """Settings that our programs and tables need; asked once the reserved memory is known."""
    return await conditions.judged(bed, bed.memories)


async def self_test(bed: Bedside) -> list[CheckLine]:
    """The report that each axis' self-test left in the control; nothing is started here."""
    transfer = Transfer(bed.session, bed.settings.channel, bed.where, bed.timeout_s)
    files = {axis.name: file_path("SELF", axis.name) for axis, _ in bed.memories}
    return conditions.self_tests({name: await transfer.found(path) for name, path in files.items()})


async def left_over(bed: Bedside) -> list[CheckLine]:
    """Programs of ours whose gateway is gone, and their words, by the numbers they were sent with."""
    selected = await bed.value(nodes.in_channel("progName", bed.settings.channel, "ProgramInfo"))
    seen = await Dialogue(
        session=bed.session, reader=bed.reader, settings=bed.settings, clock=bed.clock, where=bed.where
    ).look()
    left, _sent = found_left(seen, str(selected or ""), bed.wanted.sent)
    return [(fine if left.clear else wrong)(left.code, "left over", **left.facts)]


async def r_parameters(bed: Bedside) -> list[CheckLine]:
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
