"""A host with LinuxCNC's own kernel, without realtime and display: mill, plant, person and agent, started and ended.

The kernel refuses to run as root, so root becomes nobody for it. Its shared memory is one for the whole computer: only
one kernel runs at a time.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import signal
import subprocess
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded
from drivers.linuxcnc.device import LinuxCnc

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
SYSTEM_PYTHON = "/usr/bin/python3"
TOKEN = "interop-0123456789"
START_S, END_S, PAUSE_S = 40.0, 20.0, 0.1
NOBODY = 65534
CAME_UP: list[Path] = []
SCREWS = ("x.comp", "y.comp", "z.comp", "a.comp")


def _as_nobody() -> list[str]:
    return ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"] if os.geteuid() == 0 else []


class Host:
    """One folder with the mill; `person` does what somebody in front of it does."""

    def __init__(self, folder: Path, files: Mapping[str, str]) -> None:
        self.folder = folder
        self._clock = LoopClock()
        self._kernel: asyncio.subprocess.Process | None = None
        self._agent: asyncio.subprocess.Process | None = None
        self.port = 0
        for one in (HERE / "linuxcnc").iterdir():
            if one.is_file():
                shutil.copy(one, folder)
        for name in (*SCREWS, "mill.tbl"):
            (folder / name).write_text(files.get(name, ""))
        # All that a host needs of us: the agent's folder, and the two it lies in.
        agent = folder / "drivers" / "linuxcnc" / "agent"
        shutil.copytree(ROOT / "drivers" / "linuxcnc" / "agent", agent, ignore=shutil.ignore_patterns("__pycache__"))
        for room in (agent.parent, agent.parent.parent):
            shutil.copy(ROOT / room.relative_to(folder) / "__init__.py", room)
        (folder / "token").write_text(TOKEN)
        (folder / "token").chmod(0o600)
        if os.geteuid() == 0:
            for one in (folder, *folder.rglob("*")):
                os.chown(one, NOBODY, NOBODY)

    async def _run(self, *words: str, out: str) -> asyncio.subprocess.Process:
        here = str(self.folder)
        wanted = {"HOME": here, "RTAPI_FIFO_PATH": f"{here}/fifo", "PYTHONPATH": here}
        with (self.folder / out).open("ab") as log:
            return await asyncio.create_subprocess_exec(
                *_as_nobody(),
                *words,
                cwd=self.folder,
                env={**os.environ, **wanted},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    # ---- the kernel and its person ----------------------------------------------------------------

    async def start(self) -> None:
        """LinuxCNC with its display, which is the person; fails with its log where it does not come up."""
        (self.folder / "person.port").unlink(missing_ok=True)
        self._kernel = await self._run("linuxcnc", "mill.ini", out="kernel.log")
        async with self._clock.deadline(START_S, "LinuxCNC"):
            while not (self.folder / "person.port").exists():
                log = (self.folder / "kernel.log").read_text()
                assert self._kernel.returncode is None, f"LinuxCNC ended: {log}"
                await self._clock.sleep(PAUSE_S)

    async def stop(self) -> None:
        """The display is closed: LinuxCNC ends everything that belongs to it."""
        if self._kernel is None or self._kernel.returncode is not None:
            return
        with contextlib.suppress(OSError, ValueError):
            await self.person("quit")
        try:
            async with self._clock.deadline(END_S, "LinuxCNC"):
                await self._kernel.wait()
        except DeadlineExceeded:
            os.killpg(self._kernel.pid, signal.SIGKILL)
            await self._kernel.wait()

    async def restart(self) -> None:
        await self.stop()
        await self.start()
        await self.person("home")

    async def person(self, do: str, *told: object) -> Any:
        """What the person did or saw."""
        port = int((self.folder / "person.port").read_text())
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        try:
            writer.write(json.dumps([do, *told]).encode() + b"\n")
            await writer.drain()
            return json.loads(await reader.readline() or b"null")
        finally:
            writer.close()
            await writer.wait_closed()

    # ---- the agent ----------------------------------------------------------------------------------

    async def start_agent(self) -> None:
        """The agent by the system's Python, beside the kernel."""
        listen = f"127.0.0.1:{self.port}"
        words = ("-m", "drivers.linuxcnc.agent", "--token-file", "token", "--listen", listen)
        self._agent = await self._run(SYSTEM_PYTHON, *words, out="agent.log")
        async with self._clock.deadline(START_S, "LinuxCNC"):
            while "listening" not in (said := (self.folder / "agent.log").read_text()):
                assert self._agent.returncode is None, said
                await self._clock.sleep(PAUSE_S)
        self.port = int(said.split("listening on 127.0.0.1:")[-1].split()[0])

    async def kill_agent(self) -> None:
        """kill -9 for parent and child."""
        assert self._agent is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._agent.pid, signal.SIGKILL)
        await self._agent.wait()
        (self.folder / "agent.log").unlink(missing_ok=True)

    @contextlib.asynccontextmanager
    async def device(self) -> AsyncIterator[LinuxCnc]:
        """The driver at this host's agent, open."""
        settings = {"token_file": str(self.folder / "token"), "poll_s": 0.05}
        device = LinuxCnc("mill", f"tcp://127.0.0.1:{self.port}", settings, self._clock)
        try:
            await device.open(10.0)
            yield device
        finally:
            await device.close()


def kernel_there() -> None:
    """Skip, visibly, where there is no LinuxCNC: not every computer can have it."""
    asked = [SYSTEM_PYTHON, "-c", "import linuxcnc, hal"]
    if shutil.which("linuxcnc") is None or subprocess.run(asked, capture_output=True, check=False).returncode != 0:
        pytest.skip("NOT RUN: LinuxCNC is not installed here; `make interop` installs it where it can")


async def _first(host: Host) -> None:
    """Start the kernel; one that never came up on this computer cannot be had here, which is said."""
    try:
        await host.start()
    except (AssertionError, DeadlineExceeded) as error:
        if CAME_UP:
            raise
        pytest.skip(f"NOT RUN: LinuxCNC does not come up on this computer: {error}")
    CAME_UP.append(host.folder)


@contextlib.asynccontextmanager
async def running(folder: Path, files: Mapping[str, str] | None = None) -> AsyncIterator[Host]:
    """Kernel up and homed with these screw files (none: empty ones), agent up."""
    kernel_there()
    host = Host(folder, files or {})
    try:
        await _first(host)
        await host.person("home")
        await host.start_agent()
        yield host
        said = (folder / "agent.log").read_text() if (folder / "agent.log").exists() else ""
        assert "Traceback" not in said, said
    finally:
        if host._agent is not None:
            await host.kill_agent()
        await host.stop()
