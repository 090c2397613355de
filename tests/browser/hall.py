"""A shipped cell and the service beside it, two processes joined by real wires, and a hand at the cell's panel."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import IO, Any

from gateway.config import load_site
from gateway.store import Store
from gateway.users import UserAccounts, first_token_path
from gateway.workflow.run.folder import store_of
from simulators.cellfile import load_cell
from tests.selftested import keep

GRACE_S = 20.0


def spoken(child: subprocess.Popen[str]) -> IO[str]:
    """What a child says, line by line."""
    assert child.stdout is not None
    return child.stdout


def ended(child: subprocess.Popen[str]) -> None:
    """No child of ours is left."""
    try:
        child.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


@dataclass
class Hall:
    """The cell, where there is one, where its service keeps things, and the service's address while it lives.

    ``speeds`` are the cell's machine seconds in one second while nothing is at work, and while a command is: a fast
    cell that samples for nobody, and a service that reads it, take both processors of a small computer.
    """

    cell: subprocess.Popen[str] | None
    path: Path
    service: subprocess.Popen[str] | None = None
    url: str = ""
    speeds: tuple[float, float] | None = None
    told: list[str] = field(default_factory=list)

    @property
    def store(self) -> Store:
        """The service's own folder, read as a file and not through it."""
        return store_of(load_site(self.path), self.path)

    @property
    def serial(self) -> str:
        """The machine's serial number, as the site has it."""
        return load_site(self.path).controller.serial

    @property
    def token(self) -> str:
        """What the service wrote for its first start."""
        return first_token_path(self.store.root).read_text(encoding="ascii").strip()

    def week_passes(self) -> None:
        """Accounts made today count as made eight days ago: their approvals count for who made them, too."""
        accounts = UserAccounts(self.store.root)
        for one in accounts.all():
            then = [(who, datetime.fromisoformat(when) - timedelta(days=8)) for who, when in one.keepers]
            accounts._change(replace(one, keepers=tuple((who, when.isoformat()) for who, when in then)))

    def do(self, order: str | dict[str, Any]) -> dict[str, Any]:
        """What a person does at the machine, or the judge's order; its answer."""
        assert self.cell is not None
        assert self.cell.stdin is not None
        self.cell.stdin.write((order if isinstance(order, str) else json.dumps(order)) + "\n")
        self.cell.stdin.flush()
        answer: dict[str, Any] = json.loads(spoken(self.cell).readline())
        assert "error" not in answer, answer
        return answer

    def hurry(self, *, on: bool) -> None:
        """A command is at work now, or none is; nothing where the cell keeps one speed."""
        if self.speeds is not None:
            self.do({"set": "speed", "value": self.speeds[on]})

    def serve(self) -> str:
        """Start the service; its address."""
        words = [sys.executable, "-m", "gateway.cli", "serve", str(self.path), "--port", "0"]
        with (self.path.parent / "serve.log").open("ab") as log:
            self.service = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=log, text=True)
        line = spoken(self.service).readline()
        self.url = next(word for word in line.split() if word.startswith("http"))
        return self.url

    def kill(self) -> None:
        """The service dies without a word."""
        if self.service is not None:
            self.service.kill()
            ended(self.service)
            spoken(self.service).close()
        self.service = None


@contextmanager
def hall(
    folder: Path,
    edit: Callable[[str], str],
    *,
    cell: str = "demo",
    speed: float = 100.0,
    idle: float | None = None,
    tested: bool = False,
    served: bool = True,
) -> Iterator[Hall]:
    """A cell and its service; ``edit`` changes the site file before the service reads it.

    Without ``served`` the service is the caller's to start. With ``idle`` the cell keeps that speed, but while a
    `Person` waits for a command.
    """
    path = folder / "hall" / "site.toml"
    path.parent.mkdir(parents=True)
    words = [sys.executable, "-m", "simulators.cell", cell, "--site", str(path), "--speed", str(speed)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        at = Hall(child, path)
        try:
            json.loads(spoken(child).readline())
            path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
            if tested:
                keep(path, load_cell(cell))
            if served:
                at.serve()
            if idle is not None:
                at.speeds = (idle, speed)
                at.hurry(on=False)
            yield at
        finally:
            if at.service is not None:
                at.service.terminate()
                ended(at.service)
                spoken(at.service).close()
            assert child.stdin is not None
            child.stdin.close()
            ended(child)
