"""The book of sent programs: durable before they are sent, known by number, at work only while somebody lives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.stale_programs import Sent
from gateway.errors import BusyError
from gateway.push import sent_programs as rooms
from gateway.push.sent_programs import FILE, SentProgramBook

FIRST = Sent(123456, "/_N_MPF_DIR/_N_TFMEAS_X1_MPF", 80, (0.0,) * 19 + (7.5,))
SECOND = replace(FIRST, number=654321, program="/_N_MPF_DIR/_N_TFPUSH_X1_MPF", others={77: 0.25})


def test_a_noted_program_is_known_to_the_next_gateway(tmp_path: Path) -> None:
    book = SentProgramBook(tmp_path, "S-1")
    book.note(FIRST)
    book.note(SECOND)
    later = SentProgramBook(tmp_path, "S-1")
    assert later.known() == (FIRST, SECOND)
    assert later.at_work()
    assert SentProgramBook(tmp_path, "S-2").known() == ()
    book.close()
    assert not later.at_work()
    assert [sent.open for sent in later.known()] == [True, True]


def test_what_is_given_back_is_closed_and_free(tmp_path: Path) -> None:
    book = SentProgramBook(tmp_path, "S-1")
    book.note(FIRST)
    book.given_back()
    assert [sent.open for sent in book.known()] == [False]
    assert not book.at_work()
    book.note(SECOND)
    assert [(sent.number, sent.open) for sent in book.known()] == [(123456, False), (654321, True)]
    book.close()


def test_two_gateways_do_not_send_to_one_machine(tmp_path: Path) -> None:
    mine, theirs = SentProgramBook(tmp_path, "S-1"), SentProgramBook(tmp_path, "S-1")
    mine.note(FIRST)
    with pytest.raises(BusyError) as caught:
        theirs.note(SECOND)
    assert caught.value.code == "E-SENT-BUSY"
    assert theirs.known() == (FIRST,)
    mine.close()
    theirs.note(SECOND)
    theirs.close()


def test_a_line_torn_by_a_crash_hides_no_other(tmp_path: Path) -> None:
    book = SentProgramBook(tmp_path, "S-1")
    book.note(FIRST)
    book.close()
    path = next(tmp_path.rglob(FILE))
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        book.note(SECOND)
        book.close()
        assert SECOND in book.known()
        assert all(sent in (FIRST, SECOND) for sent in book.known())


def test_a_long_book_keeps_its_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rooms, "LONGEST_BYTES", 2000)
    monkeypatch.setattr(rooms, "NEWEST", 5)
    book = SentProgramBook(tmp_path, "S-1")
    for number in range(30):
        book.note(replace(FIRST, number=100000 + number))
        book.given_back()
    book.note(SECOND)
    book.close()
    assert len(book.known()) == 5
    assert book.known()[-1] == SECOND
    assert not book.known()[0].open
    assert next(tmp_path.rglob(FILE)).stat().st_size < 5000
