"""The index is a picture of the folders: rebuilt at will, never trusted over them."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from drivers.types import Ambient, MachineIdentity
from gateway.errors import StoreError
from gateway.store import Index, Store


def _filled(root: Path) -> Store:
    store = Store(root)
    for serial in ("SN-1", "SN-2"):
        folder = store.create("site")
        folder.put("capture", Ambient())
        folder.set_state("done", machine=MachineIdentity(serial, "v", ("X1",)))
    return store


def test_rebuilt_from_the_folders(tmp_path: Path) -> None:
    store = _filled(tmp_path)
    index = Index(store)
    assert index.rebuild() == 2
    assert index.list_runs() == store.runs()
    assert [run.machine for run in index.list_runs("SN-2")] == ["SN-2"]
    (store.runs()[0].path / "run.json").write_text("{")
    assert index.rebuild() == 2
    assert sum(bool(run.problem) for run in index.list_runs()) == 1
    index.close()


def test_update_of_one_run(tmp_path: Path) -> None:
    store = Store(tmp_path)
    index = Index(store)
    assert index.list_runs() == ()
    folder = store.create("site")
    index.update(folder)
    folder.put("verdict", Ambient())
    folder.set_state("done")
    index.update(folder)
    assert index.list_runs() == store.runs()
    index.close()


def test_a_broken_file_is_set_aside(tmp_path: Path) -> None:
    store = _filled(tmp_path)
    (tmp_path / "index.sqlite").write_bytes(b"this is no database at all" * 100)
    index = Index(store)
    assert index.rebuild() == 2
    assert (tmp_path / "index.broken-1.sqlite").read_bytes().startswith(b"this is no")
    index.close()


def test_journal_mode_and_durability(tmp_path: Path) -> None:
    index = Index(_filled(tmp_path))
    index.rebuild()
    connection = sqlite3.connect(tmp_path / "index.sqlite")
    try:
        assert connection.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
    finally:
        connection.close()
    with index._begin() as inside:
        assert inside.exec_driver_sql("PRAGMA synchronous").scalar() == 2
    index.close()


@pytest.mark.parametrize("url", ["nonsense", "sqlite:////nowhere/at/all/x.sqlite"])
def test_a_wrong_address_is_our_error(tmp_path: Path, url: str) -> None:
    with pytest.raises(StoreError) as caught:
        Index(Store(tmp_path), url).list_runs()
    assert caught.value.code == "E-STORE-INDEX"


def test_another_url(tmp_path: Path) -> None:
    store = _filled(tmp_path / "runs")
    index = Index(store, f"sqlite:///{tmp_path / 'plant.sqlite'}")
    assert index.rebuild() == 2
    assert not (tmp_path / "runs" / "index.sqlite").exists()
    index.close()
