"""What measured files state of a measurement besides readings, and which differences a person has accepted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class StatedFact:
    """One statement of a file: ``key`` of `gateway.workflow.files.statements.KEYS`, ``value`` as the file has it."""

    file: str
    key: str
    value: str


@dataclass(frozen=True, slots=True)
class AcceptedDifference:
    """A statement that differs from ``other`` and counts all the same, because a person accepted it at ``utc``.

    ``source`` is "site" for the site file, else the name of the other file.
    """

    file: str
    key: str
    value: str
    other: str
    source: str
    utc: str = ""


@dataclass(frozen=True, slots=True)
class StatedFacts:
    """Everything that the files of one run or report state, in the order of the files.

    ``conditions`` are the test conditions that a person stated, by axis ("" for every axis) and by key of
    `gateway.config.sections.CaptureConditionsSection`, each as text with its unit.
    """

    facts: tuple[StatedFact, ...] = ()
    accepted: tuple[AcceptedDifference, ...] = ()
    conditions: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def of(self, file: str) -> Mapping[str, str]:
        """The statements of one file by key."""
        return {one.key: one.value for one in self.facts if one.file == file}

    def values(self, key: str) -> tuple[str, ...]:
        """Every different value that files state under a key, in their order."""
        return tuple(dict.fromkeys(one.value for one in self.facts if one.key == key))
