"""Which programs were sent to a machine, and what stood in its R parameters before: durable before they are sent.

A number found in the control later is recognised by this book. While a gateway has programs at work it holds a lock of
the operating system, which a killed process cannot leave behind: what is open and not held is left over.
"""

from __future__ import annotations

import json
import os
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from drivers.local.ownfiles import open_own, read_own
from drivers.stale_programs import Sent
from gateway.errors import BusyError, StoreError
from gateway.push.journal import hold_lock, is_lock_held, machine_folder

FILE = "sent.jsonl"
# Numbers are drawn anew for each program; older ones are not looked for.
NEWEST = 400
LONGEST_BYTES = 1 << 18


class SentProgramBook:
    """The book of one machine, below the journals of a store."""

    def __init__(self, journals: Path, serial: str) -> None:
        self._folder = machine_folder(journals, serial) / "sent"
        self._holding = ExitStack()
        self._mine: set[int] = set()

    def note(self, sent: Sent) -> None:
        """Keep a program, durable, before it is sent.

        Raises BusyError (E-SENT-BUSY) while another gateway has programs there, StoreError (E-PUSH-DISK).
        """
        if not self._mine:
            self._take()
        self._mine.add(sent.number)
        self._append(_program_facts(sent))

    def _take(self) -> None:
        self.close()
        try:
            self._holding.enter_context(hold_lock(self._folder))
        except BusyError as error:
            raise BusyError("E-SENT-BUSY", str(self._folder), holder=error.fields["holder"]) from error
        self._drop_oldest()

    def _drop_oldest(self) -> None:
        """Only the newest are looked for; the lock is held, so nobody else writes."""
        path = self._folder / FILE
        if not path.is_file() or path.stat().st_size <= LONGEST_BYTES:
            return
        known = self.known()
        fresh = path.with_suffix(".new")
        fresh.unlink(missing_ok=True)
        for sent in known:
            self._append(_program_facts(sent), fresh)
        self._append({"given_back": [sent.number for sent in known if not sent.open]}, fresh)
        os.replace(fresh, path)

    def given_back(self) -> None:
        """All that was noted here has ended and is given back. Raises StoreError (E-PUSH-DISK)."""
        if self._mine:
            self._append({"given_back": sorted(self._mine)})
        self.close()

    def close(self) -> None:
        """What is still open is nobody's work from now on."""
        self._mine.clear()
        self._holding.close()

    def at_work(self) -> bool:
        """Whether a living gateway, this one included, holds the machine's programs."""
        return bool(self._mine) or is_lock_held(self._folder)

    def known(self) -> tuple[Sent, ...]:
        """The newest programs noted, oldest first; lines torn by a crash are left out. Raises StoreError."""
        found: dict[int, Sent] = {}
        for line in self._lines():
            for number in line.get("given_back", ()):
                if number in found:
                    found[number] = replace(found[number], open=False)
            sent = _program_from(line)
            if sent is not None:
                found.pop(sent.number, None)
                found[sent.number] = sent
        return tuple(found.values())[-NEWEST:]

    def _lines(self) -> list[dict[str, Any]]:
        try:
            text = read_own(self._folder / FILE).decode("ascii", "replace")
        except FileNotFoundError:
            return []
        except OSError as error:
            raise StoreError("E-PUSH-DISK", str(self._folder), why=str(error)) from error
        return [line for line in map(_read_line, text.splitlines()) if line is not None]

    def _append(self, entry: dict[str, Any], path: Path | None = None) -> None:
        # A leading end of line keeps a line torn by a crash apart from this one.
        text = "\n" + json.dumps(entry, separators=(",", ":")) + "\n"
        try:
            with open_own(path or self._folder / FILE, "ab", buffering=0) as file:
                file.write(text.encode("ascii"))
                os.fsync(file.fileno())
        except OSError as error:
            raise StoreError("E-PUSH-DISK", str(self._folder), why=str(error)) from error


def _program_facts(sent: Sent) -> dict[str, Any]:
    return {name: value for name, value in asdict(sent).items() if name != "open"}


def _read_line(line: str) -> dict[str, Any] | None:
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def _program_from(line: dict[str, Any]) -> Sent | None:
    try:
        before = tuple(float(value) for value in line["before"])
        others = {int(number): float(value) for number, value in line["others"].items()}
        return Sent(int(line["number"]), str(line["program"]), first=int(line["first"]), before=before, others=others)
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
