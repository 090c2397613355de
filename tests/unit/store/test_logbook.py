"""The log of a store: whole lines, turned over by size, and nothing rests on it."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from gateway.store.log_book import KEPT, LogBook, LogTail, lines_of


def now() -> datetime:
    return datetime(2026, 11, 23, 8, 0, tzinfo=UTC)


def test_it_turns_over_and_keeps_the_newest(tmp_path: Path) -> None:
    book = LogBook(tmp_path, now, largest_bytes=2000)
    for number in range(200):
        book.add("INFO", "P-STOP", {"axis": "X1", "program": "P", "done": number, "total": 200}, run="r")
    files = sorted(path.name for path in (tmp_path / "logs").iterdir())
    assert len(files) == KEPT
    assert all(path.stat().st_size <= 2000 for path in (tmp_path / "logs").iterdir())
    numbers = [line["fields"]["done"] for line in lines_of(tmp_path)]
    assert numbers == list(range(numbers[0], 200))
    assert numbers[0] > 0


def test_what_a_crash_cut_short_is_left_out(tmp_path: Path) -> None:
    book = LogBook(tmp_path, now)
    book.add("INFO", "P-RUN", {"folder": "a"})
    with book.path.open("ab") as file:
        file.write(b'{"utc": "2026')
    assert [line["code"] for line in lines_of(tmp_path)] == ["P-RUN"]


def test_a_log_that_cannot_be_written_says_so_and_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("a file where the folder should be")
    book = LogBook(tmp_path, now)
    book.add("INFO", "P-RUN", {"folder": "a"})
    assert book.problem
    book.add("INFO", "P-RUN", {"folder": "b"})


def test_who_follows_gets_each_line_once_and_whole(tmp_path: Path) -> None:
    book = LogBook(tmp_path, now, largest_bytes=600)
    book.add("INFO", "P-RUN", {"folder": "before"})
    tail = LogTail(book.path)
    book.add("INFO", "P-RUN", {"folder": "one"})
    with book.path.open("ab") as file:
        file.write(b'{"code": "P-')
    assert [line["fields"]["folder"] for line in tail.new()] == ["one"]
    with book.path.open("ab") as file:
        file.write(b'HALF"}\n')
    assert [line["code"] for line in tail.new()] == ["P-HALF"]
    for number in range(4):
        book.add("INFO", "P-RUN", {"folder": str(number)})
    assert tail.new()[-1]["fields"]["folder"] == "3"
    assert tail.new() == []
