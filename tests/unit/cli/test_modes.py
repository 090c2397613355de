"""No mode of a command ignores an option: what it cannot use is a wrong option, by its name."""

from __future__ import annotations

from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from gateway.cli import app
from gateway.cli.command_list import COMMON_OPTIONS, OPTIONS_BY_MODE

ROOT = typer.main.get_command(app)
MODE = {"--run": ["--run", "r"], "--axis": ["--run", "r", "--axis", "X1"]}
"""What is typed for a mode; the others are their own words."""


def command_of(words: list[str]) -> Any:
    found: Any = ROOT
    for word in words:
        found = found.commands[word]
    return found


def value_of(one: Any) -> list[str]:
    """The option with a value that its type takes."""
    if getattr(one, "is_flag", False):
        return [one.opts[0]]
    return [one.opts[0], {"road": "opcua"}.get(one.name, "30")]


@pytest.mark.parametrize("mode", OPTIONS_BY_MODE)
def test_a_mode_refuses_by_name_whatever_it_does_not_take(mode: str) -> None:
    name, words = mode[: mode.index(" --")].split(), mode[mode.index("--") :].split()
    command = command_of(name)
    known = {one.name for one in command.params}
    assert set(OPTIONS_BY_MODE[mode]) <= known, "a mode takes what its command has"
    typed = [*name, *MODE.get(words[0] if words[0] != "--run" or name == ["correct"] else "", words)]
    typed += ["x.toml" for one in command.params if one.param_type_name == "argument" and one.required]
    others = [
        one
        for one in command.params
        if one.param_type_name == "option"
        and one.name not in (*OPTIONS_BY_MODE[mode], *COMMON_OPTIONS)
        and not one.hidden
    ]
    assert others or mode == "evaluate --kind positioning"
    for one in others:
        told = CliRunner().invoke(app, [*typed, *value_of(one)])
        if one.name == "site" and "--kind" in mode:  # of a kind of geometry: refused by a text that says why
            assert getattr(told.exception, "code", "") == "E-CLI-SITE-KIND"
            continue
        assert told.exit_code == 2, (one.opts, told.output)
        assert one.opts[0] in told.output, told.output


def test_what_a_mode_takes_and_what_nobody_typed_is_not_refused() -> None:
    told = CliRunner().invoke(app, ["docs", "schema", "--states"])
    assert told.exit_code == 0, told.output
    assert "ROLLING" in told.output.upper()


@pytest.mark.parametrize("words", ["--kind angular --angle pitch", "--kind harmonics --order 3", "--seed 3"])
def test_what_a_kind_takes_reaches_its_file(words: str) -> None:
    told = CliRunner().invoke(app, ["evaluate", *words.split(), "missing.csv"])
    assert "cannot use" not in told.output
    assert "missing.csv" in f"{told.output} {told.exception}"
