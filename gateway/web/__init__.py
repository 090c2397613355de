"""The read-only status page and its few routes; the one thing it can start is a run that only proposes."""

from __future__ import annotations

from gateway.web.app import create_app

__all__ = ["create_app"]
