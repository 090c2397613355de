"""Run folders: stored once, hashed, found again, and one bad run never hides the others."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from drivers.types.identity import MachineIdentity
from drivers.types.sensing import Ambient
from gateway.errors import CorruptRecord, FutureSchema, StoreError
from gateway.store import Store, disk, records
from gateway.store import folder as layout
from gateway.store.folder import with_seal

MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "C1"))


def _store(root: Path) -> Store:
    moments = iter(datetime(2026, 11, 21, 10, tzinfo=UTC) + timedelta(seconds=s) for s in range(1000))
    return Store(root, lambda: next(moments))


def test_a_run_keeps_what_it_is_given(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("yk7350b", {"axes": ["X1"], "apply": False})
    first = folder.put("capture-X1-before", Ambient(20.0))
    second = folder.put("evaluation-X1-before", Ambient(21.0), parents=(first,))
    assert folder.get("capture-X1-before", Ambient) == Ambient(20.0)
    assert folder.digest("evaluation-X1-before") == second != first
    assert folder.parents("evaluation-X1-before") == (first,)
    assert folder.stages == ("capture-X1-before", "evaluation-X1-before")
    assert folder.plan == {"axes": ["X1"], "apply": False}
    kept = folder.path / "captures" / "capture-X1-before.json"
    assert records.sha256(kept.read_bytes()) == first


def test_run_ids_sort_by_time_and_name_the_site(tmp_path: Path) -> None:
    store = _store(tmp_path)
    ids = [store.create("Halle 3 / ö").run_id for _ in range(3)]
    assert ids == sorted(ids)
    assert all(run_id.isascii() and "Halle-3" in run_id for run_id in ids)


def test_storing_again_keeps_the_old_file(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("s")
    old = folder.put("verdict", Ambient(1.0))
    assert folder.put("verdict", Ambient(1.0)) == old
    folder.put("verdict", Ambient(2.0))
    folder.put("verdict", Ambient(3.0))
    assert folder.get("verdict", Ambient) == Ambient(3.0)
    files = [json.loads((folder.path / n).read_bytes()) for n in ("verdict.json", "verdict.2.json", "verdict.3.json")]
    assert [file["record"]["air_degc"] for file in files] == [1.0, 2.0, 3.0]
    assert folder.facts["stages"]["verdict"]["replaces"] == ["verdict.json", "verdict.2.json"]


def test_texts_and_arrays_come_back_exactly(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("s")
    path = folder.write_text("backup-X1.mpf", "N10 A\r\nN20 µ\n")
    assert path.read_bytes() == "N10 A\r\nN20 µ\n".encode()
    assert folder.read_text("backup-X1.mpf") == "N10 A\r\nN20 µ\n"
    array = np.array([[1.0, np.nan]])
    folder.write_array("raw-X1", array)
    assert np.array_equal(folder.read_array("raw-X1"), array, equal_nan=True)
    path.write_bytes(b"changed")
    with pytest.raises(CorruptRecord):
        folder.read_text("backup-X1.mpf")
    with pytest.raises(StoreError) as caught:
        folder.read_bytes("none.bin")
    assert caught.value.code == "E-STORE-FILE"


def test_state_machine_and_errors_are_noted(tmp_path: Path) -> None:
    store = _store(tmp_path)
    folder = store.create("s")
    folder.set_state("failed", error=StoreError("E-STORE-NAME", "x", name="y").as_record(), machine=MACHINE)
    summary = store.runs()[0]
    assert (summary.state, summary.machine, summary.site) == ("failed", "SN-1", "s")
    assert records.from_plain(folder.facts["errors"][0])["code"] == "E-STORE-NAME"


@pytest.mark.parametrize("byte", [0, 40, 100, -2])
def test_a_changed_stage_is_corrupt(tmp_path: Path, byte: int) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("capture", Ambient(20.0))
    path = folder.path / "capture.json"
    data = bytearray(path.read_bytes())
    data[byte] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(CorruptRecord) as caught:
        folder.get("capture", Ambient)
    assert caught.value.code == "E-STORE-HASH"


def test_unreadable_runs_never_break_the_list(tmp_path: Path) -> None:
    store = _store(tmp_path)
    folders = [store.create("s") for _ in range(4)]
    (folders[0].path / "run.json").write_bytes(b"{")
    text = (folders[1].path / "run.json").read_text()
    (folders[1].path / "run.json").write_text(text.replace('"created"', '"committed"'))
    facts = json.loads((folders[2].path / "run.json").read_text())
    (folders[2].path / "run.json").write_text(json.dumps({**facts, "schema": 99}))
    (tmp_path / "journal").mkdir()
    (tmp_path / "stray.txt").write_text("")
    runs = store.runs()
    assert [bool(run.problem) for run in runs] == [True, True, True, False]
    assert "E-STORE-FUTURE" in runs[2].problem
    ids = sorted((one.run_id for one in folders), reverse=True)
    assert (store.newest(3), store.newest(9, before=ids[1])) == (tuple(ids[:3]), tuple(ids[2:]))
    assert list(store.marks()) == ids[::-1]
    with pytest.raises(FutureSchema):
        store.open(folders[2].run_id)


def test_open_by_id_prefix_or_path(tmp_path: Path) -> None:
    store = _store(tmp_path)
    one, two = store.create("a"), store.create("b")
    assert store.open(one.run_id).path == one.path
    assert store.open(str(two.path)).path == two.path
    assert store.open(one.run_id[:19]).path == one.path
    assert store.open(Path("latest")).path == store.open("latest").path == two.path
    for wrong in ("2026", "nothing", ""):
        with pytest.raises(StoreError) as caught:
            store.open(wrong)
        assert caught.value.code == "E-STORE-RUN"


def test_an_unknown_stage_says_which_there_are(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("capture", Ambient())
    assert folder.has("capture")
    assert not folder.has("verdict")
    with pytest.raises(StoreError) as caught:
        folder.get("verdict", Ambient)
    assert caught.value.fields["known"] == "capture"


@pytest.mark.parametrize(
    "name", ["../x", "a/b", "a\\b", "", ".hidden", "CON", "nul.txt", "COM1.json", "x" * 200, "a:b", "a."]
)
def test_unsafe_names_are_refused(tmp_path: Path, name: str) -> None:
    folder = _store(tmp_path).create("s")
    with pytest.raises(StoreError) as caught:
        folder.write_text(name, "")
    assert caught.value.code == "E-STORE-NAME"
    with pytest.raises(StoreError):
        folder.put(name, Ambient())


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("capture", Ambient(1.0))

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError) as caught:
        folder.put("capture", Ambient(2.0))
    assert caught.value.code == "E-STORE-DISK"
    monkeypatch.undo()
    assert folder.get("capture", Ambient) == Ambient(1.0)
    assert not list(folder.path.glob(".*"))


def test_windows_passing_refusals_are_waited_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = os.replace, []

    def scanner(source: Path, target: Path) -> None:
        calls.append(source)
        if len(calls) < 4:
            error = OSError("held")
            error.winerror = 32
            raise error
        real(source, target)

    monkeypatch.setattr(os, "replace", scanner)
    monkeypatch.setattr(disk, "_PAUSE_S", 0.0)
    disk.write_whole(tmp_path / "a", b"data")
    assert (tmp_path / "a").read_bytes() == b"data"
    assert len(calls) == 4


def test_other_refusals_are_not_waited_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(_source: Path, _target: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", denied)
    with pytest.raises(StoreError):
        disk.write_whole(tmp_path / "a", b"data")
    assert list(tmp_path.iterdir()) == []


def test_killed_between_file_and_run_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("capture", Ambient(1.0))

    class Killed(BaseException):
        pass

    def kill(_facts: object) -> None:
        raise Killed

    monkeypatch.setattr(folder, "_write_facts", kill)
    with pytest.raises(Killed):
        folder.put("capture", Ambient(2.0))
    again = Store(tmp_path).open(folder.run_id)
    assert again.get("capture", Ambient) == Ambient(1.0)
    again.put("capture", Ambient(3.0))
    assert again.get("capture", Ambient) == Ambient(3.0)


def test_a_run_from_before_the_sub_folders_is_read_and_goes_on_as_it_was(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("capture-X1-before", Ambient(1.0))
    folder.write_text("sent-001-A.MPF", "N10")
    for path in [path for path in folder.path.rglob("*") if path.is_file()]:
        path.rename(folder.path / path.name)
    facts = {key: value for key, value in folder.facts.items() if key != layout.KEY}
    (folder.path / "run.json").write_bytes(with_seal(facts))
    assert folder.get("capture-X1-before", Ambient) == Ambient(1.0)
    assert folder.read_text("sent-001-A.MPF") == "N10"
    folder.put("capture-X1-before", Ambient(2.0))
    folder.write_array("raw-X1", np.zeros(2))
    assert (folder.path / "capture-X1-before.2.json").is_file()
    assert (folder.path / "raw-X1.npy").is_file()
    assert [one.name for one in folder.differences() if one.kind != "added"] == []


def test_every_file_of_a_run_lies_where_its_name_says(tmp_path: Path) -> None:
    folder = _store(tmp_path).create("s")
    folder.put("setup-EYX-X1", Ambient(1.0))
    folder.put("setup-EYX-X1", Ambient(2.0))
    for name in ("live-X1-000001.mpf", "sent-001-A.MPF", "site.toml", "index.html"):
        folder.write_text(name, "x")
    folder.write_array("raw-X1-before", np.zeros(2))
    found = {path.relative_to(folder.path).as_posix() for path in folder.path.rglob("*") if path.is_file()}
    assert found == {
        "run.json",
        "site.toml",
        "index.html",
        "setups/setup-EYX-X1.json",
        "setups/setup-EYX-X1.2.json",
        "tables/live-X1-000001.mpf",
        "protocol/sent-001-A.MPF",
        "raw/raw-X1-before.npy",
    }
    assert folder.differences() == ()
    assert folder.read_text("live-X1-000001.mpf") == "x"
