"""The index in PostgreSQL: many gateways on one, killed and started again in the middle; run by `make services`."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import create_engine
from sqlalchemy.exc import SQLAlchemyError

from drivers.errors import TrueflankError
from gateway.index.database import RunIndex, catch_up, rebuild
from gateway.push.journal import JOURNALS
from gateway.store import Store
from tests.services.peers import lasting_port
from tests.unit.push.test_history import SERIAL, written
from tests.unit.service.test_index import measured

pytestmark = pytest.mark.services


def program(name: str) -> str:
    """A program of the server: by the path, or where Debian keeps it. Skips, visibly, where there is none."""
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    found = shutil.which(name) or (str(places[-1]) if places else "")
    if not found:
        pytest.skip("NOT RUN: no PostgreSQL server here (Debian package postgresql)")
    return found


class Server:
    """One PostgreSQL on loopback in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self._data = folder / "data"
        self._who = "postgres" if os.geteuid() == 0 else None  # it refuses to run as root
        if self._who is not None:
            owner = pwd.getpwnam(self._who)
            os.chown(folder, owner.pw_uid, owner.pw_gid)
        self.port = lasting_port()
        self._run(program("initdb"), "-D", str(self._data), "-U", "trueflank", "-A", "trust", "--no-sync")
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"postgresql+psycopg://trueflank@127.0.0.1:{self.port}/postgres"

    def _run(self, *words: str) -> None:
        subprocess.run(words, check=True, user=self._who, stdout=subprocess.DEVNULL, cwd="/")

    def start(self) -> None:
        words = [program("postgres"), "-D", str(self._data), "-p", str(self.port), "-k", str(self._data.parent)]
        words += ["-c", "listen_addresses=127.0.0.1", "-c", "fsync=off"]
        self._process = subprocess.Popen(words, user=self._who, stderr=subprocess.DEVNULL, cwd="/")
        engine = create_engine(self.url)
        while True:
            try:
                with engine.connect():
                    break
            except SQLAlchemyError:
                assert self._process.poll() is None
        engine.dispose()

    def kill(self) -> None:
        """As a power cut would: its own process group has no time for anything."""
        assert self._process is not None
        self._run("pg_ctl", "-D", str(self._data), "stop", "-m", "immediate", "-s")
        self._process.wait()


@pytest.fixture
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = Path("/tmp") / f"trueflank-pg-{os.getpid()}"
    folder.mkdir()
    made = Server(folder)
    made.start()
    yield made
    made.kill()
    shutil.rmtree(folder)


def test_gateways_that_begin_together_make_one_index_and_keep_their_runs_apart(server: Server, tmp_path: Path) -> None:
    stores = [Store(tmp_path / f"gateway-{number}") for number in range(6)]
    for store in stores:
        for _run in range(3):
            measured(store, "X1")
        written(store.root / JOURNALS, 1, 0.0, 1.0, serial=SERIAL)
    failed: list[Exception] = []

    def follow(store: Store) -> None:
        index = RunIndex(store.root, server.url)
        try:
            for _round in range(3):
                catch_up(index, store)
        except (TrueflankError, SQLAlchemyError) as error:
            failed.append(error)

    threads = [threading.Thread(target=follow, args=(store,)) for store in stores]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    index = RunIndex(stores[0].root, server.url)
    index.open()
    assert len(index.trend("E", subject="X1")) == 18
    assert [(one["serial"], one["name"], one["transaction"]) for one in index.tables()] == [(SERIAL, "X1", 1)] * 6
    assert len({one["gateway"] for one in index.tables()}) == 6
    assert rebuild(index, stores[0]) == 3
    assert len(index.search()) == 18
    assert len(index.tables()) == 6


def test_a_service_and_a_reindex_beside_it_are_in_nobodys_way(server: Server, tmp_path: Path) -> None:
    store = Store(tmp_path / "runs")
    for _run in range(6):
        measured(store, "X1")
    failed: list[Exception] = []

    def work(anew: bool) -> None:
        index = RunIndex(store.root, server.url)
        try:
            for _round in range(6):
                (rebuild if anew else catch_up)(index, store)
        except (TrueflankError, SQLAlchemyError) as error:
            failed.append(error)

    threads = [threading.Thread(target=work, args=(anew,)) for anew in (True, False, True, False)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    index = RunIndex(store.root, server.url)
    catch_up(index, store)
    assert len(index.search()) == len(index.trend("E", subject="X1")) == 6


def test_a_database_that_dies_in_the_middle_loses_nothing(server: Server, tmp_path: Path) -> None:
    store = Store(tmp_path / "runs")
    index = RunIndex(store.root, server.url)
    for _round in range(3):
        measured(store, "X1")
        catch_up(index, store)
        measured(store, "C1")
        server.kill()
        with pytest.raises(TrueflankError) as caught:
            catch_up(index, store)
        assert caught.value.code == "E-INDEX"
        server.start()
        catch_up(index, store)
        assert {one["run_id"] for one in index.search()} == {one.run_id for one in store.runs()}
