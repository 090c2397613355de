"""The log: what was recorded is found; every change of a bit, a line, a file or the end of it is found too."""

from __future__ import annotations

import json
import random
import threading
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import TrueflankError
from gateway import audit
from gateway.audit.chain import AUDIT, HEAD, audit_files, file_name
from gateway.audit.integrity import judge_log
from gateway.errors import CorruptRecord, StoreError
from tests.sizes import long
from tests.unit.audit.log import Moments, bulk, log_files


def _small(root: Path, count: int = 5) -> audit.ChainHead:
    clock, head = Moments(), audit.ChainHead()
    for number in range(count):
        head = audit.record(root, "approve", clock=clock, actor="ann", serial="SN-1", transaction=number)
    return head


def test_what_is_recorded_is_read_again(tmp_path: Path) -> None:
    clock = Moments()
    odd = {"why": 'a "quoted" \\ line\nµ', "share": float("nan"), "many": (1, 2), "on": True, "hash": "f" * 64}
    audit.record(tmp_path, "push-start", clock=clock, serial="SN-1", transaction=7, plan_hash="ab", details=odd)
    head = audit.correct(tmp_path, 1, "wrong machine", clock=clock, actor="bob")
    first, second = audit.read_entries(tmp_path)
    assert first["actor"] == audit.os_user()
    assert (first["seq"], first["transaction"], first["plan_hash"], first["serial"]) == (1, 7, "ab", "SN-1")
    assert first["details"] == {**odd, "share": "nan", "many": "(1, 2)"}
    assert first["utc"].startswith("2026-11-21T10:00")
    assert second["prev_hash"] == first["hash"]
    assert second["details"] == {"corrects": 1, "why": "wrong machine"}
    assert second["monotonic_s"] > first["monotonic_s"]
    assert audit.check_log(tmp_path).head == head == audit.ChainHead(2, second["hash"])
    assert audit.is_sound(tmp_path)


def test_an_empty_store_has_a_sound_empty_log(tmp_path: Path) -> None:
    assert audit.check_log(tmp_path) == audit.Health(audit.ChainHead())
    assert list(audit.read_entries(tmp_path)) == []


def test_the_user_is_the_processs_and_not_the_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.setenv(name, "somebody-else")
    assert audit.os_user() != "somebody-else"


def test_files_rotate_and_stay_one_chain(tmp_path: Path) -> None:
    clock = Moments()
    for number in range(12):
        entry = audit.AuditEntry(0, "t", clock.now(), 1, "0", audit.AuditEvent("a", "ann", transaction=number), "")
        head = audit.append(tmp_path, entry, rotate_bytes=1500)
    health = audit.check_log(tmp_path)
    assert health.sound
    assert health.head == head
    assert health.files > 2
    assert [entry["transaction"] for entry in audit.read_entries(tmp_path)] == list(range(12))


