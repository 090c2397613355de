"""What a site file may say about a control that is reached by carrying files."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from pydantic import Field

from drivers.errors import words
from drivers.settings import DriverSettings, FolderPathText, Rule
from drivers.sinumerik.ncprogram.words import COUNT, SetupWord, Words
from drivers.sinumerik.opcua.session import nodes

_AXIS = re.compile(r"[A-Z_][A-Z0-9_]{0,31}")
MOST_AXES, MOST_TABLES = 31, 62


class OfflineSettings(DriverSettings):
    """Keys under ``[controller.settings]`` of a control that is reached by carrying files."""

    addresses: ClassVar[tuple[str, ...]] = ("carried",)
    sources: ClassVar[str] = "MD10000, MD18342: Siemens' own list of machine data (sublime-s840d, doc/en)"
    folder: FolderPathText = Field(
        default="carried", min_length=1, description="folder of what is carried to the control and back"
    )
    axes: str = Field(
        default="", description="names of all machine axes in the control's own order (MD10000), blanks between them"
    )
    cross_tables: int = Field(default=0, ge=0, le=MOST_TABLES, description="how many CEC tables have memory (MD18342)")
    r_first: int = Field(
        default=80, ge=3, le=nodes.R_LAST - COUNT, description=f"first of {COUNT} R parameters that are ours alone"
    )

    r_marker: int = Field(
        default=-1,
        ge=-1,
        le=nodes.R_LAST,
        description="R parameter in which a person typed this machine's own number; only read, -1: none",
    )

    def rules(self) -> tuple[Rule, ...]:
        """Axis names go into programs; the marker's R parameter is none that programs write."""
        names = self.names
        good = 0 < len(set(names)) == len(names) <= MOST_AXES and all(_AXIS.fullmatch(name) for name in names)
        free = not Words(self.r_first, self.r_first - len(SetupWord)).holds(self.r_marker)
        return (("axes", good, words("W-KEY-AXES")), ("r_marker", free, words("W-KEY-R-MARKER")))

    @property
    def machine_axes(self) -> tuple[str, ...]:
        """The axes by their numbers."""
        return self.names

    @property
    def names(self) -> tuple[str, ...]:
        """The axes by their numbers."""
        return tuple(self.axes.split())

    @property
    def road(self) -> dict[str, Any]:
        """The settings that the programs and their conversation are written by.

        No file comes out of a control while a program waits there, so each half is a program of its own.
        """
        pace = {"poll_s": 0.2, "fast_poll_s": 0.02, "stale_s": 0.0}
        words = {"r_first": self.r_first, "r_marker": self.r_marker}
        return {"security": "None", "two_programs": True, **words, **pace}
