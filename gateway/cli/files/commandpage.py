"""The command `commands`: every command with its options as a page in Markdown, made of the command line's own help."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from typing import Any

from drivers.terms import shown
from gateway.cli.lazily import Entry, loaded, order
from gateway.cli.show import echo

HEAD = """# Commands

Every command of `trueflank` with its options. This page is made of the command line's own help by `trueflank commands`;
a test compares the two. `--help` after a command shows the same in the terminal.
"""


def commands_command() -> None:
    """Print this page of all commands as Markdown."""
    echo(page().rstrip())


def page() -> str:
    """The page of the command line: groups in the order of the work, a section a command."""
    parts = []
    for group in order():
        sections = (_section(words, command) for words, command in _all(group["commands"], ()))
        source = f"<!-- source: {group['source']} -->\n\n" if "source" in group else ""
        parts.append(f"## {group['title']}\n\n{source}" + "\n".join(sections))
    return shown(HEAD + "\n" + "\n".join(parts))


def _all(entries: Mapping[str, Entry], before: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, entry in entries.items():
        if "inner" in entry:
            yield from _all(entry["inner"], (*before, name))
        else:
            yield (*before, name), loaded(name, entry)


def _section(words: tuple[str, ...], command: Any) -> str:
    """Heading, usage, help, options as a table, and the examples of the help."""
    name = " ".join(("trueflank", *words))
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join(command.collect_usage_pieces(context)).replace("{", "").replace("}", "")
    rows = [one for one in (part.get_help_record(context) for part in command.params) if one]
    table = [f"| `{_plain(left)}` | {_cell(right)} |" for left, right in rows]
    text = _plain(inspect.cleandoc(command.help or ""))
    options = "\n".join(("| | |", "|---|---|", *table)) if table else ""
    parts = [f"### {' '.join(words)}", f"`{name} {usage}`", text, options]
    if command.examples:
        parts.append("```\n" + "\n".join(command.examples) + "\n```")
    return "\n\n".join(part for part in parts if part) + "\n"


def _cell(text: str) -> str:
    return " ".join(_plain(text).split()).replace("|", "\\|")


def _plain(text: str) -> str:
    return text.replace("\b", "").strip()
