"""Exit codes that no exception carries: verdicts. docs/exit-codes.md lists all of them."""

from __future__ import annotations

from gateway.workflow.run.outcome import CANNOT_TELL, LIMIT_EXCEEDED, of_verdicts

__all__ = ["CANNOT_TELL", "LIMIT_EXCEEDED", "REMEASURE", "of_verdicts"]
REMEASURE = 20
