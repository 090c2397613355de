"""Fixtures for all tests, and the hook that runs those that are `async def`."""

from __future__ import annotations

import gc
import inspect
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests import attacks, spent
from tests.unit.drivers.loops import run_clean

# What a busy computer does to an example's time is no fault of the code.
settings.register_profile("trueflank", deadline=None)
settings.load_profile("trueflank")


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


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where an OPC UA server keeps its key pair: made once for each file of tests, because some exchange it."""
    return tmp_path_factory.mktemp("server-keys")
