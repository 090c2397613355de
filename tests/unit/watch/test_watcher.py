"""The watch folder: whole files once, whatever happens to them; in virtual time, and with real files."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, FileFormatError, FileUnreadable
from gateway.cli import app
from gateway.errors import CorruptRecord, StoreError
from gateway.store import Store
from gateway.watch.watcher import Folder, SeenFile, Watcher, WatchJournal
from gateway.workflow.files.importing import import_file
from gateway.workflow.files.reading import ReadOptions

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
BASIC = (GOLDEN / "basic.rtl").read_bytes()
DATELESS = BASIC.replace(b"Date:2020", b"Date:")  # of no year: a site asks about what is old
SETTLE_S = 5.0


@dataclass
class Imagined:
    """A folder of byte strings; `denied` cannot be opened, `growing` change while they are read."""

    files: dict[str, bytes] = field(default_factory=dict)
    times: dict[str, int] = field(default_factory=dict)
    denied: set[str] = field(default_factory=set)
    growing: set[str] = field(default_factory=set)
    links: set[str] = field(default_factory=set)
    gone: bool = False

    def write(self, name: str, data: bytes) -> None:
        self.files[name] = data
        self.times[name] = self.times.get(name, 0) + 1

    def entries(self) -> tuple[SeenFile, ...]:
        if self.gone:
            raise ConfigError("E-WATCH-FOLDER", "folder", why="no such folder")
        return tuple(
            SeenFile(name, len(data), self.times[name], name not in self.links)
            for name, data in sorted(self.files.items())
        )

    def digest(self, seen: SeenFile) -> str:
        if seen.name in self.denied:
            raise FileUnreadable("E-FILE-READ", seen.name, why="permission denied")
        if seen.name in self.growing:
            return ""
        return hashlib.sha256(self.files[seen.name]).hexdigest()

    def path(self, name: str) -> Path:
        return Path(name)


class Desk:
    """A watcher with its imagined folder: what was taken and what was said."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = Imagined()
        self.taken: list[str] = []
        self.said: list[tuple[str, str]] = []
        self.error: Exception | None = None
        self.start()

    def start(self) -> None:
        self.watcher = Watcher(
            self.folder, WatchJournal(self.root), self._take, {".rtl", ".csv"}, settle_s=SETTLE_S, say=self._say
        )

    def _take(self, path: Path, sha256: str) -> str:
        if self.error is not None:
            raise self.error
        self.taken.append(path.name)
        return f"run-{sha256[:8]}"

    def _say(self, code: str, /, **fields: object) -> None:
        self.said.append((code, str(fields.get("name", ""))))

    def through(self, start_s: float, end_s: float) -> None:
        for second in range(int(start_s), int(end_s) + 1):
            self.watcher.look(float(second))

    def codes(self) -> list[str]:
        return [code for code, _name in self.said]


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def test_a_file_is_taken_once_it_stopped_growing_and_once_only(desk: Desk) -> None:
    for second in range(10):
        desk.folder.write("a.rtl", b"x" * second)
        desk.watcher.look(float(second))
    assert desk.taken == []
    assert desk.watcher.waiting == 1
    desk.through(10, 13)
    assert desk.taken == []
    desk.through(14, 100)
    assert desk.taken == ["a.rtl"]
    assert desk.codes() == ["P-WATCH-IMPORTED"]
    assert desk.watcher.waiting == 0


def test_same_size_and_a_new_time_is_a_change(desk: Desk) -> None:
    desk.folder.write("a.rtl", b"1")
    desk.through(0, 4)
    desk.folder.write("a.rtl", b"2")
    desk.through(5, 9)
    assert desk.taken == []
    desk.through(10, 11)
    assert desk.taken == ["a.rtl"]


def test_once_only_across_restarts_renames_and_copies(desk: Desk) -> None:
    desk.folder.write("a.rtl", b"1")
    desk.through(0, 10)
    desk.start()
    desk.through(20, 40)
    desk.folder.write("b.rtl", desk.folder.files.pop("a.rtl"))
    desk.folder.write("copy.csv", b"1")
    desk.through(41, 60)
    assert desk.taken == ["a.rtl"]
    assert ("P-WATCH-SAME", "b.rtl") in desk.said
    desk.folder.write("b.rtl", b"other content")
    desk.through(61, 80)
    assert desk.taken == ["a.rtl", "b.rtl"]


def test_an_unreadable_file_is_said_once_and_tried_until_it_can_be_read(desk: Desk) -> None:
    desk.folder.write("a.rtl", b"1")
    desk.folder.denied.add("a.rtl")
    desk.through(0, 50)
    assert desk.codes() == ["P-WATCH-FAILED"]
    assert desk.watcher.waiting == 1
    desk.folder.denied.clear()
    desk.through(51, 70)
    assert desk.taken == ["a.rtl"]


