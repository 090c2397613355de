"""Every question that is put to a control after the login, in the order of the road; each one only reads."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from drivers.checks import CheckLine, failed, unknown
from drivers.errors import TransportError, TrueflankError
from drivers.sinumerik.opcua.bedside import machine, programs, server
from drivers.sinumerik.opcua.bedside.bed import Bedside


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


_QUESTIONS: tuple[tuple[str, Callable[[Bedside], Awaitable[list[CheckLine]]]], ...] = (
    ("clock", server.clock),
    ("namespace", server.name_space),
    ("option", server.option),
    ("methods", server.methods),
    ("server version", server.version),
    ("rights", server.rights),
    ("axes", machine.axes),
    ("serial number", machine.identity),
    ("variables", machine.variables),
    ("units", machine.units),
    ("measuring system", machine.encoders),
    ("table memory", machine.memory),
    ("written files", programs.settings),
    ("key switch", machine.level),
    ("files", server.files),
    ("self-test", programs.self_test),
    ("left over", programs.left_over),
    ("R parameters", programs.r_parameters),
    ("alarms", server.alarms),
    ("state", machine.state),
)
