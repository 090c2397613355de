"""What goes on at this moment, for whoever looks on: samples, stops, what is waited for; and what an onlooker asks.

The work tells it to the onlooker of its task, if there is one. Onlookers return at once, raise nothing and slow nobody.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

from drivers.message import Message
from drivers.types.sensing import Ambient, SampleBlock
from drivers.units import DeviationUnit


@dataclass(frozen=True, slots=True)
class LiveDeviation:
    """A reading of the plot: measured - target in ``unit``, zero at the first reading of its axis.

    ``expanded`` is its U (k = 2) while the capture goes on, None where no budget is known; ``raw`` is what the
    instrument showed, uncorrected, in the unit of its axis.
    """

    value: float
    unit: DeviationUnit
    expanded: float | None
    raw: float


Asked = tuple[float, int, int]
"""A reading that a person wants taken again: target, repetition, approach (+1, -1); repetition 0 means all of them."""


class Onlooker(Protocol):
    """Looks on at one run."""

    def samples(self, instrument: str, block: SampleBlock) -> None:
        """What an instrument has just sent."""
        ...

    def waiting(self, instrument: str, missing: Message, done_s: float, needed_s: float) -> None:
        """Which condition a reading waits for, and how much of its time has passed, in instrument time."""
        ...

    def ambient(self, instrument: str, air: Ambient) -> None:
        """Air and material as the run has just read them."""
        ...

    def stands(self, positions: Mapping[str, float]) -> None:
        """Where axes stand now, mm or deg by machine axis; one that is not named stands as before."""
        ...

    def taken(self, axis: str, stop: Asked, seen: LiveDeviation) -> None:
        """A reading was taken."""
        ...

    def asked_again(self, axis: str) -> tuple[Asked, ...]:
        """Readings to be taken again, each told once."""
        ...


class Nobody:
    """An onlooker that is not there."""

    def samples(self, instrument: str, block: SampleBlock) -> None:
        """Nothing."""

    def waiting(self, instrument: str, missing: Message, done_s: float, needed_s: float) -> None:
        """Nothing."""

    def ambient(self, instrument: str, air: Ambient) -> None:
        """Nothing."""

    def stands(self, positions: Mapping[str, float]) -> None:
        """Nothing."""

    def taken(self, axis: str, stop: Asked, seen: LiveDeviation) -> None:
        """Nothing."""

    def asked_again(self, axis: str) -> tuple[Asked, ...]:  # noqa: ARG002 - the protocol's
        """Nothing."""
        return ()


_NOBODY: Onlooker = Nobody()
_onlooker: ContextVar[Onlooker] = ContextVar("onlooker", default=_NOBODY)
_run: ContextVar[Callable[[], str]] = ContextVar("run", default=str)
_device: ContextVar[str] = ContextVar("device", default="")


def concern() -> tuple[str, str]:
    """Which run and which device this task is about, for a log; "" where it is about none."""
    return _run.get()(), _device.get()


@contextmanager
def of_run(run_id: Callable[[], str]) -> Iterator[None]:
    """What the block does, its tasks among it, is about this run, whose id may be known later."""
    before = _run.set(run_id)
    try:
        yield
    finally:
        _run.reset(before)


def of_device(name: str) -> None:
    """From here on this task, and those that it begins, are about this device."""
    _device.set(name)


def onlooker() -> Onlooker:
    """Who looks on at the run that this task belongs to."""
    return _onlooker.get()


@contextmanager
def looked_on_by(one: Onlooker) -> Iterator[None]:
    """What the block does, its tasks among it, has this onlooker."""
    before = _onlooker.set(one)
    try:
        yield
    finally:
        _onlooker.reset(before)
