"""The site-acceptance sheet: every check with what was seen, what was left out and why, and lines to sign."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from html import escape
from typing import Literal

from drivers.probes import Allowance

Outcome = Literal["passed", "failed", "skipped"]

_STYLE = (
    "body{font:11pt sans-serif;max-width:60em;margin:2em auto}table{border-collapse:collapse;width:100%}"
    "td,th{border:1px solid #999;padding:.3em;text-align:left;vertical-align:top}.failed{font-weight:bold}"
    ".sign td{height:3em}"
)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """How one check ended: ``said`` is what was seen, what was wrong and what to do, or why it was skipped."""

    name: str
    allow: Allowance
    what: str
    outcome: Outcome
    said: str

    def as_record(self) -> dict[str, str]:
        """The result as data."""
        return {"check": self.name, "allow": self.allow, "what": self.what, "outcome": self.outcome, "said": self.said}


def sheet_text(results: Collection[CheckResult], about: Mapping[str, str]) -> str:
    """The sheet as one HTML page that prints; ``about`` names site, machine, date, allowance and version."""
    head = "".join(f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in about.items())
    rows = "".join(
        f'<tr class="{one.outcome}"><td>{escape(one.name)}</td><td>{escape(one.what)}</td>'
        f"<td>{one.outcome}</td><td>{escape(one.said)}</td></tr>"
        for one in results
    )
    count = {word: sum(one.outcome == word for one in results) for word in ("passed", "failed", "skipped")}
    summary = ", ".join(f"{number} {word}" for word, number in count.items())
    people = "".join(f"<tr><td>{who}</td><td></td><td></td></tr>" for who in ("Tested by", "Accepted by"))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Site acceptance</title>'
        f"<style>{_STYLE}</style><h1>Site acceptance</h1><table>{head}</table><p>{summary}</p>"
        f"<table><tr><th>check</th><th>looks at</th><th>result</th><th>seen</th></tr>{rows}</table>"
        '<h2>Signatures</h2><table class="sign">'
        f"<tr><th></th><th>name, date</th><th>signature</th></tr>{people}</table>"
        "<p>A skipped check says nothing about the machine.</p></html>\n"
    )
