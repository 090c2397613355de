"""Every fault of the double by name, with its meaning out of the code that plays it; injected one by one, bounded."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from simulators.cellfile import CellFile
from simulators.faults import FaultPlan
from simulators.nck.switches import OPEN, Switches
from simulators.opcua.manners import Manners

_TEXT = re.compile(r"\s+")
MOST = 1e9
ACTS = frozenset({"quantise", "hmi_writes_at_block"})
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
        highest = 1.0 if self.name.startswith("wire.") and kind is float else MOST
        if isinstance(value, int | float) and kind is not bool:
            lowest = -MOST if isinstance(self.usual, int) else 0.0
            if not (math.isfinite(value) and lowest <= value <= highest):
                raise ValueError(f"{self.name} takes {lowest:g} to {highest:g}, not {value!r}")
        open_ones = OPEN.get(self.name.removeprefix("control."))
        if self.name.startswith("control.") and open_ones is not None and value not in open_ones:
            raise ValueError(f"{self.name} is one of {', '.join(map(str, open_ones))}, not {value!r}")
        return kind(value) if kind is float else value


def named_faults() -> dict[str, NamedFault]:
    """All faults by name, as the code has them."""
    found = [*_of("control", Switches), *_of("server", Manners), *_of("wire", FaultPlan)]
    return {one.name: one for one in found}


def _of(front: str, kind: type) -> Iterator[NamedFault]:
    usual, texts = kind(), _meanings(kind.__doc__ or "")
    for one in fields(kind):
        value = getattr(usual, one.name)
        if one.name not in texts or one.name in ACTS or not isinstance(value, bool | int | float | str | None):
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


def faulty(cell: CellFile, wanted: Mapping[str, Any], wire: str) -> tuple[CellFile, dict[str, Any], dict[str, Any]]:
    """A cell file with these faults of its control, options of a cell with those of the wire, manners of its server.

    ``wire`` is the instrument whose wire is meant. Raises ValueError naming a fault that does not exist.
    """
    known = named_faults()
    for name in wanted:
        if name not in known:
            raise ValueError(f"{name!r} is no fault; there are: {', '.join(known)}")
    values = {name: known[name].checked(value) for name, value in wanted.items()}
    parts = {front: _part(values, front) for front in ("control", "server", "wire")}
    switches = {**cell.machine.switches, **parts["control"]}
    cell = cell.model_copy(update={"machine": cell.machine.model_copy(update={"switches": switches})})
    options = {"faults": {wire: replace(FaultPlan(), **parts["wire"])}} if parts["wire"] else {}
    return cell, options, parts["server"]


def _part(values: Mapping[str, Any], front: str) -> dict[str, Any]:
    start = f"{front}."
    return {name.removeprefix(start): value for name, value in values.items() if name.startswith(start)}
