"""Fixtures for all tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import attacks


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
