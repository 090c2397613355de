"""Whose names stand for the roles of a question: the first axis with a table, a free cross table, the R words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.sinumerik.ncprogram.words import Word
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.settings import UaSettings

FIRST_NUMBER = 100_000


@dataclass(frozen=True, slots=True)
class Roles:
    """Role to name; ``places`` the axis names by number, ``encoders`` what acts by axis, ``cross_on`` tables on."""

    names: Mapping[str, str]
    places: tuple[str, ...]
    encoder: int | None
    cross_on: tuple[int, ...]

    def filled(self, text: str, **more: str) -> str:
        """A question with its roles filled in. Raises KeyError naming the role that this control has not."""
        return text.format_map({**self.names, **more})


async def found_roles(reader: MachineReader, settings: UaSettings) -> Roles:
    """Read the machine's configuration and choose; raises what the reader raises."""
    configuration = await reader.configuration()
    words, channel = settings.words, settings.channel
    echo = words.number(Word.ECHO)
    names = {"channel": str(channel), "r_echo": str(echo), "r_next": str(echo + 1), "echo": words.name(Word.ECHO)}
    names |= {"phase": words.name(Word.PHASE), "release": words.name(Word.RELEASE)}
    acting: int | None = None
    for axis in configuration.names:
        encoders = await reader.encoders(configuration, axis)
        reserved = [index for index in encoders.acting if encoders.reserved[index]]
        off = [index for index in encoders.there if encoders.reserved[index] and encoders.enabled[index] is False]
        if off and "free_axis" not in names:
            names |= {"free_axis": axis, "free_encoder": str(off[0]), "free_points": str(encoders.reserved[off[0]])}
        if reserved and "axis" not in names:
            acting = reserved[0]
            names |= {"axis": axis, "axis_number": str(configuration.places.index(axis) + 1), "encoder": str(acting)}
            names["points"] = str(encoders.reserved[acting])
    names.setdefault("axis_number", str(configuration.places.index(configuration.names[0]) + 1))
    points = (await reader.memory(configuration, configuration.names[0], 0)).cec_points
    tables = [number for number, count in enumerate(points) if count]
    switched = [
        table
        for table in tables
        if await reader.figure(f"$SN_CEC_TABLE_ENABLE[{table}]", configuration) not in (0.0, None)
    ]
    free = [table for table in tables if table not in switched]
    if free:
        names |= {"table": str(free[-1]), "table_points": str(points[free[-1]])}
    names["tables"] = str(await _tables(reader, configuration))
    return Roles(names, configuration.places, acting, tuple(switched))


async def _tables(reader: MachineReader, configuration: Configuration) -> int:
    """How many cross tables the control has: twice its axes, or as far as their memory can be read."""
    count = 0
    while count < 2 * len(configuration.places):
        if await reader.figure(f"$MN_MM_CEC_MAX_POINTS[{count}]", configuration) is None:
            break
        count += 1
    return count
