"""What the service tells the system: ready, alive and stopping to systemd, and its own words to log and journal."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from drivers.clock import Clock
from drivers.local.scrub import without_secrets_text
from gateway.live import concern
from gateway.store.log_book import LogBook

# Tells the service manager how the daemon is: ready, alive, stopping; nothing where there is no manager.

LONGEST_STOP_US = 60_000_000


class Notifier:
    """The protocol of systemd: one datagram to the socket that the environment names."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        known = os.environ if environment is None else environment
        self._address = known.get("NOTIFY_SOCKET", "")
        every = known.get("WATCHDOG_USEC", "")
        mine = known.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.every_s = int(every) / 2e6 if every.isdigit() and mine and int(every) > 0 else 0.0

    def ready(self, words: str) -> None:
        """The page answers."""
        self._tell(f"READY=1\nSTATUS={words}\nMAINPID={os.getpid()}")

    def stopping(self) -> None:
        """The end has begun; a push at work may take its time to leave the machine in order."""
        self._tell(f"STOPPING=1\nEXTEND_TIMEOUT_USEC={LONGEST_STOP_US}")

    def alive(self) -> None:
        """The loop turns. What a push does, however long it waits for a person, holds this up never."""
        self._tell("WATCHDOG=1")

    def _tell(self, text: str) -> None:
        if not self._address or not hasattr(socket, "AF_UNIX"):
            return
        address = f"\0{self._address[1:]}" if self._address.startswith("@") else self._address
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as way:
            way.setblocking(False)
            way.sendto(text.encode("utf-8"), address)


async def keep_telling(notifier: Notifier, clock: Clock) -> None:
    """Tell the watchdog twice in its time that the loop turns, for ever; nothing where none is set."""
    while notifier.every_s > 0.0:
        notifier.alive()
        await clock.sleep(notifier.every_s)


# The service's own words into the log of its store and to the journal: one form for both, and no secret in either.

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
def log_into(book: LogBook) -> Iterator[None]:
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
