"""The agent as a process: `python3 -m drivers.linuxcnc.agent --token-file FILE [--listen 127.0.0.1:5011]`.

A stopping kernel ends every process that uses its HAL, and a stat object dies with its kernel. So a child serves one
life of the kernel, and its parent starts the next one.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import stat
import sys
import time
from pathlib import Path

from drivers.linuxcnc.agent.answering import MOST_LINE, Agent
from drivers.linuxcnc.agent.kernel import Kernel
from drivers.linuxcnc.agent.lives import Life, running
from drivers.linuxcnc.agent.refusal import AgentRefusal

LEAST_TOKEN = 16
LOOK_S, AGAIN_S = 0.5, 0.3


def _token(path: str) -> str:
    """The token, from a file that is the owner's alone."""
    if Path(path).stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        sys.exit(f"{path}: others may read the token. Run: chmod 600 {path}")
    token = Path(path).read_text(encoding="utf-8").strip()
    if len(token) < LEAST_TOKEN:
        sys.exit(f"{path}: the token has {len(token)} characters; it needs at least {LEAST_TOKEN}.")
    return token


def _found() -> Kernel:
    try:
        import hal
        import linuxcnc
    except ImportError as error:
        raise AgentRefusal("E-LCNC-DOWN", why=str(error)) from error
    return Kernel(linuxcnc, hal)


def _serve(listener: socket.socket, token: str) -> None:
    """One gateway after the other, until this life of the kernel ends.

    Of another life nothing is told here: whoever hears of it goes on asking, and this child is about to leave.
    """
    mine = running()
    agent = Agent(token, _found, lambda: mine if running() == mine else None)
    listener.settimeout(LOOK_S)
    while running() == mine:
        try:
            wire, _ = listener.accept()
        except TimeoutError:
            continue
        with wire:
            _talk(wire, agent, mine)


def _talk(wire: socket.socket, agent: Agent, mine: Life | None) -> None:
    wire.settimeout(LOOK_S)
    held = b""
    while running() == mine:
        try:
            data = wire.recv(1 << 16)
        except TimeoutError:
            continue
        except OSError:
            return
        held += data
        if not data or len(held) > MOST_LINE:
            return
        *lines, held = held.split(b"\n")
        for line in lines:
            wire.settimeout(None)
            wire.sendall(agent.line(line))
            wire.settimeout(LOOK_S)


def main() -> None:
    """Listen, and keep a child for each life of the kernel."""
    parser = argparse.ArgumentParser(prog="python3 -m drivers.linuxcnc.agent", description=__doc__.splitlines()[0])
    parser.add_argument("--token-file", required=True, help="file with the token that the gateway sends")
    parser.add_argument("--listen", default="127.0.0.1:5011", help="address:port")
    told = parser.parse_args()
    host, _, port = told.listen.rpartition(":")
    token = _token(told.token_file)
    listener = socket.create_server((host, int(port)))
    print(f"listening on {host}:{listener.getsockname()[1]}", flush=True)
    child = 0

    def stop(_signal: int, _frame: object) -> None:
        if child:
            os.kill(child, signal.SIGTERM)
        os._exit(0)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    while True:
        child = os.fork()
        if not child:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            _serve(listener, token)
            os._exit(0)
        os.waitpid(child, 0)
        time.sleep(AGAIN_S)


if __name__ == "__main__":
    main()
