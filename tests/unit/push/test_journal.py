"""The journal: durable lines in a chain; torn ends are dropped, broken middles are not believed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.errors import StoreError
from gateway.push import journal


def _written(folder: Path, count: int = 4) -> Path:
    book = journal.Journal.create(folder, 12)
    for number in range(count):
        book.append("STEP", number=number, text="a|b\nµ", value=0.1 + 0.2)
    book.close()
    return book.path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    found = journal.read(_written(tmp_path))
    assert found.number == 12
    assert found.kinds == ("STEP",) * 4
    assert found.entries[3].facts == {"number": 3, "text": "a|b\nµ", "value": 0.1 + 0.2}
    assert found.latest("number") == 3
    assert found.latest("none") is None
    assert not found.is_ended


def test_numbers_that_are_none_are_noted_as_text(tmp_path: Path) -> None:
    book = journal.Journal.create(tmp_path, 1)
    book.append("ODD", value=float("nan"), each=[1.0, float("-inf")], table={"deviations": (float("inf"),)})
    book.close()
    facts = journal.read(book.path).entries[0].facts
    assert facts == {"value": "nan", "each": [1.0, "-inf"], "table": {"deviations": ["inf"]}}


def test_torn_at_every_byte(tmp_path: Path) -> None:
    path = _written(tmp_path)
    data = path.read_bytes()
    ends = [index + 1 for index, byte in enumerate(data) if byte == 10]
    for size in range(len(data)):
        path.write_bytes(data[:size])
        found = journal.read(path)
        assert not found.broken
        assert len(found.entries) == sum(end <= size for end in ends)


def test_flipped_at_every_byte(tmp_path: Path) -> None:
    path = _written(tmp_path, 3)
    data = path.read_bytes()
    last = data[:-1].rfind(b"\n") + 1
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
        found = journal.read(path)
        assert not found.is_ended
        if place < last - 1:
            assert found.broken, place
        else:  # in the last line, or its border: torn, or a line end was made in the middle
            assert found.broken or len(found.entries) <= 2


def test_lines_cannot_be_dropped_swapped_or_taken_from_elsewhere(tmp_path: Path) -> None:
    path = _written(tmp_path)
    lines = path.read_bytes().splitlines(keepends=True)
    for wrong in (
        lines[1:],
        [lines[0], *lines[2:]],
        [lines[1], lines[0], *lines[2:]],
        [lines[0], lines[0], *lines[1:]],
    ):
        path.write_bytes(b"".join(wrong))
        assert journal.read(path).broken


def test_going_on_after_a_torn_end(tmp_path: Path) -> None:
    path = _written(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[:-20])
    book = journal.Journal.reopen(journal.read(path))
    book.append("CLOSED")
    book.close()
    found = journal.read(path)
    assert found.kinds == ("STEP", "STEP", "STEP", "CLOSED")
    assert found.is_ended


def test_empty_means_nothing_was_announced(tmp_path: Path) -> None:
    journal.Journal.create(tmp_path, 5).close()
    (found,) = journal.read_journals(tmp_path)
    assert found.is_ended
    assert found.entries == ()


def test_an_fsync_error_poisons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = journal.Journal.create(tmp_path, 5)
    book.append("FIRST")

    def broken(_descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", broken)
        with pytest.raises(StoreError):
            book.append("SECOND")
    with pytest.raises(StoreError) as caught:
        book.append("THIRD")
    assert caught.value.code == "E-PUSH-JOURNAL"
    book.close()


def test_numbers_go_up_and_survive_a_lost_counter(tmp_path: Path) -> None:
    folder = tmp_path / "SN-1"
    folder.mkdir()
    first = journal.allocate_number(folder, 1_763_000_123)
    assert 100_000_000 < first < 1_000_000_000
    assert journal.allocate_number(folder, 0) == first + 1
    journal.Journal.create(folder, first + 40).close()
    for damage in (b"", b"what", b"\xff", b"99999999999"):
        (folder / "number").write_bytes(damage)
        assert journal.allocate_number(folder, 0) > first + 40
    part = first // journal.PART_SIZE
    (folder / "number").write_text(str(part * journal.PART_SIZE + journal.MAX_COUNT))
    assert journal.allocate_number(folder, 0) == part * journal.PART_SIZE + 1


def test_two_stores_begun_in_the_same_second_give_no_number_twice(tmp_path: Path) -> None:
    given = []
    for name in ("one", "two", "three"):
        folder = tmp_path / name / "SN-1"
        folder.mkdir(parents=True)
        given.append({journal.allocate_number(folder, 1_763_000_123) for _ in range(20)})
        assert all(journal.is_own_number(folder, number) for number in given[-1])
        assert not journal.is_own_number(tmp_path / "nowhere" / "SN-1", min(given[-1]))
    assert len(set().union(*given)) == 60


def test_a_store_with_numbers_of_six_digits_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "SN-1"
    folder.mkdir()
    old = journal.Journal.create(folder, 523_456)
    old.append("COMMITTED")
    old.close()
    (folder / "number").write_text("523456")
    number = journal.allocate_number(folder, 0)
    journal.Journal.create(folder, number).close()
    assert [found.number for found in journal.read_journals(folder)] == [523_456, number]
    assert journal.is_known_number(folder, 523_456)
    assert not journal.is_own_number(folder, 523_456)


def test_an_emptied_journal_of_a_transaction_that_had_begun_is_not_finished(tmp_path: Path) -> None:
    path = _written(tmp_path)
    path.write_bytes(b"")
    assert journal.unfinished_journals(tmp_path) == ()
    (found,) = journal.unfinished_journals(tmp_path, lambda number: number == 12)
    assert not found.is_ended
    assert journal.set_ended_aside(tmp_path, lambda number: True) == ()
    assert path.exists()


def test_an_unfinished_journal_among_the_ended_ones_is_still_open(tmp_path: Path) -> None:
    journal.set_aside(_written(tmp_path))
    (found,) = journal.unfinished_journals(tmp_path)
    journal.set_aside(found.path)
    assert found.path.parent.name == "done"
    assert found.path.exists()


def test_machines_do_not_share_a_folder(tmp_path: Path) -> None:
    names = {journal.machine_folder(tmp_path, serial).name for serial in ("SN/1", "SN_1", "SN 1", "../x", "", "ö")}
    assert len(names) == 6
    assert all((tmp_path / name).parent == tmp_path for name in names)


def test_set_aside_keeps_the_journal(tmp_path: Path) -> None:
    path = _written(tmp_path)
    data = path.read_bytes()
    journal.set_aside(path)
    assert (tmp_path / "done" / path.name).read_bytes() == data
    assert journal.read_journals(tmp_path) == ()


def test_a_number_is_never_used_twice(tmp_path: Path) -> None:
    journal.Journal.create(tmp_path, 5).close()
    with pytest.raises(StoreError):
        journal.Journal.create(tmp_path, 5)
