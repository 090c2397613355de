"""The agent as a process: `python3 -m drivers.linuxcnc.agent --token-file FILE [--listen 127.0.0.1:5011]`.

A stopping kernel ends every process that uses its HAL, and a stat object dies with its kernel. So a child serves one
life of the kernel, and its parent starts the next one.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import secrets
import signal
import socket
import stat
import sys
import time
from pathlib import Path

from drivers.linuxcnc.agent.answering import Agent
from drivers.linuxcnc.agent.kernel import STARTING, Kernel, goes_on, running_life
from drivers.linuxcnc.agent.protocol import AgentRefusal, GatewayLines

LEAST_TOKEN, TOKEN_BYTES = 16, 24
LOOK_S, AGAIN_S = 0.5, 0.3


def _token(path: str) -> str:
    """The token, from a file that is the owner's alone; where there is none, a new one."""
    if not Path(path).exists():
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(f"{secrets.token_urlsafe(TOKEN_BYTES)}\n")
        print(f"{path}: a new token. Copy this file to the folder of the site file.")
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
    """Every gateway that asks, until this life of the kernel or the parent ends.

    Of another life nothing is told here: whoever hears of it goes on asking, and this child is about to leave.
    """
    mine, parent, told = running_life(), os.getppid(), False
    agent = Agent(token, _found, lambda: mine if goes_on(mine) else None)
    lines = GatewayLines(listener, agent.line)
    while goes_on(mine) and os.getppid() == parent:
        lines.turn(LOOK_S)
        if not told and mine is not None:
            told = _tells(agent)


def _tells(agent: Agent) -> bool:
    """What this kernel and its joints are; whether it could be said yet."""
    try:
        print(*agent.facts(), sep="\n", flush=True)
    except AgentRefusal as error:
        if error.fields.get("why") == STARTING:
            return False
        print(error.code, *(f"{key}={value}" for key, value in error.fields.items()), flush=True)
    return True


def main() -> None:
    """Listen, and keep a child for each life of the kernel."""
    parser = argparse.ArgumentParser(prog="python3 -m drivers.linuxcnc.agent", description=__doc__.splitlines()[0])
    parser.add_argument("--token-file", required=True, help="file with the token that the gateway sends")
    parser.add_argument("--listen", default="127.0.0.1:5011", help="address:port")
    told = parser.parse_args()
    host, _, port = told.listen.rpartition(":")
    if not host or not port.isdigit():
        parser.error(f"--listen {told.listen}: give an address and a port, as 127.0.0.1:5011")
    token = _token(told.token_file)
    try:
        listener = socket.create_server((host, int(port)))
    except (OSError, OverflowError) as error:
        sys.exit(f"{told.listen}: {error}. Is another agent running? Or give another port by --listen.")
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
            with contextlib.suppress(KeyboardInterrupt):  # how HAL asks a program that uses it to end
                _serve(listener, token)
            os._exit(0)
        os.waitpid(child, 0)
        time.sleep(AGAIN_S)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):  # it may come a second time, while the first is taken
        main()
