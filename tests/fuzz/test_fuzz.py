"""A short search of every parser, the same each time; `make fuzz` searches for longer, from another seed each time."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator

import pytest

from drivers.errors import FileFormatError
from tests.fuzz.engine import Endless, search, tried
from tests.fuzz.engine import Search as Found
from tests.fuzz.targets import targets
from tests.sizes import long

NAMES = tuple(targets(recording=False))
QUICK = "bridge messages"
SLOW = {"OPC UA answers": 20, "site TOML": 5, "gear table": 2, "mka": 2, "840D tables": 4, "840D listing": 2}


@pytest.fixture
def quiet() -> Iterator[None]:
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("name", [name if name == QUICK else long(name) for name in NAMES])
def test_whatever_the_bytes_a_parser_reads_them_or_refuses_them(name: str, quiet: None) -> None:
    read, seeds = targets()[name]
    count = 600 // SLOW.get(name, 1)
    found = search(read, seeds, 1, lambda tried: tried < count)
    print(f"{found.tried} inputs, {len(found.ways)} ways, {len(found.kept)} kept")
    assert [(one.why, one.data) for one in found.findings] == []
    assert found.tried >= count
    assert len(found.kept) > len(seeds), "no input went a new way: nothing guided the search"


def test_the_search_finds_what_it_is_for() -> None:
    """Three letters in order, each of which opens a way: blind damage of a seed would need millions of tries."""

    def read(data: bytes) -> None:
        from drivers.local.textfile import parse_toml

        if data[:1] != b"e":
            raise FileFormatError("E-FILE-ROWS", "x")
        try:
            parse_toml(data.decode("ascii", "replace"))
        except ValueError:
            raise FileFormatError("E-FILE-ROWS", "x") from None
        if b"nan" not in data and b"1" in data:
            raise KeyError("found")

    found = search(read, [b"e = 'x'\n"], 3, lambda tried: tried < 3000)
    assert any("KeyError" in one.why for one in found.findings)


def test_a_reader_without_end_is_a_finding() -> None:
    from drivers.local import textfile

    def read(_data: bytes) -> None:
        while True:
            textfile.decode_utf8(b"x")

    found = Found()
    tried(read, b"x", found)
    (one,) = found.findings
    assert Endless.__name__ in one.why
    assert sys.gettrace() is None or sys.gettrace().__class__.__module__ != "tests.fuzz.engine"
