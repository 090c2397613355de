"""The history of a table: what should be live now, and what a rollback would take back."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.types.tables import CompensationTable
from gateway.errors import StoreError
from gateway.push import journal
from gateway.push.compare import table_facts
from gateway.push.history import committed_pushes, newest_not_undone

SERIAL = "SN-1"


def table(value: float, axis: str = "X1") -> CompensationTable:
    return CompensationTable("axis", axis, axis, 0.0, 100.0, 50.0, (0.0, value, 0.0))


def written(
    root: Path, number: int, old: float, new: float, *, end: str = "COMMITTED", purpose: str = "table", **facts: object
) -> Path:
    """A journal as a push leaves it; the clock is not in the order of the numbers."""
    folder = journal.machine_folder(root, SERIAL)
    folder.mkdir(parents=True, exist_ok=True)
    book = journal.Journal.create(folder, number)
    axis = str(facts.pop("axis", "X1"))
    minute = facts.pop("minute", 59 - number % 60)
    tables = {"old": table_facts(table(old, axis)), "old_enabled": old != 0.0, "new": table_facts(table(new, axis))}
    book.append("LEASED", purpose=purpose, axis=axis, **tables, **facts)
    book.append("SNAPSHOT", path=f"live-{number}.mpf")
    book.append(end, utc=f"2026-11-21T10:{minute:02}:00+00:00")
    book.close()
    if end == "COMMITTED":
        journal.set_aside(book.path)
    return book.path


def test_nothing_was_ever_pushed(tmp_path: Path) -> None:
    assert committed_pushes(tmp_path, SERIAL, "X1") == ()
    assert newest_not_undone(()) is None


def test_only_committed_pushes_of_this_table_count_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    written(tmp_path, 2, 0.0, 1.0, minute=50)
    written(tmp_path, 5, 1.0, 2.0, minute=2)
    written(tmp_path, 6, 2.0, 9.0, end="ROLLED_BACK")
    written(tmp_path, 7, 2.0, 9.0, end="HELD")
    written(tmp_path, 8, 2.0, 9.0, purpose="sign-proof")
    written(tmp_path, 9, 0.0, 9.0, axis="C1")
    pushes = committed_pushes(tmp_path, SERIAL, "X1")
    assert [push.transaction for push in pushes] == [2, 5]
    assert [push.old.enabled for push in pushes] == [False, True]
    assert pushes[1].new.table == table(2.0)
    assert pushes[1].new.enabled
    assert pushes[1].backup == "live-5.mpf"
    undo = newest_not_undone(pushes)
    assert undo is not None
    assert undo.transaction == 5


def test_numbers_that_begin_again_are_in_order(tmp_path: Path) -> None:
    for number, old in ((999_998, 0.0), (999_999, 1.0), (1, 2.0), (2, 3.0)):
        written(tmp_path, number, old, old + 1.0)
    (journal.machine_folder(tmp_path, SERIAL) / "number").write_text("2")
    assert [push.transaction for push in committed_pushes(tmp_path, SERIAL, "X1")] == [999_998, 999_999, 1, 2]


def test_numbers_with_a_part_are_newer_than_those_without_and_the_newest_part_is_last(tmp_path: Path) -> None:
    last = 4_321 * journal.PART_SIZE + 2
    wrapped = 4_321 * journal.PART_SIZE + journal.MAX_COUNT
    for number in (523_456, 999_999, 9_000 * journal.PART_SIZE + 7, wrapped, last):
        written(tmp_path, number, 0.0, 1.0)
    (journal.machine_folder(tmp_path, SERIAL) / "number").write_text(str(last))
    given = [push.transaction for push in committed_pushes(tmp_path, SERIAL, "X1")]
    assert given == [523_456, 999_999, 9_000 * journal.PART_SIZE + 7, wrapped, last]


def test_what_was_taken_back_is_not_taken_back_again(tmp_path: Path) -> None:
    written(tmp_path, 1, 0.0, 1.0)
    written(tmp_path, 2, 1.0, 2.0)
    written(tmp_path, 3, 2.0, 1.0, purpose="restore", undoes=2, enable=True)
    pushes = committed_pushes(tmp_path, SERIAL, "X1")
    undo = newest_not_undone(pushes)
    assert undo is not None
    assert undo.transaction == 1
    written(tmp_path, 4, 1.0, 0.0, purpose="restore", undoes=1, enable=False)
    pushes = committed_pushes(tmp_path, SERIAL, "X1")
    assert newest_not_undone(pushes) is None
    assert not pushes[-1].new.enabled
    written(tmp_path, 5, 0.0, 3.0)
    again = newest_not_undone(committed_pushes(tmp_path, SERIAL, "X1"))
    assert again is not None
    assert again.transaction == 5


def test_a_journal_that_cannot_be_believed_is_told(tmp_path: Path) -> None:
    written(tmp_path, 1, 0.0, 1.0)
    path = journal.machine_folder(tmp_path, SERIAL) / "done" / "tx-000001.jnl"
    data = bytearray(path.read_bytes())
    data[30] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(StoreError) as caught:
        committed_pushes(tmp_path, SERIAL, "X1")
    assert caught.value.code == "E-PUSH-JOURNAL"
