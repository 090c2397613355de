"""What measuring, proving and pushing ask of a person, by the programs that each sends; pure.

The one place that counts them beforehand. `tests/closing` compares it with what a run asked.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.types.stops import StopPlan
from gateway.capture.duration import HANDSHAKE_S, plan_s, reading_s
from gateway.config import AxisSection, SiteFile, one_start
from gateway.push import ROUNDS, TIMES
from gateway.workflow.control.proving import SWITCH_SETTLE_S
from gateway.workflow.loop.dayplan import Asks

PROGRAM_S = 5.0
"""To send a program, write and compare its tables, and bring its files back."""
EVERY = "all axes"
STREAM_S = 0.4
"""What the blocks of a stream add to each reading, which begins and ends with a whole one."""
TOUCHED = 5
"""About so many places prove the effect of a table."""


def visiting(plans: Sequence[StopPlan], axis: AxisSection) -> Asks:
    """The stops of an axis' plans, each of them read."""
    standing = reading_s(axis.measure) + STREAM_S
    programs = tuple((len(plan.stops), plan_s(plan, standing)) for plan in plans)
    return Asks(machine_s=sum(seconds for _, seconds in programs), programs=programs)


def reading_tables(what: str) -> Asks:
    """What acts on an axis, or on all axes of a transaction, saved by a program that moves nothing."""
    return Asks((f"read the tables of {what}",), (), PROGRAM_S)


def pushing(
    site: SiteFile, tables: Sequence[tuple[AxisSection, AxisSection]], name: str, *, just: bool = False
) -> Asks:
    """One transaction of tables, each as (output, input), and of what reversals go with them.

    One load, one release where it is a start of its own, one restart, one proof of effect; one read of all their axes
    before them, unless ``just``: a program before has just read them, and the one that loads compares.
    """
    inputs = {over.name: over for _, over in tables}
    moved = sum(0.5 * _across_s(site, axis) for axis in inputs.values())
    shown = sum(_across_s(site, over) + TOUCHED * (over.measure.dwell_s + HANDSHAKE_S) for _, over in tables)
    presses = (*_loaded(site, f"load {name}", f"switch on {name}"), f"effect of {name}")
    read = Asks() if just else reading_tables(name)
    return read.plus(Asks(presses, (f"switch on {name}",), 3 * PROGRAM_S + moved + shown))


def trials_in(site: SiteFile) -> Asks:
    """The trial tables of all signs: read what is live, loaded, left off, and one restart lets them act when on."""
    presses = _loaded(site, "load trial tables", "end trial tables")
    return reading_tables(EVERY).plus(Asks(presses, ("trial tables",), 2 * PROGRAM_S))


def trials_out(site: SiteFile) -> Asks:
    """What was live before, back by one program; no restart, and no read of its own, where none of it was on."""
    return Asks(_loaded(site, "load what was before", "end what was before"), (), 2 * PROGRAM_S)


def _loaded(site: SiteFile, load: str, release: str) -> tuple[str, ...]:
    return (load,) if one_start(site) else (load, release)


def proving(site: SiteFile, out: AxisSection, over: AxisSection, kind: str) -> Asks:
    """One trial table switched at its peak: it goes on in the program that proved the instrument."""
    stops = 6 * ROUNDS if kind == "reversal" else 2 * TIMES
    read = 4 * ROUNDS if kind == "reversal" else stops
    turned = (stops - read) * 2.0 * over.measure.overrun / _feed(site, over) * 60.0
    stood = read * (SWITCH_SETTLE_S + out.measure.average_s + over.measure.dwell_s + HANDSHAKE_S + STREAM_S)
    return Asks(machine_s=0.5 * _across_s(site, over) + stood + turned)


def _feed(site: SiteFile, axis: AxisSection) -> float:
    return min(axis.measure.feed, site.moves.places.feed(axis.unit))


def _across_s(site: SiteFile, axis: AxisSection) -> float:
    """Seconds across an axis' table at the feed of a push."""
    return (axis.table.maximum - axis.table.minimum) / _feed(site, axis) * 60.0