def test_every_single_bit_counts(tmp_path: Path) -> None:
    """Every bit of a small log of two files and of its head."""
    bulk(tmp_path, 4, per_file=2)
    parts = [(path.name, path.read_bytes()) for path in log_files(tmp_path)]
    flips = 0
    for number, (name, data) in enumerate(parts):
        for place in range(len(data) * 8):
            changed = bytearray(data)
            changed[place // 8] ^= 1 << place % 8
            *log, (_, head) = [*parts[:number], (name, bytes(changed)), *parts[number + 1 :]]
            assert not judge_log(head, log).sound, (name, place)
            flips += 1
    assert judge_log(parts[-1][1], parts[:-1]).sound
    assert flips > 10_000


@pytest.mark.parametrize("turns", [20, long(60), pytest.param(1500, marks=pytest.mark.soak)])
def test_changes_of_a_long_log_are_all_found(tmp_path: Path, turns: int) -> None:
    """10 000 records: bits, deletions, swaps and repetitions at seeded places."""
    bulk(tmp_path, 10_000, per_file=500)
    *parts, (_, head) = [(path.name, path.read_bytes()) for path in log_files(tmp_path)]
    assert judge_log(head, parts).head.seq == 10_000
    rng = random.Random(1)
    for turn in range(turns):
        number = rng.randrange(len(parts))
        name, data = parts[number]
        log = [*parts[:number], (name, _changed(data, turn, rng)), *parts[number + 1 :]]
        assert not judge_log(head, log).sound, turn


def _changed(data: bytes, turn: int, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    one, two = sorted(rng.sample(range(len(lines)), 2))
    if turn % 4 == 0:
        changed = bytearray(data)
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        return bytes(changed)
    if turn % 4 == 1:
        del lines[one:two]
    elif turn % 4 == 2:
        lines[one], lines[two] = lines[two], lines[one]
    else:
        lines.insert(two, lines[one])
    return b"".join(lines)


def test_a_lost_end_shows_by_the_kept_head(tmp_path: Path) -> None:
    bulk(tmp_path, 10, per_file=4)
    last = audit_files(tmp_path / AUDIT)[-1]
    data = last.read_bytes()
    *parts, (_, head) = [(path.name, path.read_bytes()) for path in log_files(tmp_path)]
    for cut in range(len(data)):
        assert not judge_log(head, [*parts[:-1], (last.name, data[:cut])]).sound, cut
    last.unlink()
    assert not audit.check_log(tmp_path).sound
    with pytest.raises(CorruptRecord) as caught:
        _small(tmp_path, 1)
    assert caught.value.code == "E-AUDIT-BROKEN"


def test_an_end_cut_together_with_its_head_shows_by_an_exported_head(tmp_path: Path) -> None:
    exported = _small(tmp_path, 6)
    later = _small(tmp_path, 2)
    by_hash = audit.parse_head(exported.hash)
    for heads in ((exported,), (by_hash,), (exported, later), (audit.parse_head(str(later)),)):
        assert audit.check_log(tmp_path, heads).sound
    path = audit_files(tmp_path / AUDIT)[0]
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:5]))
    kept = audit.ChainHead(5, json.loads(lines[4])["hash"])
    (tmp_path / AUDIT / HEAD).write_text(f"{kept}\n")
    assert audit.check_log(tmp_path).sound
    for head in (exported, by_hash, later):
        problem = audit.check_log(tmp_path, (head,)).problem
        assert problem is not None
        assert problem.code == "W-AUDIT-EXPORT"


def test_a_log_written_anew_shows_by_an_exported_head(tmp_path: Path) -> None:
    bulk(tmp_path / "one", 10, per_file=4)
    exported = audit.ChainHead(5, "0" * 63 + "1")
    problem = audit.check_log(tmp_path / "one", (exported,)).problem
    assert problem is not None
    assert problem.code == "W-AUDIT-EXPORT"
    assert "exported head" in problem.words


@pytest.mark.parametrize("gone", [1, 2])
def test_a_missing_file_shows(tmp_path: Path, gone: int) -> None:
    bulk(tmp_path, 10, per_file=4)
    (tmp_path / AUDIT / file_name(gone)).unlink()
    assert not audit.is_sound(tmp_path)


def test_a_missing_or_strange_head_shows(tmp_path: Path) -> None:
    _small(tmp_path)
    head = tmp_path / AUDIT / HEAD
    text = head.read_text()
    for wrong in ("", "5", text.strip(), text + "\n", text.partition(":")[2], "0:" + "0" * 64 + "\n" + text):
        head.write_text(wrong)
        assert not audit.is_sound(tmp_path), wrong
    head.unlink()
    assert not audit.is_sound(tmp_path)
    head.write_text(text)
    assert audit.is_sound(tmp_path)


def _torn(root: Path, keep: int) -> bytes:
    """As a crash in the middle of the last record leaves it: `head` was not written yet."""
    before = _small(root, 3)
    path = audit_files(root / AUDIT)[-1]
    whole = path.read_bytes()
    _small(root, 1)
    line = path.read_bytes()[len(whole) :]
    path.write_bytes(whole + line[:keep])
    (root / AUDIT / HEAD).write_text(f"{before}\n")
    return line[:keep]


