"""What a site file may say about a LinuxCNC host."""

from __future__ import annotations

from typing import ClassVar
from urllib.parse import urlsplit

from pydantic import Field

from drivers.errors import words
from drivers.message import Message
from drivers.settings import DriverSettings, FilePathText, Rule

_HERE = ("localhost", "127.0.0.1", "::1", "[::1]")


class LinuxCncSettings(DriverSettings):
    """Keys under ``[controller.settings]``: the agent's token, and the pins that programs shake hands with."""

    addresses: ClassVar[tuple[str, ...]] = ("tcp", "memory")
    token_file: FilePathText = Field(default="", description="file with the agent's token, the same as on its host")
    count_output: int = Field(default=0, ge=0, le=63, description="motion.analog-out: a program counts stops")
    echo_output: int = Field(default=1, ge=0, le=63, description="motion.analog-out: a program says a count back")
    go_input: int = Field(default=0, ge=0, le=63, description="motion.digital-in: a program may go on")
    leave_input: int = Field(default=1, ge=0, le=63, description="motion.digital-in: a program ends at its next wait")
    wait_limit_s: float = Field(
        default=3600.0, ge=60.0, le=86400.0, description="longest wait of a program at one stop, s"
    )
    reply_s: float = Field(default=10.0, ge=0.5, le=60.0, description="longest wait for one answer, s")
    poll_s: float = Field(default=0.2, ge=0.02, le=5.0, description="time between two questions while waiting, s")

    def rules(self) -> tuple[Rule, ...]:
        """Count and echo, go and leave are pins of their own."""
        return (
            ("echo_output", self.echo_output != self.count_output, words("W-KEY-OUTPUT")),
            ("leave_input", self.leave_input != self.go_input, words("W-KEY-INPUT")),
        )

    def unprotected(self, url: str) -> Message | None:
        """The lines are plain; on the host itself nobody else is on them."""
        parts = urlsplit(url)
        return None if parts.scheme == "memory" or parts.hostname in _HERE else Message.of("W-LCNC-UNPROTECTED")
