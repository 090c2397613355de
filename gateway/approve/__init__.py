"""A person's consent to exactly one plan on one machine: ten minutes long, used once, never given by the pusher."""

from __future__ import annotations

from gateway.approve.approval import VALID, consent
from gateway.approve.keeping import Approvals
from gateway.approve.risk import UNPROTECTED, risk_taken, risking

__all__ = ["UNPROTECTED", "VALID", "Approvals", "consent", "risk_taken", "risking"]
