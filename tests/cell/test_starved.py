"""A run over real wires with one clock gives the same figures however little of the processor its processes get."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.cell.bench import short

pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(900),
    pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="a process is stopped for a moment"),
]
STALLS_S = (0.03, 0.2, 0.01, 0.08)
BETWEEN_S = 0.04


@contextlib.contextmanager
def starved(*processes: subprocess.Popen[str]) -> Iterator[None]:
    """Each in turn gets no processor for a moment, as beside eight busy ones, and costs none meanwhile."""
    over = threading.Event()

    def stall() -> None:
        for process, held_s in zip(itertools.cycle(processes), itertools.cycle(STALLS_S), strict=False):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGSTOP)
                over.wait(held_s)
                os.kill(process.pid, signal.SIGCONT)
            if over.wait(BETWEEN_S):
                return

    thread = threading.Thread(target=stall)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def measured(folder: Path, *, stalls: bool) -> dict[str, Any]:
    """The figures of C as a run found them, its cell and itself processes of their own."""
    folder.mkdir()
    site, pipe = folder / "site.toml", subprocess.PIPE
    words = [sys.executable, "-m", "simulators.cell", "demo", "--site", str(site), "--shared", "--speed", "0"]
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as cell:
        assert cell.stdout is not None
        assert cell.stdin is not None
        cell.stdout.readline()
        site.write_text(short(("C1",), 7, 3)(site.read_text(encoding="utf-8")), encoding="utf-8")
        command = [sys.executable, "-m", "gateway.cli", "run", str(site), "--json"]
        with (
            subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as gateway,
            starved(cell, gateway) if stalls else contextlib.nullcontext(),
        ):
            out, err = gateway.communicate()
        cell.stdin.close()
    assert gateway.returncode == 0, err
    found: dict[str, Any] = json.loads(out)["axes"]["C1"]["before"]
    return found


def test_stalls_of_cell_and_gateway_change_no_figure(tmp_path: Path) -> None:
    quiet = measured(tmp_path / "quiet", stalls=False)
    assert quiet["M"] > 0.0
    assert measured(tmp_path / "starved", stalls=True) == quiet
