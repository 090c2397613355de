"""What an extra lacks is read from the installed metadata, and named before anything starts."""

from __future__ import annotations

from importlib import metadata

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError
from drivers.local import extras
from gateway.cli import app

ASKED = [
    "numpy>=2",
    "lark>=1.2; extra == 'sim'",
    'dask[distributed]>=2025.1; extra == "cluster"',
    "pytest>=8; extra == 'simple'",
]


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        if name in {"lark", "dask"}:
            raise metadata.PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(metadata, "requires", lambda _: ASKED)
    monkeypatch.setattr(metadata, "version", version)


def test_what_an_extra_lacks_is_named(without: None) -> None:
    assert extras.missing("sim") == ("lark",)
    assert extras.missing("cluster") == ("dask",)
    assert extras.missing("simple") == extras.missing("none") == ()
    with pytest.raises(ConfigError, match=r"lark.*trueflank\[sim\]") as told:
        extras.need("sim", "demo")
    assert told.value.code == "E-EXTRA-MISSING"


def test_a_source_that_is_not_installed_lacks_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(name: str) -> list[str]:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", unknown)
    assert extras.missing("sim") == ()


@pytest.mark.parametrize("words", [["simulate", "--list"], ["simulate", "demo"], ["demo"]])
def test_a_command_without_its_extra_starts_nothing(without: None, words: list[str], tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, SystemExit | ConfigError)
    assert "trueflank[sim]" in done.output + str(done.exception)
    assert list(tmp_path.iterdir()) == []
