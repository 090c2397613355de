"""Faults by name: seeded faults of any wire, and the list of every fault that a simulator can play.

`FaultPlan` disturbs a wire, always the same way for one seed. `named_faults` collects the fields of the control's
switches, the OPC UA server's quirks and the fault plan; their meanings are read from those classes' docstrings, so a
fault cannot be listed without its description, nor described differently in two places.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from drivers.errors import TransportError
from drivers.transport import ByteTransport, FaultyTransport
from simulators.cellfile import CellFile
from simulators.nck import OPEN, Switches
from simulators.opcua import ServerQuirks


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults of one wire, seen from the end that it is put around; all zero is a faultless wire.

    Probabilities are for each piece written: ``split`` cuts it at random places, ``flip`` turns one bit,
    ``lose`` swallows some of its bytes, ``garbage`` puts random bytes before it. ``cut_after`` cuts the
    wire after so many bytes (0: never). ``incoming`` plays the same on what is read.
    """

    seed: int = 0
    split: float = 0.0
    flip: float = 0.0
    lose: float = 0.0
    garbage: float = 0.0
    cut_after: int = 0
    incoming: bool = False

    @property
    def harmless(self) -> bool:
        """True when nothing goes wrong."""
        return not (self.split or self.flip or self.lose or self.garbage or self.cut_after)

    def around(self, wire: ByteTransport) -> ByteTransport:
        """The wire with these faults."""
        if self.harmless:
            return wire
        bent = _FaultyDirection(self, wire.description)
        if self.incoming:
            return FaultyTransport(wire, incoming=bent, outgoing=_FaultyDirection(self, wire.description))
        return FaultyTransport(wire, outgoing=bent)


class _FaultyDirection:
    """One direction of one connection."""

    def __init__(self, plan: FaultPlan, where: str) -> None:
        self._plan = plan
        self._where = where
        self._rng = np.random.default_rng(plan.seed)
        self._passed = 0

    def __call__(self, data: bytes) -> Iterable[bytes]:
        self._passed += len(data)
        if self._plan.cut_after and self._passed > self._plan.cut_after:
            raise TransportError("E-LINK-CLOSED", self._where, why="the fault plan cut the wire")
        for change in (self._lost, self._flipped, self._dirtied):
            data = change(data)
        return self._pieces(data)

    def _happens(self, chance: float) -> bool:
        return bool(self._rng.random() < chance)

    def _lost(self, data: bytes) -> bytes:
        if not data or not self._happens(self._plan.lose):
            return data
        first, last = sorted(self._rng.integers(0, len(data) + 1, 2).tolist())
        return data[:first] + data[min(last, first + 64) :]

    def _flipped(self, data: bytes) -> bytes:
        if not data or not self._happens(self._plan.flip):
            return data
        bent = bytearray(data)
        bent[int(self._rng.integers(len(bent)))] ^= 1 << int(self._rng.integers(8))
        return bytes(bent)

    def _dirtied(self, data: bytes) -> bytes:
        return self._rng.bytes(7) + data if self._happens(self._plan.garbage) else data

    def _pieces(self, data: bytes) -> list[bytes]:
        if len(data) < 2 or not self._happens(self._plan.split):
            return [data]
        cuts = np.unique(self._rng.integers(1, len(data), 3)).tolist()
        return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


# The list of all faults, by name.

_TEXT = re.compile(r"\s+")
LARGEST_VALUE = 1e9
COMPOSITE_SWITCHES = frozenset({"quantise", "hmi_writes_at_block"})
"""Switches whose value is more than one number or word."""


@dataclass(frozen=True, slots=True)
class NamedFault:
    """One fault: ``name`` is "control.", "server." or "wire." and the switch; ``meaning`` one line.

    ``usual`` is its value while nothing is wrong, whose type a value must have (a whole number where it is None).
    """

    name: str
    meaning: str
    usual: Any

    def checked(self, value: Any) -> Any:
        """The value in its type. Raises ValueError for another type or beyond what the fault can be."""
        kind = type(self.usual)
        if self.usual is None:
            kind = int
        right = isinstance(value, int | float) if kind is float else isinstance(value, kind)
        if not right or (isinstance(value, bool) and kind is not bool):
            raise ValueError(f"{self.name} takes a {kind.__name__}, not {value!r}")
        highest = 1.0 if self.name.startswith("wire.") and kind is float else LARGEST_VALUE
        if isinstance(value, int | float) and kind is not bool:
            lowest = -LARGEST_VALUE if isinstance(self.usual, int) else 0.0
            if not (math.isfinite(value) and lowest <= value <= highest):
                raise ValueError(f"{self.name} takes {lowest:g} to {highest:g}, not {value!r}")
        open_ones = OPEN.get(self.name.removeprefix("control."))
        if self.name.startswith("control.") and open_ones is not None and value not in open_ones:
            raise ValueError(f"{self.name} is one of {', '.join(map(str, open_ones))}, not {value!r}")
        return kind(value) if kind is float else value


def named_faults() -> dict[str, NamedFault]:
    """All faults by name, as the code has them."""
    found = [
        *_faults_of_class("control", Switches),
        *_faults_of_class("server", ServerQuirks),
        *_faults_of_class("wire", FaultPlan),
    ]
    return {one.name: one for one in found}


def _faults_of_class(front: str, kind: type) -> Iterator[NamedFault]:
    usual, texts = kind(), _meanings(kind.__doc__ or "")
    for one in fields(kind):
        value = getattr(usual, one.name)
        if (
            one.name not in texts
            or one.name in COMPOSITE_SWITCHES
            or not isinstance(value, bool | int | float | str | None)
        ):
            continue
        yield NamedFault(f"{front}.{one.name}", texts[one.name], value)


def _meanings(text: str) -> dict[str, str]:
    """What a docstring says behind each ``name``, up to the next sentence that names another."""
    marks = list(re.finditer(r"``(\w+)``", text))
    found: dict[str, str] = {}
    for place, mark in enumerate(marks):
        end = marks[place + 1].start() if place + 1 < len(marks) else len(text)
        said = _TEXT.sub(" ", text[mark.end() : end].partition("\n\n")[0]).strip(" :,.;")
        said = re.sub(r" (and|or)$", "", said)
        if mark[1] not in found:
            found[mark[1]] = said if len(said) > len("and") else mark[1].replace("_", " ")
    return found


def with_faults(
    cell: CellFile, wanted: Mapping[str, Any], wire: str
) -> tuple[CellFile, dict[str, Any], dict[str, Any]]:
    """A cell file with these faults of its control, options of a cell with those of the wire, quirks of its server.

    ``wire`` is the instrument whose wire is meant. Raises ValueError naming a fault that does not exist.
    """
    known = named_faults()
    for name in wanted:
        if name not in known:
            raise ValueError(f"{name!r} is no fault; there are: {', '.join(known)}")
    values = {name: known[name].checked(value) for name, value in wanted.items()}
    parts = {front: _values_of_group(values, front) for front in ("control", "server", "wire")}
    switches = {**cell.machine.switches, **parts["control"]}
    cell = cell.model_copy(update={"machine": cell.machine.model_copy(update={"switches": switches})})
    options = {"faults": {wire: replace(FaultPlan(), **parts["wire"])}} if parts["wire"] else {}
    return cell, options, parts["server"]


def _values_of_group(values: Mapping[str, Any], front: str) -> dict[str, Any]:
    start = f"{front}."
    return {name.removeprefix(start): value for name, value in values.items() if name.startswith(start)}
