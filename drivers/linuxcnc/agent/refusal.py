"""What the agent answers instead of a result: a code of the gateway's catalogue and its fields."""

from __future__ import annotations


class AgentRefusal(Exception):
    """Asked for something that cannot be had; ``code`` and ``fields`` go over the wire."""

    def __init__(self, code: str, **fields: object) -> None:
        super().__init__(code)
        self.code, self.fields = code, fields
