"""How a check ended, in words that every language of the product has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Literal

from drivers.probes import Allowance
from gateway.report.document.words import Tongue

Outcome = Literal["passed", "failed", "skipped"]
OUTCOMES: tuple[Outcome, ...] = ("passed", "failed", "skipped")
ENGLISH = Tongue()


@dataclass(frozen=True, slots=True)
class SeenLine:
    """One line: a key of the document's catalogue behind "accept_seen_", and its fields."""

    key: str
    fields: Mapping[str, object] = field(default_factory=dict)

    def told(self, t: Tongue) -> str:
        """The line in a language. Raises KeyError for an unknown key: a fault of ours."""
        return t(f"accept_seen_{self.key}", **self.fields)


def seen(key: str, /, **fields: object) -> SeenLine:
    """A line by its key and fields."""
    return SeenLine(key, fields)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """How one check ended for an axis ("" for the site as a whole).

    ``seen`` is what was seen, or why the check was skipped. What was wrong stands there as the product's error, in
    English.
    """

    check: str
    axis: str
    allow: Allowance
    _: KW_ONLY
    outcome: Outcome
    seen: SeenLine

    @property
    def name(self) -> str:
        """As people read it: "limits X1"."""
        return f"{self.check} {self.axis}".strip()

    @property
    def said(self) -> str:
        """The line in English, for the terminal, JSON and JUnit."""
        return self.seen.told(ENGLISH)

    def as_record(self) -> dict[str, str]:
        """The result as data, in English."""
        what = ENGLISH(f"accept_what_{self.check}")
        return {"check": self.name, "allow": self.allow, "what": what, "outcome": self.outcome, "said": self.said}
