"""Files of our own are never opened through a link, nor a pipe; new ones are private, or their shared folder's."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.local import ownfiles
from drivers.replay.recorder import TraceRecorder
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from gateway import audit
from gateway.approve import Approvals
from gateway.broker.state_folder import LOCK_FILE, TOKEN_FILE, hold_folder_lock, token_of, token_path
from gateway.domain.proposals import Approval
from gateway.errors import StoreError
from gateway.push import journal
from gateway.push.journal import hold_lock
from gateway.store import Store
from gateway.store.machine_books import ProofBook
from gateway.store.raw_stream import RawRecorder, StreamFacts
from gateway.views.runs import newest_runs, stored_report
from gateway.watch.watcher import WatchJournal as Watched

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links and rights are told so on POSIX only")
MACHINE = MachineIdentity("SN-1", "V4.8", ("X1",))
APPROVAL = Approval("ann", "p" * 64, "b" * 64, "SN-1", "2026-01-01T00:00:00+00:00", "2026-01-01T00:10:00+00:00")


def record(root: Path) -> None:
    class Clock(LoopClock):
        def now(self) -> float:
            return 0.0

        def utc(self) -> datetime:
            return datetime(2026, 1, 1, tzinfo=UTC)

    audit.record(root, "propose", clock=Clock(), actor="ann")


def with_lock(root: Path) -> None:
    with hold_lock(root / "audit"):
        pass


def with_daemon(root: Path) -> None:
    with hold_folder_lock(root):
        pass


def with_journal(root: Path) -> None:
    journal.Journal.create(root, 7).close()


# What opens a file, and the file that somebody put a link for.
OPENERS: list[tuple[str, Callable[[Path], object]]] = [
    ("audit/lock", with_lock),
    ("audit/head", record),
    ("audit/audit-000001.jsonl", record),
    (LOCK_FILE, with_daemon),
    (TOKEN_FILE, token_of),
    ("tx-000007.jnl", with_journal),
    ("number", lambda root: journal.allocate_number(root, 1)),
    ("watch/journal.jsonl", lambda root: Watched(root).note("0" * 64, "run", "f")),
    ("s.f64", lambda root: RawRecorder(root, "s", StreamFacts(1.0, "um"))),
]


@pytest.mark.parametrize(("name", "use"), OPENERS, ids=[case[0] for case in OPENERS])
@pytest.mark.parametrize("target", ["whole", "missing"])
def test_no_file_of_ours_is_a_link(tmp_path: Path, name: str, use: Callable[[Path], object], target: str) -> None:
    elsewhere, root = tmp_path / "elsewhere", tmp_path / "store"
    (root / name).parent.mkdir(parents=True)
    if target == "whole":
        elsewhere.write_bytes(b"12")
    (root / name).symlink_to(elsewhere)
    with pytest.raises(StoreError) as caught:
        use(root)
    assert target == "missing" or elsewhere.read_bytes() == b"12"
    assert elsewhere.exists() == (target == "whole")
    assert "link" in caught.value.what or target == "missing"


@pytest.mark.parametrize("name", ["audit", "proofs", "run/approvals"])
def test_no_folder_of_ours_is_a_link(tmp_path: Path, name: str) -> None:
    (tmp_path / "away").mkdir()
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).symlink_to(tmp_path / "away")
    use = {
        "audit": lambda: record(tmp_path),
        "proofs": lambda: ProofBook(tmp_path).save(SignProof(MACHINE, "cross", "X1", 1.0, 0.1, 1, "2026-01-01")),
        "run/approvals": lambda: Approvals(tmp_path / "run").keep(APPROVAL),
    }[name]
    if name == "proofs":
        (tmp_path / name).unlink()
        (tmp_path / name).mkdir()
        (tmp_path / name / "SN-1").symlink_to(tmp_path / "away")
    with pytest.raises(StoreError, match="link"):
        use()
    assert list((tmp_path / "away").iterdir()) == []


def test_an_approval_and_a_stage_behind_a_link_do_not_count(tmp_path: Path) -> None:
    folder = Store(tmp_path / "runs").create("s")
    Approvals(folder.path).keep(APPROVAL)
    folder.put("capture", Ambient(20.0))
    for path in (*(folder.path / "approvals").iterdir(), folder.path / "capture.json"):
        path.rename(tmp_path / path.name)
        path.symlink_to(tmp_path / path.name)
    with pytest.raises(StoreError, match="link"):
        Approvals(folder.path).read_unused()
    with pytest.raises(StoreError, match="link"):
        folder.get("capture", Ambient)


def test_a_pipe_in_a_files_place_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "lock")
    with pytest.raises(StoreError), hold_lock(tmp_path):
        pytest.fail("a pipe was locked")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="regular file"):
        ownfiles.read_own(tmp_path / "pipe")


def test_a_run_folder_that_is_a_link_is_none(tmp_path: Path) -> None:
    store, other = Store(tmp_path / "runs"), Store(tmp_path / "other")
    mine, theirs = store.create("mine"), other.create("theirs")
    theirs.write_text("report.html", "<p>theirs</p>")
    link = store.root / "20991231T000000000Z-link-0000"
    link.symlink_to(theirs.path)
    for word in (link.name, link.name[:12], str(link)):
        with pytest.raises(StoreError) as caught:
            store.open(word)
        assert caught.value.code == "E-STORE-LINK"
    listed = {run.run_id: run.problem for run in store.runs()}
    assert listed[mine.run_id] == ""
    assert "E-STORE-LINK" in listed[link.name]
    assert next(past.state for past in newest_runs(store)) == "unreadable"
    with pytest.raises(StoreError):
        stored_report(store, link.name)


# ---- rights ----------------------------------------------------------------------------------------


@pytest.fixture
def umask() -> Iterator[Callable[[int], None]]:
    before = os.umask(0o022)
    yield lambda mask: (os.umask(mask), None)[1]
    os.umask(before)


def filled(root: Path) -> Path:
    """A store in which every room has kept something."""
    store = Store(root)
    folder = store.create("s")
    folder.put("capture", Ambient(20.0))
    folder.write_text("site.toml", "x")
    Approvals(folder.path).keep(APPROVAL)
    ProofBook(root).save(SignProof(MACHINE, "cross", "X1", 1.0, 0.1, 1, "2026-01-01"))
    record(root)
    Watched(root).note("0" * 64, "run", "f")
    token_of(root)
    with hold_lock(root / "journal" / "SN-1"), hold_folder_lock(root):
        journal.allocate_number(root / "journal" / "SN-1", 1)
        with_journal(root / "journal" / "SN-1")
    TraceRecorder(folder.path / "traces", "laser", Told(), {}).close()
    return root


class Told(LoopClock):
    def utc(self) -> datetime:
        return datetime(2026, 1, 1, tzinfo=UTC)


def rights(root: Path) -> tuple[set[str], set[str]]:
    modes = [(path.is_dir(), oct(stat.S_IMODE(path.stat().st_mode)), path.name) for path in (root, *root.rglob("*"))]
    return ({mode for folder, mode, _ in modes if folder}, {mode for folder, mode, name in modes if not folder})


@pytest.mark.parametrize("mask", [0o022, 0o000])
def test_a_new_store_is_for_its_owner_alone(tmp_path: Path, umask: Callable[[int], None], mask: int) -> None:
    umask(mask)
    plain = tmp_path / "plain"
    plain.mkdir()
    plain.chmod(0o755)
    assert rights(filled(plain / "runs").parent / "runs") == ({"0o700"}, {"0o600"})
    assert stat.S_IMODE(plain.stat().st_mode) == 0o755


def test_a_store_shared_by_a_group_stays_so_and_secrets_stay_private(
    tmp_path: Path, umask: Callable[[int], None]
) -> None:
    umask(0o002)
    root = tmp_path / "runs"
    root.mkdir()
    root.chmod(0o2770)
    folders, files = rights(filled(root))
    assert folders == {"0o2770"}
    assert files == {"0o660", "0o600"}
    private = {path.name for path in root.rglob("*") if path.is_file() and not path.stat().st_mode & 0o060}
    assert private == {TOKEN_FILE}
    assert stat.S_IMODE(token_path(root).stat().st_mode) == 0o600


def test_a_folder_that_was_there_keeps_its_rights(tmp_path: Path, umask: Callable[[int], None]) -> None:
    umask(0o022)
    root = tmp_path / "runs"
    root.mkdir(mode=0o750)
    run = Store(root).create("s")
    assert rights(run.path) == ({"0o700"}, {"0o600"})
    assert stat.S_IMODE(root.stat().st_mode) == 0o750
