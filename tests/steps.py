"""The steps of a push as a person reads them in the report."""

from __future__ import annotations

from gateway.domain.outcomes import PushRecord, SwitchRecord
from gateway.report.sentences import step_line


def lines(record: PushRecord | SwitchRecord) -> tuple[str, ...]:
    """Each step in one line of English, with its details."""
    return tuple(step_line(step) for step in record.steps)
