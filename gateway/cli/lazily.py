"""The commands as typer sees them: each is loaded when it is chosen, so that the list of all of them is quick."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command_from_info
from typer.models import CommandInfo

from drivers.errors import UnsupportedDevice
from gateway.cli import voice
from gateway.cli.modes import running
from gateway.cli.show import begun_with

Entry = Mapping[str, Any]
FIRST = ("trueflank demo", "trueflank init", "trueflank run --help")
WIDTH = {"max_content_width": 100}


@cache
def order() -> tuple[Entry, ...]:
    """Groups in the order of the work, each {"title", "commands": {name: {"place", "words", "examples"}}}."""
    data = tomllib.loads(Path(__file__).with_name("order.toml").read_text(encoding="utf-8"))
    return tuple(data["groups"])


def entries() -> dict[str, Entry]:
    """Every command of the first floor by its name, in the order of the work."""
    return {name: entry for group in order() for name, entry in group["commands"].items()}


class CommandTable(dict[str, Any]):
    """Commands by name; one that is asked for is loaded and kept."""

    def __init__(self, known: Mapping[str, Entry]) -> None:
        super().__init__(dict.fromkeys(known))
        self._known = known

    def __getitem__(self, name: str) -> Any:
        """The command. Raises KeyError."""
        if super().__getitem__(name) is None:
            self[name] = loaded(name, self._known[name])
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        """The command, or ``default`` where there is none of this name."""
        return self[name] if name in self else default  # noqa: SIM401 - `get` of a dict would not load it

    def items(self) -> Any:
        """Names with their commands, all of them loaded."""
        return [(name, self[name]) for name in self]


class OneCommand(TyperCommand):
    """A command whose help ends with its examples."""

    examples: tuple[str, ...] = ()

    def invoke(self, ctx: Any) -> Any:
        """The command, and from now on its texts know its site file.

        Where one fact of the machine is another than it was, a person is asked, and it begins again.
        """
        begun_with(ctx.params)
        with running(ctx):
            try:
                return super().invoke(ctx)
            except UnsupportedDevice as error:
                from gateway.cli.control.recognised import answered

                if not answered(error, ctx.params):
                    raise
            return super().invoke(ctx)

    def format_epilog(self, _ctx: Any, formatter: Any) -> None:
        """The examples, one a line as they are typed."""
        told(formatter, self.examples)


class CommandList(TyperGroup):
    """A group whose help lists its commands without loading one; the first floor's in groups."""

    examples: tuple[str, ...] = ()
    floor: tuple[Entry, ...] = ()

    def __init__(self, **asked: Any) -> None:
        super().__init__(**asked)
        if not self.commands:
            self.floor, self.examples = order(), FIRST
            self.commands = CommandTable(entries())
        self.no_args_is_help = True

    def list_commands(self, _ctx: Any) -> list[str]:
        """Names in the order of the work."""
        return list(self.commands)

    def format_commands(self, _ctx: Any, formatter: Any) -> None:
        """What each command is for."""
        for group in self.floor:
            with formatter.section(group["title"]):
                formatter.write_dl([(name, entry["words"]) for name, entry in group["commands"].items()])

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The commands first: they are what is looked for."""
        self.format_commands(ctx, formatter)
        rows = [record for one in self.get_params(ctx) if (record := one.get_help_record(ctx)) is not None]
        with formatter.section("Options"):
            formatter.write_dl(rows)

    def format_epilog(self, _ctx: Any, formatter: Any) -> None:
        """The examples, one a line as they are typed."""
        told(formatter, self.examples)


def told(formatter: Any, examples: tuple[str, ...]) -> None:
    """Examples below a help."""
    with formatter.section("Examples"):
        for one in examples:
            formatter.write(f"{'':{formatter.current_indent}}{one}\n")


def loaded(name: str, entry: Entry) -> Any:
    """A command or a group of commands, made of its entry."""
    if "inner" in entry:
        group = CommandList(
            name=name, commands=CommandTable(entry["inner"]), help=entry["words"], rich_markup_mode=None
        )
        group.floor = ({"title": "Commands", "commands": entry["inner"]},)
        group.examples = tuple(entry["examples"])
        return group
    module, _, function = entry["place"].partition(":")
    command = _made(name, getattr(import_module(module), function), entry["words"])
    command.examples = tuple(entry["examples"])
    command.params = [*command.params, *_voices()]
    return command


def _made(name: str, work: Callable[..., Any], words: str) -> Any:
    info = CommandInfo(name=name, cls=OneCommand, callback=work, help=words, context_settings=WIDTH)
    return get_command_from_info(info, pretty_exceptions_short=True, rich_markup_mode=None)


def _voices() -> list[Any]:
    """How much a command says: options that every command has."""

    def options(
        _quiet: Annotated[
            bool,
            typer.Option(
                "--quiet", "-q", help="Print essential messages only.", callback=voice.quiet, expose_value=False
            ),
        ] = False,
        _verbose: Annotated[
            bool,
            typer.Option(
                "--verbose", "-v", help="Print every step, as in the log.", callback=voice.verbose, expose_value=False
            ),
        ] = False,
    ) -> None: ...

    return list(_made("voices", options, "").params)


def names() -> Iterator[str]:
    """Every command as it is typed, groups left out."""
    for name, entry in entries().items():
        yield from (f"{name} {inner}" for inner in entry["inner"]) if "inner" in entry else (name,)
