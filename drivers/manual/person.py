"""Where a person is asked: on the terminal, or through a folder of small files that another program shows."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, TextIO

from drivers.clock import Clock
from drivers.errors import ConfigError, TransportError
from drivers.local.names import visible

POLL_S = 0.2


class TypingDesk(Protocol):
    """One person, asked one thing at a time."""

    async def ask(self, question: str) -> str:
        """The answer as typed; raises TransportError (E-LINK-CLOSED) when nobody can answer any more."""
        ...

    async def close(self) -> None:
        """Ask no more."""
        ...


class TerminalDesk:
    """Asks on a terminal; reading it waits in a thread of its own, which a closed terminal ends."""

    def __init__(self, where: str, reads: TextIO | None = None, writes: TextIO | None = None) -> None:
        self._where = where
        self._reads = reads or sys.stdin
        self._writes = writes or sys.stderr

    async def ask(self, question: str) -> str:
        """Print the question and wait for a line."""
        self._writes.write(f"{visible(question)} ")
        self._writes.flush()
        line = await asyncio.get_running_loop().run_in_executor(None, self._reads.readline)
        if not line:
            raise TransportError("E-LINK-CLOSED", self._where, why="the terminal is closed")
        return line

    async def close(self) -> None:
        """Nothing is held between questions."""


class FolderDesk:
    """Asks by ``question.txt`` and takes the answer from ``answer.txt``, which it then removes.

    An answer counts only if it ends with a line end, so one that is still being written is waited for.
    """

    def __init__(self, folder: Path, clock: Clock, where: str) -> None:
        self._question = folder / "question.txt"
        self._answer = folder / "answer.txt"
        self._clock = clock
        self._where = where
        if not folder.is_dir():
            raise ConfigError("E-MANUAL-FOLDER", where, folder=str(folder))

    async def ask(self, question: str) -> str:
        """Write the question, wait for the answer."""
        with _as_transport(self._where):
            self._answer.unlink(missing_ok=True)
            self._question.write_text(question + "\n", encoding="utf-8")
        while True:
            with _as_transport(self._where):
                text = self._answer.read_text(encoding="utf-8", errors="replace") if self._answer.exists() else ""
                if text.endswith("\n"):
                    self._answer.unlink()
                    self._question.unlink(missing_ok=True)
                    return text
            await self._clock.sleep(POLL_S)

    async def close(self) -> None:
        """Take the question back."""
        with contextlib.suppress(OSError):
            self._question.unlink(missing_ok=True)


@contextlib.contextmanager
def _as_transport(where: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise TransportError("E-LINK-CLOSED", where, why=str(error)) from error


class QueueDesk:
    """Asks inside this program: a page or a test puts the answers in."""

    def __init__(self) -> None:
        self.questions: asyncio.Queue[str] = asyncio.Queue()
        self.answers: asyncio.Queue[str] = asyncio.Queue()

    async def ask(self, question: str) -> str:
        """Hand the question out and wait for an answer."""
        self.questions.put_nowait(question)
        return await self.answers.get()

    async def close(self) -> None:
        """Nothing is held."""


DeskMaker = Callable[[str, Clock, str], TypingDesk]


def open_desk(url: str, clock: Clock, where: str) -> TypingDesk:
    """``terminal://`` or ``folder:///path``. Raises ConfigError (E-LINK-URL, E-MANUAL-FOLDER)."""
    scheme, mark, rest = url.partition("://")
    if mark and scheme == "terminal" and not rest:
        return TerminalDesk(where)
    if mark and scheme == "folder" and rest:
        return FolderDesk(Path(rest), clock, where)
    raise ConfigError("E-LINK-URL", url, why="typed readings come from terminal:// or folder:///path")
