"""The list of commands: quick, in the order of the work, with words and examples that can be typed."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from drivers.errors import ConfigError
from drivers.languages import LANGUAGES
from gateway.cli import app, output
from gateway.cli.command_list import command_entries, command_groups, command_names, renamed_commands
from gateway.cli.output import Voice

REPOSITORY = Path(__file__).parents[3]
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
    assert {"init", "run", "push", "runs", "simulate", "doctor"} <= set(listed)


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
    words = " ".join(text.split())
    assert "Compensation tables: list, verify, lint, diff, convert" in words, "a group names what is in it"
    assert "also devices, certificate, identity, self-test, compare, accept" in words
    assert all(one["words"] in words for one in command_entries().values() if "--apply" in one["words"])
    assert len(text.splitlines()) < 90


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


MOST_AT_THE_TOP = 30


def test_the_top_level_has_at_most_thirty_commands() -> None:
    assert len(command_entries()) <= MOST_AT_THE_TOP


@pytest.mark.parametrize("name", [name for name, entry in command_entries().items() if "inner" in entry])
def test_the_help_of_a_group_shows_its_commands_and_the_options_of_its_default(name: str) -> None:
    entry = command_entries()[name]
    text = RUN.invoke(app, [name, "--help"]).stdout
    words = " ".join(text.split())
    assert all(f"{inner} {one['words'][:40]}" in words for inner, one in entry["inner"].items())
    assert text.index("Commands:") < text.index("Options:")
    assert ("--json" in text or "--yes" in text or "--seed" in text) == ("place" in entry)


def test_the_first_word_chooses_the_sub_command_and_a_path_the_default(tmp_path: Path) -> None:
    """`check programs` writes programs; a site file of that name is checked by its path, an option goes to `check`."""
    site = REPOSITORY / "examples" / "sites" / "files-only.toml"
    (tmp_path / "programs").write_bytes(site.read_bytes())
    assert RUN.invoke(app, ["check", str(tmp_path / "programs")]).exit_code == 0
    assert RUN.invoke(app, ["check", "--json", str(site)]).exit_code == 0
    inner = RUN.invoke(app, ["check", "programs", "--help"]).stdout
    assert " check programs [OPTIONS] {site}\n" in inner, "no argument of `check` stands before it"
    assert "-o, --output" in inner
    missing = RUN.invoke(app, ["check"])
    assert missing.exit_code == 2
    assert "site" in missing.output


@pytest.mark.parametrize(("old", "new"), renamed_commands().items())
def test_a_name_of_a_former_version_says_the_line_of_today(old: str, new: str) -> None:
    done = RUN.invoke(app, [*old.split(), "my site.toml", "--json"])
    assert isinstance(done.exception, ConfigError)
    assert (done.exception.code, done.exception.exit_code) == ("E-CLI-RENAMED", 2)
    names = [one for one in new.split() if not one.startswith("--")]
    options = [one for one in new.split() if one.startswith("--")]
    line = " ".join(("trueflank", *names, *options, "'my site.toml' --json"))
    assert line in done.exception.hint
    command, rest = command_of(names)
    assert rest == [], "it is a command of today"
    assert set(options) <= {one for part in command.params for one in part.opts}  # type: ignore[attr-defined]
    assert command is not ROOT


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_line_of_today_is_said_in_every_language(language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEFLANK_LANGUAGE", language)
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", "check", "hall.toml", "--connect"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "E-CLI-RENAMED" in done.stderr
    assert "trueflank doctor devices hall.toml" in done.stderr


def test_no_text_names_a_command_of_a_former_version() -> None:
    old = "|".join(re.escape(one) for one in renamed_commands() if " --" not in one and one != "tables")
    former = re.compile(rf"\btrueflank (?:({old})(?![\w-])|tables SITE|check \S+ --connect)")
    texts = [REPOSITORY / name for name in ("README.md", "SECURITY.md", "CHANGELOG.md")]
    for folder in ("docs", "drivers", "gateway", "simulators", "examples", "benchmarks", ".github"):
        texts += [
            one for one in (REPOSITORY / folder).rglob("*") if one.suffix in (".md", ".toml", ".py", ".js", ".yml")
        ]
    found = [f"{path.name}: {hit[0]}" for path in texts for hit in former.finditer(path.read_text(encoding="utf-8"))]
    assert len(texts) > 500
    assert found == []
