"""What README and docs name exists: paths, modules, commands with their options, and targets of make; sentences end."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import typer

import trueflank as tf
from drivers.errors import catalogue
from gateway.cli import app
from release import reference

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
TOPS = "drivers|gateway|simulators|tests|docs|examples|benchmarks"
PATH = re.compile(rf"(?<![\w/.-])((?:{TOPS})(?:[./][\w-]+)+)(?:\.\w+)?")
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")
CODE = re.compile(r"```\w*\n(.*?)```|`([^`]+)`", re.DOTALL)
FENCE = re.compile(r"```.*?```", re.DOTALL)
LONGEST_SENTENCE = 29
# A name to fill in.
PLACEHOLDER = re.compile(r"[/.](NAME|ROOM|MAKER)\b")


def _text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def _exists(name: str) -> bool:
    """A path, a module, or a public name in a module."""
    if (ROOT / name).exists():
        return True
    place, _, attribute = name.replace(".", "/").rpartition("/")
    module = ROOT / (name.replace(".", "/") + ".py")
    holders = (ROOT / f"{place}.py", ROOT / place / "__init__.py")
    found = [holder for holder in holders if holder.exists()]
    return module.exists() or (ROOT / name.replace(".", "/")).exists() or any(attribute in _text(one) for one in found)


def test_every_path_and_module_that_is_named_exists() -> None:
    missing = []
    for page in PAGES:
        named = [match.group(0) for match in PATH.finditer(_text(page)) if not PLACEHOLDER.search(match.group(0))]
        missing += [f"{page.name}: {name}" for name in named if not (_exists(name) or (page.parent / name).exists())]
        links = LINK.findall(FENCE.sub("", _text(page)))
        missing += [f"{page.name}: {link}" for link in links if not (page.parent / link).exists()]
    assert missing == []


def _snippets(page: Path) -> Iterator[str]:
    """Pieces of code, one a line."""
    for block, span in CODE.findall(_text(page)):
        yield from (re.sub(r"\s*\n\s*", " ", span),) if span else block.splitlines()


def _calls(page: Path) -> Iterator[str]:
    """What follows `trueflank` in each command a page shows; a list of commands is parted at its bars."""
    listed = False
    for line in _snippets(page):
        name, _, rest = line.strip().removeprefix(".venv\\Scripts\\").partition(" ")
        listed = name == "trueflank" or (listed and line.startswith("  "))
        if listed:
            yield from (part.strip() for part in (rest if name == "trueflank" else line).split("#")[0].split(" | "))


@cache
def _commands() -> dict[str, click.Command]:
    """Every command by the words that call it, groups among them."""
    found: dict[str, click.Command] = {}

    def walk(command: click.Command, words: str) -> None:
        found[words] = command
        for name, inner in getattr(command, "commands", {}).items():
            walk(inner, f"{words} {name}".strip())

    walk(typer.main.get_command(app), "")
    return found


def _called(call: str) -> tuple[str, set[str]]:
    """The words of a command and its options, as a page shows them."""
    words = ""
    for word in call.split():
        if not re.fullmatch(r"[a-z][a-z-]*", word) or f"{words} {word}".strip() not in _commands():
            break
        words = f"{words} {word}".strip()
    return words, set(re.findall(r"(?<!\S)\[?(--[a-z][a-z-]*)", call))


def _wrong_with(call: str) -> list[str]:
    words, options = _called(call)
    known = {name for one in _commands()[words].params for name in (*one.opts, *one.secondary_opts)} | {"--help"}
    unknown = [f"no command in {call!r}"] if not words and call and not call.startswith(("-", "|")) else []
    return unknown + [f"{words}: no option {option}" for option in sorted(options - known)]


def test_every_command_and_option_that_is_shown_exists() -> None:
    calls = [(page.name, call) for page in PAGES for call in _calls(page)]
    wrong = [f"{name}: {what}" for name, call in calls for what in _wrong_with(call)]
    assert wrong == []
    assert len(calls) > 60


def test_every_page_stands_in_the_handbooks_list_and_every_entry_is_a_page() -> None:
    text = _text(ROOT / "mkdocs.yml")
    assert re.search(r"^nav:\n  - ", text, re.MULTILINE), "the list of pages is a key of its own, or no page is built"
    listed = re.findall(r": ([\w/-]+\.md)$", text, re.MULTILINE)
    generated = set(reference.GENERATED)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    decisions = {page for page in pages if re.match(r"decisions/\d", page)}
    index = set(re.findall(r"\]\((\d[\w-]+\.md)\)", _text(ROOT / "docs" / "decisions" / "index.md")))
    assert {f"decisions/{page}" for page in index} == decisions, "docs/decisions/index.md"
    assert set(listed) - generated == pages - decisions, "mkdocs.yml, nav"
    assert len(listed) == len(set(listed))


def test_pages_made_from_the_code_hold_every_name() -> None:
    routes, library = reference.routes(), reference.library()
    told = json.loads(_text(ROOT / "docs" / "openapi.json"))["paths"]
    assert [path for path, verbs in told.items() for verb in verbs if f"`{verb.upper()} {path}`" not in routes] == []
    source = _text(ROOT / "gateway" / "web" / "metrics.py")
    metrics = set(re.findall(r"\"(trueflank_\w+)\"", source))
    assert len(metrics) >= 12
    assert [name for name in metrics if f"`{name}" not in routes] == []
    assert [name for name in tf.__all__ if f"`tf.{name}" not in library] == []
    assert "#### `.relative_error(name: str" in library
    assert "| `curvature` | `FloatArray` |" in library
    assert "`tf.interferometer.length_mm(fringes: ArrayLike" in library
    assert "``" not in library.replace("```", "")
    records = reference.records()
    assert {"Capture", "Evaluation", "Proposal"} <= set(re.findall(r"^## (\w+)$", records, re.MULTILINE))
    codes = reference.codes()
    assert [code for code in catalogue() if code.startswith("E-") and f"`{code}`" not in codes] == []


def test_every_target_of_make_that_is_shown_exists() -> None:
    makefile = _text(ROOT / "Makefile")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    variables = set(re.findall(r"^([A-Z]+) \??:?=", makefile, flags=re.MULTILINE)) | {"PUSHES"}
    lines = [line.strip() for page in PAGES for line in _snippets(page) if line.strip().startswith("make ")]
    for line in lines:
        words = line.split("#")[0].split()[1:]
        assert set(words) & targets, line
        assert {word.partition("=")[0] for word in words if "=" in word} <= variables, line
    assert len(lines) > 5


def test_sentences_of_the_architecture_are_short() -> None:
    text = FENCE.sub("", _text(ROOT / "docs" / "architecture.md"))
    prose = [line for line in text.splitlines() if not line.startswith(("|", "#"))]
    paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:-|\d+\.) )", "\n".join(prose))
    sentences = [one for part in paragraphs for one in re.split(r"(?<=[.?!])\**\s+", part)]
    long = [f"{len(one.split())}: {one}" for one in sentences if len(one.split()) > LONGEST_SENTENCE]
    assert long == []
