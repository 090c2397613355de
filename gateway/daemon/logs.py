"""The service's own words into the log of its store and to the journal: one form for both, and no secret in either."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from drivers.local.scrub import without_secrets_text
from gateway.live import concern
from gateway.store.logbook import LogBook

PRIORITIES = {"DEBUG": 7, "INFO": 6, "WARNING": 4, "ERROR": 3, "CRITICAL": 2}
OURS = "trueflank"


def text_of(record: logging.LogRecord) -> str:
    """What a record says, with the kind of its exception; secret values and users of addresses hidden."""
    found = record.getMessage()
    if record.exc_info and record.exc_info[1] is not None:
        found = f"{found}: {type(record.exc_info[1]).__name__}: {record.exc_info[1]}"
    return without_secrets_text(found)[:2000]


class JournalForm(logging.Formatter):
    """A line for the journal, which takes the level from its beginning; plain elsewhere."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self._journal = "JOURNAL_STREAM" in (os.environ if environment is None else environment)

    def format(self, record: logging.LogRecord) -> str:
        """Level, who says it, the run and the device it concerns, text; one line, whatever stands in it."""
        about = " ".join(filter(None, concern()))
        source = f"{record.name} [{about}]" if about else record.name
        head = f"<{PRIORITIES.get(record.levelname, 5)}>" if self._journal else ""
        return f"{head}{record.levelname} {source}: {text_of(record)}".replace("\n", "\\n")


class BookHandler(logging.Handler):
    """Keeps what the program says by `logging` in the log of a store."""

    def __init__(self, book: LogBook) -> None:
        super().__init__(logging.INFO)
        self._book = book

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one record; never raises."""
        source = record.name.removeprefix(f"{OURS}.")
        run, device = concern()
        told = {"source": source, "text": text_of(record)}
        self._book.add(record.levelname, "P-SERVICE-LOG", told, run=run, where=device)


@contextmanager
def logged_into(book: LogBook) -> Iterator[None]:
    """While the block lasts our own words, and warnings of libraries, are kept in this log."""
    handler = BookHandler(book)
    root, ours = logging.getLogger(), logging.getLogger(OURS)
    quiet = BookHandler(book)
    quiet.setLevel(logging.WARNING)
    quiet.addFilter(lambda record: not record.name.startswith(OURS))
    level = ours.level
    ours.setLevel(logging.INFO)
    root.addHandler(quiet)
    ours.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(quiet)
        ours.removeHandler(handler)
        ours.setLevel(level)
