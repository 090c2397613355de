"""Commands of README and docs: parsed by the real command line, run where they need no machine; pages are current."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from drivers.errors import catalogue
from gateway.cli import app
from gateway.cli.begin.checking import checked
from gateway.cli.files.commandpage import page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
ALONE = ("check", "commands", "convert", "diff", "evaluate", "explain", "lint", "schema", "init")
"""Commands that need neither a machine nor minutes of computing; `check` without --connect."""
VERDICTS = (13, 21)  # of `evaluate --limit`: beyond the limit, not decidable


def _blocks(page_text: str, kind: str) -> list[str]:
    return [text for word, text in BLOCK.findall(page_text) if word == kind]


def _calls() -> Iterator[tuple[str, list[str]]]:
    """Every line of a block that calls `trueflank`, with its page; the page of commands is made from the help."""
    for path in sorted({README, *DOCS.rglob("*.md")} - {DOCS / "commands.md"}):
        for block in _blocks(path.read_text(encoding="utf-8"), ""):
            for line in block.splitlines():
                call = line.strip().removeprefix(".venv\\Scripts\\")
                if call.startswith("trueflank "):
                    yield path.name, shlex.split(call, comments=True)[1:]


def _parsed(words: list[str]) -> None:
    """Parse as the command line would. Raises what it raises on an unknown command, option or value."""
    command, name = typer.main.get_command(app), "trueflank"
    while hasattr(command, "commands"):
        name, words = words[0], words[1:]
        command = command.commands[name]
    command.make_context(name, list(words))


def test_every_command_of_a_block_is_taken_by_the_command_line() -> None:
    calls = list(_calls())
    assert len(calls) > 20
    wrong = []
    for where, words in calls:
        try:
            _parsed(words)
        except Exception as error:  # noqa: BLE001 - whatever it is, the other commands are told too
            wrong.append(f"{where}: trueflank {' '.join(words)}: {error!r}")
    assert wrong == []


def test_what_the_command_line_does_not_know_is_found() -> None:
    for words in (["push", "latest", "--aply"], ["nothing"], ["study"]):
        with pytest.raises(BaseException):  # noqa: B017, PT011 - of the command line's own making
            _parsed(words)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place with the files that the README speaks of."""
    site = next(text for text in _blocks(README.read_text(encoding="utf-8"), "toml"))
    (tmp_path / "site.toml").write_text(site, encoding="utf-8")
    (tmp_path / "control.der").write_bytes(b"\x30\x82")
    golden = ROOT / "tests" / "golden" / "files"
    (tmp_path / "laser.rtl").write_bytes((golden / "basic.rtl").read_bytes())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRUEFLANK_PASSWORD", "x")
    return tmp_path


def test_the_site_file_of_the_readme_is_valid_and_short(folder: Path) -> None:
    found = checked(folder / "site.toml")
    assert [fault.error("site").what for fault in found.faults] == []
    assert len((folder / "site.toml").read_text(encoding="utf-8").splitlines()) <= 15


def test_every_command_of_the_readme_that_needs_no_machine_runs(folder: Path) -> None:
    ran = 0
    for where, words in _calls():
        if where != "README.md" or words[0] not in ALONE or "--connect" in words or words == ["init"]:
            continue
        if words[0] == "diff":
            (folder / words[2]).write_bytes((folder / words[1]).read_bytes())
        ended = CliRunner().invoke(app, words)
        assert ended.exit_code in (0, *VERDICTS), f"{words}: {ended.output}\n{ended.exception!r}"
        ran += 1
    assert ran >= 5


def test_the_page_of_commands_is_current() -> None:
    wanted = page().rstrip() + "\n"
    assert (DOCS / "commands.md").read_text(encoding="utf-8") == wanted, "run: trueflank commands > docs/commands.md"


def test_the_readme_names_every_command() -> None:
    names = {
        name for name, command in typer.main.get_command(app).commands.items() if not getattr(command, "hidden", False)
    }
    text = README.read_text(encoding="utf-8")
    assert sorted(name for name in names if f"`{name}`" not in text) == []


def test_every_term_of_the_glossary_is_used() -> None:
    lines = (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()
    terms = [found[1] for line in lines if (found := re.match(r"\| \*\*(.+?)\*\* \|", line))]
    assert len(terms) >= 60
    assert len(terms) == len(set(terms))
    pages = [path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md") if path.name != "glossary.md"]
    texts = [text for entry in catalogue().values() for text in entry.values()]
    everything = re.sub(r"\s+", " ", " ".join((*pages, README.read_text(encoding="utf-8"), *texts))).replace("*", "")
    unused = [term for term in terms if not re.search(rf"\b{re.escape(term)}", everything, re.IGNORECASE)]
    assert unused == []


def test_the_blocks_of_toml_can_be_read() -> None:
    blocks = [text for path in (README, *DOCS.glob("*.md")) for text in _blocks(path.read_text("utf-8"), "toml")]
    assert len(blocks) > 1
    assert all(tomllib.loads(text) for text in blocks)