def test_a_wrong_content_is_said_once_even_after_a_restart_and_tried_again_when_it_changes(desk: Desk) -> None:
    desk.error = FileFormatError("E-FILE-CUT", "a.rtl", line=3)
    desk.folder.write("a.rtl", b"half")
    desk.through(0, 50)
    desk.start()
    desk.through(60, 90)
    assert desk.codes() == ["P-WATCH-FAILED"]
    desk.error = None
    desk.folder.write("a.rtl", b"half and the rest")
    desk.through(91, 100)
    assert desk.taken == ["a.rtl"]


def test_what_a_person_must_say_first_is_tried_again(desk: Desk) -> None:
    desk.error = ConfigError("E-FILE-RTA-UNIT", "a.rtl", largest="0.1")
    desk.folder.write("a.rtl", b"1")
    desk.through(0, 30)
    assert desk.codes() == ["P-WATCH-FAILED"]
    desk.error = None
    desk.through(31, 40)
    assert desk.taken == ["a.rtl"]


def test_a_full_disk_loses_nothing(desk: Desk) -> None:
    desk.error = StoreError("E-STORE-DISK", "store", why="no space left")
    desk.folder.write("a.rtl", b"1")
    desk.through(0, 20)
    desk.error = None
    desk.through(21, 40)
    assert desk.taken == ["a.rtl"]


def test_a_file_that_grows_while_it_is_read_is_waited_for(desk: Desk) -> None:
    desk.folder.write("a.rtl", b"1")
    desk.folder.growing.add("a.rtl")
    desk.through(0, 20)
    assert desk.taken == []
    assert desk.said == []
    desk.folder.growing.clear()
    desk.through(21, 30)
    assert desk.taken == ["a.rtl"]


def test_links_other_endings_and_hidden_files_are_left_alone(desk: Desk) -> None:
    for name in ("link.rtl", ".hidden.rtl", "~lock.csv", "note.doc", "a.rtl.part"):
        desk.folder.write(name, name.encode())
    desk.folder.links.add("link.rtl")
    desk.through(0, 30)
    assert desk.taken == []
    assert desk.said == [("P-WATCH-LINK", "link.rtl")]


def test_a_folder_that_is_gone_for_a_while_is_said_once(desk: Desk) -> None:
    desk.folder.gone = True
    desk.through(0, 20)
    assert desk.codes() == ["P-WATCH-FOLDER"]
    desk.folder.gone = False
    desk.folder.write("a.rtl", b"1")
    desk.through(21, 40)
    assert desk.taken == ["a.rtl"]


def test_names_are_shown_without_what_moves_the_cursor(desk: Desk) -> None:
    desk.folder.write("a\x1b[2J\n.rtl", b"1")
    desk.through(0, 20)
    assert desk.said == [("P-WATCH-IMPORTED", "a?[2J?.rtl")]


@settings(max_examples=60)
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 3), st.integers(1, 9), st.booleans()), max_size=12))
def test_whatever_happens_every_final_content_is_taken_exactly_once(
    tmp_path_factory: pytest.TempPathFactory, story: list[tuple[str, int, int, bool]]
) -> None:
    """Writes, removals (content 0), pauses and restarts in any order."""
    desk, now = Desk(tmp_path_factory.mktemp("w")), 0
    for name, content, pause, restart in story:
        if content:
            desk.folder.write(f"{name}.rtl", bytes([content]))
        else:
            desk.folder.files.pop(f"{name}.rtl", None)
        if restart:
            desk.start()
        desk.through(now + 1, now + pause)
        now += pause
    desk.through(now + 1, now + 2 * SETTLE_S + 2)
    digests = _known(desk.root)
    assert len(digests) == len(set(digests)) == len(desk.taken)
    assert {hashlib.sha256(data).hexdigest() for data in desk.folder.files.values()} <= set(digests)


def _known(root: Path) -> list[str]:
    path = root / "watch" / "journal.jsonl"
    return [json.loads(line)["sha256"] for line in path.read_text().splitlines()] if path.exists() else []


def test_a_torn_line_costs_one_import_and_a_damaged_one_is_told(tmp_path: Path) -> None:
    journal = WatchJournal(tmp_path)
    journal.note("a" * 64, "run-1", "a.rtl")
    path = tmp_path / "watch" / "journal.jsonl"
    with path.open("ab") as file:
        file.write(b'{"sha256": "bb')
    again = WatchJournal(tmp_path)
    assert again.outcome("a" * 64) == "run-1"
    again.note("c" * 64, "run-2", "c.rtl")
    third = WatchJournal(tmp_path)
    assert (third.outcome("a" * 64), third.outcome("c" * 64)) == ("run-1", "run-2")
    path.write_bytes(path.read_bytes().replace(b'"sha256"', b'"sha25"', 1))
    with pytest.raises(CorruptRecord):
        WatchJournal(tmp_path)


