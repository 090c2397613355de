"""The watch folder: new result files are noticed, waited for until they are whole, and handed on once."""

from __future__ import annotations

from gateway.watch.bounded_process import run_bounded
from gateway.watch.watcher import Folder, Watcher, WatchJournal

__all__ = ["Folder", "WatchJournal", "Watcher", "run_bounded"]
