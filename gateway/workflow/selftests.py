"""What a run refuses before it measures; what this store knows of the control's self-test, as a proposal says."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.message import Message
from drivers.programs import SelfTested
from gateway.config import AxisSection
from gateway.errors import WriteRefused
from gateway.store.selftests import SelfTestBook
from gateway.workflow.bench import Bench


def last_of(at: Bench, axis: AxisSection) -> SelfTested | None:
    """The last self-test of an axis, of this very machine or else of what it was before. Raises StoreError."""
    return SelfTestBook(at.store.root).last(at.machine, axis.name, axis.encoder)


def untested(at: Bench, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the axes by name that this very control has not passed a self-test for; none where it needs none."""
    if not at.supervisor.controller.capabilities.self_test:
        return ()
    found = {name: last_of(at, at.axis(name)) for name in dict.fromkeys(names)}
    return tuple(name for name, test in found.items() if test is None or not _holds(at, test))


def _holds(at: Bench, test: SelfTested) -> bool:
    return test.ok and not test.machine.differences(at.machine)


def warnings(at: Bench, names: Iterable[str]) -> tuple[Message, ...]:
    """What a proposal for these axes must say, in words; nothing where every one is tested."""
    missing = untested(at, names)
    return (Message.of("W-RUN-SELF-TEST", axes=", ".join(missing)),) if missing else ()


def demand(at: Bench) -> None:
    """Before hours of measuring: what a push would be refused for.

    Raises WriteRefused (E-RUN-PLACES: axes of the control without a safe place; E-RUN-SELF-TEST).
    """
    unplaced = [name for name in at.machine.axis_names if name not in at.site.moves.places.ranges]
    if unplaced:
        raise WriteRefused("E-RUN-PLACES", at.site.site.name, axes=", ".join(unplaced), first=unplaced[0])
    missing = untested(at, (axis.name for axis in at.site.axes))
    if missing:
        raise WriteRefused("E-RUN-SELF-TEST", at.site.site.name, axes=", ".join(missing))
