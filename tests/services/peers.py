"""Where the servers of others listen while a test kills them and starts them again."""

from __future__ import annotations

import random
import socket
from contextlib import suppress


def lasting_port() -> int:
    """A free port of loopback that the kernel gives to nobody else while its server is away.

    It is below every system's range for outgoing connections: a port of that range may be another connection's own
    end when a killed server wants it again.
    """
    chance = random.SystemRandom()
    while True:
        port = chance.randrange(20_000, 30_000)
        with suppress(OSError), socket.socket() as free:
            free.bind(("127.0.0.1", port))
            return port
