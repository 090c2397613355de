"""Reference for people and tools: the page of all commands, the meaning of a code, the schemas."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError, catalogue, explained, words
from drivers.message import Message
from drivers.terms import shown
from gateway.cli.command_list import CommandEntry, command_groups, load_command, require_only
from gateway.cli.options import JsonOption
from gateway.cli.output import echo, show_json

PAGE_HEAD = """# Commands

Every command of `trueflank` with its options. `trueflank docs commands` makes this page of the command line's own help;
a test compares the two. `--help` after a command shows the same in the terminal.
"""


def commands_command() -> None:
    """Print this page of all commands as Markdown."""
    echo(command_page().rstrip())


def command_page() -> str:
    """The page of the command line: groups in the order of the work, a section a command."""
    parts = []
    for group in command_groups():
        sections = (_section(words, command) for words, command in _all_commands(group["commands"], ()))
        source = f"<!-- source: {group['source']} -->\n\n" if "source" in group else ""
        parts.append(f"## {group['title']}\n\n{source}" + "\n".join(sections))
    return shown(PAGE_HEAD + "\n" + "\n".join(parts))


def _all_commands(
    entries: Mapping[str, CommandEntry], before: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, entry in entries.items():
        if "place" in entry:
            yield (*before, name), load_command(name, entry)
        yield from _all_commands(entry.get("inner", {}), (*before, name))


def _section(words: tuple[str, ...], command: Any) -> str:
    """Heading, usage, help, options as a table, and the examples of the help."""
    name = " ".join(("trueflank", *words))
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join(command.collect_usage_pieces(context)).replace("{", "").replace("}", "")
    rows = [one for one in (part.get_help_record(context) for part in command.params) if one]
    table = [f"| `{_plain(left)}` | {_cell(right)} |" for left, right in rows]
    text = _plain(inspect.cleandoc(command.help or ""))
    options = "\n".join(("| | |", "|---|---|", *table)) if table else ""
    inner = ", ".join(f"`{' '.join((*words, one))}`" for one in getattr(command, "commands", ()))
    parts = [f"### {' '.join(words)}", f"`{name} {usage}`", text, inner and f"Below it: {inner}.", options]
    if command.examples:
        parts.append("```\n" + "\n".join(command.examples) + "\n```")
    return "\n\n".join(part for part in parts if part) + "\n"


def _cell(text: str) -> str:
    return " ".join(_plain(text).split()).replace("|", "\\|")


def _plain(text: str) -> str:
    return text.replace("\b", "").strip()


# ---- explain

CodeArgument = Annotated[str, typer.Argument(help="A code as it is printed, such as E-INT-WARMTH.", show_default=False)]
EXPLAINED_PARTS = {"what": "it says", "do": words("S-REF-DO"), "how": words("S-REF-HOW"), "out": words("S-REF-OUT")}


def explain_command(code: CodeArgument, as_json: JsonOption = False) -> None:
    """Say what a code means, how it comes about and how to get out of it."""
    found = explanation(code.strip().upper())
    if as_json:
        show_json(found)
        return
    echo(found["code"], bold=True)
    for part, title in EXPLAINED_PARTS.items():
        if found.get(part):
            echo(f"{title}: {found[part]}")


def explanation(code: str) -> dict[str, str]:
    """``code`` with its texts: what, do and, for what people meet most, how and out.

    Raises ConfigError (E-CLI-CODE) with the codes that are spelt most alike.
    """
    known = catalogue()
    if code not in known:
        near = difflib.get_close_matches(code, known, n=3, cutoff=0.6)
        raise ConfigError("E-CLI-CODE", "command line", given=code, near=", ".join(near) or Message.of("W-REF-NONE"))
    return {"code": code, "what": words(code), "do": words(code, "do"), **explained(code)}


# ---- schema


def schema_command(
    as_page: Annotated[bool, typer.Option("--page", help="Print the reference page instead, in Markdown.")] = False,
    api: Annotated[bool, typer.Option("--api", help="Print the service's routes instead (OpenAPI).")] = False,
    states: Annotated[bool, typer.Option("--states", help="Print the states of a push instead, in Markdown.")] = False,
) -> None:
    """Print the site file's JSON schema, the settings of every driver among it."""
    if api:
        require_only("docs schema --api")
        from gateway.web.document import described

        show_json(described())
        return
    if states:
        require_only("docs schema --states")
        from gateway.push import transitions_in_markdown

        echo(transitions_in_markdown().rstrip())
        return
    from gateway.config import page
    from gateway.config import schema as site_schema

    if as_page:
        require_only("docs schema --page")
        echo(page().rstrip())
    else:
        show_json(site_schema())
