"""Tells the service manager how the daemon is: ready, alive, stopping; nothing where there is no manager."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping

from drivers.clock import Clock

LONGEST_STOP_US = 60_000_000


class Notifier:
    """The protocol of systemd: one datagram to the socket that the environment names."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        known = os.environ if environment is None else environment
        self._address = known.get("NOTIFY_SOCKET", "")
        every = known.get("WATCHDOG_USEC", "")
        mine = known.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.every_s = int(every) / 2e6 if every.isdigit() and mine and int(every) > 0 else 0.0

    def ready(self, words: str) -> None:
        """The page answers."""
        self._tell(f"READY=1\nSTATUS={words}\nMAINPID={os.getpid()}")

    def stopping(self) -> None:
        """The end has begun; a push at work may take its time to leave the machine in order."""
        self._tell(f"STOPPING=1\nEXTEND_TIMEOUT_USEC={LONGEST_STOP_US}")

    def alive(self) -> None:
        """The loop turns. What a push does, however long it waits for a person, holds this up never."""
        self._tell("WATCHDOG=1")

    def _tell(self, text: str) -> None:
        if not self._address or not hasattr(socket, "AF_UNIX"):
            return
        address = f"\0{self._address[1:]}" if self._address.startswith("@") else self._address
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as way:
            way.setblocking(False)
            way.sendto(text.encode("utf-8"), address)


async def keep_telling(notifier: Notifier, clock: Clock) -> None:
    """Tell the watchdog twice in its time that the loop turns, for ever; nothing where none is set."""
    while notifier.every_s > 0.0:
        notifier.alive()
        await clock.sleep(notifier.every_s)
