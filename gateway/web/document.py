"""The description of all routes (OpenAPI), as it is shipped in the documents."""

from __future__ import annotations

from typing import Any

from gateway.web.app import routed


def described() -> dict[str, Any]:
    """The OpenAPI document of this version."""
    found: dict[str, Any] = routed().openapi()
    return found
