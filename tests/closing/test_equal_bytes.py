"""Equal seeds give equal bytes: a run twice in virtual time, once beside busy processes, stores the same files."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import secrets
import socket
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

import simulators.cell
from drivers.clock import LoopClock, run_virtual
from gateway.config import load_site
from gateway.say import silence
from gateway.workflow.complete_run import close_site
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import load_cell, with_plan
from tests.closing.reckoned import BLOCK_S
from tests.selftested import cell_running

# One moment for both runs; today's, for the certificates of both ends are made by the wall's clock.
STARTED = datetime.now(UTC)
# The audit's chain holds the process' own number and seconds, which no record of a run does.
NOT_A_RUN = ("audit",)


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that never wait."""
    beside = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for one in beside:
            one.kill()
            one.wait()


def free_port() -> int:
    """A port that nobody listens on just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def proposal(folder: Path, port: int) -> None:
    """X measured live on the cell, every other set-up from files, up to the proposal for the tooth."""
    clock = LoopClock(started_utc=STARTED)
    file = with_plan(load_cell("demo"))
    machine = file.machine.model_copy(update={"opcua": {**file.machine.opcua, "port": port}})
    file = file.model_copy(update={"machine": machine})
    async with cell_running(file, folder, clock, wires="memory", block_s=BLOCK_S) as cell:
        path = write_site_of_files(cell, cell.site_path, {one.component for one in cell.file.setups} - {"EXX"})
        await close_site(load_site(path), path, apply=False, machine_name="", clock=clock, say=silence)


def stored(folder: Path) -> dict[str, str]:
    """Every file of the runs by its path, as a digest of its bytes; without `NOT_A_RUN`."""
    runs = folder / "runs"
    named = {path.relative_to(runs).as_posix(): path for path in sorted(runs.rglob("*")) if path.is_file()}
    wanted = {name: path for name, path in named.items() if not name.startswith(NOT_A_RUN)}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in wanted.items()}


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_equal_seeds_give_equal_bytes_beside_busy_processes_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the system draws for names of folders and numbers of programs is drawn once for both."""
    monkeypatch.setattr(secrets, "token_hex", lambda size=4: "ab" * size)
    monkeypatch.setattr(secrets, "randbelow", lambda _below: 7)
    monkeypatch.setattr(
        simulators.cell, "_numbers", itertools.repeat(1)
    )  # a cell's number is in the names of its wires
    site, port = tmp_path / "site", free_port()  # one path and one port for both: records name them
    run_virtual(lambda: proposal(site, port))
    quiet = stored(site)
    site.rename(tmp_path / "quiet")
    with busy(1):  # more of them would take the time of the tests beside this one
        run_virtual(lambda: proposal(site, port))
    assert any(name.endswith("tooth.json") for name in quiet)
    assert stored(site) == quiet