def test_watching_goes_on_until_it_is_told_to_stop_in_virtual_time(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.folder.write("a.rtl", b"1")

    async def main() -> float:
        clock, stop = LoopClock(), asyncio.Event()
        task = asyncio.create_task(desk.watcher.watch(clock, stop, 2.0))
        await clock.sleep(3600.0)
        stop.set()
        await task
        return clock.now()

    assert run_virtual(main) == pytest.approx(3600.0, abs=5.0)
    assert desk.taken == ["a.rtl"]


# --- real files


def real(tmp_path: Path, said: list[str]) -> tuple[Watcher, Path, Store]:
    folder, store = tmp_path / "in", Store(tmp_path / "runs")
    folder.mkdir(exist_ok=True)

    def take(path: Path, sha256: str) -> str:
        return import_file(path, store, ReadOptions(), None, expected=sha256)[0].run_id

    def say(code: str, /, **_fields: object) -> None:
        said.append(code)

    return Watcher(Folder(folder), WatchJournal(store.root), take, {".rtl"}, settle_s=1.0, say=say), folder, store


def test_real_files_become_runs_once_and_stay_as_they_are(tmp_path: Path) -> None:
    said: list[str] = []
    watcher, folder, store = real(tmp_path, said)
    (folder / "a.rtl").write_bytes(BASIC[:200])
    watcher.look(0.0)
    (folder / "a.rtl").write_bytes(BASIC)
    watcher.look(0.5)
    watcher.look(1.4)
    assert said == []
    watcher.look(1.6)
    (folder / "a.rtl").rename(folder / "b.rtl")
    again, _folder, _store = real(tmp_path, said)
    for now in (2.0, 3.0, 4.0):
        again.look(now)
    assert said == ["P-WATCH-IMPORTED", "P-WATCH-SAME"]
    assert [run.state for run in store.runs()] == ["imported"]
    assert (folder / "b.rtl").read_bytes() == BASIC
    assert store.open(store.runs()[0].run_id).read_bytes("source.rtl") == BASIC


def test_a_crash_between_import_and_journal_imports_nothing_twice(tmp_path: Path) -> None:
    said: list[str] = []
    watcher, folder, store = real(tmp_path, said)
    (folder / "a.rtl").write_bytes(BASIC)
    watcher.look(0.0)
    watcher.look(2.0)
    (store.root / "watch" / "journal.jsonl").unlink()
    again, _folder, _store = real(tmp_path, said)
    again.look(3.0)
    again.look(5.0)
    assert len(store.runs()) == 1


def test_fault_123_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    said: list[str] = []
    watcher, folder, store = real(tmp_path, said)
    (tmp_path / "secret.rtl").write_bytes(BASIC)
    (folder / "a.rtl").symlink_to(tmp_path / "secret.rtl")
    (folder / "folder.rtl").mkdir()
    os.mkfifo(folder / "pipe.rtl")
    for now in (0.0, 2.0, 4.0):
        watcher.look(now)
    assert said == ["P-WATCH-LINK"] * 3
    assert store.runs() == ()
    for name in ("../secret.rtl", "", "..", "a/b", "a\0b", "a\\b"):
        with pytest.raises(ConfigError, match="E-WATCH-NAME"):
            Folder(folder).path(name)


def test_a_file_swapped_for_a_link_after_it_was_listed_is_not_read(tmp_path: Path) -> None:
    _watcher, folder, _store = real(tmp_path, [])
    (folder / "a.rtl").write_bytes(BASIC)
    seen = Folder(folder).entries()[0]
    (folder / "a.rtl").rename(tmp_path / "moved.rtl")
    (folder / "a.rtl").symlink_to(tmp_path / "moved.rtl")
    with pytest.raises(FileUnreadable, match="E-FILE-READ"):
        Folder(folder).digest(seen)


def test_the_command_imports_what_lies_there_and_ends(tmp_path: Path) -> None:
    folder, site = tmp_path / "in", tmp_path / "site.toml"
    folder.mkdir()
    (folder / "a.rtl").write_bytes(DATELESS)
    (folder / "bad.rtl").write_bytes(BASIC[:100])
    site.write_text(
        '[site]\nname = "g1"\n[controller]\nurl = "opc.tcp://127.0.0.1:1"\nserial = "1"\n[[instruments]]\nname = "l"\n'
        'driver = "umd"\nurl = "tcp://127.0.0.1:1"\n[[axes]]\nname = "X1"\nletter = "X"\nkind = "linear"\n'
        'travel = [0.0, 10.0]\n[axes.measure]\ncomponent = "EXX"\ninstrument = "l"\nfeed = 1000.0\nstable = 1.0\n'
        "[axes.measure.targets]\nfirst = 0.0\nlast = 10.0\ncount = 5\n"
        "[axes.table]\nminimum = 0.0\nmaximum = 10.0\nstep = 1.0\n"
        '[machine]\ntype = "Example"\nnumber = "12"\n',
        encoding="utf-8",
    )
    words = ["import", "watch", str(site), "--folder", str(folder), "--settle", "0", "--once"]
    assert CliRunner().invoke(app, words).exit_code == 0
    runs = Store(tmp_path / "runs").runs()
    assert [run.state for run in runs] == ["imported"]
    assert runs[0].site == "g1"
