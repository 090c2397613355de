"""The list of commands: quick, in the order of the work, with words and examples that can be typed."""

from __future__ import annotations

import shlex
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from gateway.cli import app, output
from gateway.cli.command_list import command_entries, command_groups, command_names
from gateway.cli.output import Voice

RUN = CliRunner()
ROOT = typer.main.get_command(app)


def command_of(words: list[str]) -> tuple[object, list[str]]:
    """The command that some words name, and what is left of them."""
    found = ROOT
    while words and words[0] in getattr(found, "commands", {}):
        found, words = found.commands[words[0]], words[1:]
    return found, words


def test_every_command_stands_once_in_a_group_of_the_work() -> None:
    listed = [name for group in command_groups() for name in group["commands"]]
    assert listed == list(dict.fromkeys(listed)) == list(command_entries())
    assert command_groups()[0]["title"].startswith("Try")
    assert {"init", "run", "push", "runs", "logs", "cell"} <= set(listed)


@pytest.mark.parametrize("name", list(command_names()))
def test_every_help_ends_with_two_examples_that_can_be_typed(name: str) -> None:
    done = RUN.invoke(app, [*name.split(), "--help"])
    assert done.exit_code == 0
    shown = done.stdout.partition("Examples:")[2].split("\n")
    examples = [line.strip() for line in shown if line.strip()]
    assert len(examples) >= 2
    for line in examples:
        words = shlex.split(line)
        assert words[0] == "trueflank"
        command, rest = command_of(words[1:])
        assert command is command_of(name.split())[0]
        command.make_context(name, rest)  # type: ignore[attr-defined]


def test_the_list_of_commands_loads_none_of_them() -> None:
    code = (
        "import sys; from typer.testing import CliRunner; from gateway.cli import app; "
        "done = CliRunner().invoke(app, ['--help']); assert done.exit_code == 0, done.output; "
        "heavy = ('numpy', 'asyncio', 'pydantic', 'rich', 'gateway.config', 'gateway.cli.machine'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_first_help_shows_groups_commands_and_examples() -> None:
    text = RUN.invoke(app, ["--help"]).stdout
    assert all(group["title"] in text for group in command_groups())
    assert "trueflank init" in text.partition("Examples:")[2]
    assert "\x1b" not in text


def test_the_version_is_said() -> None:
    assert RUN.invoke(app, ["--version"]).stdout.startswith("trueflank ")


@pytest.mark.parametrize("words", [["rnu"], ["check", "--conect", "x.toml"], ["push"], ["runs", "lst"]])
def test_what_is_mistyped_ends_with_two(words: list[str]) -> None:
    assert RUN.invoke(app, words).exit_code == 2


def test_every_command_can_be_quiet_or_verbose() -> None:
    for name in command_names():
        options = {one for parameter in command_of(name.split())[0].params for one in parameter.opts}  # type: ignore[attr-defined]
        assert {"-q", "-v", "--quiet", "--verbose"} <= options, name


@pytest.mark.parametrize(
    ("words", "chosen"),
    [([], Voice.PLAIN), (["-q"], Voice.QUIET), (["-v"], Voice.VERBOSE), (["--verbose"], Voice.VERBOSE)],
)
def test_a_voice_is_chosen_before_the_commands_name_as_well_as_after(words: list[str], chosen: Voice) -> None:
    for typed in ([*words, "explain", "E-CFG-READ"], ["explain", "E-CFG-READ", *words]):
        assert RUN.invoke(app, typed).exit_code == 0
        assert output.chosen_voice() is chosen
    output.use_voice(Voice.PLAIN)