@pytest.mark.parametrize("keep", [1, 40, -1])
def test_a_torn_end_stays_and_is_spoken_of_by_a_record(tmp_path: Path, keep: int) -> None:
    fragment = _torn(tmp_path, keep)
    assert audit.check_log(tmp_path).torn_bytes == len(fragment)
    assert audit.is_sound(tmp_path)
    head = _small(tmp_path, 1)
    found = list(audit.read_entries(tmp_path))
    assert [entry["action"] for entry in found] == ["approve"] * 3 + ["torn-line", "approve"]
    assert found[3]["details"]["bytes"] == len(fragment)
    assert audit.check_log(tmp_path) == audit.Health(head, 2)
    old = audit_files(tmp_path / AUDIT)[0]
    old.write_bytes(old.read_bytes()[:-1])
    problem = audit.check_log(tmp_path).problem
    assert problem is not None
    assert problem.code == "W-AUDIT-TORN"


def test_torn_again_while_speaking_of_a_torn_end(tmp_path: Path) -> None:
    fragment = _torn(tmp_path, 30)
    (tmp_path / AUDIT / file_name(2)).write_bytes(b'{"acti')
    (tmp_path / AUDIT / file_name(3)).write_bytes(b"")
    assert audit.is_sound(tmp_path)
    _small(tmp_path, 2)
    found = list(audit.read_entries(tmp_path))
    assert found[3]["details"]["bytes"] == len(fragment) + 6
    assert audit.check_log(tmp_path).head.seq == 6


def test_a_crash_between_record_and_head_is_nothing(tmp_path: Path) -> None:
    before = _small(tmp_path, 3)
    _small(tmp_path, 1)
    (tmp_path / AUDIT / HEAD).write_text(f"{before}\n")
    assert audit.is_sound(tmp_path)
    assert _small(tmp_path, 1).seq == 5
    assert audit.is_sound(tmp_path)


def test_the_first_record_torn(tmp_path: Path) -> None:
    (tmp_path / AUDIT).mkdir()
    (tmp_path / AUDIT / HEAD).write_text(f"{audit.ChainHead()}\n")
    (tmp_path / AUDIT / file_name(1)).write_bytes(b'{"action":"ap')
    assert audit.is_sound(tmp_path)
    assert _small(tmp_path, 1).seq == 2
    assert audit.is_sound(tmp_path)


def test_a_broken_log_stops_writes_and_no_reads(tmp_path: Path) -> None:
    bulk(tmp_path, 10, per_file=20)
    path = audit_files(tmp_path / AUDIT)[0]
    path.write_bytes(path.read_bytes().replace(b'"transaction":9', b'"transaction":8'))
    assert not audit.is_sound(tmp_path)
    with pytest.raises(CorruptRecord) as caught:
        audit.require_sound(tmp_path)
    assert caught.value.code == "E-AUDIT-BROKEN"
    assert "record 9" in str(caught.value)
    assert audit.note(tmp_path, "propose", clock=Moments()) == ""
    shown = list(audit.read_entries(tmp_path))
    assert [entry["damaged"] for entry in shown] == [False] * 8 + [True] + [False] * 2


def test_a_log_that_cannot_be_written_stops_a_push_and_no_proposal(tmp_path: Path) -> None:
    (tmp_path / AUDIT).write_text("a file in the way")
    clock = Moments()
    with pytest.raises(StoreError):
        audit.record(tmp_path, "push-start", clock=clock)
    assert "E-" in audit.note(tmp_path, "propose", clock=clock)
    assert not audit.is_sound(tmp_path)


def test_many_at_once_make_one_chain(tmp_path: Path) -> None:
    problems: list[Any] = []

    def work(name: str) -> None:
        clock = Moments()
        try:
            for number in range(10):
                audit.record(tmp_path, "approve", clock=clock, actor=name, transaction=number)
        except TrueflankError as error:
            problems.append(error)

    threads = [threading.Thread(target=work, args=(name,)) for name in ("ann", "bob", "eve")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems
    assert audit.check_log(tmp_path).head.seq == 30
    for name in ("ann", "bob", "eve"):
        own = [entry["transaction"] for entry in audit.read_entries(tmp_path) if entry["actor"] == name]
        assert own == list(range(10))


@pytest.mark.parametrize("text", ["", "x", "12", "5:" + "0" * 63, "5:" + "g" * 64, "A" * 64])
def test_what_is_no_head_is_refused(text: str) -> None:
    with pytest.raises(CorruptRecord) as caught:
        audit.parse_head(text)
    assert caught.value.code == "E-AUDIT-HEAD"
