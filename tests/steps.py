"""What records say, as a person reads it in English: the steps of a push, the remarks about figures."""

from __future__ import annotations

from typing import Any

from gateway.domain.outcomes import PushRecord, SwitchRecord
from gateway.report.sentences import step_line


def lines(record: PushRecord | SwitchRecord) -> tuple[str, ...]:
    """Each step in one line of English, with its details."""
    return tuple(step_line(step) for step in record.steps)


def said(figures: Any) -> tuple[str, ...]:
    """The remarks about figures."""
    return tuple(map(str, figures.flags))
