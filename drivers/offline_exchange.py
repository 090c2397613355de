"""What a control without a wire is asked for: files that a person carries there, runs, and brings back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable


class ToCarry(BaseException):
    """The work stands still until a person has been at the machine; it goes on from there when it is begun again.

    No failure, so that nothing takes it for one and leads a table back: it is no `Exception`. ``folder`` holds what is
    to be carried, ``back`` is where files come back to, ``sheet`` says what to run and what to bring, ``program`` is
    what must run; ``why`` is what was wrong with what came back ("": nothing came yet).
    """

    def __init__(self, folder: Path, back: Path, program: str, sheet: str, *, why: str = "") -> None:
        super().__init__(str(folder), program, why)
        self.folder = folder
        self.back = back
        self.program = program
        self.sheet = sheet
        self.why = why


@dataclass(frozen=True, slots=True)
class PieceOfWork:
    """What the files are carried for. ``name`` is the same each time it is begun again; "" for what is done in one go.

    ``start``: "fresh" refuses while other work waits for its files, "go-on" takes up what waits under its own name, or
    begins, "resume" takes it up and never begins, "instead" sets aside whatever waits. ``ends``: it ends with
    `ToCarry`; else it waits for the files.
    """

    name: str = ""
    start: Literal["fresh", "go-on", "resume", "instead"] = "fresh"
    ends: bool = False

    def refused(self, waits: str | None) -> str:
        """The code that speaks against it, "" for none, where ``waits`` waits for its files (None: nothing does)."""
        if waits is None:
            return "E-OFF-NOTHING" if self.start == "resume" else ""
        return "" if waits == self.name and self.start in ("go-on", "resume") else "E-OFF-BEGUN"


_IN_ONE_GO = PieceOfWork()
_work: ContextVar[PieceOfWork] = ContextVar("piece of work", default=_IN_ONE_GO)


@contextmanager
def exchange_files_for(work: PieceOfWork) -> Iterator[None]:
    """In the block this is what files are carried for."""
    before = _work.set(work)
    try:
        yield
    finally:
        _work.reset(before)


def at_work() -> PieceOfWork:
    """What files are carried for now."""
    return _work.get()


@runtime_checkable
class OfflineExchange(Protocol):
    """A controller that is reached by carrying files, for the piece of work of `carrying`."""

    @property
    def stick(self) -> Path:
        """The folder that holds what is carried and what came back."""
        ...

    def is_waited_for(self) -> bool:
        """Whether a piece of work waits for its files here."""
        ...

    def conclude(self) -> None:
        """The piece of work has come to its end: what was carried for it is set aside. Raises our errors."""
        ...
