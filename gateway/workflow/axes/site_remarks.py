"""What a site file asks for that will do for no push, or only just: said before anything is measured; pure."""

from __future__ import annotations

from drivers.message import Message
from gateway.config import SiteFile
from gateway.interlocks import MIN_REPETITIONS

SPARE = 2


def remarks(site: SiteFile) -> tuple[Message, ...]:
    """One line for each live axis that asks for no more repetitions than a push needs."""
    asked = {axis.name: axis.measure.repetitions for axis in site.axes if axis.measure.file is None}
    letters = {axis.name: axis.letter for axis in site.axes}
    for setup in site.setups:
        if setup.component == f"E{letters[setup.axis] * 2}" and setup.repetitions and setup.source == "live":
            asked[setup.axis] = setup.repetitions
    return tuple(_remark(axis, count) for axis, count in asked.items() if count <= MIN_REPETITIONS)


def _remark(axis: str, asked: int) -> Message:
    code = "W-SITE-REPETITIONS-FEW" if asked < MIN_REPETITIONS else "W-SITE-REPETITIONS-LEAST"
    fields = {"asked": asked, "needed": MIN_REPETITIONS, "advised": MIN_REPETITIONS + SPARE}
    return Message(code, {"axis": axis, **fields})
