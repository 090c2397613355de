"""Fixtures for all tests, and the hook that runs those that are `async def`."""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import inspect
import itertools
import os
import shutil
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from hypothesis import settings

from tests import attacks, spent
from tests.unit.drivers.loops import run_clean

# What a busy computer does to an example's time is no fault of the code.
settings.register_profile("trueflank", deadline=None)
settings.load_profile("trueflank")

MEMORY, ROOM_BYTES = Path("/dev/shm"), 4 << 30
RSA_PAIRS = 6
HERE = Path(__file__).parent


def _write_to_memory() -> None:
    """Let folders of tests lie in memory where there is room: the store waits for the disk at every record."""
    if MEMORY.is_dir() and os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > ROOM_BYTES:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))


_write_to_memory()


def _own_keys() -> None:
    """Keys that sign proposals and approvals lie in a folder of this process and its children, never at home."""
    place = tempfile.mkdtemp(prefix="trueflank-keys-")
    os.environ["TRUEFLANK_KEYS"] = place
    atexit.register(shutil.rmtree, place, ignore_errors=True)


_own_keys()


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option of `make slowest`."""
    parser.addoption("--slowest", action="store_true", help="print what the tests cost, by processor time")


def pytest_configure(config: pytest.Config) -> None:
    """Count where it is asked for."""
    if config.getoption("--slowest"):
        config.pluginmanager.register(spent.Spent(config), "trueflank-spent")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays until the end: the collector of garbage never looks at these million objects again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()
        gc.set_threshold(20_000, 10, 10)


@pytest.hookimpl(tryfirst=True)
def pytest_collectstart(collector: pytest.Collector) -> None:
    """Each worker imports its share of all test files first: by then the others have compiled theirs.

    Rewriting the asserts of all files takes twenty seconds of a processor, and every worker collects all of them. What
    fails here fails again, and is said, where the file is collected.
    """
    worker = getattr(collector.config, "workerinput", None)
    if worker is None or not isinstance(collector, pytest.Session) or collector.config.args != ["tests"]:
        return
    files = sorted(HERE.rglob("test_*.py"))
    for file in files[int(worker["workerid"].removeprefix("gw")) :: worker["workercount"]]:
        with contextlib.suppress(BaseException):
            importlib.import_module(".".join(file.relative_to(HERE.parent).with_suffix("").parts))


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an `async def` test in virtual time, or on a real loop where `wall_time` asks for it; it leaves no task."""
    test = pyfuncitem.obj
    if not inspect.iscoroutinefunction(test):
        return None
    given = {name: pyfuncitem.funcargs[name] for name in inspect.signature(test).parameters}
    run_clean(lambda: test(**given), virtual=pyfuncitem.get_closest_marker("wall_time") is None)
    return True


@pytest.fixture(autouse=True)
def count_attack(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test marked with a family and a road is one try of it, counted once it has been judged."""
    failed = request.session.testsfailed
    yield
    marker = request.node.get_closest_marker("attack")
    if marker is not None and marker.args:
        family, road = marker.args
        attacks.counted(family, road, 1, false_words=int(request.session.testsfailed > failed))


@pytest.fixture(scope="session", autouse=True)
def few_key_pairs() -> Iterator[None]:
    """Give out six RSA pairs in turn, and prove each but once.

    Finding primes, and proving those of a key that is read, take longer than all the rest of most connections.
    """
    generate, turns = rsa.generate_private_key, itertools.cycle(range(RSA_PAIRS))

    @functools.cache
    def pair(_turn: int, public_exponent: int, key_size: int) -> rsa.RSAPrivateKey:
        return generate(public_exponent, key_size)

    def next_pair(public_exponent: int, key_size: int) -> rsa.RSAPrivateKey:
        return pair(next(turns), public_exponent, key_size)

    read = functools.lru_cache(serialization.load_pem_private_key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rsa, "generate_private_key", next_pair)
        patch.setattr(serialization, "load_pem_private_key", read)
        yield


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where an OPC UA server keeps its key pair: made once for each file of tests, because some exchange it."""
    return tmp_path_factory.mktemp("server-keys")
